"""Every rule of the scene check just past what it reports, and just short of it, unmasked by other settings."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
from measured_materials.addon.lights.light_tables import update_scene
from measured_materials.addon.scene_check import (
    camera_rules,
    light_path_rules,
    material_rules,
    mix_rules,
    pass_rules,
    scene_rules,
)
from measured_materials.nodes import compat

from support.light_paths import darken
from support.scene_check_cases import (
    another_lamp,
    cycles,
    image_world,
    lamp_of,
    material_of,
    mixed,
    scripted,
    shadow_linked,
    shrunk,
    table_image,
)
from support.scenes import TestScene

Change = Callable[[TestScene], Any]
MODULES = (scene_rules, light_path_rules, material_rules, mix_rules, camera_rules, pass_rules)
STOP = 0.4392  # at which 50 mm that focus at 2.53 blur over one of 32 pixels of 36 mm
IMAGES = 64  # texels along the longest edge that the test shrinks tables by


@dataclass(frozen=True)
class Edge:
    """A rule's two sides.

    Parameters
    ----------
    past : the least change that is reported, of a scene that the check has nothing to say about
    short : the largest that is not, or what takes the reason away while the setting stays; applied after `past`, which
        it undoes, or to a scene of its own where `anew`
    """

    rule: str
    past: Change
    short: Change
    anew: bool = False


def both(*changes: Change) -> Change:
    def apply(scene: TestScene) -> None:
        for change in changes:
            change(scene)

    return apply


def lamp_value(name: str, value: Any) -> Change:
    return lambda scene: setattr(lamp_of(scene).data, name, value)


def lamp_object(name: str, value: Any) -> Change:
    return lambda scene: setattr(lamp_of(scene), name, value)


def dark_lamp(scene: TestScene) -> None:
    """Its other settings do not matter then."""
    lamp_of(scene).data.energy = 0.0
    update_scene(scene.scene)


def seen_by(glossy: bool, diffuse: bool) -> Change:
    def apply(scene: TestScene) -> None:
        lamp_of(scene).visible_glossy, lamp_of(scene).visible_diffuse = glossy, diffuse
        update_scene(scene.scene)

    return apply


def world_seen_by(glossy: bool, diffuse: bool) -> Change:
    def apply(scene: TestScene) -> None:
        visibility = scene.scene.world.cycles_visibility
        visibility.glossy, visibility.diffuse = glossy, diffuse
        update_scene(scene.scene)

    return apply


def sphere_seen_by(glossy: bool, diffuse: bool) -> Change:
    def apply(scene: TestScene) -> None:
        scene.sphere.visible_glossy, scene.sphere.visible_diffuse = glossy, diffuse

    return apply


def haze(output: str) -> Change:
    """A volume in the world that is there where an output of Light Path is not above 0.5."""

    def apply(scene: TestScene) -> None:
        tree = scene.scene.world.node_tree
        volume = tree.nodes.new("ShaderNodeVolumeAbsorption")
        tree.links.new(volume.outputs[0], tree.get_output_node("CYCLES").inputs["Volume"])
        darken(tree, volume.inputs["Density"], output, 0.5)
        scene.scene.cycles.min_light_bounces = 1024
        update_scene(scene.scene)

    return apply


def adaptive(least: int, samples: int, threshold: float = 0.01) -> Change:
    return both(
        cycles("use_adaptive_sampling", True),
        cycles("adaptive_threshold", threshold),
        cycles("adaptive_min_samples", least),
        cycles("samples", samples),
    )


def lamps_moved(by: float) -> Change:
    def apply(scene: TestScene) -> None:
        lamp_of(scene).location.x += by

    return apply


def far(distance: float) -> Change:
    def apply(scene: TestScene) -> None:
        scene.sphere.matrix_world.translation = (distance, 0, 0)
        update_scene(scene.scene)

    return apply


def terminator(kind: int, value: float) -> Change:
    """1 for the shading's, 2 for the geometry's."""

    def apply(scene: TestScene) -> None:
        owner, *names = compat.shadow_terminator(scene.sphere)
        setattr(owner, names[kind - 1], value)

    return apply


def without_light_tree(scene: TestScene) -> None:
    scene.scene.cycles.use_light_tree = False


def without_lamps(scene: TestScene) -> None:
    bpy.data.objects.remove(lamp_of(scene))
    update_scene(scene.scene)


def texture_limit(scene: TestScene, limit: str) -> None:
    scene.scene.render.use_simplify = True
    scene.scene.cycles.texture_limit_render = limit


def largest_texture() -> int:
    return max(max(image.size) for image in bpy.data.images if image.size[0])


def just_large_enough(scene: TestScene) -> None:
    """The smallest of Cycles' limits that shrinks nothing."""
    texture_limit(scene, str(next(limit for limit in (128, 256, 512, 1024, 2048) if limit >= largest_texture())))


