"""Sheets as OSL scripts: their functions against float64 numpy, and pictures against quadrature and the nodes' own."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured_materials.addon.lights.light_tables import lamp_image, update_scene
from measured_materials.bake import xp_numpy
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.modes import MODES
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.images.image_io import write_image
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.sampling.cell_sampler import build_sampler
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sampling.lamps import aim_numpy, expected_light_on_sheet, lamp_table
from measured_materials.bake.sampling.world import expected_world_light_on_sheet
from measured_materials.bake.sources.analytic import Ggx, ThinCloth
from measured_materials.bake.tables.atlas import pack
from measured_materials.nodes import compat
from measured_materials.nodes.material import build_material
from measured_materials.nodes.osl_material import build_osl_material
from measured_materials.nodes.osl_parameters import cell_constants
from measured_materials.nodes.osl_script import is_one_script, use_osl
from support.clean_blend import clean_blend  # noqa: F401
from support.coarse_bakes import coarse  # noqa: F401
from support.direct_light import environment
from support.osl import (
    assert_preview_on_the_ground,
    assert_shows_nodes_in_eevee,
    closures_of_group,
    declared_table,
    header_card,
    skip_without_osl,
)
from support.scenes import add_lamp, diffuse_material
from support.sheet_scenes import (
    BEADED,
    BEFORE,
    BEHIND,
    GLAZED,
    LINED,
    PRISMATIC,
    SETTINGS,
    assert_mean,
    lit_by,
    osl_that_samples,
    record_of,
    set_sky,
    sheet_scene,
    spread,
    under_sky,
)
from test_osl_cards import LAMPS, random_table
from test_sampled_sheets import add_room
from test_sheet_material import WHITE, Woven

HEADER = "measured_sheet.h"


@pytest.fixture(autouse=True, scope="module")
def osl() -> None:
    skip_without_osl()


@pytest.fixture(scope="module")
def records(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """What is asked for is baked, once."""
    sources = {"glazed": GLAZED, "lined": LINED, "white": WHITE, "beaded": BEADED, "prismatic": PRISMATIC}
    folder, made = tmp_path_factory.mktemp("sheets"), {}

    def find(name: str) -> BrdfRecord:
        if name not in made:
            made[name] = record_of(bake_source(sources[name], folder / name, SETTINGS))
        return made[name]

    return find


def test_a_direction_through_the_sheet_and_its_weight(tmp_path: Path) -> None:
    """As drawn by numpy, mirrored in the sheet; f cos / pdf by the table and the sampler."""
    layout = SamplerLayout(n_o=8, n_h=12, n_phi=8)
    table, sampler = random_table(8), build_sampler(Ggx(alpha=0.5), layout)
    write_image(tmp_path / "cells.exr", sampler.texels, Storage.FLOAT32)
    write_image(tmp_path / "table.exr", pack(table.grid, table.values), Storage.FLOAT32)
    rng = np.random.default_rng(3)
    u = rng.random((1500, 4)).astype(np.float32)
    theta = np.arccos(rng.uniform(0.05, 1, 1500))
    incoming = np.stack([np.sin(theta), 0 * theta, np.cos(theta)], -1).astype(np.float32)
    cells = cell_constants(layout)
    bins, *sizes = (cells[name] for name in ("Bins", "CellRows", "CellColumns", "Warp"))
    sizes = ", ".join(str(size) for size in sizes)
    body = f"""{declared_table(table.grid, tmp_path / "table.exr", "trilinear")}
      MMSampler s = {{"{tmp_path / "cells.exr"}", {bins}, 0, {sizes}, 0, 0, 0, 0, 1}};
      MMPart part;
      part.sampler = s; part.table = table; part.grid = g;
      MMFrame frame = mm_below(mm_viewer_frame(normal(0, 0, 1), i));
      float xi[9] = {{a, b, c, d, 0.5, 0.5, 0.5, 0.5, 0.5}};
      MMDrawn none = {{vector(0), vector(0), color(0)}};
      MMAhead ahead = mm_ahead(part, mm_viewer_of(s, frame.wo), frame, 0, none, xi, 1);
      wi = ahead.wi_world; weight = ahead.weight; pdf = ahead.of_table;"""
    outputs = {"wi": "vector", "weight": "color", "pdf": "float"}
    inputs = dict(zip("abcd", u.T, strict=True)) | {"i": incoming}
    wi, weight, pdf = header_card(body, outputs, HEADER, **inputs)
    drawn, density = sampler.sample(incoming.astype(float), u.astype(float))
    # Next to a cell's border float32 may draw in the neighbour.
    same = np.abs(wi - drawn * [1, 1, -1]).max(-1) < 1e-5
    assert same.mean() > 0.98
    up = same & (drawn[:, 2] > 1e-3)
    assert np.abs(pdf / density - 1)[up].max() < 5e-4
    truth = table.evaluate(drawn, incoming.astype(float), "trilinear") * (drawn[:, 2:] / density[:, None])
    assert np.abs(weight - truth)[up].max() < 2e-3 * truth[up].max()
    assert (weight[same & (drawn[:, 2] <= 0)] == 0).all()


@pytest.mark.parametrize("flux", [0.0, 2.0])
def test_light_of_either_side_is_expected_as_by_numpy(flux: float) -> None:
    """Of every kind of lamp and of a world, and how often the mirror above is drawn for it."""
    rng = np.random.default_rng(4)
    size = 800
    p = rng.uniform(-0.3, 0.3, (size, 3)).astype(np.float32)
    n = rng.normal(size=(size, 3))
    n = (n / np.linalg.norm(n, axis=1, keepdims=True)).astype(np.float32)
    front = rng.uniform(0, 1, size).astype(np.float32)
    rows, toward = lamp_table(LAMPS, 4), np.array((0.4, -0.3, 0.9)) * flux

    def triple(numbers: Any) -> str:
        return f"vector({', '.join(f'{x:.9g}' for x in numbers)})"

    vectors = [[triple(r[k, :3]) for k in range(4)] + [triple((r[0, 3], r[1, 3], r[3, 3]))] for r in rows]
    lamps = ", ".join("{" + ", ".join(row) + "}" for row in vectors)
    body = f"""MMLamp lamps[MM_MOST_LAMPS] = {{{lamps}}};
      side = mm_light_side(lamps, 4, vector(0.3, 0.8, {flux}), {triple(toward)}, {int(flux > 0)}, p, n, f);
      world = mm_expected_world_light_on_sheet({triple(toward)}, {flux}, n, f);
      first = mm_expected_light_on_sheet(mm_aim_at(lamps[0], p), n, lamps[0].facts[1], f);"""
    outputs = dict.fromkeys(("side", "world", "first"), "float")
    side, world, first = header_card(body, outputs, HEADER, p=p, n=n, f=front)
    n64, f64 = n.astype(float), front.astype(float)
    aims = [aim_numpy(row, p.astype(float)) for row in rows]
    light = [
        expected_light_on_sheet(xp_numpy, aim, n64, lamp.power, f64) for aim, lamp in zip(aims, LAMPS, strict=True)
    ]
    assert np.allclose(first, light[0], rtol=2e-5, atol=1e-6)
    around = expected_world_light_on_sheet(xp_numpy, toward, flux, n64, f64)
    assert np.allclose(world, around, rtol=1e-5, atol=1e-6)
    above = 0.3 * f64 + sum(one * ((aim.axis * n64).sum(-1) > 0) for one, aim in zip(light, aims, strict=True))
    total = 0.3 + sum(light)
    if flux:
        above = above + f64 * np.maximum(n64 @ toward + flux, 0.1 * flux)
        total = total + around
    assert np.allclose(side, np.clip(above / total, 0.1, 0.9), atol=1e-4)


SOME = {("preview", 20.0), ("exact", 130.0), ("reference", 80.0)}  # of every mode and every side one in each run


@pytest.mark.parametrize(
    ("mode", "theta"),
    [
        pytest.param(*case, marks=() if case in SOME else pytest.mark.slow)
        for case in itertools.product(("preview", "exact", "reference"), (20.0, 80.0, 130.0))
    ],
)
def test_no_mode_is_biased_under_a_sky(records: Any, mode: str, theta: float) -> None:
    record = records("lined")
    with sheet_scene(build_osl_material(record, mode=mode), theta) as scene:
        use_osl(scene.scene)
        set_sky(scene.scene)
        assert_mean(scene, under_sky(record, mode, theta), samples=128)


def test_preview_is_the_nodes_picture(records: Any) -> None:
    """Closures alone draw no random number of ours: under equal seeds OSL and nodes differ by rounding."""
    record = records("lined")
    for theta in (30.0, 150.0):
        pictures = []
        for build, mode in ((build_material, "preview"), (build_osl_material, "preview")):
            with sheet_scene(build(record, mode=mode), theta) as scene:
                set_sky(scene.scene)
                if build is build_osl_material:
                    use_osl(scene.scene)
                pictures.append(scene.render(4, 1))
        assert (np.abs(pictures[1] - pictures[0]) > 1e-4 * pictures[0]).mean() < 1e-3


@pytest.mark.slow
def test_balanced_is_exact_until_a_diffuse_bounce(records: Any) -> None:
    """The same picture of the sheet itself; on matte ground it is Preview's, its light having bounced there."""
    exact, balanced, preview = (
        build_osl_material(records("lined"), mode=mode) for mode in ("exact", "balanced", "preview")
    )
    with sheet_scene(exact, 40.0) as scene:
        use_osl(scene.scene)
        set_sky(scene.scene)
        seen = scene.render(4, 1)
        scene.show(balanced)
        assert (scene.render(4, 1) == seen).all()
    assert_preview_on_the_ground(exact, balanced, preview)


