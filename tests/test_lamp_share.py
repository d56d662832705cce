"""The mirror's probability under one lamp: its table, its nodes and OSL against numpy, and the noise it saves."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from measured_materials.addon.lights.light_tables import lamp_image, update_scene
from measured_materials.addon.material.build_brdf import build_brdf
from measured_materials.bake import xp_numpy
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.bundle.bundle import Bundle, StoredImage, read_bundle, write_bundle
from measured_materials.bake.directions import normalize, spherical
from measured_materials.bake.envelope import (
    EnvelopeFit,
    ShareLayout,
    SlopeShareLayout,
    ViewerGrid,
    checked_shares,
    lamp_shares,
    part_of_light,
    share_coordinates,
)
from measured_materials.bake.envelope.anisotropic_lobes import AnisotropicLobe
from measured_materials.bake.errors import BakeError
from measured_materials.bake.images.image_io import write_image
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.sampling.lamps import RECTANGLE, SUN, Lamp, lamp_table
from measured_materials.bake.sampling.slope_cells import SlopeLayout
from measured_materials.bake.source import Array
from measured_materials.nodes.lamp_share_group import LampShares, lamp_probability
from measured_materials.nodes.material import build_material
from measured_materials.nodes.osl_parameters import share_constants
from scipy.ndimage import map_coordinates
from support import bundles
from support.cards import card, data_image
from support.clean_blend import clean_blend  # noqa: F401
from support.osl import header_card, skip_without_osl
from support.scenes import TestScene, lit_sphere

LAMP = Lamp(RECTANGLE, 5.0, (0.5, -0.3, 2.0), (0.1, 0, 0), (0, 0.1, 0), (0, 0, -1))
SCENES = {
    "lamp": lamp_table([LAMP], 4, sky=0.4),
    "two lamps": lamp_table([LAMP, LAMP], 4),
    "sun": lamp_table([Lamp(SUN, 2.0, axis=(0.36, 0.48, 0.8), extent=0.01)], 4, sky=0.5),
    "window and lamp": lamp_table([LAMP], 4, sky=0.5, world=((0.6, 0.0, 0.8), 2.0)),
    "nothing": lamp_table([], 4),
}


@pytest.fixture(scope="module")
def paint(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    """A flake's wide highlight below a coat's narrow one."""
    return bundles.baked(bundles.ANALYTIC["metallic paint"], tmp_path_factory.mktemp("share"))


def pairs(count: int) -> tuple[Array, Array]:
    """Local (wi, wo), wo in the x-z plane."""
    rng = np.random.default_rng(0)
    wi = spherical(np.arccos(rng.uniform(0.1, 1, count)), rng.uniform(-np.pi, np.pi, count))
    return wi, spherical(np.arccos(rng.uniform(0.1, 1, count)), 0.0)


def tap(image: Array, u: Array, v: Array) -> Array:
    """(..., 3) as an image node reads it, linear and extended."""
    height, width = image.shape[:2]
    place = [(1 - v) * height - 0.5, u * width - 0.5]
    return np.stack([map_coordinates(image[..., k], place, order=1, mode="nearest") for k in range(3)], -1)


def test_shares_are_those_of_the_light(paint: Bundle) -> None:
    """Near R / (R + E), and of less variance than the share of all light at theta_o."""
    wi, wo = pairs(20000)
    image = bundle_shares(paint)
    found, reflected, _ = tap(image, *share_coordinates(xp_numpy, wi, wo, np.array([0.0, 0.0, 1.0]), wo)).T
    native = BrdfRecord.read(paint).load_envelope().evaluate(wi, wo).sum(-1)
    mirror = bundles.brdf_of(paint, "exact")(wi, wo).sum(-1) - native
    truth = mirror / (mirror + native)
    usual = np.interp(
        np.sqrt(1 - wo[:, 2]), np.linspace(0, 1, paint_nodes(paint)), paint.load("envelope")[0, :, 3].astype(float)
    )
    # Seen 0.014: cells are wide, and nothing lies below a quarter of the usual share.
    assert np.median(np.abs(found - np.clip(truth, np.maximum(0.02, usual / 4), 0.98))) < 0.06

    def second_moment(p: Array) -> float:
        relative = 1 / (mirror + native) ** 2
        return float((relative * (mirror**2 / p + native**2 / (1 - p))).mean()) - 1

    # Seen 0.020 against 0.151.
    assert second_moment(found) < 0.3 * second_moment(usual)
    # The second channel follows f cos.
    brightness = (mirror + native) * wi[:, 2]
    assert np.corrcoef(np.log(reflected + 1e-3), np.log(brightness))[0, 1] > 0.9


def bundle_shares(bundle: Bundle) -> Array:
    return checked_shares(bundle.load("residual_share"))


def paint_nodes(bundle: Bundle) -> int:
    return int(bundle.load("envelope").shape[1])


def test_slices_and_ends_of_the_image() -> None:
    """A tap stays in its slice, from the mirror direction at its left to the retro-reflection at its top."""
    layout = ShareLayout()
    up = np.array([0.0, 0.0, 1.0])
    for theta_o in (0.0, 0.5, 1.2, np.pi / 2):
        wo = spherical(theta_o, 0.0)
        index = min(int(np.sqrt(1 - np.cos(theta_o)) * layout.n_o), layout.n_o - 1)
        column, row = share_coordinates(xp_numpy, wo * [-1, 1, 1], wo, up, wo)
        assert column * layout.size[0] - 0.5 == pytest.approx(index * layout.n_h, abs=1e-3)
        assert row * layout.n_d - 0.5 == pytest.approx(np.cos(theta_o) * (layout.n_d - 1))
        _, row = share_coordinates(xp_numpy, wo, wo, up, wo)
        assert row * layout.n_d - 0.5 == pytest.approx(layout.n_d - 1)


class Leaning:
    """A residual that differs by where the half vector leans, and from where it is seen; of a Lambertian's strength."""

    def __init__(self, folded: bool) -> None:
        self.folded = folded

    def evaluate(self, wi: Array, wo: Array) -> Array:
        x, y, z = np.moveaxis(normalize(wi + wo), -1, 0)
        x, y = x / z, y / z
        # After half a turn both slopes change their signs, and so does the viewer's side.
        lean = 2 * x * y + x * x if self.folded else 2 * x + y
        side = wo[..., 0] ** 2 if self.folded else wo[..., 0]
        return np.repeat(((1 + 0.9 * np.tanh(2 * lean + side)) / np.pi)[..., None], 3, -1)


