"""The scene check: every rule where it fires and where not, its fix, and which materials count."""

# ruff: noqa: F811  (fixtures of another module, asked for by their names)

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import measured_materials
import pytest
from measured_materials.addon.lights.light_tables import lamp_image, update_scene
from measured_materials.addon.scene_check import material_rules, pass_rules, scene_rules
from measured_materials.addon.scene_check.check import check_scene, measured_names, mend, mend_scene
from measured_materials.addon.scene_check.findings import NOTE, SLOW, WRONG, Finding
from measured_materials.addon.ui.panels import check_scene as check_operator
from measured_materials.addon.ui.panels.wrapped_text import Lines
from measured_materials.bake.bundle.bundle import Bundle
from measured_materials.nodes.aimed_light_group import SLOTS_KEY
from measured_materials.nodes.group import HASH_KEY, SWITCHED_KEY, content_hash
from measured_materials.nodes.material import build_material
from support.checked_scenes import bundle, clean_blend, painted  # noqa: F401
from support.scene_check_cases import (
    CASES,
    Case,
    another_lamp,
    clear_blend,
    cycles,
    lamp,
    lamp_of,
    material_of,
    rules,
)
from support.scenes import TestScene, diffuse_material, lit_sphere

# --- every rule -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("case", CASES, ids=[f"{case.rule}-{k}" for k, case in enumerate(CASES)])
def test_rule(painted: TestScene, case: Case) -> None:
    """Silent before, reported after, silent again when fixed."""
    assert not rules(painted)
    case.spoil(painted)
    found = rules(painted)[case.rule]
    assert found.severity == case.severity
    assert (found.mend is not None) == case.mendable
    assert "\n" not in found.line and found.why and found.found
    if case.mendable:
        assert mend([found]) == [found]
        assert case.rule not in rules(painted)


def test_every_rule_has_a_case() -> None:
    told = {setting.rule for setting in scene_rules._SETTINGS}
    for module in (scene_rules, material_rules, pass_rules):
        told |= set(re.findall(r'Finding\(\s*"(\w+)"', Path(str(module.__file__)).read_text()))
    assert len(told) > 25
    assert told - {case.rule for case in CASES} == {
        "adaptive_sampling",
        "pixel_jitter",
        "linked_slots",
        "not_aimed",
        "not_sampled",
        "emission_sampling",
        *NEWER,
    }


NEWER = {"texture_resolution", "world_shadow"}


def test_settings_of_newer_versions(painted: TestScene) -> None:
    """Blender 5.2 has three more; stand-ins answer for it here."""
    scene = painted.scene
    newer = SimpleNamespace(texture_resolution_render=0.5, use_pixel_jitter=True, id_data=scene)
    world = SimpleNamespace(
        name="w",
        node_tree=None,
        cycles_visibility=scene.world.cycles_visibility,
        cycles=SimpleNamespace(sampling_method="AUTOMATIC", use_shadows=False),
    )
    stand_in = SimpleNamespace(
        name="s", cycles=newer, world=world, render=SimpleNamespace(use_simplify=True), blur_glossy=0
    )
    subject: Any = SimpleNamespace(scene=stand_in, wearers={})
    found = [
        *scene_rules.cycles_settings(subject),
        *scene_rules.world(subject),
        *material_rules.texture_limit(subject),
    ]
    assert {finding.rule for finding in found} == {"pixel_jitter", *NEWER}
    mend(found)
    assert newer.use_pixel_jitter is False and newer.texture_resolution_render == 1


def test_shadow_terminator_of_older_versions() -> None:
    """Before Blender 4.4 it is among Cycles' settings of the object."""
    settings = SimpleNamespace(shadow_terminator_offset=0.2, shadow_terminator_geometry_offset=0.1)
    obj = SimpleNamespace(name="o", cycles=settings, is_editable=True)
    settings.id_data = obj
    subject: Any = SimpleNamespace(scene=SimpleNamespace(name="s"), shown=[obj])
    found = list(material_rules.shadow_terminator(subject))
    assert [finding.rule for finding in found] == ["shading_offset", "geometry_offset"]
    mend(found)
    assert settings.shadow_terminator_offset == settings.shadow_terminator_geometry_offset == 0


