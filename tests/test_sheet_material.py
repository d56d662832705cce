"""A sheet that lets light through, as a bundle and as a Cycles material: against quadrature, both sides, all modes."""

from __future__ import annotations

import itertools
import json
import math
import shutil
from pathlib import Path
from typing import Any

import bpy  # noqa: F401 -- mathutils is there once it has been imported
import numpy as np
import pytest
from mathutils import Matrix
from measured_materials.addon.cli.main import main
from measured_materials.addon.lights.aim_targets import UNKNOWN, Sampling
from measured_materials.addon.lights.light_tables import lamp_image
from measured_materials.addon.material.bake_material import material_from
from measured_materials.addon.material.choices import Choices
from measured_materials.addon.material.scene_fit import plan_brdf
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.modes import MODES
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.bundle.result import BakeResult
from measured_materials.bake.errors import BakeError
from measured_materials.bake.source import Array
from measured_materials.bake.sources.analytic import Lambert, ThinCloth
from measured_materials.nodes import compat
from measured_materials.nodes.material import build_material
from support.clean_blend import clean_blend  # noqa: F401
from support.coarse_bakes import coarse  # noqa: F401
from support.scenes import add_lamp
from support.sheet_scenes import (
    BEFORE,
    BEHIND,
    BELOW,
    LINED,
    SETTINGS,
    assert_shows,
    lit_by,
    record_of,
    seen,
    set_sky,
    sheet_scene,
    spread,
    under_sky,
    upper_hemisphere,
    viewer,
)
from test_addon import registered  # noqa: F401

WHITE = ThinCloth((0.5, 0.5, 0.5), None, (0.5, 0.5, 0.5), (0.0, 0.0, 0.0))


@pytest.fixture(scope="module")
def baked(tmp_path_factory: pytest.TempPathFactory) -> dict[str, BakeResult]:
    folder = tmp_path_factory.mktemp("sheets")
    return {name: bake_source(source, folder / name, SETTINGS) for name, source in (("lined", LINED), ("white", WHITE))}


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


def test_a_sheet_is_one_script_wherever_that_is_asked_for(baked: dict[str, BakeResult]) -> None:
    """Whatever there is to sample, and though nodes could with a script's help; it writes no denoiser's passes."""
    record, sampling = record_of(baked["lined"]), Sampling(gain="less noise")
    for known, sample in ((UNKNOWN, False), (sampling, True)):
        for mode, sampled in (("exact", sample), ("reference", False)):
            choices = Choices(mode=mode, shader="osl")
            plan = plan_brdf(record, choices, "", passes=True, sampling=known, by_script=sampling)
            told = {effect.name: effect for effect in plan.effects}
            assert plan.osl and not plan.scripted and told["Open Shading Language"].kept
            assert plan.sample == sampled and not plan.features
            assert ("Light through the sheet" in told) == (not sampled)
    plan = plan_brdf(record, Choices(mode="preview", shader="osl"), "")
    told = {effect.name: effect for effect in plan.effects}
    assert not plan.osl and not told["Open Shading Language"].kept
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


def test_a_sheet_is_quiet_under_a_sky_alone(baked: dict[str, BakeResult]) -> None:
    """Cycles chooses between the sides, by numbers more even than White Noise, by which these had 0.12 and 0.086."""
    record = record_of(baked["lined"])
    for mode, most in (("exact", 0.03), ("reference", 0.07)):
        with sheet_scene(build_material(record, mode=mode), 20.0) as scene:
            set_sky(scene.scene)
            assert spread(scene) < most
