"""The mirror's probability under one lamp on anisotropic materials: bundle, nodes and OSL, one mean and less noise."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
from measured_materials.addon.lights.light_tables import lamp_image, update_scene
from measured_materials.bake import xp_numpy
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, StoredImage, read_bundle, write_bundle
from measured_materials.bake.directions import normalize, spherical
from measured_materials.bake.envelope import ResidualSource, SlopeShareLayout, lamp_shares, part_of_light
from measured_materials.bake.errors import BakeError
from measured_materials.bake.images.image_io import write_image
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sampling.slope_cells import SlopeLayout
from measured_materials.bake.source import Array
from measured_materials.bake.sources import analytic
from measured_materials.bake.tables.accuracy import direction_pairs
from measured_materials.bake.tables.albedo import directional_albedo
from measured_materials.bake.tables.atlas import AtlasLayout
from measured_materials.bake.tables.grids.anisotropic_grids import AnisotropicHalfGrid
from measured_materials.bake.tables.table import tabulate
from measured_materials.bake.tables.treated_source import TreatedSource
from measured_materials.nodes.lamp_share_group import LampShares, lamp_probability
from measured_materials.nodes.material import build_material
from measured_materials.nodes.osl_material import build_osl_material
from measured_materials.nodes.osl_script import use_osl
from support.cards import card, data_image
from support.clean_blend import clean_blend  # noqa: F401
from support.monte_carlo import assert_agree, assert_same, compare
from support.osl import header_card, skip_without_osl
from support.scenes import TestScene, lit_sphere
from test_lamp_share import SCENES, darken, groups_of, probability_by_osl, tap, without_shares

SATIN = analytic.Ward(alpha=0.12, alpha_y=0.35, diffuse=(0.3, 0.1, 0.05), specular=0.4)
LAYOUTS = {
    "whole turn": SlopeShareLayout(SlopeLayout(8, 16, 16, 16, 0.1, 0.4)),
    "folded": SlopeShareLayout(SlopeLayout(8, 8, 16, 16, 0.4, 0.1, True)),
}
# --- the formula -----------------------------------------------------------------------------------------


def shading_points(count: int = 1500) -> tuple[Array, Array, Array, Array, Array]:
    """Positions, normals, viewers and tangents in the world, usual shares; float32."""
    rng = np.random.default_rng(4)
    position = rng.uniform(-0.3, 0.3, (count, 3))
    normal, incoming = (spherical(np.arccos(rng.uniform(-1, 1, count)), rng.uniform(0, 7, count)) for _ in range(2))
    incoming *= np.sign((normal * incoming).sum(-1, keepdims=True))
    # Not at right angles to the normal, as on a smooth mesh.
    tangent = normalize(np.cross(normal, rng.normal(size=(count, 3)))) + 0.3 * normal
    values = position, normal, incoming, tangent, rng.uniform(0.05, 0.6, count)
    return tuple(value.astype(np.float32) for value in values)  # type: ignore[return-value]


def local(points: tuple[Array, ...], directions: Array) -> Array:
    """World directions (P, 3) in the frame of normal and tangent."""
    normal, tangent = (normalize(points[k].astype(float)) for k in (1, 3))
    across = normalize(np.cross(normal, tangent))
    frame = np.stack([np.cross(across, normal), across, normal], 1)
    return np.einsum("pij,pj->pi", frame, directions)


def random_shares(layout: SlopeShareLayout) -> Array:
    """Harsher than any material's."""
    values = np.random.default_rng(2).uniform(0.02, 0.98, (*layout.size[::-1], 1))
    return np.repeat(values, 3, -1).astype(np.float32)