@pytest.mark.parametrize("mode", ["exact", pytest.param("reference", marks=pytest.mark.slow)])
def test_a_white_sheet_loses_nothing(records: Any, mode: str) -> None:
    """R + T = 1 in a furnace, both faces."""
    material = build_osl_material(records("white"), mode=mode)
    for theta in (30.0, 120.0):
        with sheet_scene(material, theta) as scene:
            use_osl(scene.scene)
            scene.scene.world, background = compat.new_world("furnace")
            background.inputs["Color"].default_value = (1, 1, 1, 1)
            assert_mean(scene, np.ones(3), samples=16)


@pytest.mark.parametrize(
    ("theta", "place"),
    [
        (60.0, BEHIND),
        pytest.param(15.0, BEHIND, marks=pytest.mark.slow),
        pytest.param(130.0, BEFORE, marks=pytest.mark.slow),
        pytest.param(30.0, BEFORE, marks=pytest.mark.slow),
    ],
)
def test_a_lamp_that_is_aimed_at_behind_and_before(records: Any, theta: float, place: Any) -> None:
    record = records("lined")
    with sheet_scene(build_osl_material(record, mode="exact", lamps=lamp_image()), theta) as scene:
        use_osl(scene.scene)
        lamp = add_lamp(scene, "AREA", place, energy=300, size=3.0)
        lamp.visible_camera = True
        update_scene(scene.scene)
        assert_mean(scene, lit_by(record, "exact", theta, lamp), samples=256)


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["reference", "balanced"])
def test_other_modes_that_aim_are_the_nodes(records: Any, mode: str) -> None:
    record = records("glazed")
    for theta in (40.0, 140.0):
        with sheet_scene(build_osl_material(record, mode=mode, lamps=lamp_image()), theta) as scene:
            use_osl(scene.scene)
            lamp = add_lamp(scene, "AREA", BEHIND, energy=300, size=3.0)
            lamp.visible_camera = True
            update_scene(scene.scene)
            shown = "reference" if mode == "reference" else "exact"
            assert_mean(scene, lit_by(record, shown, theta, lamp), samples=512)