@pytest.mark.parametrize(
    "threshold, least, told", [(0.01, 0, False), (0.1, 0, True), (0.01, 4, True), (0.1, 64, False)]
)
def test_adaptive_sampling(painted: TestScene, threshold: float, least: int, told: bool) -> None:
    settings = painted.scene.cycles
    settings.use_adaptive_sampling = True
    settings.adaptive_threshold, settings.adaptive_min_samples = threshold, least
    assert ("adaptive_sampling" in rules(painted)) is told
    mend_scene(painted.scene)
    assert "adaptive_sampling" not in rules(painted)


def test_what_is_hidden_from_all_rays_is_meant_to_be(painted: TestScene) -> None:
    obj = lamp_of(painted)
    obj.visible_glossy = obj.visible_diffuse = False
    update_scene(painted.scene)
    assert not rules(painted)


def test_lamps_that_give_no_light_do_not_matter(painted: TestScene) -> None:
    another_lamp("POINT", energy=0, shadow_soft_size=0.0)(painted)
    another_lamp("POINT", energy=9, shadow_soft_size=0.0)(painted)
    bpy.data.objects["POINT.001"].hide_render = True
    assert not rules(painted)


def test_mending_all_leaves_notes(painted: TestScene) -> None:
    cycles("blur_glossy", 1.0)(painted)
    cycles("use_denoising", True)(painted)
    lamp("size", 0.0)(painted)
    mended = [finding.rule for finding in mend_scene(painted.scene)]
    # Given a size, the lamp can be aimed at, which makes the table an old one.
    assert sorted(mended[:2]) == ["filter_glossy", "lamp_size"] and set(mended[2:]) <= {"lamp_table"}
    assert set(rules(painted)) == {"denoising"}
    assert not mend_scene(painted.scene)


# --- which materials count --------------------------------------------------------------------------------


def test_a_scene_without_measured_materials_says_so(bundle: Bundle) -> None:
    build_material(bundle, lamps=lamp_image())
    with lit_sphere(diffuse_material(), 16) as scene:
        scene.scene.cycles.blur_glossy = 1
        assert check_scene(scene.scene) is None and not mend_scene(scene.scene)
        assert scene.scene.cycles.blur_glossy == 1


def test_hidden_objects_do_not_count_and_instances_do(painted: TestScene) -> None:
    sphere, scene = painted.sphere, painted.scene
    sphere.hide_render = True
    assert check_scene(scene) is None
    sphere.hide_render = False
    collection = bpy.data.collections.new("kept apart")
    collection.objects.link(sphere)
    scene.collection.objects.unlink(sphere)
    assert check_scene(scene) is None
    instance = bpy.data.objects.new("instance", None)
    instance.instance_type, instance.instance_collection = "COLLECTION", collection
    scene.collection.objects.link(instance)
    assert measured_names(scene) == [material_of(painted).name]
    scene.collection.objects.link(sphere)


def test_a_group_within_a_group_counts(painted: TestScene) -> None:
    tree = material_of(painted).node_tree
    outer = bpy.data.node_groups.new("outer", "ShaderNodeTree")
    node = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeGroup")
    outer.nodes.new("ShaderNodeGroup").node_tree = node.node_tree
    node.node_tree = outer
    assert check_scene(painted.scene) is not None


def test_mode_preview_needs_no_mirror(bundle: Bundle) -> None:
    with lit_sphere(build_material(bundle, mode="preview"), 16) as scene:
        scene.scene.cycles.blur_glossy = 1
        assert check_scene(scene.scene) == []
        next(i for i in bpy.data.images if "preview" in i.name).alpha_mode = "STRAIGHT"
        assert set(rules(scene)) == {"alpha_mode"}


def test_linked_materials_are_told_and_left_alone(bundle: Bundle, tmp_path: Path) -> None:
    material = build_material(bundle)
    material.cycles.use_bump_map_correction = True
    library = tmp_path / "library.blend"
    bpy.data.libraries.write(str(library), {material})
    bpy.data.materials.remove(material)
    with bpy.data.libraries.load(str(library), link=True) as (source, target):
        target.materials = source.materials
    with lit_sphere(target.materials[0], 16) as scene:
        scene.leave_terminator()
        found = rules(scene)
        assert set(found) == {"bump_correction"} and found["bump_correction"].mend is None
        assert not mend_scene(scene.scene)


