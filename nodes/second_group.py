"""A second measured group in a material's tree, which a mask chooses instead of the material's own (method.md, 9).

The choice is made for each sample, by a random number: mixed by their weights, mirrors would hardly ever be picked, see
`nodes.mix_factor_group`. EEVEE, which has no mirror, mixes by the mask itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy

from . import expr
from .group import node_group
from .mix_factor_group import MIX_FACTOR, chosen
from .surface_inputs import exchange_linked

# Custom properties of nodes: the material whose group it holds, the output it mixes, and that it gives the factors.
SECOND_KEY, MIX_KEY, MASK_KEY = (f"measured_materials_{name}" for name in ("second", "mixed", "mask"))
# Nodes that give the second group its inputs, which go with it.
HELPER_KEY = "measured_materials_of_second"
MASK = "Mask"
# Lamps that materials aim at in a file that holds a blend: Cycles computes what both groups ask of a lamp once, and
# keeps it on its stack for both, up to 57 floats each. Two and the world leave 33 of 255; others are met by chance.
MOST_LAMPS = 2
OUTPUTS = {"BSDF": "Factor", "EEVEE": "EEVEE"}


def mask_group() -> bpy.types.ShaderNodeTree:
    """(Mask, Salt) to 0 or 1, as often as the mask says, for Cycles; and to the mask, held to that, for EEVEE."""

    def choose(mask: Any, salt: Any) -> tuple[Any, Any]:
        return chosen(mask, salt), expr.minimum(expr.maximum(mask, 0.0), 1.0)

    inputs, outputs = {MASK: "float", "Salt": "float"}, {"Factor": "float", "EEVEE": "float"}
    defaults = {MASK: 0.5, "Salt": 1.0}
    return node_group(f"{MIX_FACTOR} by Mask", inputs, outputs, choose, defaults, limits={MASK: (0.0, 1.0)})


def second_node(tree: bpy.types.NodeTree) -> bpy.types.Node | None:
    """The node that holds the second group."""
    return next((node for node in tree.nodes if SECOND_KEY in node), None)


def is_blended(material: bpy.types.Material) -> bool:
    """Whether a material shows a second one."""
    return material.node_tree is not None and second_node(material.node_tree) is not None


def mask_node(tree: bpy.types.NodeTree) -> bpy.types.Node | None:
    """The node whose input Mask decides."""
    return next((node for node in tree.nodes if node.get(MASK_KEY)), None)


def mix_nodes(tree: bpy.types.NodeTree) -> list[bpy.types.Node]:
    """The Mix Shaders, one for each output."""
    return [node for node in tree.nodes if MIX_KEY in node]


def connect_second(tree: bpy.types.NodeTree, first: bpy.types.Node) -> None:
    """Link what both groups show to the Mix Shaders, where nothing is: an exchange may have taken an output away."""
    second = second_node(tree)
    for mix in mix_nodes(tree):
        name = mix[MIX_KEY]
        for node, socket in ((first, mix.inputs[1]), (second, mix.inputs[2])):
            if node is not None and name in node.outputs and not socket.is_linked:
                tree.links.new(node.outputs[name], socket)


@contextmanager
def helpers_of(tree: bpy.types.NodeTree, node: bpy.types.Node) -> Iterator[None]:
    """Note which nodes are made for this one in the meantime, if it holds the second group: they go with it."""
    before = set(tree.nodes)
    yield
    for made in set(tree.nodes) - before if SECOND_KEY in node else ():
        made[HELPER_KEY] = True


def follow(material: bpy.types.Material, group: bpy.types.ShaderNodeTree) -> None:
    """Give every node that shows a material as its second the material's new group."""
    plain = without_passes(group)
    for other, node in showing(material):
        if node.node_tree != plain:
            with helpers_of(other.node_tree, node):
                exchange_linked(other.node_tree, node, plain)


def without_passes(group: bpy.types.ShaderNodeTree) -> bpy.types.ShaderNodeTree:
    """The group inside one that also writes passes for a denoiser: of two materials they would be added."""
    if not any(node.bl_idname == "ShaderNodeOutputAOV" for node in group.nodes):
        return group
    inside = (node.node_tree for node in group.nodes if "BSDF" in node.outputs and getattr(node, "node_tree", None))
    return next(inside, group)


def showing(material: bpy.types.Material) -> Iterator[tuple[bpy.types.Material, bpy.types.Node]]:
    """Materials that show this one as their second, and the nodes by which they do."""
    for other in bpy.data.materials:
        for node in other.node_tree.nodes if other.node_tree is not None and other.is_editable else ():
            if node.get(SECOND_KEY) == material:
                yield other, node


def samples_by_second(material: bpy.types.Material) -> bool:
    """Whether the second material samples lamps itself: then neither may be taken for one."""
    node = second_node(material.node_tree) if material.node_tree is not None else None
    second = node.get(SECOND_KEY) if node is not None else None
    return isinstance(second, bpy.types.Material) and second.cycles.emission_sampling == "NONE"
