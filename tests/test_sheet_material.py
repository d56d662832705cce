"""A sheet that lets light through, as a bundle and as a Cycles material: against quadrature, both sides, all modes."""

from __future__ import annotations

import itertools
import json
import math
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Matrix, Vector
from measured_materials.addon.cli.main import main
from measured_materials.addon.lights.light_tables import lamp_image
from measured_materials.addon.material.bake_material import material_from
from measured_materials.addon.material.choices import Choices
from measured_materials.addon.material.scene_fit import plan_brdf
from measured_materials.addon.rendering.renderer import set_unbiased
from measured_materials.addon.studio import studio
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.modes import MODES
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.bundle.result import BakeResult
from measured_materials.bake.errors import BakeError
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.source import Array
from measured_materials.bake.sources.analytic import Lambert, ThinCloth
from measured_materials.nodes import compat
from measured_materials.nodes.material import build_material
from support.clean_blend import clean_blend  # noqa: F401
from support.coarse_bakes import coarse  # noqa: F401
from support.monte_carlo import assert_same
from support.scenes import TestScene, add_lamp
from test_addon import registered  # noqa: F401

# Front and back differ, and so do the channels.
LINED = ThinCloth((0.3, 0.2, 0.1), (0.1, 0.2, 0.3), (0.2, 0.2, 0.1), (0.3, 0.3, 0.3), 8.0)
WHITE = ThinCloth((0.5, 0.5, 0.5), None, (0.5, 0.5, 0.5), (0.0, 0.0, 0.0))
SETTINGS = BakeSettings(resolution=12, alpha=(0.5, 0.3), sampler=SamplerLayout(n_o=16, n_h=16, n_phi=8))
RESOLUTION, AZIMUTH = 16, 0.7
BELOW, TURNED = np.array([1.0, 1.0, -1.0]), np.array([1.0, -1.0, -1.0])
# Of light as dense as cos(theta) over the hemisphere.
NODES = 160


@pytest.fixture(scope="module")
def baked(tmp_path_factory: pytest.TempPathFactory) -> dict[str, BakeResult]:
    folder = tmp_path_factory.mktemp("sheets")
    return {name: bake_source(source, folder / name, SETTINGS) for name, source in (("lined", LINED), ("white", WHITE))}


def record_of(result: BakeResult) -> BrdfRecord:
    return BrdfRecord.read(read_bundle(result.path))


def sky(direction: Array) -> Array:
    """Different above and below, and on all sides."""
    return (0.6 + 0.4 * direction[..., 2:] + 0.2 * direction[..., :1]) * np.array([0.8, 0.9, 1.0])


def set_sky(scene: bpy.types.Scene) -> None:
    scene.world, background = compat.new_world("sky")
    tree = scene.world.node_tree
    slope, strength = tree.nodes.new("ShaderNodeVectorMath"), tree.nodes.new("ShaderNodeMath")
    slope.operation, slope.inputs[1].default_value = "DOT_PRODUCT", (0.2, 0, 0.4)
    tree.links.new(tree.nodes.new("ShaderNodeTexCoord").outputs["Generated"], slope.inputs[0])
    tree.links.new(slope.outputs["Value"], strength.inputs[0])
    strength.inputs[1].default_value = 0.6
    tree.links.new(strength.outputs[0], background.inputs["Strength"])
    background.inputs["Color"].default_value = (0.8, 0.9, 1, 1)
    scene.world.cycles.sampling_method, scene.world.cycles.sample_map_resolution = "MANUAL", 64


def viewer(theta: float) -> Array:
    """Direction to a viewer at so many degrees from the front's normal; beyond 90 he sees the back."""
    t = math.radians(theta)
    return np.array([math.sin(t) * math.cos(AZIMUTH), math.sin(t) * math.sin(AZIMUTH), math.cos(t)])