@pytest.mark.parametrize("folded", [False, True])
def test_shares_of_an_anisotropic_material(folded: bool) -> None:
    """R / (R + E) of directions on all sides, over the seams of the azimuth too; and of less variance than usual."""
    viewers = ViewerGrid(4, 4, folded)
    weights, usual = np.ones((4, 4, 1, 3), np.float32), 0.5
    fit = EnvelopeFit((AnisotropicLobe("lambert"),), viewers, weights, np.full((4, 4), usual, np.float32), {})
    residual = Leaning(folded)
    layout = SlopeShareLayout.of(SlopeLayout(8, 8, 16, 16, 0.4, 0.4, folded))
    image = checked_shares(lamp_shares(fit, residual, layout), layout=layout)
    assert image.shape == (*layout.size[::-1], 3)
    rng = np.random.default_rng(1)
    wi, wo = (spherical(np.arccos(rng.uniform(0.2, 1, 20000)), rng.uniform(-np.pi, np.pi, 20000)) for _ in range(2))
    found, reflected, _ = tap(image, *layout.coordinates(xp_numpy, wi, wo)).T
    native, mirror = fit.evaluate(wi, wo)[:, 0], residual.evaluate(wi, wo)[:, 0]
    truth = np.clip(mirror / (mirror + native), usual / 4, 0.98)
    off = np.abs(found - truth)
    # Slices are 22 to 45 degrees wide.
    assert np.median(off) < 0.03 and np.quantile(off, 0.95) < 0.12

    def second_moment(p: Array | float) -> float:
        return float(((mirror**2 / p + native**2 / (1 - p)) / (mirror + native) ** 2).mean()) - 1

    assert second_moment(found) < 0.2 * second_moment(usual)
    brightness = (mirror + native) * wi[:, 2]
    # But for the albedo, which another viewer sees another of.
    assert np.corrcoef(reflected, brightness)[0, 1] > 0.7
    with pytest.raises(BakeError, match="bake it again"):
        checked_shares(image[:-1], layout=layout)