def assert_formula(found: Array, layout: SlopeShareLayout, table: Array, points: tuple[Array, ...]) -> None:
    """As numpy has it, but for viewers at the border of two slices, where float32 may read the other."""
    position, incoming, usual = (points[k].astype(float) for k in (0, 2, 4))
    to_centre = table[0, 0, :3].astype(float) - position
    wi, wo = (local(points, w) for w in (normalize(to_centre), incoming))
    sky, _, lamps, strength = table[0, 4].astype(float)
    seen, reflected, _ = tap(random_shares(layout), *layout.coordinates(xp_numpy, wi, wo)).T
    part = part_of_light(xp_numpy, to_centre, reflected, strength, lamps, sky)
    nudged = [layout.slopes.bin_of(xp_numpy, normalize(wo + d)) for d in 1e-4 * np.vstack([np.eye(3), -np.eye(3)])]
    # What shows from behind at a silhouette is held in front by the frame.
    inside = (np.ptp(nudged, 0) == 0) & (wo[:, 2] > 2e-3)
    off = np.abs(found - (usual + part * (seen - usual)))[inside]
    assert inside.mean() > 0.95
    # A slope in the tail, where neighbours differ by up to 1 in a 16th of it, has the digits of the half vector's z.
    assert np.median(off) < 1e-4 and np.quantile(off, 0.995) < 5e-3


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("kind", LAYOUTS)
def test_nodes_are_the_formula(kind: str, name: str) -> None:
    points, layout, table = shading_points(), LAYOUTS[kind], SCENES[name]
    shares = LampShares(data_image("shares", random_shares(layout)), layout)
    lamps = data_image("lamps", table)

    def probability(*values: object) -> object:
        position, normal, incoming, tangent, usual, wo = values
        return lamp_probability(shares, lamps, position, incoming, normal, wo, usual, tangent)

    (found,) = card(probability, *points, local(points, points[2].astype(float)).astype(np.float32))
    assert_formula(found, layout, table, points)


@pytest.mark.parametrize("name", ["two lamps", "sun"])
@pytest.mark.parametrize("kind", LAYOUTS)
def test_osl_is_the_formula(tmp_path: Path, kind: str, name: str) -> None:
    skip_without_osl()
    points, layout, table = shading_points(), LAYOUTS[kind], SCENES[name]
    file = tmp_path / "shares.exr"
    write_image(file, random_shares(layout), Storage.FLOAT32)
    body = "MMFrame frame = mm_tangent_frame(n, i, along);" + probability_by_osl(file, layout, table)
    inputs = dict(zip(("p", "n", "i", "along", "usual"), points))
    (found,) = header_card(body, {"y": "float"}, "measured_lamps.h", **inputs)
    assert_formula(found, layout, table, points)


# --- a bundle --------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def satin(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    """A lobe that ends where closures go on, so that half of its light is residual."""
    settings = BakeSettings(16, sampler=SamplerLayout(16, 16, 16), basis="half", viewers=(6, 3))
    out = tmp_path_factory.mktemp("satin") / "satin"
    return read_bundle(bake_source(SATIN, out, settings).path)


def test_the_bundle_holds_the_shares_of_its_parts(satin: Bundle) -> None:
    record = BrdfRecord.read(satin)
    layout = record.share_layout
    assert isinstance(layout, SlopeShareLayout) and isinstance(record.sampler, SlopeLayout)
    assert (layout.slopes.width_x, layout.slopes.folded) == (record.sampler.width_x, True)
    record.check_shares()
    expected = lamp_shares(record.load_envelope(), record.load_table("residual"), layout)
    image = satin.load("residual_share")
    assert image.shape == (128, 128, 3)
    # Closures of a bundle have their widths rounded, and tables their values.
    assert np.quantile(np.abs(image - expected)[..., 0], 0.99) < 0.01
    assert np.ptp(image[..., 0]) > 0.5


def test_the_residual_has_a_grid_of_its_own(satin: Bundle) -> None:
    """Of no more texels, for what has no reciprocity: E + R errs less, and loses less light at grazing."""
    record, source = BrdfRecord.read(satin), TreatedSource(SATIN)
    fit, grid = record.load_envelope(), record.stored("residual").grid
    assert isinstance(grid, AnisotropicHalfGrid) and not grid.folded and record.table.grid.facts()["folded"]
    assert np.prod(AtlasLayout.of(grid).size) <= np.prod(AtlasLayout.of(record.table.grid).size)
    left = ResidualSource(source, fit)
    residuals = [record.load_table("residual"), tabulate(left, record.table.grid)]
    pairs = direction_pairs(4096, turned=True)
    whole = source.evaluate(pairs.wi, pairs.wo)
    envelope = fit.evaluate(pairs.wi, pairs.wo)
    rms = [pairs.rms(envelope + residual.evaluate(pairs.wi, pairs.wo) - whole) for residual in residuals]
    assert rms[0] < 0.9 * rms[1]
    light, true, *found = (directional_albedo(f, np.radians(85.0), 24, 0.1) for f in (source, left, *residuals))
    off = [float(np.abs((value - true) / light).max()) for value in found]
    assert off[0] < off[1]