LIT = [
    ("glazed", 80.0, BEHIND, 3.0),
    ("glazed", 150.0, BEHIND, 3.0),
    ("glazed", 60.0, BEFORE, 3.0),
    ("lined", 130.0, BEFORE, 1.0),
    ("beaded", 130.0, (1.9, 1.6, -2.1), 3.0),
    ("beaded", 40.0, (-1.5, -1.3, -2.4), 3.0),
    ("prismatic", 60.0, (2.0, 1.7, -1.5), 1.5),
]


@pytest.mark.parametrize(
    ("name", "theta", "place", "size"),
    [
        pytest.param(*case, marks=() if case[0] == "prismatic" or case[:2] == ("glazed", 150.0) else pytest.mark.slow)
        for case in LIT
    ],
)
def test_a_sampled_lamp_that_the_camera_does_not_see_loses_nothing(
    records: Any, name: str, theta: float, place: Any, size: float
) -> None:
    """No Ray Portal of a camera's ray meets it."""
    record = records(name)
    with sheet_scene(diffuse_material(), theta) as scene:
        lamp = add_lamp(scene, "AREA", place, energy=300, size=size)
        assert not lamp.visible_camera
        osl_that_samples(scene, record)
        assert_mean(scene, lit_by(record, "exact", theta, lamp), samples=64)