@contextmanager
def sheet_scene(material: bpy.types.Material, theta: float) -> Iterator[TestScene]:
    """A large sheet in the plane z = 0, seen along one direction: all pixels show one radiance."""
    compat.ensure_cycles()
    scene = bpy.data.scenes.new("sheet")
    mesh = bpy.data.meshes.new("sheet")
    mesh.from_pydata([(-20, -20, 0), (20, -20, 0), (20, 20, 0), (-20, 20, 0)], [], [(0, 1, 2, 3)])
    layer = mesh.uv_layers.new()
    for loop, corner in zip(layer.data, [(0, 0), (1, 0), (1, 1), (0, 1)], strict=True):
        loop.uv = corner
    mesh.materials.append(material)
    plane = bpy.data.objects.new("sheet", mesh)
    scene.collection.objects.link(plane)
    camera = bpy.data.cameras.new("camera")
    camera.type, camera.ortho_scale = "ORTHO", 0.004  # so small that a lamp lights all of it alike
    scene.camera = bpy.data.objects.new("camera", camera)
    scene.collection.objects.link(scene.camera)
    eye = Vector(viewer(theta) * 5)
    scene.camera.matrix_world = Matrix.Translation(eye) @ (-eye).to_track_quat("-Z", "Y").to_matrix().to_4x4()
    scene.render.resolution_x = scene.render.resolution_y = RESOLUTION
    set_unbiased(scene, samples=64, seed=0)
    scene.world, background = compat.new_world("dark")
    background.inputs["Strength"].default_value = 0
    try:
        yield TestScene(scene, plane)
    finally:
        studio.remove_studio(scene)


def upper_hemisphere() -> Array:
    """Directions (n, 3), each of the same projected solid angle pi / n."""
    u, v = ((np.arange(n) + 0.5) / n for n in (NODES, 2 * NODES))
    radius, phi = np.sqrt(u)[:, None], 2 * np.pi * v
    up = np.broadcast_to(np.sqrt(1 - u)[:, None], (len(u), len(v)))
    return np.stack([radius * np.cos(phi), radius * np.sin(phi), up], -1).reshape(-1, 3)


def shown(record: BrdfRecord | None, mode: str, wi: Array, wo: Array) -> Array:
    """What a part of the material has to show, of its own tables and closures."""
    if record is None:
        return np.zeros(wi.shape)
    if mode == "reference":
        return record.load_table().evaluate(wi, wo, "trilinear")
    if mode == "preview":
        return record.load_preview().evaluate(wi, wo)
    closures = record.load_envelope().evaluate(wi, wo)
    assert record.envelope is not None
    return closures if record.envelope.suffices else closures + record.load_table("residual").evaluate(wi, wo)


def seen(record: BrdfRecord, theta: float) -> tuple[BrdfRecord | None, BrdfRecord | None, Array]:
    """Reflection and transmission that such a viewer sees, and what turns directions into the frame of his side."""
    assert record.sheet is not None
    if theta < 90:
        return record, record.part("through"), np.ones(3)
    if record.sheet.alike:
        return record, record.part("through"), TURNED
    return record.part("behind"), record.part("through_behind"), TURNED


def under_sky(record: BrdfRecord, mode: str, theta: float) -> Array:
    """Radiance (3,) by quadrature."""
    reflected, through, turn = seen(record, theta)
    wi, wo = upper_hemisphere(), (viewer(theta) * turn)[None]
    light = shown(reflected, mode, wi, wo) * sky(wi * turn) + shown(through, mode, wi, wo) * sky(wi * BELOW * turn)
    return math.pi * light.mean(0)