@pytest.mark.parametrize("change", ["size", "zero", "one", "nan", "negative"])
def test_shares_that_would_lose_light_are_refused(paint: Bundle, change: str) -> None:
    image = bundle_shares(paint).copy()
    image[3, 5, 1 if change == "negative" else 0] = {"negative": -1, "zero": 0, "one": 1, "nan": np.nan}.get(
        change, 0.5
    )
    with pytest.raises(BakeError, match="bake it again"):
        checked_shares(image[:-1] if change == "size" else image)


def shading_points(count: int = 1500) -> tuple[Array, Array, Array, Array, Array]:
    """Positions, normals, viewers in the world and locally, usual shares; float32."""
    rng = np.random.default_rng(4)
    position = rng.uniform(-0.3, 0.3, (count, 3))
    normal, incoming = (spherical(np.arccos(rng.uniform(-1, 1, count)), rng.uniform(0, 7, count)) for _ in range(2))
    incoming *= np.sign((normal * incoming).sum(-1, keepdims=True))
    cosine = (normal * incoming).sum(-1)
    wo = np.stack([np.sqrt(1 - cosine**2), 0 * cosine, cosine], -1)
    values = position, normal, incoming, wo, rng.uniform(0.05, 0.6, count)
    return tuple(value.astype(np.float32) for value in values)  # type: ignore[return-value]


def expected(image: Array, table: Array, position: Array, normal: Array, incoming: Array, wo: Array) -> Array:
    """(P, 2): the share that a lamp sees, and how far it decides."""
    to_centre = table[0, 0, :3].astype(float) - position
    to_lamp = normalize(to_centre)
    sky, _, lamps, strength = table[0, 4].astype(float)
    seen, reflected, _ = tap(image, *share_coordinates(xp_numpy, to_lamp, incoming, normal, wo)).T
    return np.stack([seen, part_of_light(xp_numpy, to_centre, reflected, strength, lamps, sky)], -1)


def random_shares() -> Array:
    """Harsher than any material's."""
    layout = ShareLayout()
    values = np.random.default_rng(2).uniform(0.02, 0.98, (*layout.size[::-1], 1))
    return np.repeat(values, 3, -1).astype(np.float32)


def assert_same(found: Array, image: Array, table: Array, points: tuple[Array, ...]) -> None:
    position, normal, incoming, wo, usual = (p.astype(float) for p in points)
    seen, part = expected(image, table, position, normal, incoming, wo).T
    chord = np.linalg.norm(wo - [0, 0, 1], axis=-1) / np.sqrt(2) * ShareLayout().n_o
    # Beside the edge of a slice float32 may read the other.
    inside = np.abs(chord - np.round(chord)) > 1e-3
    # Neighbours differ by up to 1 in a 16th of the square root of a chord: 1e-7 of the chord is 1e-3 at the peak.
    assert np.abs(found - (usual + part * (seen - usual)))[inside].max() < 5e-3
    assert np.median(np.abs(found - (usual + part * (seen - usual)))[inside]) < 1e-4


@pytest.mark.parametrize("name", SCENES)
def test_nodes_are_the_formula(name: str) -> None:
    points = shading_points()
    image, table = random_shares(), SCENES[name]
    images = LampShares(data_image("shares", image), ShareLayout()), data_image("lamps", table)
    (found,) = card(lambda *inputs: lamp_probability(*images, *reordered(inputs)), *points)
    assert_same(found, image, table, points)


def reordered(points: Sequence[Any]) -> tuple[Any, ...]:
    """Position, viewer, normal, local viewer, usual share, as nodes and OSL take them."""
    position, normal, incoming, wo, usual = points
    return position, incoming, normal, wo, usual