@pytest.mark.slow
@pytest.mark.parametrize("theta", [40.0, 80.0])
def test_a_lamp_hidden_from_transmission_loses_nothing(records: Any, theta: float) -> None:
    record = records("glazed")
    with sheet_scene(diffuse_material(), theta) as scene:
        lamp = add_lamp(scene, "AREA", BEHIND, energy=300, size=1.0)
        lamp.visible_camera, lamp.visible_transmission = True, False
        osl_that_samples(scene, record)
        assert_mean(scene, lit_by(record, "exact", theta, lamp), samples=48)


@pytest.mark.parametrize("theta", [70.0, *(pytest.param(theta, marks=pytest.mark.slow) for theta in (20.0, 130.0))])
def test_the_world_s_picture_is_sampled_on_both_sides(records: Any, theta: float) -> None:
    record = records("glazed")
    with sheet_scene(diffuse_material(), theta) as scene:
        pixels = add_room(scene)
        osl_that_samples(scene, record)
        assert_mean(scene, under_sky(record, "exact", theta, environment(pixels)), samples=64)


@pytest.mark.slow
def test_a_lamp_and_a_sky_that_is_aimed_at(records: Any) -> None:
    """A world of no picture beside a lamp: that is sampled, and mirrors are aimed at the world."""
    record = records("glazed")
    with sheet_scene(diffuse_material(), 40.0) as scene:
        lamp = add_lamp(scene, "AREA", BEHIND, energy=300, size=1.0)
        set_sky(scene.scene)
        osl_that_samples(scene, record)
        assert_mean(scene, lit_by(record, "exact", 40.0, lamp) + under_sky(record, "exact", 40.0), samples=64)


@pytest.mark.slow
def test_an_anisotropic_sheet_lies_along_the_tangent_on_both_sides(tmp_path: Path) -> None:
    settings = BakeSettings(8, basis="normal", parameterization="uniform", sampler=SETTINGS.sampler, viewers=(6, 3))
    record = record_of(bake_source(Woven(), tmp_path / "woven", settings))
    for theta, height in ((40.0, -3), (140.0, 3)):
        with sheet_scene(diffuse_material(), theta) as scene:
            lamp = add_lamp(scene, "AREA", (2, -0.5, height), energy=300, size=2.0)
            osl_that_samples(scene, record)
            assert_mean(scene, lit_by(record, "exact", theta, lamp), samples=24)


def test_a_sheet_is_quiet_under_a_sky_alone(records: Any) -> None:
    """Cycles chooses between the sides and the closures, as of nodes."""
    with sheet_scene(build_osl_material(records("lined"), mode="exact"), 20.0) as scene:
        use_osl(scene.scene)
        set_sky(scene.scene)
        assert spread(scene) < 0.03


def test_switched_to_osl_the_viewport_keeps_both_sides(records: Any) -> None:
    record = records("lined")
    closures = closures_of_group(build_material(record, mode="preview"))
    assert "ShaderNodeBsdfTranslucent" in closures
    for mode in ("exact", "reference"):
        assert_shows_nodes_in_eevee(build_osl_material(record, build_material(record), mode=mode), closures)


def test_a_back_that_shows_nothing_is_black(tmp_path: Path) -> None:
    """Of one reflection and no transmission, in all modes."""
    none = (0.0, 0.0, 0.0)
    record = record_of(bake_source(ThinCloth((0.3, 0.2, 0.1), none, none, none), tmp_path / "opaque", SETTINGS))
    for mode in MODES:
        material = build_osl_material(record, mode=mode)
        assert is_one_script(material)
        for theta, value in ((30.0, 0.3), (150.0, 0.0)):
            with sheet_scene(material, theta) as scene:
                use_osl(scene.scene)
                scene.scene.world, background = compat.new_world("furnace")
                background.inputs["Color"].default_value = (1, 1, 1, 1)
                assert scene.render(16, 1)[..., 0].mean() == pytest.approx(value, rel=0.02)
