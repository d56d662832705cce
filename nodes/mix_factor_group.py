"""Node group: a Mix Shader's factor as 0 or 1, as often as the factor says.

Cycles picks one closure of a point in proportion to their weights. A mirror that aims at a small lamp weighs next to
nothing, for all the light it carries: beside another shader's closures it is picked almost never, and then counts
enormously. With the choice made here each of the two is alone in its samples, and the mean is the mix.
"""

from __future__ import annotations

from typing import Any

import bpy

from . import expr
from .group import HASH_KEY, node_group
from .stochastic_mirror_group import ray_hash

MIX_FACTOR = "MM Mix Factor"


def mix_factor_group() -> bpy.types.ShaderNodeTree:
    """(Factor, Salt) to 0 or 1; Mix Shaders behind one another need different salts to choose independently."""
    inputs = {"Factor": "float", "Salt": "float"}
    return node_group(MIX_FACTOR, inputs, {"Factor": "float"}, chosen, {"Factor": 0.5, "Salt": 1.0})


def chosen(factor: Any, salt: Any) -> Any:
    """1 as often as the factor says, else 0."""
    position, (first, _, _) = ray_hash(salt)
    number, _, _ = expr.white_noise(position, first)
    return number < factor


def is_mix_factor(node: bpy.types.Node) -> bool:
    """Whether a node is this group."""
    tree = getattr(node, "node_tree", None)
    return tree is not None and HASH_KEY in tree and tree.name.startswith(MIX_FACTOR)


def insert_mix_factor(mix: bpy.types.Node) -> bpy.types.Node:
    """Put the group between a Mix Shader and what gives its factor; returns the new node."""
    tree, factor = mix.id_data, mix.inputs[0]
    node = tree.nodes.new("ShaderNodeGroup")
    node.node_tree = mix_factor_group()
    node.location, node.parent = (mix.location.x - 190, mix.location.y + 120), mix.parent
    if factor.is_linked:
        tree.links.new(factor.links[0].from_socket, node.inputs["Factor"])
    else:
        node.inputs["Factor"].default_value = factor.default_value
    node.inputs["Salt"].default_value = 1.0 + sum(map(is_mix_factor, tree.nodes))
    tree.links.new(node.outputs["Factor"], factor)
    return node
