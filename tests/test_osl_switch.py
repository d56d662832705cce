"""Measured BRDFs as OSL by one switch: property, operator, textures that are packed or gone, the scene check."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np
import pytest
from measured_materials.addon.lights.aim_targets import Sampling, sampling_of
from measured_materials.addon.lights.light_tables import lamp_image, lamp_light_image, survey_scene, update_scene
from measured_materials.addon.material.bake_material import material_from
from measured_materials.addon.material.choices import Choices
from measured_materials.addon.material.facts import record_of
from measured_materials.addon.material.kinds import BRDF
from measured_materials.addon.material.rebuild import current_choices, effects_of, rebuild_brdf
from measured_materials.addon.material.scene_fit import plan_brdf
from measured_materials.addon.material.textures import script_files
from measured_materials.addon.material.textures.kept import image_nodes, textures_of
from measured_materials.addon.scene_check.check import check_scene, mend
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.bundle.result import BakeResult
from measured_materials.bake.errors import BakeError
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sources import analytic
from measured_materials.nodes.material import build_material
from measured_materials.nodes.osl_material import build_osl_material
from measured_materials.nodes.osl_script import is_one_script, is_scripted, use_osl
from support.clean_blend import clean_blend  # noqa: F401
from support.osl import skip_without_osl
from support.records import brdf_record, sheet_parts
from support.scenes import TestScene, lit_sphere
from test_addon import registered  # noqa: F401

# A script as a whole, whose textures are files, is built where nodes would sample nothing.
NODES = Choices(sample="never")
SCRIPT = Choices(sample="never", shader="osl")


@pytest.fixture(autouse=True, scope="module")
def osl() -> None:
    skip_without_osl()


@pytest.fixture(scope="module")
def baked(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    """Paint whose residual is a third of the light."""
    source = analytic.MetallicPaint((0.05, 0.1, 0.3), (0.1, 0.2, 0.4), flake_alpha=0.3, coat_alpha=0.2)
    settings = BakeSettings(resolution=16, alpha=(0.5, 0.4), sampler=SamplerLayout(n_o=16, n_h=16, n_phi=8))
    return read_bundle(bake_source(source, tmp_path_factory.mktemp("paint") / "paint", settings).path)


@pytest.fixture
def bundle(baked: Bundle, tmp_path: Path) -> Bundle:
    """A copy that a test may take away."""
    return read_bundle(Path(shutil.copytree(baked.path, tmp_path / "paint.mmat")))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Stands for Blender's folder of what extensions write."""

    class Resources:
        utils = type("Utils", (), {"user_resource": staticmethod(lambda _kind, path: str(tmp_path / path))})

    monkeypatch.setattr(script_files, "bpy", Resources)
    return tmp_path / "measured_materials" / "osl"


@pytest.fixture
def scene() -> Iterator[TestScene]:
    """A sphere under a lamp, of which Exact samples as it is set up."""
    with lit_sphere(None, 24, resolution=16) as made:
        made.leave_terminator()
        yield made


def worn(scene: TestScene, bundle: Bundle, *, pack: bool = True) -> bpy.types.Material:
    material = material_from(BakeResult(bundle.path, {}, 0.0), pack=pack)
    scene.show(material)
    update_scene(scene.scene)
    return material


def kept(material: bpy.types.Material) -> dict[str, bool]:
    return {effect.name: effect.kept for effect in effects_of(material)}


def switch(scene: TestScene, **options: bool) -> None:
    with bpy.context.temp_override(scene=scene.scene):
        assert bpy.ops.measured_materials.use_osl(**options) == {"FINISHED"}


def rules(scene: TestScene) -> set[str]:
    return {finding.rule for finding in check_scene(scene.scene) or ()}


