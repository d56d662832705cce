"""What panel, scene check and queue know of a sheet that lets light through; nothing is rendered."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from measured_materials.addon.baking.request import BakeRequest
from measured_materials.addon.lights import aim_targets
from measured_materials.addon.lights.light_tables import lamp_image, lamp_light_image, survey_scene, update_scene
from measured_materials.addon.material.adjust.energy import energy_of
from measured_materials.addon.material.bake_material import material_from
from measured_materials.addon.material.build_brdf import account_of, build_brdf
from measured_materials.addon.material.choices import Choices
from measured_materials.addon.material.facts import facts_of, keep_facts, record_of
from measured_materials.addon.material.kinds import BRDF
from measured_materials.addon.material.rebuild import effects_of, rebuild_brdf
from measured_materials.addon.material.scene_fit import SAMPLED_EFFECT
from measured_materials.addon.scene_check.check import check_scene
from measured_materials.addon.ui.background import kept_pace, tasks
from measured_materials.addon.ui.background.tasks import ImportTask
from measured_materials.addon.ui.fit_to_scene import MEASURED_MATERIALS_OT_use_osl
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.common import RenderingRecord
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.bundle.result import BakeResult
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.source import Array
from measured_materials.bake.sources.analytic import Ggx, Lambert, ThinCloth
from measured_materials.nodes.aimed_light_group import SLOTS_KEY, room_of
from measured_materials.nodes.group import trees_below
from measured_materials.nodes.lamp_light_groups import SAMPLED_KEY
from measured_materials.nodes.material import build_material
from measured_materials.nodes.material_tree import BUNDLE_KEY, measured_nodes
from measured_materials.nodes.osl_script import is_one_script, is_scripted
from support.clean_blend import clean_blend  # noqa: F401
from support.coarse_bakes import coarse  # noqa: F401
from support.osl import skip_without_osl
from support.scenes import TestScene, add_lamp, lit_sphere
from support.sheet_scenes import set_sky
from test_addon import registered  # noqa: F401
from test_sampled_sheets import add_room

CLOTH = ThinCloth((0.1, 0.1, 0.1), (0.3, 0.2, 0.1), (0.2, 0.2, 0.1), (0.4, 0.4, 0.4), 8.0)
TURNED = np.array([1.0, -1.0, -1.0])
SETTINGS = BakeSettings(resolution=8, alpha=(0.5, 0.3), sampler=SamplerLayout(n_o=16, n_h=16, n_phi=8))


@pytest.fixture(scope="module")
def baked(tmp_path_factory: pytest.TempPathFactory) -> BakeResult:
    return bake_source(CLOTH, tmp_path_factory.mktemp("cloth") / "cloth", SETTINGS)


@pytest.fixture
def cloth(baked: BakeResult, tmp_path: Path, registered: None) -> bpy.types.Material:  # noqa: F811
    path = Path(shutil.copytree(baked.path, tmp_path / "cloth.mmat"))
    return material_from(BakeResult(path, baked.facts, 0.0), pack=True)


@pytest.fixture
def scene(cloth: bpy.types.Material) -> Iterator[TestScene]:
    with lit_sphere(cloth, 24, resolution=8) as made:
        made.leave_terminator()
        update_scene(made.scene)
        yield made


def rules(scene: TestScene) -> set[str]:
    return {finding.rule for finding in check_scene(scene.scene) or ()}


@pytest.mark.parametrize("mode", ["exact", "balanced"])
def test_the_scene_check_asks_a_sheet_to_sample_lamps_where_it_can(
    cloth: bpy.types.Material, scene: TestScene, mode: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    skip_without_osl()
    rebuild_brdf(cloth, Choices(mode=mode), scene.scene)
    assert "not_sampled" not in rules(scene)  # nodes cannot before Blender 5.1
    with monkeypatch.context() as newer:
        newer.setattr(aim_targets, "can_raycast", lambda: True)
        (told,) = (found for found in check_scene(scene.scene) or () if found.rule == "not_sampled")
        assert told.why.endswith(
            "sampling leaves less than a tenth of the noise under a lamp, for " + aim_targets.GAIN_OF_SHEET.time
        )
    assert "lamp_camera" in rules(scene)
    rebuild_brdf(cloth, Choices(mode=mode, shader="osl"), scene.scene)
    update_scene(scene.scene)
    assert not rules(scene) & {"not_sampled", "not_aimed", "osl_files", "lamp_camera"}
    scripts = [n for tree in trees_below(cloth.node_tree) for n in tree.nodes if n.bl_idname == "ShaderNodeScript"]
    assert scripts and cloth.cycles.emission_sampling == "NONE"
    (sampled,) = (effect for effect in effects_of(cloth) if effect.name == SAMPLED_EFFECT)
    assert sampled.why.endswith(aim_targets.GAIN_OF_SHEET.time)
    # Whose light the tables no longer hold, its mirrors have to meet.
    lamp = next(obj for obj in scene.scene.objects if obj.type == "LIGHT")
    for group in ("apart", ""):
        lamp.lightgroup = group
        update_scene(scene.scene)
        assert ("lamp_camera" in rules(scene)) is bool(group)


def test_a_file_of_what_comes_through_that_is_lost_is_told(cloth: bpy.types.Material, scene: TestScene) -> None:
    skip_without_osl()
    rebuild_brdf(cloth, Choices(shader="osl"), scene.scene)
    assert "missing_script_file" not in rules(scene)
    (file,) = Path(cloth[BUNDLE_KEY]).glob("*_through_behind_residual.exr")
    file.unlink()
    assert "missing_script_file" in rules(scene)


def test_a_world_that_scripts_no_longer_sample_has_to_be_seen(cloth: bpy.types.Material, scene: TestScene) -> None:
    """Another picture than that which they were built for."""
    skip_without_osl()
    add_room(scene)
    update_scene(scene.scene)
    rebuild_brdf(cloth, Choices(shader="osl"), scene.scene)
    update_scene(scene.scene)
    scene.scene.world.cycles_visibility.camera = False
    assert "world_camera" not in rules(scene)
    nodes = scene.scene.world.node_tree.nodes
    shown = next(node for node in nodes if node.bl_idname == "ShaderNodeTexEnvironment")
    shown.image = shown.image.copy()
    update_scene(scene.scene)
    assert "world_camera" in rules(scene)


def test_nodes_with_an_artist_s_own_script_are_no_script(cloth: bpy.types.Material) -> None:
    trees = cloth.node_tree, measured_nodes(cloth.node_tree)[0][1].node_tree
    for tree in trees:
        tree.nodes.new("ShaderNodeScript")
    assert is_scripted(cloth) and not is_one_script(cloth)


def test_a_sheet_of_nodes_samples_two_lamps_of_four_and_is_up_to_date(
    cloth: bpy.types.Material, baked: BakeResult, scene: TestScene
) -> None:
    """With more it is black in Blender 5.2, and says so nowhere but in the log; the others the mirror finds."""
    skip_without_osl()
    for place in ((2, 0, 3), (-2, 1, 3), (0, -2, 2)):
        add_lamp(scene, "POINT", place, energy=100.0, shadow_soft_size=0.2)
    update_scene(scene.scene)
    assert survey_scene(scene.scene).slots == 4
    tables = {"lamps": lamp_image(), "lights": lamp_light_image()}
    build_material(BrdfRecord.read(read_bundle(baked.path)), cloth, mode="exact", scripted=True, pack=True, **tables)
    update_scene(scene.scene)
    groups = [tree for tree in trees_below(cloth.node_tree) if SAMPLED_KEY in tree]
    assert groups and {tree[SLOTS_KEY] for tree in groups} == {room_of(tree) for tree in groups} == {2}
    assert "lamp_table" not in rules(scene)


def test_a_sheet_tells_at_how_many_lamps_it_aims(cloth: bpy.types.Material, scene: TestScene) -> None:
    """Of nodes at two; a script at all."""
    skip_without_osl()
    places = ((1, 2, 3), (2, 1, 3))
    lamps = [add_lamp(scene, "POINT", place, energy=50, shadow_soft_size=0.1) for place in places]
    for shader, told in (("nodes", True), ("osl", False)):
        rebuild_brdf(cloth, Choices(mode="reference", shader=shader), scene.scene)
        (aimed,) = (effect for effect in effects_of(cloth) if effect.name == "Aimed light")
        assert "3 lamps" in aimed.why and ("of the lamps at the 2 that light most" in aimed.why) == told
    for lamp in lamps:
        bpy.data.objects.remove(lamp)


def test_a_sheet_is_a_script_also_where_there_is_nothing_to_sample(cloth: bpy.types.Material, scene: TestScene) -> None:
    """Under a world of no picture and no lamp; what it costs was not measured."""
    skip_without_osl()
    for obj in [obj for obj in scene.scene.objects if obj.type == "LIGHT"]:
        obj.hide_render = True
    set_sky(scene.scene)
    update_scene(scene.scene)
    for sample in ("always", "auto"):
        rebuild_brdf(cloth, Choices(sample=sample, shader="osl"), scene.scene)
        assert is_one_script(cloth) and not BRDF.cost(cloth).startswith("About")
        assert "lamp_camera" not in rules(scene)


def totals(cloth: bpy.types.Material) -> list[float]:
    """What leaves either side, of the light that comes from both: the most of all angles and channels."""
    record = record_of(cloth)
    parts = {"": record, **record.sheet.parts}
    sides = ("", "through"), ("behind", "through_behind")
    return [float(sum(np.array(parts[name].albedo.directional) for name in side).max()) for side in sides]


def test_light_of_both_kinds_counts_on_the_worse_side(cloth: bpy.types.Material, scene: TestScene) -> None:
    (node,) = (node for _, node in measured_nodes(cloth.node_tree))
    front, back = totals(cloth)
    assert front == pytest.approx(0.7, abs=0.03) and back == pytest.approx(0.9, abs=0.03)
    assert energy_of(cloth) is None
    node.inputs["Brightness"].default_value = 1.05
    assert not energy_of(cloth).gains
    node.inputs["Brightness"].default_value = 1.3
    found = energy_of(cloth)
    assert found.gains and found.largest == pytest.approx(1.3 * back, rel=1e-5)
    assert found.words.startswith("The material reflects and lets through up to 1.")
    (told,) = (finding for finding in check_scene(scene.scene) or () if finding.rule == "too_bright")
    assert "reflects and lets through" in told.why
    assert told.mend is not None
    told.mend()
    assert not energy_of(cloth).gains
    assert node.inputs["Brightness"].default_value == pytest.approx(1 / back, abs=1e-3)
    facts = facts_of(cloth)
    keep_facts(cloth, {**facts, "sheet": {"alike": True, "through": facts["sheet"]["through"]}})
    node.inputs["Brightness"].default_value = 1.3
    assert not energy_of(cloth).gains and energy_of(cloth).largest == pytest.approx(1.3 * front, rel=1e-5)


def test_what_gloss_adds_to_the_back_is_told(cloth: bpy.types.Material) -> None:
    (node,) = (node for _, node in measured_nodes(cloth.node_tree))
    facts, (_, back) = facts_of(cloth), totals(cloth)
    count = len(record_of(cloth).albedo.theta_o_deg)
    gained = [[1.0, [[0.0] * 3] * count], [4.0, [[1.2 - back] * 3] * count]]
    keep_facts(cloth, {**facts, "rendering": {**facts["rendering"], "brightened_behind": gained}})
    assert energy_of(cloth) is None
    node.inputs["Gloss"].default_value = 4.0
    assert energy_of(cloth).largest == pytest.approx(1.2, abs=1e-5)
    keep_facts(cloth, {**facts, "rendering": {**facts["rendering"], "brightened": gained}})
    assert not energy_of(cloth).gains


class Foil:
    """Matt in front, and a sharper highlight behind; hardly anything goes through."""

    name, isotropic, bilateral, alike = "foil", True, True, False
    facts: dict[str, Any] = {}
    front, back = Lambert((0.3, 0.3, 0.3)), Ggx()

    def evaluate(self, wi: Array, wo: Array) -> Array:
        return self.front.evaluate(wi, wo)

    def reflected_behind(self, wi: Array, wo: Array) -> Array:
        return self.back.evaluate(wi * TURNED, wo * TURNED)

    def transmitted(self, wi: Array, wo: Array) -> Array:
        across = (wi[..., 2:] > 0) != (wo[..., 2:] > 0)
        return np.where(across, np.full(3, 0.01), 0)


def test_a_material_knows_what_its_back_gains_by_gloss(tmp_path: Path) -> None:
    """Of closures that its front has not."""
    record = BrdfRecord.read(read_bundle(bake_source(Foil(), tmp_path / "foil", SETTINGS).path))
    for mode in ("preview", "exact"):
        _, plan = build_brdf(record, choices=Choices(mode=mode))
        told = RenderingRecord.parse(account_of(Choices(mode=mode), plan))
        assert told.brightened == () and np.max(dict(told.brightened_behind)[4.0]) > 0.005
    _, plan = build_brdf(record, choices=Choices(mode="reference"))
    assert "brightened_behind" not in account_of(Choices(mode="reference"), plan)


def test_a_sheet_is_offered_what_any_brdf_is(cloth: bpy.types.Material) -> None:
    for mode, names in (
        ("preview", ("mode",)),
        ("exact", ("mode", "aim", "sample", "residual", "filter", "shader")),
        ("balanced", ("mode", "aim", "sample", "residual", "filter", "shader")),
        ("reference", ("mode", "aim", "filter", "shader")),
    ):
        cloth.measured_quality.mode = mode
        assert BRDF.effective(cloth) == names


def test_the_time_of_a_sheet_s_bake_teaches_nothing(
    cloth: bpy.types.Material, baked: BakeResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It has up to four parts, and other bakes one."""
    kept: list[Any] = []
    monkeypatch.setattr(tasks, "learn_pace", lambda *told: kept.append(told))
    monkeypatch.setattr(kept_pace, "keep", lambda: None)
    task = ImportTask(BakeRequest(tmp_path / "x.xml", SETTINGS), tmp_path, "x", True, None, lambda _: None)
    task.learn(BakeResult(baked.path, baked.facts, 60.0), cloth)
    assert not kept
    keep_facts(cloth, {key: value for key, value in facts_of(cloth).items() if key != "sheet"})
    task.learn(BakeResult(baked.path, baked.facts, 60.0), cloth)
    assert kept == [(SETTINGS, 60.0)]