def lit_by(record: BrdfRecord, mode: str, theta: float, lamp: bpy.types.Object) -> Array:
    """The same of one square area lamp that faces the origin, by a grid of points on it."""
    reflected, through, turn = seen(record, theta)
    u = (np.arange(40) + 0.5) / 40 - 0.5
    across = np.stack(np.meshgrid(u, u), -1).reshape(-1, 2) * lamp.data.size
    matrix = np.array(lamp.matrix_world)
    place = matrix[:3, 3] + across @ matrix[:3, :2].T
    distance = np.linalg.norm(place, axis=-1, keepdims=True)
    world = place / distance
    facing = np.abs(world @ matrix[:3, 2:3])
    radiance = lamp.data.energy / (math.pi * lamp.data.size**2)
    wi, wo = world * turn, (viewer(theta) * turn)[None]
    behind = wi[:, 2:] < 0
    wi = np.where(behind, wi * BELOW, wi)
    value = np.where(behind, shown(through, mode, wi, wo), shown(reflected, mode, wi, wo))
    solid = facing * lamp.data.size**2 / len(u) ** 2 / distance**2
    return (value * wi[:, 2:] * solid * radiance).sum(0)


def assert_shows(scene: TestScene, truth: Array, samples: int = 64, seeds: int = 24, tolerance: float = 1e-3) -> None:
    """By a t-test of tiles that finds 1 %, and that a planted 2 % fails."""
    pictures = scene.render(samples, seeds)
    expected = np.broadcast_to(truth.astype(np.float32), (3, RESOLUTION, RESOLUTION, 3))
    assert_same(expected, pictures, np.ones((RESOLUTION, RESOLUTION), bool), tolerance, 0.01)


SOME = {("preview", 20.0), ("exact", 130.0), ("reference", 80.0)}  # of every mode and every side one in each run


@pytest.mark.parametrize(
    ("mode", "theta"),
    [
        pytest.param(*case, marks=() if case in SOME else pytest.mark.slow)
        for case in itertools.product(("preview", "exact", "reference"), (20.0, 80.0, 130.0))
    ],
)
def test_no_mode_is_biased_under_a_sky(baked: dict[str, BakeResult], mode: str, theta: float) -> None:
    record = record_of(baked["lined"])
    with sheet_scene(build_material(record, mode=mode), theta) as scene:
        set_sky(scene.scene)
        assert_shows(scene, under_sky(record, mode, theta))


BEHIND, BEFORE = (1, 1, -3), (1, 1, 3)


@pytest.mark.parametrize(
    ("theta", "place", "aimed"),
    [
        (15.0, BEHIND, True),
        pytest.param(15.0, BEHIND, False, marks=pytest.mark.slow),
        pytest.param(60.0, BEHIND, True, marks=pytest.mark.slow),
        (130.0, BEFORE, True),
        pytest.param(30.0, BEFORE, True, marks=pytest.mark.slow),
    ],
)
def test_a_lamp_behind_and_before(
    baked: dict[str, BakeResult], theta: float, place: tuple[float, float, float], aimed: bool
) -> None:
    """The lamp is shown to the camera, as which the ray goes on where no refraction leads."""
    record = record_of(baked["lined"])
    lamps = lamp_image() if aimed else None
    with sheet_scene(build_material(record, mode="exact", lamps=lamps), theta) as scene:
        lamp = add_lamp(scene, "AREA", place, energy=300, size=3.0)
        lamp.visible_camera = True
        assert_shows(scene, lit_by(record, "exact", theta, lamp), samples=128 if aimed else 384)


class Woven:
    """A sheet whose light straight on is spread less along x than across, grey."""

    name, isotropic, bilateral, alike = "woven", False, False, False
    facts: dict[str, Any] = {}

    def evaluate(self, wi: Array, wo: Array) -> Array:
        return self._grey(np.full(np.broadcast_shapes(wi.shape, wo.shape)[:-1], 0.06), wi, wo, 1, 1)

    def reflected_behind(self, wi: Array, wo: Array) -> Array:
        return self._grey(np.full(np.broadcast_shapes(wi.shape, wo.shape)[:-1], 0.1), wi, wo, -1, -1)

    def transmitted(self, wi: Array, wo: Array) -> Array:
        away = wi + wo
        lobe = 0.03 + 0.4 * np.exp(-((away[..., 0] / 0.3) ** 2) - (away[..., 1] / 0.8) ** 2)
        return self._grey(lobe, wi, wo, -1, 1) + self._grey(lobe, wi, wo, 1, -1)

    def _grey(self, value: Array, wi: Array, wo: Array, lit: int, seen: int) -> Array:
        there = (wi[..., 2] * lit > 0) & (wo[..., 2] * seen > 0)
        return np.repeat(np.where(there, value, 0)[..., None], 3, -1)


