"""A node group made of its recording, node by node, with rests in between where it is made in portions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy

from . import expr, portions
from .recording import Key, Recording, is_constant

Ends = tuple[bpy.types.Node, bpy.types.Node]


def make_as_recorded(
    recording: Recording, recipe: str, begin: Callable[[], bpy.types.ShaderNodeTree]
) -> bpy.types.ShaderNodeTree:
    """The group that a recording is of.

    Parameters
    ----------
    recipe : what the recording is known by
    begin : makes the group with its interface and its two ends
    """
    work = portions.active()
    tree = _begun_before(work, recipe) or begin()
    try:
        made = list(tree.nodes)
        for recorded in recording.nodes[len(made) - 2 :]:
            portions.rest()
            node = tree.nodes.new(recorded.kind)
            for name, value in recorded.properties:
                setattr(node, name, value)
            for index, key in recorded.inputs:
                _feed(tree, node.inputs[index], key, made)
            made.append(node)
        for socket, key in zip(made[1].inputs, recording.results):
            _feed(tree, socket, key, made)
    except portions.Pause:
        assert work is not None
        work.partial[recipe] = tree.session_uid, len(tree.nodes)
        raise
    except BaseException:
        bpy.data.node_groups.remove(tree)
        raise
    return tree


def _begun_before(work: portions.Portions | None, recipe: str) -> bpy.types.ShaderNodeTree | None:
    """A group that a portion before has begun, and that still is as that left it."""
    if work is None:
        return None
    uid, count = work.partial.pop(recipe, (0, 0))
    tree = portions.found("node_groups", uid) if uid else None
    return tree if tree is not None and len(tree.nodes) == count and not tree.users else None


def _feed(tree: bpy.types.ShaderNodeTree, socket: Any, key: Key, made: list[Any]) -> None:
    """Give an input what is recorded of it: a number, a triple or a link; see `expr.feed`."""
    if is_constant(key):
        expr.feed(tree, socket, expr.Vector(constant=key[1:]) if isinstance(key, tuple) else key)
        return
    name, identifier = key
    # The group's inputs, then the nodes by their places.
    node = made[0] if name == "source" else made[int(name) + 2]
    tree.links.new(_output(node, identifier), socket)


def _output(node: Any, identifier: int | str) -> Any:
    """An output by what it was recorded as: of a node that holds a group, its identifier in the group's interface."""
    if node.bl_idname == "ShaderNodeGroup":
        return next(output for output in node.outputs if output.identifier == identifier)
    return node.outputs[identifier]