@pytest.mark.parametrize("change", ["one", "negative", "isotropic"])
def test_shares_that_would_lose_light_are_refused(satin: Bundle, tmp_path: Path, change: str) -> None:
    """Before a material is built of them; one that needs none is built."""
    image = satin.load("residual_share").copy()
    if change == "isotropic":
        image = image[:16]
    else:
        image[3, 5] = {"one": (1, 1, 0), "negative": (0.5, -1, 0)}[change]
    images = {
        name: StoredImage(satin.load(name), Storage(satin.material["images"][name]["storage"]))
        for name in satin.material["images"]
    }
    shares = {"residual_share": StoredImage(image, Storage.FLOAT32)}
    spoiled = read_bundle(write_bundle(tmp_path / "spoiled", satin.material, images | shares))
    with pytest.raises(BakeError, match="bake it again"):
        build_material(spoiled, mode="exact", lamps=lamp_image(), lamp_share=True)
    build_material(spoiled, mode="exact", lamps=lamp_image())


# --- pictures --------------------------------------------------------------------------------------------


def under_a_lamp(material: bpy.types.Material, ground: bool) -> TestScene:
    """A sphere in the light of one small lamp, and on demand of what matte ground sends back."""
    scene = lit_sphere(material, 64, lamp_size=0.2, ground=ground, resolution=32)
    darken(scene)
    return scene


def shown(scene: TestScene, material: bpy.types.Material, samples: int, seeds: range) -> Array:
    scene.show(material)
    update_scene(scene.scene)
    return scene.render(samples, seeds)


def relative_variance(pictures: Array, mask: Array) -> float:
    """Of a pixel's value, over its brightness squared: the median of what is lit."""
    seen = pictures[:, mask].astype(float)
    mean = seen.mean((0, 2))
    lit = mean > 0.05 * mean.mean()
    return float(np.median(seen.var(0, ddof=1).mean(-1)[lit] / mean[lit] ** 2))


def by_shares(satin: Bundle, folder: Path, ground: bool, samples: int) -> tuple[list[Array], Array]:
    """Pictures of a bundle as an older version baked it, which still is a material, and of this one; and their mask."""
    pictures = []
    with under_a_lamp(build_material(satin, mode="preview"), ground) as scene:
        for k, bundle in enumerate((without_shares(satin, folder), satin)):
            material = build_material(bundle, mode="exact", lamps=lamp_image(), lamp_share=True)
            assert any(t.name.startswith("MM Mirror Probability") for t in groups_of(material)) == (bundle is satin)
            pictures.append(shown(scene, material, samples, range(100 * k, 100 * k + 12)))
        return pictures, scene.mask()


def test_one_picture(satin: Bundle, tmp_path: Path) -> None:
    pictures, mask = by_shares(satin, tmp_path, True, 72)
    assert_same(*pictures, mask, 1e-3, 0.02)


def test_less_noise(satin: Bundle, tmp_path: Path) -> None:
    pictures, mask = by_shares(satin, tmp_path, False, 24)
    variances = [relative_variance(found, mask) for found in pictures]
    # Seen 0.55; of 12 pictures' variances the median of some 400 pixels is good to 4 %.
    assert variances[1] < 0.7 * variances[0], variances


@pytest.mark.slow
def test_osl_is_the_same_picture(satin: Bundle) -> None:
    """As bright, and as little noise: without the shares it would have more."""
    skip_without_osl()
    pictures = []
    for osl in (False, True):
        if osl:
            material = build_osl_material(satin, mode="exact", lamps=lamp_image())
        else:
            material = build_material(satin, mode="exact", lamps=lamp_image(), lamp_share=True)
        with under_a_lamp(material, ground=False) as scene:
            if osl:
                use_osl(scene.scene)
            pictures.append(shown(scene, material, 48, range(100 * osl, 100 * osl + 12)))
            mask = scene.mask()
    variances = [relative_variance(found, mask) for found in pictures]
    assert_agree(compare(*pictures, mask, tolerance=1e-3), 0.025)
    assert 0.8 < variances[1] / variances[0] < 1.25, variances