def packed(scene: TestScene) -> None:
    for image in bpy.data.images:
        if image.source == "FILE":
            image.pack()


def lost_but_packed(scene: TestScene) -> None:
    packed(scene)
    table_image(scene).filepath = "//gone/nothing.exr"


def lost(scene: TestScene) -> None:
    table_image(scene).filepath = "//gone/nothing.exr"


def colour_space(name: str) -> Change:
    return lambda scene: setattr(table_image(scene).colorspace_settings, "name", name)


def moved_nodes(scene: TestScene) -> None:
    """Where a node stands in the editor is not what a group is."""
    tree = measured_tree(scene)
    tree.nodes[0].location.x += 100
    tree.nodes[0].label = "moved"


def changed_value(scene: TestScene) -> None:
    """By the last bit that matters to an artist: one number of one node."""
    tree = measured_tree(scene)
    node = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeMath" and not n.inputs[1].is_linked)
    node.inputs[1].default_value += 0.01


def measured_tree(scene: TestScene) -> Any:
    from measured_materials.addon.scene_check.findings import measured_trees

    return measured_trees(material_of(scene))[0]


def added(second: bool) -> Change:
    """An Add Shader of the material with nothing, or with another."""

    def apply(scene: TestScene) -> None:
        tree = material_of(scene).node_tree
        group = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeGroup")
        add = tree.nodes.new("ShaderNodeAddShader")
        target = group.outputs["BSDF"].links[0].to_socket
        tree.links.new(group.outputs["BSDF"], add.inputs[0])
        tree.links.new(add.outputs[0], target)
        if second:
            tree.links.new(tree.nodes.new("ShaderNodeBsdfDiffuse").outputs[0], add.inputs[1])

    return apply


def volume(bounces_short: int) -> Change:
    """Cycles' least number of bounces, so many short of the largest, with a volume in the world."""

    def apply(scene: TestScene) -> None:
        tree = scene.scene.world.node_tree
        output = tree.get_output_node("CYCLES")
        tree.links.new(tree.nodes.new("ShaderNodeVolumeScatter").outputs[0], output.inputs["Volume"])
        scene.scene.cycles.min_light_bounces = scene.scene.cycles.max_bounces - bounces_short

    return apply


def world_nodes(output: str) -> Change:
    def apply(scene: TestScene) -> None:
        tree = scene.scene.world.node_tree
        strength = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeBackground").inputs["Strength"]
        darken(tree, strength, output, 0.5)
        update_scene(scene.scene)

    return apply


def lamp_nodes(output: str) -> Change:
    def apply(scene: TestScene) -> None:
        data = lamp_of(scene).data
        data.use_nodes = True
        strength = next(n for n in data.node_tree.nodes if n.bl_idname == "ShaderNodeEmission").inputs["Strength"]
        darken(data.node_tree, strength, output, 0.5)
        update_scene(scene.scene)

    return apply


def ground_emits(output: str) -> Change:
    """The matte ground glows, and is told apart by rays."""

    def apply(scene: TestScene) -> None:
        ground = next(o for o in scene.scene.objects if o.type == "MESH" and o != scene.sphere)
        tree = ground.data.materials[0].node_tree
        shader = tree.nodes.new("ShaderNodeEmission")
        tree.links.new(shader.outputs[0], tree.get_output_node("CYCLES").inputs["Surface"])
        darken(tree, shader.inputs["Strength"], output, 0.5)

    return apply


