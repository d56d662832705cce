"""Changes to a scene of the check, of which each puts one rule to the test."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
from measured_materials.addon.lights.light_tables import update_scene

from support.light_paths import darken
from support.scene_check_cases import (
    another_lamp,
    cycles,
    lamp_of,
    material_of,
    table_image,
)
from support.scenes import TestScene

Change = Callable[[TestScene], Any]

IMAGES = 64  # texels along the longest edge that the test shrinks tables by


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
        scene.set_terminator(kind, value)

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


# --- sheets -----------------------------------------------------------------------------------------------------------


def lamp_seen_by(rays: str, seen: bool) -> Change:
    def apply(scene: TestScene) -> None:
        setattr(lamp_of(scene), f"visible_{rays}", seen)
        update_scene(scene.scene)

    return apply


def world_rays(rays: str, seen: bool) -> Change:
    def apply(scene: TestScene) -> None:
        setattr(scene.scene.world.cycles_visibility, rays, seen)
        update_scene(scene.scene)

    return apply


def card_only(scene: TestScene) -> None:
    """The sheet is flat, with camera and lamp on the same side of it."""
    mesh = bpy.data.meshes.new("card")
    mesh.from_pydata([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [], [(0, 1, 2, 3)])
    mesh.materials.append(material_of(scene))
    scene.sphere.data = mesh
    towards = lamp_of(scene).location + scene.scene.camera.location
    scene.sphere.rotation_mode = "QUATERNION"
    scene.sphere.rotation_quaternion = towards.to_track_quat("Z", "Y")
    update_scene(scene.scene)


def film(transparent: bool, glass: bool = False) -> Change:
    def apply(scene: TestScene) -> None:
        scene.scene.render.film_transparent = transparent
        scene.scene.cycles.film_transparent_glass = glass

    return apply


def ground_catches(caught: bool) -> Change:
    def apply(scene: TestScene) -> None:
        next(o for o in scene.scene.objects if o.type == "MESH" and o != scene.sphere).is_shadow_catcher = caught

    return apply


def layer_shows(name: str, shown: bool | float) -> Change:
    return lambda scene: setattr(scene.scene.view_layers[0], name, shown)
