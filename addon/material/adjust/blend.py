"""A measured material blended with another by a mask."""

from __future__ import annotations

import contextlib

import bpy

from ....bake.errors import BakeError
from ....nodes.material_tree import lit_by_emission, measured_nodes
from ....nodes.osl_script import is_scripted
from ....nodes.second_group import (
    HELPER_KEY,
    MASK_KEY,
    MIX_KEY,
    OUTPUTS,
    SECOND_KEY,
    connect_second,
    helpers_of,
    mask_group,
    mask_node,
    mix_nodes,
    second_node,
    without_passes,
)
from ....nodes.surface_inputs import connect_inputs, coordinates_before_tiling
from ...lights.light_tables import fit_slots
from ..facts import is_measured


def partners_of(material: bpy.types.Material) -> list[bpy.types.Material]:
    """Materials that this one can be blended with, by name."""
    return [other for other in bpy.data.materials if other != material and is_measured(other)]


def second_of(material: bpy.types.Material) -> bpy.types.Material | None:
    """The material that this one is blended with."""
    node = second_node(material.node_tree)
    found = node.get(SECOND_KEY) if node is not None else None
    return found if isinstance(found, bpy.types.Material) else None


def blend_with(material: bpy.types.Material, second: bpy.types.Material) -> None:
    """Let a mask choose between this material and a second one, which looks as its own node is set now.

    What the second is rebuilt or baked as later is seen here too. Raises BakeError where the two cannot be blended.
    """
    tree, other = material.node_tree, next(iter(measured_nodes(second.node_tree)), None)
    first = next((node for inner, node in measured_nodes(tree) if inner == tree), None)
    if material == second or other is None:
        raise BakeError(second.name, "is not another measured material", "choose one that is")
    if first is None:
        cause = "its measured group lies inside another group, or is gone"
        raise BakeError(material.name, cause, "ungroup it, or mix the two materials by hand")
    if is_scripted(material) != is_scripted(second):
        raise BakeError(second.name, "one of the two is shaded by OSL and the other by nodes", "shade both alike")
    remove_blend(material)
    node = tree.nodes.new("ShaderNodeGroup")
    node.location, node.width, node.label = (first.location.x, first.location.y - 420), first.width, second.name
    node.node_tree = without_passes(other[1].node_tree)
    node[SECOND_KEY] = second
    with helpers_of(tree, node):
        connect_inputs(tree, node)
        _take_over(tree, first, node, *other)
        _keep_apart(tree, node.inputs["Normal"])
    mask = tree.nodes.new("ShaderNodeGroup")
    mask.node_tree, mask.label, mask[MASK_KEY] = mask_group(), "Blend", True
    mask.location = (first.location.x + 300, first.location.y + 180)
    for output, factor in OUTPUTS.items():
        if output in first.outputs and output in node.outputs:
            _mix(tree, first, output, mask.outputs[factor])
    connect_second(tree, first)
    lit_by_emission(material, material.cycles.emission_sampling == "NONE")
    fit_slots()


def remove_blend(material: bpy.types.Material) -> None:
    """Show this material alone again; nothing where it is not blended."""
    tree, node = material.node_tree, second_node(material.node_tree)
    if node is None:
        return
    for mix in mix_nodes(tree):
        targets = [link.to_socket for link in mix.outputs[0].links]
        own = mix.inputs[1].links[0].from_socket if mix.inputs[1].is_linked else None
        for target in targets if own is not None else ():
            tree.links.new(own, target)
    mask = mask_node(tree)
    for gone in [*mix_nodes(tree), node, *([mask] if mask is not None else [])]:
        tree.nodes.remove(gone)
    # From the end back, for each to lose its last reader before it is looked at.
    for helper in reversed([n for n in tree.nodes if n.get(HELPER_KEY)]):
        if not any(socket.is_linked for socket in helper.outputs):
            tree.nodes.remove(helper)
    fit_slots()


def _take_over(
    tree: bpy.types.NodeTree,
    first: bpy.types.Node,
    node: bpy.types.Node,
    home: bpy.types.NodeTree,
    own: bpy.types.Node,
) -> None:
    """Set the second group as its own material has it, on the surface of the first."""
    for socket in node.inputs:
        there, here = own.inputs.get(socket.name), first.inputs.get(socket.name)
        if there is not None and hasattr(socket, "default_value") and not socket.is_linked:
            with contextlib.suppress(TypeError, ValueError):
                socket.default_value = there.default_value
        if socket.name in ("Normal", "Tangent") and here is not None and here.is_linked:
            tree.links.new(here.links[0].from_socket, socket)
    if "UV" in node.inputs and own.inputs["UV"].is_linked:
        theirs, ours = (source and source.node for source in map(coordinates_before_tiling, (own, node)))
        if theirs and ours and theirs.bl_idname == ours.bl_idname == "ShaderNodeMapping":
            ours.vector_type = theirs.vector_type
            for name in ("Location", "Rotation", "Scale"):
                ours.inputs[name].default_value = theirs.inputs[name].default_value


def _keep_apart(tree: bpy.types.NodeTree, normal: bpy.types.NodeSocket) -> None:
    """Give the second group the same normal from a node of its own.

    Cycles computes equal nodes of both groups once, and would keep what the second needs of them on its stack all
    through the first: so it does not keep the viewer's frame.
    """
    passed = tree.nodes.new("ShaderNodeVectorMath")
    passed.operation, passed.label = "MAXIMUM", "Same normal"  # than less than any: nothing that Cycles would leave out
    passed.inputs[1].default_value = (-2, -2, -2)
    passed.location = (normal.node.location.x - 200, normal.node.location.y)
    tree.links.new(normal.links[0].from_socket, passed.inputs[0])
    tree.links.new(passed.outputs[0], normal)


def _mix(tree: bpy.types.NodeTree, first: bpy.types.Node, output: str, factor: bpy.types.NodeSocket) -> None:
    """Put a Mix Shader between an output of the first group and whatever it is linked to."""
    targets = [link.to_socket for link in first.outputs[output].links]
    mix = tree.nodes.new("ShaderNodeMixShader")
    mix[MIX_KEY] = output
    mix.location = (first.location.x + 480, first.location.y - 200 * list(OUTPUTS).index(output))
    tree.links.new(factor, mix.inputs[0])
    for target in targets:
        tree.links.new(mix.outputs[0], target)
