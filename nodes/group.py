"""Node groups as Python: a function over sockets becomes a shader group, reused only while its content is equal."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any

import bpy

from . import expr

HASH_KEY = "measured_materials_hash"
# Groups of one family may take each other's place without a change of what they are in.
FAMILY_KEY = "measured_materials_family"
# Settings of a group's nodes that the extension switches while it is in use: no part of what the group is known by.
SWITCHED_KEY = "measured_materials_switched"
_SOCKETS = {
    "float": "NodeSocketFloat",
    "vector": "NodeSocketVector",
    "color": "NodeSocketColor",
    "shader": "NodeSocketShader",
}
_SKIPPED = frozenset(
    """location location_absolute width height select name label color parent dimensions show_options show_preview
    show_texture hide use_custom_color internal_links inputs outputs rna_type warning_propagation color_tag
    is_active_output""".split()
)


def node_group(
    name: str,
    inputs: Mapping[str, str],
    outputs: Mapping[str, str],
    function: Callable[..., Any],
    defaults: Mapping[str, Any] | None = None,
    *,
    switched: str = "",
) -> bpy.types.ShaderNodeTree:
    """A group whose inputs are the function's arguments and whose outputs are its results, in order.

    Parameters
    ----------
    name : of the group, shown to artists; Blender appends a number where it is taken by other content
    inputs, outputs : socket name to "float", "vector", "color" or "shader"
    function : takes `expr` values and returns one or a tuple of them
    defaults : of inputs
    switched : names of the nodes' properties, between blanks, that may change without making it another group

    Returns
    -------
    A group of exactly this content: the existing one of this name if its content still hashes equal (an artist may
    have edited it), otherwise a new one.
    """
    tree = bpy.data.node_groups.new(name, "ShaderNodeTree")
    try:
        for socket, kind in inputs.items():
            made = tree.interface.new_socket(socket, in_out="INPUT", socket_type=_SOCKETS[kind])
            if defaults and socket in defaults:
                made.default_value = defaults[socket]
        for socket, kind in outputs.items():
            tree.interface.new_socket(socket, in_out="OUTPUT", socket_type=_SOCKETS[kind])
        source, sink = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
        with expr.building(tree):
            arguments = [_value(source.outputs[s], kind) for s, kind in inputs.items()]
            results = function(*arguments)
            for socket, value in zip(outputs, results if isinstance(results, tuple) else (results,), strict=True):
                expr.feed(tree, sink.inputs[socket], value)
    except BaseException:
        bpy.data.node_groups.remove(tree)
        raise
    if switched:
        tree[SWITCHED_KEY] = switched
    digest = content_hash(tree)
    # One of a linked library would be lost with the library.
    for other in (group for group in bpy.data.node_groups if group.library is None):
        if other != tree and other.get(HASH_KEY) == digest and content_hash(other) == digest:
            bpy.data.node_groups.remove(tree)
            return other
    tree[HASH_KEY] = digest
    arrange(tree)
    return tree


def call(group: bpy.types.ShaderNodeTree, *arguments: Any) -> Any:
    """Use a group inside the tree being built; returns its output, or a tuple of outputs."""
    items = [i for i in group.interface.items_tree if i.item_type == "SOCKET" and i.in_out == "INPUT"]
    inputs = {item.name: value for item, value in zip(items, arguments, strict=True)}
    made = expr.node("ShaderNodeGroup", {"node_tree": group}, inputs)
    results = tuple(_value(socket, _kind(socket)) for socket in made.outputs if socket.enabled)
    return results[0] if len(results) == 1 else results


def _kind(socket: Any) -> str:
    return {"VALUE": "float", "SHADER": "shader"}.get(socket.type, "vector")


def _value(socket: Any, kind: str) -> Any:
    return expr.Vector(socket) if kind in ("vector", "color") else expr.Scalar(socket)


def is_measured_tree(tree: Any) -> bool:
    """Whether a material's tree holds a group made here."""
    return any(n.bl_idname == "ShaderNodeGroup" and n.node_tree and HASH_KEY in n.node_tree for n in tree.nodes)


def active_output(tree: bpy.types.NodeTree) -> bpy.types.Node:
    """The Group Output that counts; a group that can be switched has several."""
    return next(n for n in tree.nodes if n.bl_idname == "NodeGroupOutput" and n.is_active_output)


def nodes_before(node: bpy.types.Node) -> set[bpy.types.Node]:
    """The node and all in its tree that it depends on."""
    sources: dict[str, list[bpy.types.Node]] = {}
    for link in node.id_data.links:
        sources.setdefault(link.to_node.name, []).append(link.from_node)
    found, pending = {node}, [node]
    while pending:
        new = [source for source in sources.get(pending.pop().name, ()) if source not in found]
        found.update(new)
        pending += new
    return found


