"""A node group made as a copy of one that differs in numbers, images and inner groups alone."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from .recording import Recording, is_constant

_ENDS = ("NodeGroupInput", "NodeGroupOutput")


def is_fit_to_copy(tree: bpy.types.NodeTree) -> bool:
    """Whether a copy would hold nothing but nodes: no animation, and no place in an asset library."""
    return tree.animation_data is None and tree.asset_data is None


def copy_as_recorded(
    donor: bpy.types.ShaderNodeTree, recording: Recording, name: str
) -> bpy.types.ShaderNodeTree | None:
    """A copy of a group of the recording's shape that holds what is recorded; None where a node is not in its place."""
    tree = donor.copy()
    try:
        set_right = _set_as_recorded(tree, recording)
    except BaseException:
        bpy.data.node_groups.remove(tree)
        raise
    if not set_right:
        bpy.data.node_groups.remove(tree)
        return None
    tree.name, tree.use_fake_user = name, False
    return tree


def _set_as_recorded(tree: bpy.types.ShaderNodeTree, recording: Recording) -> bool:
    """Whether every recorded node was found, and none has lost a link by the group that it holds now."""
    nodes = [node for node in tree.nodes if node.bl_idname not in _ENDS]
    if [node.bl_idname for node in nodes] != [recorded.kind for recorded in recording.nodes]:
        return False
    links = len(tree.links)
    for node, recorded in zip(nodes, recording.nodes):
        for name, value in recorded.properties:
            if getattr(node, name) != value:
                setattr(node, name, value)
        for index, value in recorded.inputs:
            _set_constant(node.inputs[index], value)
    sink = next(node for node in tree.nodes if node.bl_idname == "NodeGroupOutput")
    for socket, value in zip(sink.inputs, recording.results):
        _set_constant(socket, value)
    return len(tree.links) == links


def _set_constant(socket: Any, value: Any) -> None:
    """Let an input have a recorded number or triple; each write has Blender look at the tree, so equal ones stay."""
    if not is_constant(value):
        return
    if not isinstance(value, tuple):
        if socket.default_value != float(np.float32(value)):
            socket.default_value = value
        return
    # Colour sockets have an alpha.
    wanted = (*value[1:], 1.0) if socket.type == "RGBA" else value[1:]
    if tuple(socket.default_value) != tuple(np.array(wanted, np.float32).tolist()):
        socket.default_value = wanted