@pytest.mark.slow
def test_an_anisotropic_sheet_lies_along_the_tangent_on_both_sides(tmp_path: Path) -> None:
    settings = BakeSettings(8, basis="normal", parameterization="uniform", sampler=SETTINGS.sampler, viewers=(6, 3))
    record = record_of(bake_source(Woven(), tmp_path / "woven", settings))
    assert record.anisotropic
    material = build_material(record, mode="exact", lamps=lamp_image())
    for theta, height in ((40.0, -3), (140.0, 3)):
        with sheet_scene(material, theta) as scene:
            lamp = add_lamp(scene, "AREA", (2, -0.5, height), energy=300, size=2.0)
            lamp.visible_camera = True
            truth = lit_by(record, "exact", theta, lamp)
            lamp.matrix_world = Matrix.Rotation(math.pi / 2, 4, "Z") @ lamp.matrix_world
            assert abs(lit_by(record, "exact", theta, lamp)[1] / truth[1] - 1) > 0.05  # what another tangent would show
            lamp.matrix_world = Matrix.Rotation(-math.pi / 2, 4, "Z") @ lamp.matrix_world
            assert_shows(scene, truth, samples=256)


@pytest.mark.parametrize("mode", ["exact", "reference"])
def test_a_white_sheet_loses_nothing(baked: dict[str, BakeResult], mode: str) -> None:
    """R + T = 1 in a furnace."""
    record = record_of(baked["white"])
    for theta in (30.0, 120.0):
        with sheet_scene(build_material(record, mode=mode), theta) as scene:
            scene.scene.world, background = compat.new_world("furnace")
            background.inputs["Color"].default_value = (1, 1, 1, 1)
            assert_shows(scene, np.ones(3), tolerance=2e-3)


def test_a_bundle_keeps_the_parts_that_are_not_black(baked: dict[str, BakeResult], tmp_path: Path) -> None:
    lined, white = record_of(baked["lined"]), record_of(baked["white"])
    assert lined.sheet is not None and white.sheet is not None
    assert set(lined.sheet.parts) == {"through", "behind", "through_behind"} and not lined.sheet.alike
    assert set(white.sheet.parts) == {"through"} and white.sheet.alike
    black = bake_source(ThinCloth((0.3, 0.3, 0.3), (0.0, 0.0, 0.0), (0.2, 0.2, 0.2)), tmp_path / "black", SETTINGS)
    sheet = record_of(black).sheet
    assert sheet is not None and set(sheet.parts) == {"through", "through_behind"}


def test_a_part_is_what_the_sheet_shows_there(baked: dict[str, BakeResult]) -> None:
    record = record_of(baked["lined"])
    wi = upper_hemisphere()[::97]
    for theta in (20.0, 70.0, 110.0, 160.0):
        reflected, through, turn = seen(record, theta)
        assert reflected is not None and through is not None
        wo = np.broadcast_to(viewer(theta) * turn, wi.shape)
        truth = LINED.evaluate(wi, wo) if theta < 90 else LINED.reflected_behind(wi * turn, wo * turn)
        np.testing.assert_allclose(reflected.load_table().evaluate(wi, wo, "trilinear"), truth, rtol=2e-3)
        found = through.load_table().evaluate(wi, wo, "trilinear")
        truth = LINED.transmitted(wi * BELOW * turn, wo * turn)
        assert np.sqrt(((found - truth) ** 2).mean() / (truth**2).mean()) < 0.15  # of 12 x 12 x 24 texels