def test_only_what_is_a_script_is_counted_as_one(scene: TestScene, cloth: bpy.types.Material, tmp_path: Path) -> None:
    """A sheet, and what has no mirror, which stays of nodes."""
    skip_without_osl()
    plain = material_from(bake_source(Lambert(), tmp_path / "plain.mmat", SETTINGS), pack=False, mode="preview")
    scene.sphere.data.materials.append(plain)
    told: list[str] = []

    def switch(nodes: bool) -> str:
        operator: Any = SimpleNamespace(nodes=nodes, report=lambda _, text: told.append(text))
        context: Any = SimpleNamespace(scene=scene.scene)
        assert MEASURED_MATERIALS_OT_use_osl.execute(operator, context) == {"FINISHED"}
        return told[-1]

    one, by = "1 material built as an OSL script", "to be rendered on the CPU"
    assert switch(nodes=False) == f"{one}: {by}; 1 material stays of nodes"
    plain.measured_quality.mode = "reference"
    assert switch(nodes=False) == f"2 materials built as OSL scripts: {by}"
    assert switch(nodes=True) == "2 materials built as nodes"
    scene.sphere.data.materials.pop(index=0)
    assert switch(nodes=False) == f"{one}: {by}"
    scene.sphere.data.materials.clear()
    assert switch(nodes=False) == "0 materials built as OSL scripts"