def test_one_switch_builds_materials_and_sets_the_scene(scene: TestScene, bundle: Bundle) -> None:
    """Of nodes, whose textures are packed, and a script that tells which lamps are seen."""
    material = worn(scene, bundle, pack=False)
    switch(scene)
    assert is_scripted(material) and material.measured_quality.shader == "osl"
    assert scene.scene.cycles.shading_system and scene.scene.cycles.device == "CPU"
    assert material.cycles.emission_sampling == "NONE"
    found = kept(material)
    assert found["Open Shading Language"] and found["Lamps sampled in the shader"]
    assert not rules(scene) - {"lamp_table"}
    assert BRDF.cost(material).startswith("Error ")  # how long nodes with a script take was not measured
    files = [node.image for node in image_nodes(material.node_tree) if node.image.source == "FILE"]
    assert not is_one_script(material) and files and all(image.packed_file for image in files)
    scripted = scene.render(4, 2)
    twin = build_material(bundle, lamps=lamp_image(), lights=lamp_light_image(), scripted=True, pack=True)
    scene.show(twin)
    assert np.array_equal(scene.render(4, 2), scripted), "the material of the switch is another than the builder's"
    scene.show(material)
    bpy.data.materials.remove(twin)
    switch(scene, nodes=True)
    assert not is_scripted(material) and material.measured_quality.shader == "nodes"
    assert not scene.scene.cycles.shading_system


def test_where_nodes_would_sample_nothing_one_script_does(scene: TestScene, bundle: Bundle) -> None:
    """A world that is no picture, beside a lamp: nodes would aim at it and leave the lamp to the mirror."""
    material = worn(scene, bundle)
    known, record = survey_scene(scene.scene), record_of(material)
    for sample in ("auto", "always"):
        choices = Choices(shader="osl", sample=sample)
        for by_script, whole in ((sampling_of(known, scripted=True), False), (Sampling(needless="a world"), True)):
            plan = plan_brdf(record, choices, "", sampling=sampling_of(known, osl=True), by_script=by_script)
            assert plan.sample and (plan.osl, plan.scripted) == (whole, not whole)


def test_a_sheet_is_a_script_as_a_whole_whether_it_samples_or_not() -> None:
    sheet, nothing = brdf_record(**sheet_parts(through={})), Sampling(needless="a world")
    for sample, sampled in (("always", True), ("auto", False), ("never", False)):
        plan = plan_brdf(sheet, Choices(shader="osl", sample=sample), "", sampling=nothing, by_script=nothing)
        assert (plan.sample, plan.osl, plan.scripted) == (sampled, True, False)


def test_other_scripts_keep_the_language_on(scene: TestScene, bundle: Bundle) -> None:
    worn(scene, bundle)
    switch(scene)
    build_osl_material(bundle)
    switch(scene, nodes=True)
    assert scene.scene.cycles.shading_system


def test_textures_are_the_bundle_s_while_it_is_there(scene: TestScene, bundle: Bundle, folder: Path) -> None:
    material = worn(scene, bundle)
    use_osl(scene.scene)
    material.measured_quality.sample = "never"
    material.measured_quality.shader = "osl"
    assert not material.measured_quality.problem and is_scripted(material)
    assert not folder.exists()
    assert set(textures_of(material)) == set(bundle.material["images"])


def test_packed_textures_are_copied_where_the_bundle_is_gone(scene: TestScene, bundle: Bundle, folder: Path) -> None:
    material = worn(scene, bundle)
    use_osl(scene.scene)
    rebuild_brdf(material, SCRIPT, scene.scene)
    before = scene.render(8, 2)
    shutil.rmtree(bundle.path)
    rebuild_brdf(material, NODES, scene.scene)
    rebuild_brdf(material, SCRIPT, scene.scene)
    assert np.array_equal(scene.render(8, 2), before)
    files = {path.stem: path for path in folder.iterdir()}
    assert {"residual", "residual_sampler", "envelope"} <= {
        name for name, entry in bundle.material["images"].items() if entry["sha256"] in files
    }
    # A copy that somebody has changed is written anew.
    path = next(iter(files.values()))
    data = path.read_bytes()
    path.write_bytes(b"nothing")
    rebuild_brdf(material, SCRIPT, scene.scene)
    assert path.read_bytes() == data


@pytest.mark.parametrize("pack", [True, False])
def test_files_that_a_script_has_lost_are_told(scene: TestScene, bundle: Bundle, folder: Path, pack: bool) -> None:
    """Once for each material; written again where its textures are in the .blend."""
    material = worn(scene, bundle, pack=pack)
    use_osl(scene.scene)
    rebuild_brdf(material, SCRIPT, scene.scene)
    assert "missing_script_file" not in rules(scene)
    shutil.rmtree(bundle.path)
    (told,) = (found for found in check_scene(scene.scene) or () if found.rule == "missing_script_file")
    assert told.found.startswith(f"file {bundle.path}") and told.found.endswith("is not there, nor are 4 more")
    assert (told.mend is not None) is pack
    if pack:
        assert mend([told]) and "missing_script_file" not in rules(scene)
        assert len(list(folder.iterdir())) == 5