def test_a_back_that_shows_nothing_is_black(tmp_path: Path) -> None:
    """As of a file of one reflection and no transmission; in all modes, and in front it is as it was measured."""
    none = (0.0, 0.0, 0.0)
    record = record_of(bake_source(ThinCloth((0.3, 0.2, 0.1), none, none, none), tmp_path / "opaque", SETTINGS))
    assert record.sheet is not None and not record.sheet.parts and not record.sheet.alike
    for mode in MODES:
        material = build_material(record, mode=mode)
        for theta, value in ((30.0, 0.3), (150.0, 0.0)):
            with sheet_scene(material, theta) as scene:
                scene.scene.world, background = compat.new_world("furnace")
                background.inputs["Color"].default_value = (1, 1, 1, 1)
                assert scene.render(16, 1)[..., 0].mean() == pytest.approx(value, rel=0.02)


def test_sheets_are_of_the_newest_schema(baked: dict[str, BakeResult], tmp_path: Path) -> None:
    """By which older versions refuse them with a clear line, and read everything else."""
    assert json.loads((baked["lined"].path / "material.json").read_text())["schema"] == 5
    plain = bake_source(Lambert(), tmp_path / "plain", SETTINGS)
    document = json.loads((plain.path / "material.json").read_text())
    assert document["schema"] == 4 and "sheet" not in document and record_of(plain).sheet is None


def albedo_rows(part: dict[str, Any]) -> tuple[list[Any], list[Any]]:
    return part["albedo"]["theta_o_deg"], part["albedo"]["directional"]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda d: d["sheet"].pop("alike"), "alike"),
        (lambda d: d["sheet"]["through"].pop("table"), "table"),
        (lambda d: d["sheet"]["through"]["sampler"].update(n_o=9), "through|texels"),
        (lambda d: d.update(sheet=[]), "sheet"),
        (lambda d: d["sheet"]["behind"]["albedo"]["theta_o_deg"].__setitem__(1, 11), "sheet.behind.*other angles"),
        (lambda d: [rows.pop() for rows in albedo_rows(d["sheet"]["through"])], "sheet.through.*other angles"),
    ],
)
def test_a_damaged_sheet_is_refused(baked: dict[str, BakeResult], change: Any, says: str, tmp_path: Path) -> None:
    path = tmp_path / "damaged.mmat"
    shutil.copytree(baked["lined"].path, path)
    document = json.loads((path / "material.json").read_text())
    change(document)
    (path / "material.json").write_text(json.dumps(document))
    with pytest.raises(BakeError, match=says):
        BrdfRecord.read(read_bundle(path))


def test_inspect_tells_what_a_bundle_lets_through(baked: dict[str, BakeResult], capsys: Any) -> None:
    assert main(["inspect", str(baked["lined"].path)]) == 0
    words = capsys.readouterr().out
    assert "Transmittance 0°" in words and "Back: through 0°" in words


def test_what_is_not_supported_yet_is_told_or_refused(baked: dict[str, BakeResult]) -> None:
    record = record_of(baked["lined"])
    plan = plan_brdf(record, Choices(mode="exact", shader="osl"), "", passes=True)
    told = {effect.name: effect for effect in plan.effects}
    assert not plan.osl and "do not hold a sheet" in told["Open Shading Language"].why
    assert plan.features
    assert not plan.sample and "aimed at" in told["Lamps sampled in the shader"].why
    with pytest.raises(BakeError, match="Sample Lamps"):
        plan_brdf(record, Choices(mode="exact", sample="always"), "")


def test_a_sheet_is_rebuilt_from_its_own_textures(
    baked: dict[str, BakeResult],
    registered: None,  # noqa: F811
    tmp_path: Path,
) -> None:
    path = tmp_path / "lined.mmat"
    shutil.copytree(baked["lined"].path, path)
    material = material_from(BakeResult(path, baked["lined"].facts, 0.0), pack=True)
    shutil.rmtree(path)
    for mode in ("reference", "preview", "exact"):
        material.measured_quality.mode = mode
        assert not material.measured_quality.problem
    with sheet_scene(material, 60.0) as scene:
        set_sky(scene.scene)
        assert scene.render(16, 1).min() > 0.05
