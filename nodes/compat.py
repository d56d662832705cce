"""Everything that differs between Blender 4.2 and 5.x, in one place."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import bpy


def blender_version() -> tuple[int, int]:
    """Major and minor version of the running Blender, e.g. (4, 5)."""
    return bpy.app.version[0], bpy.app.version[1]


def is_module() -> bool:
    """Whether this is Blender as a Python module, not the application."""
    # Before 4.4 nothing says so; the application knows its program.
    return bool(getattr(bpy.app, "module", not bpy.app.binary_path))


def longest_name() -> int:
    """Bytes of UTF-8 in the longest name of a datablock: 63, from 5.0 on 255."""
    return int(bpy.types.ID.bl_rna.properties["name"].length_max) - 1  # one for the end of the text


def widest_bump_filter() -> dict[str, float]:
    """Input by which a Bump node compares points a whole pixel apart, as it always does before 4.5."""
    return {"Filter Width": 1.0} if blender_version() >= (4, 5) else {}


def ensure_cycles() -> None:
    """Enable Cycles, which is an add-on and may be switched off; nothing happens where it runs already."""
    if not hasattr(bpy.types.Scene, "cycles"):
        bpy.ops.preferences.addon_enable(module="cycles")


def node_tree(owner: bpy.types.Material | bpy.types.World) -> bpy.types.NodeTree:
    """The node tree of a datablock, switched on; its nodes are left as they are.

    5.0 gives every material and world a tree and warns whoever touches `use_nodes`, which 6.0 removes.
    """
    if blender_version() < (5, 0):
        owner.use_nodes = True
    return owner.node_tree


def new_material(name: str) -> bpy.types.Material:
    """A material whose node tree is empty."""
    material = bpy.data.materials.new(name)
    node_tree(material).nodes.clear()
    return material


def shader_material(name: str, shader: str, inputs: Mapping[str, Any]) -> bpy.types.Material:
    """A material of one shader node, by its type, with these values of its inputs."""
    material = new_material(name)
    tree = material.node_tree
    closure, output = tree.nodes.new(shader), tree.nodes.new("ShaderNodeOutputMaterial")
    for key, value in inputs.items():
        closure.inputs[key].default_value = value
    tree.links.new(closure.outputs[0], output.inputs["Surface"])
    return material


def new_world(name: str) -> tuple[bpy.types.World, bpy.types.Node]:
    """A world of an empty tree but for Background and output, and the Background node."""
    world = bpy.data.worlds.new(name)
    tree = node_tree(world)
    tree.nodes.clear()
    background = tree.nodes.new("ShaderNodeBackground")
    output = tree.nodes.new("ShaderNodeOutputWorld")
    tree.links.new(background.outputs[0], output.inputs["Surface"])
    return world, background


def save_as_exr(settings: bpy.types.ImageFormatSettings) -> None:
    """Make renders 32-bit RGBA OpenEXR in linear Rec.709, whatever the file's working space and view."""
    if hasattr(settings, "media_type"):  # 5.0: the choice of formats hangs on it
        settings.media_type = "IMAGE"
    settings.file_format, settings.color_depth, settings.color_mode = "OPEN_EXR", "32", "RGBA"
    settings.exr_codec = "NONE"
    settings.color_management = "OVERRIDE"
    settings.linear_colorspace_settings.name = "Linear Rec.709"


def uses_nodes(owner: bpy.types.Material | bpy.types.World | bpy.types.Light) -> bool:
    """Whether a datablock renders by its nodes.

    From 5.0 on there is nothing else for materials and worlds, and, seen in 5.2, for lamps; whoever asks `use_nodes`
    there is warned.
    """
    switch = owner.bl_rna.properties.get("use_nodes")
    there = switch is not None and not getattr(switch, "is_deprecated", False)
    return owner.node_tree is not None and (not there or bool(owner.use_nodes))


def compute_device() -> str:
    """Device that Cycles takes for "GPU Compute", e.g. "OPTIX"; "NONE" where nothing is chosen."""
    addon = bpy.context.preferences.addons.get("cycles")
    return str(getattr(addon.preferences, "compute_device_type", "NONE")) if addon is not None else "NONE"


def shadow_terminator(obj: bpy.types.Object) -> tuple[Any, str, str]:
    """Owner of an object's Shadow Terminator settings, and their names: Shading Offset, Geometry Offset."""
    if hasattr(obj, "shadow_terminator_shading_offset"):
        return obj, "shadow_terminator_shading_offset", "shadow_terminator_geometry_offset"
    return obj.cycles, "shadow_terminator_offset", "shadow_terminator_geometry_offset"  # before 4.4


def curves_of(action: bpy.types.Action, slot: Any = None) -> list[bpy.types.FCurve]:
    """F-curves of an action, of one slot where one is given; since 4.4 in layers, which 5.0 shows no other way."""
    if not hasattr(action, "layers"):
        return list(action.fcurves)
    bags = (bag for layer in action.layers for strip in layer.strips for bag in strip.channelbags)
    return [curve for bag in bags if slot is None or bag.slot_handle == slot.handle for curve in bag.fcurves]