@pytest.mark.parametrize("has_room", [True, False])
def test_linked_groups_with_too_few_slots(bundle: Bundle, tmp_path: Path, has_room: bool) -> None:
    """Built under one lamp there, used under two here: a group with room follows, an older one is reported."""
    library = tmp_path / "library.blend"
    with lit_sphere(build_material(bundle, lamps=lamp_image()), 16) as scene:
        update_scene(scene.scene)
        for tree in bpy.data.node_groups if not has_room else ():
            if SLOTS_KEY in tree:
                del tree[SWITCHED_KEY]
                tree[HASH_KEY] = content_hash(tree)
        bpy.data.libraries.write(str(library), {material_of(scene)})
    clear_blend()
    with bpy.data.libraries.load(str(library), link=True) as (source, target):
        target.materials = source.materials
    with lit_sphere(target.materials[0], 16) as scene:
        scene.leave_terminator()
        another_lamp("POINT", energy=9, shadow_soft_size=0.1)(scene)
        found = rules(scene)
        if has_room:
            assert not found  # the handlers have seen to it
            assert {tree[SLOTS_KEY] for tree in bpy.data.node_groups if SLOTS_KEY in tree and tree.users} == {2}
            return
        assert set(found) == {"linked_slots"} and found["linked_slots"].mend is None
        assert "made local" in found["linked_slots"].wanted
        lamp_of(scene).location.x += 1
        assert [finding.rule for finding in mend_scene(scene.scene)] == ["lamp_table"]
        assert set(rules(scene)) == {"linked_slots"}


def test_instances_of_every_view_layer_count(painted: TestScene) -> None:
    """A material that only geometry nodes bring, in the second layer."""
    collection = bpy.data.collections.new("apart")
    painted.scene.collection.children.link(collection)
    painted.scene.view_layers.new("second")
    painted.scene.view_layers[0].layer_collection.children["apart"].exclude = True
    tree = bpy.data.node_groups.new("set", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    nodes = [tree.nodes.new(k) for k in ("NodeGroupInput", "GeometryNodeSetMaterial", "NodeGroupOutput")]
    for source, target in pairwise(nodes):
        tree.links.new(source.outputs[0], target.inputs[0])
    nodes[1].inputs["Material"].default_value = material_of(painted)
    mesh = painted.sphere.data.copy()
    mesh.materials.clear()
    dressed = bpy.data.objects.new("dressed", mesh)
    dressed.modifiers.new("set", "NODES").node_group = tree
    collection.objects.link(dressed)
    painted.sphere.hide_render = True
    assert measured_names(painted.scene) == [material_of(painted).name]


# --- in the window ----------------------------------------------------------------------------------------


class Layout:
    """Notes what is drawn; stands in for all of its parts."""

    def __init__(self, texts: list[str]) -> None:
        self.texts = texts

    def split(self, *, factor: float) -> Layout:
        return self

    def separator(self) -> None:
        pass

    def row(self, **_: Any) -> Layout:
        return self

    column = row

    def label(self, *, text: str, icon: str) -> None:
        self.texts.append(text)

    def operator(self, name: str, **_: Any) -> Any:
        self.texts.append(name)
        return SimpleNamespace()


def test_operators_and_list(painted: TestScene) -> None:
    measured_materials.register()
    try:
        cycles("blur_glossy", 1.0)(painted)
        cycles("sample_clamp_indirect", 10.0)(painted)
        with bpy.context.temp_override(scene=painted.scene):
            ops = bpy.ops.measured_materials
            assert ops.check_scene() == {"FINISHED"}
            assert painted.scene.cycles.blur_glossy == 1
            texts: list[str] = []
            check_operator.draw_findings(Layout(texts), Lines(bpy.context))
            assert texts.count(check_operator.MEASURED_MATERIALS_OT_mend_setting.bl_idname) == 2
            assert "Filter Glossy is 1, should be 0" in " ".join(texts)
            assert ops.mend_setting(key=rules(painted)["filter_glossy"].key) == {"FINISHED"}
            assert set(rules(painted)) == {"clamp_indirect"}
            assert ops.mend_setting(key="filter_glossy scene gone") == {"CANCELLED"}
            assert ops.check_scene(mend=True) == {"FINISHED"}
        assert not rules(painted)
    finally:
        measured_materials.unregister()


def test_summary() -> None:
    def found(severity: str) -> Finding:
        return Finding("r", severity, "w", "f", "", "y")

    assert "no measured material" in check_operator.summary(None)
    assert "Nothing biases" in check_operator.summary([found(NOTE)])
    assert check_operator.summary([found(WRONG), found(WRONG), found(SLOW)]).startswith("2 settings bias and 1 setting")
