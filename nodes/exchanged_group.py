"""Another group in a node, in place: values, links, keyframes and drivers of what both groups have stay."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterable, Sequence
from typing import Any

import bpy

from . import compat


def exchange_group(tree: bpy.types.NodeTree, node: bpy.types.Node, group: bpy.types.ShaderNodeTree) -> frozenset[str]:
    """Give the node of a tree another group; returns the names of the inputs that it had before.

    A value whose type has changed is carried over as far as it goes: a vector that has become a colour keeps its three
    numbers.
    """
    before = [socket.name for socket in node.inputs]
    kept = {s.name: (_kept_value(s), [k.from_socket for k in s.links]) for s in node.inputs}
    targets = [(s.name, [k.to_socket for k in s.links]) for s in node.outputs]
    # By itself Blender would give links and values to whatever stands in the new group where they stood in the old one.
    for link in [link for socket in (*node.inputs, *node.outputs) for link in socket.links]:
        tree.links.remove(link)
    node.node_tree = group
    usual = {item.name: getattr(item, "default_value", None) for item in group.interface.items_tree if _is_input(item)}
    for socket in node.inputs:
        value, sources = kept.get(socket.name, (usual[socket.name], []))
        # An artist may have changed the type of an input to one that has nothing in common with the old one.
        with contextlib.suppress(AttributeError, TypeError, ValueError):
            socket.default_value = _fitted(value, socket)
        for source in sources:
            tree.links.new(source, socket)
    for name, sockets in targets:
        for socket in sockets if name in node.outputs else ():
            tree.links.new(node.outputs[name], socket)
    _move_animation(tree, node, before)
    return frozenset(before)


def _is_input(item: Any) -> bool:
    return item.item_type == "SOCKET" and item.in_out == "INPUT"


def _kept_value(socket: Any) -> Any:
    """An input's value, a copy where it is several numbers; None of a shader."""
    value: Any = getattr(socket, "default_value", None)
    return tuple(value) if hasattr(value, "__len__") else value


def _fitted(value: Any, socket: Any) -> Any:
    """A value for this socket: colours have an alpha, vectors have none."""
    if not isinstance(value, tuple):
        return value
    if socket.type == "RGBA":
        return (*value, 1.0) if len(value) == 3 else value
    return value[:3] if socket.type == "VECTOR" else value


def _move_animation(tree: bpy.types.NodeTree, node: bpy.types.Node, before: Sequence[str]) -> None:
    """Let keyframes and drivers, which know an input by its number alone, follow it to its place in the new group."""
    start = f'nodes["{bpy.utils.escape_identifier(node.name)}"].inputs['
    moved = {k: node.inputs.find(name) for k, name in enumerate(before)}
    for curve in _curves(tree):
        found = re.fullmatch(r"(\d+)(\].*)", curve.data_path.removeprefix(start), re.DOTALL)
        if not curve.data_path.startswith(start) or found is None:
            continue
        old = int(found[1])
        new = moved.get(old, -1)
        # What the new group lacks may come back with the next one.
        if new not in (-1, old):
            curve.data_path = f"{start}{new}{found[2]}"


def _curves(tree: bpy.types.NodeTree) -> Iterable[bpy.types.FCurve]:
    """Keyframed curves and drivers of a tree that can be changed, each once."""
    data = tree.animation_data
    if data is None:
        return []
    strips = [strip for track in data.nla_tracks for strip in track.strips if strip.action is not None]
    used = [(data.action, getattr(data, "action_slot", None))] if data.action is not None else []
    used += [(strip.action, getattr(strip, "action_slot", None)) for strip in strips]
    once = {(action, getattr(slot, "handle", 0)): slot for action, slot in used if action.is_editable}
    return [*data.drivers, *(curve for (action, _), slot in once.items() for curve in compat.curves_of(action, slot))]