def test_textures_in_files_are_read_where_they_are(scene: TestScene, bundle: Bundle, folder: Path) -> None:
    """Another bake in the folder is not taken for this one."""
    material = worn(scene, bundle, pack=False)
    document = (bundle.path / "material.json").read_text()
    (bundle.path / "material.json").write_text("{}")
    rebuild_brdf(material, SCRIPT, scene.scene)
    assert is_scripted(material) and not folder.exists()
    (bundle.path / "material.json").write_text(document)


def test_what_is_lost_is_said_and_nothing_changes(scene: TestScene, bundle: Bundle, folder: Path) -> None:
    material = worn(scene, bundle, pack=False)
    shutil.rmtree(bundle.path)
    material.measured_quality.sample = "never"
    material.measured_quality.shader = "osl"
    assert material.measured_quality.problem and material.measured_quality.shader == "nodes"
    assert not is_scripted(material) and not folder.exists()


def test_a_folder_that_cannot_be_written_is_one_line(scene: TestScene, bundle: Bundle, folder: Path) -> None:
    material = worn(scene, bundle)
    shutil.rmtree(bundle.path)
    folder.parent.mkdir()
    folder.write_text("in the way")
    with pytest.raises(BakeError, match="OSL reads textures from files only; make room there"):
        rebuild_brdf(material, SCRIPT, scene.scene)
    assert not is_scripted(material)


@pytest.mark.parametrize("mode, scripted", [("preview", False), ("balanced", True), ("reference", True)])
def test_other_modes(scene: TestScene, bundle: Bundle, mode: str, scripted: bool) -> None:
    """Preview is native closures alone, which EEVEE shows too."""
    material = worn(scene, bundle)
    rebuild_brdf(material, Choices(mode=mode, shader="osl"), scene.scene)
    assert is_scripted(material) == scripted == kept(material)["Open Shading Language"]
    assert current_choices(material).shader == "osl"


def test_textures_of_nodes_beside_are_packed(scene: TestScene, bundle: Bundle) -> None:
    """OSL reads files of tables by mip levels that random slices lead it to."""
    worn(scene, bundle)
    beside = scene.sphere.copy()
    beside.data = scene.sphere.data.copy()
    beside.data.materials.clear()
    beside.data.materials.append(build_material(bundle, mode="reference"))
    scene.scene.collection.objects.link(beside)
    try:
        switch(scene)
        assert "osl_files" not in rules(scene)
        images = {node.image for node in image_nodes(beside.data.materials[0].node_tree)}
        assert images and all(image.packed_file for image in images)
    finally:
        bpy.data.objects.remove(beside)


def test_scripts_fitted_to_another_light_are_told(scene: TestScene, bundle: Bundle) -> None:
    material = worn(scene, bundle)
    switch(scene)
    lamp = next(obj for obj in scene.scene.objects if obj.type == "LIGHT")
    lamp.data.use_shadow = False
    update_scene(scene.scene)
    found = {finding.rule: finding for finding in check_scene(scene.scene) or ()}
    assert "no longer sampled" in found["not_sampled"].found
    assert mend([found["not_sampled"]]) and not kept(material)["Lamps sampled in the shader"]
    lamp.data.use_shadow = True
    update_scene(scene.scene)
    assert {"not_sampled"} == rules(scene)
    assert mend(check_scene(scene.scene)) and kept(material)["Lamps sampled in the shader"]


def test_scripts_that_aim_at_nothing_are_told(scene: TestScene, bundle: Bundle) -> None:
    material = worn(scene, bundle)
    lamp = next(obj for obj in scene.scene.objects if obj.type == "LIGHT")
    lamp.hide_render = True
    update_scene(scene.scene)
    use_osl(scene.scene)
    rebuild_brdf(material, Choices(mode="reference", shader="osl"), scene.scene)
    assert not rules(scene)
    lamp.hide_render = False
    update_scene(scene.scene)
    assert "not_aimed" in rules(scene)