def trees_below(tree: bpy.types.NodeTree) -> list[bpy.types.NodeTree]:
    """The tree and every group in it, each once."""
    found: dict[bpy.types.NodeTree, None] = {}
    pending = [tree]
    while pending:
        here = pending.pop()
        if here not in found:
            found[here] = None
            pending += [inner for node in here.nodes if (inner := getattr(node, "node_tree", None))]
    return list(found)


def content_hash(tree: bpy.types.ShaderNodeTree, known: dict[bpy.types.ShaderNodeTree, str] | None = None) -> str:
    """Hash of what a group computes: interface, nodes, their settings, unlinked inputs, links; not its looks.

    `known` holds the hashes of groups that have not changed since, and takes up those of the groups inside.
    """
    known = {} if known is None else known
    if tree in known:
        return known[tree]
    order = {node.name: i for i, node in enumerate(tree.nodes)}
    interface = [
        (i.name, i.in_out, i.socket_type, _plain(getattr(i, "default_value", None), known))
        for i in tree.interface.items_tree
        if i.item_type == "SOCKET"
    ]
    skipped = tree.get(SWITCHED_KEY, "").split()
    nodes = [(n.bl_idname, _properties(n, skipped, known), _defaults(n, known)) for n in tree.nodes]
    links = sorted(
        (order[k.from_node.name], k.from_socket.identifier, order[k.to_node.name], k.to_socket.identifier)
        for k in tree.links
    )
    text = json.dumps([interface, nodes, links], default=str)
    known[tree] = hashlib.sha256(text.encode()).hexdigest()
    return known[tree]


def _properties(node: Any, skipped: Sequence[str], known: dict[bpy.types.ShaderNodeTree, str]) -> dict[str, Any]:
    return {name: _plain(getattr(node, name), known) for name in _settings_of(type(node)) if name not in skipped}


@cache
def _settings_of(kind: type) -> tuple[str, ...]:
    """Names of a kind of node's properties that count; asking RNA for them takes longer than reading them."""
    return tuple(
        p.identifier
        for p in kind.bl_rna.properties  # type: ignore[attr-defined]
        if p.identifier not in _SKIPPED and not p.identifier.startswith("bl_") and p.type != "COLLECTION"
    )


def _defaults(node: Any, known: dict[bpy.types.ShaderNodeTree, str]) -> list[Any]:
    return [_plain(getattr(s, "default_value", None), known) for s in node.inputs if not s.is_linked]


def _plain(value: Any, known: dict[bpy.types.ShaderNodeTree, str]) -> Any:
    if isinstance(value, (bool, int, float, str, type(None))):
        return value
    if isinstance(value, bpy.types.NodeTree):
        # Its content now, not the hash it was built with: an image it used may be gone since.
        return value.get(FAMILY_KEY) or content_hash(value, known)
    if isinstance(value, bpy.types.ID):
        return value.name_full
    if isinstance(value, bpy.types.bpy_struct):
        # Settings of a sub-structure (an image user, a mapping) are never changed by us.
        return None
    return [float(x) for x in value]


def arrange(tree: bpy.types.ShaderNodeTree) -> None:
    """Place nodes left to right by their depth, so that an opened group can be read."""
    sources: dict[str, list[str]] = {node.name: [] for node in tree.nodes}
    for link in tree.links:
        sources[link.to_node.name].append(link.from_node.name)
    depth: dict[str, int] = {}
    for node in tree.nodes:
        _measure_depth(node.name, sources, depth)
    heights: dict[int, int] = {}
    places: list[float] = []
    for node in tree.nodes:
        column = depth[node.name]
        places += (column * 190, -heights.get(column, 0))
        heights[column] = heights.get(column, 0) + (320 if node.bl_idname == "ShaderNodeTexImage" else 170)
    # One by one, each would have Blender look at the whole tree again.
    tree.nodes.foreach_set("location", places)


def _measure_depth(start: str, sources: Mapping[str, list[str]], depth: dict[str, int]) -> None:
    """Longest path to a node from any source, iteratively: groups are deeper than Python's recursion limit."""
    pending = [start]
    while pending:
        name = pending[-1]
        unknown = [s for s in sources[name] if s not in depth]
        if unknown:
            pending += unknown
        else:
            depth[name] = 1 + max((depth[s] for s in sources[name]), default=-1)
            pending.pop()