@pytest.mark.parametrize("name", SCENES)
def test_osl_is_the_formula(tmp_path: Path, name: str) -> None:
    skip_without_osl()
    points = shading_points()
    image, table = random_shares(), SCENES[name]
    file = tmp_path / "shares.exr"
    write_image(file, image, Storage.FLOAT32)
    body = "MMFrame frame = {wo, vector(0), vector(0), n};" + probability_by_osl(file, ShareLayout(), table)
    inputs = dict(zip(("p", "n", "i", "wo", "usual"), points))
    (found,) = header_card(body, {"y": "float"}, "measured_lamps.h", **inputs)
    assert_same(found, image, table, points)


def probability_by_osl(file: Path, layout: ShareLayout | SlopeShareLayout, table: Array, gloss: float = 1.0) -> str:
    """Statements that find `y`, given `frame`, `usual`, `i` and `p`."""
    names = "Bins BinsPhi CellRows CellColumns Warp WidthX WidthY HalfTurn".split()
    constants = share_constants(layout)
    shares = ", ".join(f"{constants.get(f'Share{name}', 0):.9g}" for name in names)
    centre = ", ".join(f"{x:.9g}" for x in table[0, 0, :3])
    sky, _, lamps, strength = (f"{x:.9g}" for x in table[0, 4])
    call = f"shares, frame, usual, i, p, vector({centre}), {lamps}, {strength}, {sky}, {gloss:.9g}"
    return f'MMSampler shares = {{"{file}", {shares}, 0, 1}}; y = mm_lamp_probability({call});'


def without_shares(bundle: Bundle, folder: Path) -> Bundle:
    """As baked by an older version."""
    images = {
        name: StoredImage(bundle.load(name), Storage(bundle.material["images"][name]["storage"]))
        for name in bundle.material["images"]
        if name != "residual_share"
    }
    return read_bundle(write_bundle(folder / "old", bundle.material, images))


def test_less_noise_under_a_small_lamp(paint: Bundle, tmp_path: Path) -> None:
    """Against a bundle without the table, which still is a material: a pixel's variance over its brightness squared."""
    variances = []
    with lit_sphere(build_material(paint), 64, lamp_size=0.2, ground=False, resolution=32) as scene:
        darken(scene)
        for bundle in (without_shares(paint, tmp_path), paint):
            material = build_material(bundle, mode="exact", lamps=lamp_image(), lamp_share=True)
            assert any(t.name.startswith("MM Mirror Probability") for t in groups_of(material)) == (bundle is paint)
            scene.show(material)
            update_scene(scene.scene)
            pictures = scene.render(16, 12)[:, scene.mask()].astype(float)
            mean = pictures.mean((0, 2))
            lit = mean > 0.05 * mean.mean()
            variances.append(float(np.median(pictures.var(0, ddof=1).mean(-1)[lit] / mean[lit] ** 2)))
    # Seen 0.0079 against 0.0200; of 12 pictures' variances the median of some 400 pixels is good to 4 %.
    assert variances[1] < 0.5 * variances[0], variances


def groups_of(material: bpy.types.Material) -> list[bpy.types.ShaderNodeTree]:
    tree = next(n.node_tree for n in material.node_tree.nodes if n.bl_idname == "ShaderNodeGroup")
    return [n.node_tree for n in tree.nodes if n.bl_idname == "ShaderNodeGroup"]


def darken(scene: TestScene) -> None:
    """No light but the lamp's."""
    tree = scene.scene.world.node_tree
    strength = next(n for n in tree.nodes if n.type == "BACKGROUND").inputs["Strength"]
    for link in list(strength.links):
        tree.links.remove(link)
    strength.default_value = 0


def test_only_where_the_lamps_are_alone(paint: Bundle) -> None:
    """Under a sky as well, its nodes would cost more time than they save noise."""
    with lit_sphere(build_material(paint), 16, lamp_size=0.2, ground=False, resolution=8) as scene:
        for dark in (False, True):
            if dark:
                darken(scene)
            material, _ = build_brdf(paint, scene=scene.scene)
            assert any(t.name.startswith("MM Mirror Probability") for t in groups_of(material)) == dark
