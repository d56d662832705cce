"""Bumps and normal maps before a measured group's Normal, as Blender's own nodes."""

from __future__ import annotations

from typing import Any

import bpy

from ....bake.errors import BakeError
from ....nodes.material_tree import measured_nodes

BUMP, NORMAL_MAP = "ShaderNodeBump", "ShaderNodeNormalMap"
# Nodes whose normal is the surface's own: nothing is lost where another takes their place.
_PLAIN = ("ShaderNodeNewGeometry", "ShaderNodeTexCoord")


def relief_nodes(material: bpy.types.Material) -> tuple[bpy.types.Node | None, bpy.types.Node | None]:
    """The Bump and the Normal Map node that shape the measured group's normal, None for what is not there."""
    place = next(iter(measured_nodes(material.node_tree)), None)
    socket = None if place is None else place[1].inputs.get("Normal")
    bump = _source(socket, BUMP)
    return bump, _source(socket if bump is None else bump.inputs["Normal"], NORMAL_MAP)


def add_bump(material: bpy.types.Material) -> bpy.types.Node:
    """Put a Bump node before the group's Normal; what was linked there becomes the normal that it bends.

    Raises BakeError where the group is not there, or has one.
    """
    tree, node = _measured(material)
    if relief_nodes(material)[0] is not None:
        raise BakeError(material.name, "has a Bump node already", "link a texture to its Height")
    socket = node.inputs["Normal"]
    bump = _beside(tree, node, BUMP, 220)
    if socket.is_linked:
        tree.links.new(socket.links[0].from_socket, bump.inputs["Normal"])
    tree.links.new(bump.outputs["Normal"], socket)
    return bump


def add_normal_map(material: bpy.types.Material) -> bpy.types.Node:
    """Put a Normal Map node before the group's Normal, or before its Bump node's.

    Raises BakeError where the group is not there, or nodes of the artist's own give the normal.
    """
    tree, node = _measured(material)
    bump, made = relief_nodes(material)
    if made is not None:
        raise BakeError(material.name, "has a Normal Map node already", "link a texture to its Color")
    socket = (bump or node).inputs["Normal"]
    if socket.is_linked and socket.links[0].from_node.bl_idname not in _PLAIN:
        cause = f"its normal comes from {socket.links[0].from_node.name}, which a normal map would replace"
        raise BakeError(material.name, cause, "unlink that first, or add a Bump, which keeps it")
    made = _beside(tree, node, NORMAL_MAP, 220 if bump is None else 440)
    tree.links.new(made.outputs["Normal"], socket)
    return made


def _measured(material: bpy.types.Material) -> tuple[bpy.types.NodeTree, bpy.types.Node]:
    places = [(tree, node) for tree, node in measured_nodes(material.node_tree) if "Normal" in node.inputs]
    if not places:
        raise BakeError(material.name, "its measured group is no longer among its nodes", "undo its removal")
    return places[0]


def _beside(tree: bpy.types.NodeTree, node: bpy.types.Node, kind: str, left: float) -> bpy.types.Node:
    made = tree.nodes.new(kind)
    made.location, made.parent = (node.location.x - left, node.location.y + 220), node.parent
    return made


def _source(socket: Any, kind: str) -> bpy.types.Node | None:
    """The node linked to a socket, if of this kind."""
    source = socket.links[0].from_node if socket is not None and socket.is_linked else None
    return source if source is not None and source.bl_idname == kind else None