def scaled(x: float, y: float, **settings: Any) -> Change:
    """An area lamp whose object is scaled."""

    def apply(scene: TestScene) -> None:
        another_lamp("AREA", energy=2, **settings)(scene)
        bpy.data.objects["AREA"].scale = (x, y, 1)
        update_scene(scene.scene)

    return apply


def bounces(name: str, value: int, diffuse: int) -> Change:
    """With so few diffuse bounces that they do not hide the rule's own least."""
    return both(cycles("diffuse_bounces", diffuse), cycles(name, value))


def of_the_camera(kind: str, depth_of_field: bool, stop: float = 64.0) -> Change:
    def apply(scene: TestScene) -> None:
        data = scene.scene.camera.data
        data.type, data.dof.use_dof, data.dof.aperture_fstop = kind, depth_of_field, stop

    return apply


def sampled_by_chance(scene: TestScene) -> None:
    """A smooth sky has no bright places to miss."""
    scene.scene.world.cycles.sampling_method = "NONE"


EDGES = [
    *(
        Edge(rule, cycles(name, 0.01), cycles(name, 0.0))
        for rule, name in (
            ("filter_glossy", "blur_glossy"),
            ("clamp_direct", "sample_clamp_direct"),
            ("clamp_indirect", "sample_clamp_indirect"),
        )
    ),
    *(
        Edge(name, bounces(name, least - 1, diffuse), bounces(name, least, diffuse))
        for name in ("glossy_bounces", "max_bounces")
        for diffuse, least in ((0, 4), (4, 4), (7, 7))
    ),
    Edge("adaptive_sampling", adaptive(31, 64), adaptive(32, 64)),
    Edge("adaptive_sampling", adaptive(4, 32), adaptive(4, 31)),
    # Cycles' own choice is 16 / threshold^0.3: 31.9 and 32.1.
    Edge("adaptive_sampling", adaptive(0, 64, 0.1001), adaptive(0, 64, 0.0985)),
    Edge("light_tree", without_light_tree, both(without_light_tree, without_lamps)),
    Edge("world_glossy", world_seen_by(False, True), world_seen_by(False, False)),
    Edge("world_diffuse", world_seen_by(True, False), world_seen_by(False, False)),
    Edge("lamp_glossy", seen_by(False, True), seen_by(False, False)),
    Edge("lamp_diffuse", seen_by(True, False), seen_by(False, False)),
    Edge("hidden_objects", sphere_seen_by(False, True), sphere_seen_by(False, False)),
    Edge("world_sampling", image_world, sampled_by_chance, anew=True),
    *(
        Edge(rule, spoil, both(spoil, dark_lamp))
        for rule, spoil in (
            ("lamp_shadow", lamp_value("use_shadow", False)),
            ("shadow_linking", shadow_linked),
            ("lamp_mis", lambda s: setattr(lamp_of(s).data.cycles, "use_multiple_importance_sampling", False)),
            ("lamp_size", lamp_value("size", 0.0)),
        )
    ),
    Edge(
        "lamp_size", another_lamp("SUN", energy=2, angle=1e-5), another_lamp("SUN", energy=2, angle=1.1e-5), anew=True
    ),
    Edge(
        "lamp_size",
        another_lamp("POINT", energy=2, shadow_soft_size=0.0),
        another_lamp("POINT", energy=2, shadow_soft_size=1e-4),
        anew=True,
    ),
    *(
        Edge(
            "lamp_size",
            another_lamp("AREA", energy=2, shape=shape, size=size, size_y=0.0),
            another_lamp("AREA", energy=2, shape=shape, size=0.01, size_y=least),
            anew=True,
        )
        # A square and a disk have one size only.
        for shape, size, least in (("RECTANGLE", 1, 0.01), ("ELLIPSE", 1, 0.01), ("SQUARE", 0, 0), ("DISK", 0, 0))
    ),
    *(
        Edge("lamp_size", scaled(x, y, size=1.0), scaled(max(x, 1e-3), max(y, 1e-3), size=1.0), anew=True)
        for x, y in ((0, 1), (1, 0))
    ),
    Edge("lamp_table", lamps_moved(1e-2), lamps_moved(1e-6), anew=True),
    Edge("shading_offset", terminator(1, 0.01), terminator(1, 0.0)),
    Edge("geometry_offset", terminator(2, 0.01), terminator(2, 0.0)),
    Edge("colour_space", colour_space("Linear Rec.709"), colour_space("Non-Color")),
    Edge("missing_texture", lost, lost_but_packed, anew=True),
    Edge("texture_limit", shrunk, just_large_enough),
    Edge("changed_group", changed_value, moved_nodes, anew=True),
    Edge("far_away", far(10_001.0), far(9_999.0)),
    Edge("osl_files", cycles("shading_system", True), both(packed, cycles("shading_system", True))),
    Edge("osl_off", scripted, both(scripted, cycles("shading_system", True), packed)),
    Edge("osl_gpu", both(scripted, cycles("device", "GPU")), both(scripted, cycles("device", "CPU"))),
    *(
        Edge("mixed_mirror", lambda s, k=share: mixed(s, k), lambda s, k=whole: mixed(s, k), anew=True)
        for share, whole in ((0.01, 0.0), (0.99, 1.0))
    ),
    Edge("added_mirror", added(True), added(False), anew=True),
    Edge("volume_roulette", volume(1), volume(0)),
    Edge("volume_light_path", haze("Is Shadow Ray"), haze("Is Camera Ray"), anew=True),
    Edge("world_light_path", world_nodes("Ray Depth"), world_nodes("Is Camera Ray"), anew=True),
    Edge("lamp_light_path", lamp_nodes("Ray Depth"), lamp_nodes("Is Glossy Ray"), anew=True),
    Edge("quiet_camera", of_the_camera("PERSP", False), of_the_camera("PANO", False)),
    Edge("quiet_camera", of_the_camera("ORTHO", False), of_the_camera("ORTHO", True)),
    *(Edge("uneven_samples", cycles("samples", samples), cycles("samples", 64)) for samples in (63, 65, 100)),
    Edge(
        "uneven_samples",
        both(cycles("samples", 100), of_the_camera("PERSP", True, STOP * 1.02)),
        of_the_camera("PERSP", True, STOP * 0.98),
    ),
    Edge("emission_light_path", ground_emits("Is Glossy Ray"), ground_emits("Ray Depth"), anew=True),
]
# A switch has no value between: a scene that is as it should be is the other side, which every case starts from.
SWITCHES = {
    "reflective_caustics", "fast_gi", "path_guiding", "denoising", "engine", "bump_correction", "alpha_mode",
    "normal_pass", "denoising_data",
}  # fmt: skip
# Held from both sides by tests of their own.
ELSEWHERE = {
    "common_names": "tests/test_texture_files.py",
    "wrong_texture": "tests/test_texture_files.py",
    "no_texture": "test_scene_check.py, a texture is there or not",
    "linked_slots": "test_linked_groups_with_too_few_slots_are_told_and_left_alone",
    "not_aimed": "test_modes.py, of a material fitted to no lamps",
    "not_sampled": "test_sampled_lamps.py, of a file of a newer Blender",
    "emission_sampling": "test_sampled_lamps.py, of a file of a newer Blender",
    "pixel_jitter": "test_settings_of_newer_versions",
    "texture_resolution": "test_settings_of_newer_versions",
    "world_shadow": "test_settings_of_newer_versions",
}


def told_rules() -> set[str]:
    """Names of all rules, from the code that reports them."""
    told = {setting.rule for setting in scene_rules._SETTINGS}
    told |= {"glossy_bounces", "max_bounces"}  # named by their setting
    for module in MODULES:
        for name in re.findall(r'Finding\(\s*f?"([\w{}]+)"', Path(str(module.__file__)).read_text()):
            kinds = ("world", "lamp", "emission") if "kind" in name else ("world", "lamp")
            told |= {name.format(kind=kind, rule=kind) for kind in kinds}
    return told
