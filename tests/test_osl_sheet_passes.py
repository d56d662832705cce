"""Cycles' Normal pass, bakes and the denoiser's passes of sheets that are OSL scripts: as of those of nodes."""

# ruff: noqa: F811  (a fixture of another module, asked for by its name)

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
from measured_materials.addon.lights.light_tables import lamp_image
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.nodes.material import build_material
from measured_materials.nodes.osl_material import build_osl_material
from measured_materials.nodes.osl_script import use_osl
from support.clean_blend import clean_blend  # noqa: F401
from support.coarse_bakes import coarse  # noqa: F401
from support.osl import skip_without_osl
from support.scenes import diffuse_material, lit_sphere
from support.sheet_scenes import GLAZED, SETTINGS
from test_denoised_render import rendered
from test_surface_marker import baked, degrees_off, normal_pass, plane  # noqa: F401

UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def sheet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    skip_without_osl()
    return bake_source(GLAZED, tmp_path_factory.mktemp("glazed") / "glazed", SETTINGS).path


@pytest.fixture(scope="module")
def glazed(sheet: Path) -> BrdfRecord:
    return BrdfRecord.read(read_bundle(sheet))


@pytest.mark.parametrize("mode", ["exact", pytest.param("reference", marks=pytest.mark.slow)])
def test_bakes_of_normal_and_roughness_are_those_of_the_nodes(
    glazed: BrdfRecord,
    plane: bpy.types.Object,
    mode: str,
) -> None:
    wanted = baked(plane, build_material(glazed, mode=mode, lamps=lamp_image()), "ROUGHNESS")
    use_osl(bpy.context.scene)
    material = build_osl_material(glazed, mode=mode, lamps=lamp_image())
    # A mirror's weight of a hundredth of the marker's turns a sample by half a degree.
    assert degrees_off(2 * baked(plane, material, "NORMAL") - 1, UP).max() < 0.5
    assert 0.2 < wanted.mean() and np.abs(baked(plane, material, "ROUGHNESS") - wanted).max() < 0.01


@pytest.mark.parametrize("mode", [pytest.param("exact", marks=pytest.mark.slow), "reference"])
def test_normal_pass(glazed: BrdfRecord, mode: str) -> None:
    """Of a sheet that is marked for it, with the Alpha Threshold that the scene check asks for: what a Ray Portal lets
    through is transparent to Cycles, and with the usual one the pass is of the ball's far side there."""
    with lit_sphere(diffuse_material(0.5), resolution=32) as scene:
        mask = scene.mask()
        layer = scene.scene.view_layers[0]
        truth = normal_pass(scene)[mask]
        use_osl(scene.scene)
        scene.show(build_osl_material(glazed, mode=mode, lamps=lamp_image(), normals=True))
        beyond = degrees_off(normal_pass(scene)[mask], truth)
        layer.pass_alpha_threshold = 0.0
        marked = degrees_off(normal_pass(scene)[mask], truth)
        scene.show(build_osl_material(glazed, mode=mode, lamps=lamp_image()))
        plain = degrees_off(normal_pass(scene)[mask], truth)
    print(marked.mean(), plain.mean(), beyond.mean())
    assert marked.mean() < 0.1 and plain.mean() > 1.5
    assert (beyond.mean() > 0.3) == (mode == "reference")


def test_a_picture_is_denoised_by_a_twin(sheet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Cycles' OSL writes no such passes. No light is lost."""
    noisy, said = rendered(sheet, tmp_path, capsys, "--osl", "--denoise", "never", "--mode", "reference")
    assert said["osl"] and not said["denoised"]
    clean, said = rendered(sheet, tmp_path, capsys, "--osl", "--mode", "reference")
    assert said["osl"] and said["denoised"] and abs(clean.mean() / noisy.mean() - 1) < 0.02
    rough = [float(np.abs(np.diff(picture.mean(-1), axis=1)).mean()) for picture in (noisy, clean)]
    print(rough)
    assert rough[1] < 0.6 * rough[0]
