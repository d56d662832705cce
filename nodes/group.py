"""Node groups as Python: a function over sockets becomes a shader group, reused only while its content is equal."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from typing import Any

import bpy

from . import expr, portions
from .group_copy import copy_as_recorded, is_fit_to_copy
from .group_making import make_as_recorded
from .keeping import Keeping
from .recording import CannotRecord, Recording

HASH_KEY = "measured_materials_hash"
# What a group was recorded as before it was made, and the same but for numbers and images; empty where it was not.
RECIPE_KEY, SHAPE_KEY = "measured_materials_recipe", "measured_materials_shape"
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
    limits: Mapping[str, tuple[float, float]] | None = None,
    switched: str = "",
) -> bpy.types.ShaderNodeTree:
    """A group whose inputs are the function's arguments and whose outputs are its results, in order.

    The function is recorded before anything is made, and may hence be called twice.

    Parameters
    ----------
    name : of the group, shown to artists; Blender appends a number where it is taken by other content
    inputs, outputs : socket name to "float", "vector", "color" or "shader"
    function : takes `expr` values and returns one or a tuple of them
    defaults : of inputs
    limits : smallest and largest value that the inputs' sliders offer
    switched : names of the nodes' properties, between blanks, that may change without making it another group

    Returns
    -------
    A group of exactly this content: an existing one of whatever name, which other materials may use too, if its content
    still hashes equal (an artist may have edited it), otherwise a new one.
    """
    interface = [list(inputs.items()), list(outputs.items()), list((defaults or {}).items()), switched]
    if limits:
        interface.append(list(limits.items()))
    recording = _recorded(inputs, outputs, function)
    recipe = recording.digest(interface, _content_of) if recording is not None else ""
    found = _unchanged(RECIPE_KEY, recipe)
    if found is not None:
        return found
    tree, shape = None, ""
    if recording is not None:
        shape = recording.shape(interface, lambda inner: inner.get(SHAPE_KEY) or _content_of(inner))
        donor = _unchanged(SHAPE_KEY, shape)
        tree = copy_as_recorded(donor, recording, name) if donor is not None and is_fit_to_copy(donor) else None
    tree = tree or _made(name, inputs, outputs, function, defaults or {}, limits or {}, switched, recording, recipe)
    digest = content_hash(tree)
    other = _unchanged(HASH_KEY, digest, but=tree)
    if other is not None:
        bpy.data.node_groups.remove(tree)
        tree = other
    tree[HASH_KEY], tree[RECIPE_KEY], tree[SHAPE_KEY] = digest, recipe, shape
    return tree


def _recorded(inputs: Mapping[str, str], outputs: Mapping[str, str], function: Callable[..., Any]) -> Recording | None:
    """What the function makes of the inputs; None where that takes a tree in Blender."""
    recording = Recording()
    try:
        with expr.building(recording):
            results = function(*(_value(recording.source.outputs[s], kind) for s, kind in inputs.items()))
    except (CannotRecord, AttributeError, TypeError):
        return None  # what is wrong with the function itself is told when the group is made
    found = results if isinstance(results, tuple) else (results,)
    recording.results = [expr.key_of(value) for _, value in zip(outputs, found, strict=True)]
    return recording


def _content_of(tree: bpy.types.NodeTree) -> str:
    """What a group inside is known by; whoever uses it has just been given it by `node_group`, unchanged."""
    return str(tree.get(FAMILY_KEY) or tree.get(HASH_KEY) or content_hash(tree))


def _unchanged(key: str, value: str, but: bpy.types.ShaderNodeTree | None = None) -> bpy.types.ShaderNodeTree | None:
    """The file's own group of this custom property whose content still is that with which it was made."""
    # One of a linked library would be lost with the library.
    own = (t for t in bpy.data.node_groups if value and t.get(key) == value and t.library is None and t != but)
    return next((tree for tree in own if content_hash(tree) == tree.get(HASH_KEY)), None)


def _made(
    name: str,
    inputs: Mapping[str, str],
    outputs: Mapping[str, str],
    function: Callable[..., Any],
    defaults: Mapping[str, Any],
    limits: Mapping[str, tuple[float, float]],
    switched: str,
    recording: Recording | None,
    recipe: str,
) -> bpy.types.ShaderNodeTree:
    """A new group, node by node: as recorded, or by the function where that takes a tree in Blender."""

    def begin() -> bpy.types.ShaderNodeTree:
        return _begun(name, inputs, outputs, defaults, limits)

    tree = make_as_recorded(recording, recipe, begin) if recording is not None else _made_by(function, inputs, begin)
    if switched:
        tree[SWITCHED_KEY] = switched
    arrange(tree)
    return tree


def _begun(
    name: str,
    inputs: Mapping[str, str],
    outputs: Mapping[str, str],
    defaults: Mapping[str, Any],
    limits: Mapping[str, tuple[float, float]],
) -> bpy.types.ShaderNodeTree:
    """A group with its interface, and with nothing in it but the node of its inputs and that of its outputs."""
    tree = bpy.data.node_groups.new(name, "ShaderNodeTree")
    for socket, kind in inputs.items():
        made = tree.interface.new_socket(socket, in_out="INPUT", socket_type=_SOCKETS[kind])
        if socket in defaults:
            made.default_value = defaults[socket]
        if socket in limits:
            made.min_value, made.max_value = limits[socket]
    for socket, kind in outputs.items():
        tree.interface.new_socket(socket, in_out="OUTPUT", socket_type=_SOCKETS[kind])
    tree.nodes.new("NodeGroupInput")
    tree.nodes.new("NodeGroupOutput")
    return tree


def _made_by(
    function: Callable[..., Any], inputs: Mapping[str, str], begin: Callable[[], bpy.types.ShaderNodeTree]
) -> bpy.types.ShaderNodeTree:
    tree = begin()
    try:
        source, sink = tree.nodes
        with expr.building(tree):
            results = function(*(_value(source.outputs[socket], kind) for socket, kind in inputs.items()))
            found = results if isinstance(results, tuple) else (results,)
            # The virtual socket behind the last one is no output.
            for socket, value in zip(list(sink.inputs)[:-1], found, strict=True):
                expr.feed(tree, socket, value)
    except BaseException:
        bpy.data.node_groups.remove(tree)
        raise
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
            pending += _groups_of(here)
    return list(found)


# Groups that a tree's own nodes call, by its session_uid.
_called: Keeping[int, list[bpy.types.NodeTree]] = Keeping()


def looking_once() -> AbstractContextManager[None]:
    """Inside, a tree is searched for groups once. For readers, which change no tree."""
    return _called.kept()


def _groups_of(tree: bpy.types.NodeTree) -> list[bpy.types.NodeTree]:
    known = {} if _called.found is None else _called.found
    if tree.session_uid not in known:
        known[tree.session_uid] = [group for node in tree.nodes if (group := getattr(node, "node_tree", None))]
    return known[tree.session_uid]


# Hashes of trees, by their session_uid.
_hashes: Keeping[int, str] = Keeping()


def hashing_once() -> AbstractContextManager[None]:
    """Inside, a tree is hashed once. For builders, which change no tree that is finished."""
    work = portions.active()
    return _hashes.kept(None if work is None else work.hashes)


def content_hash(tree: bpy.types.ShaderNodeTree) -> str:
    """Hash of what a group computes: interface, nodes, their settings, unlinked inputs, links; not its looks."""
    return _content_hash(tree, {} if _hashes.found is None else _hashes.found)


def _content_hash(tree: bpy.types.ShaderNodeTree, known: dict[int, str]) -> str:
    """With the hashes of trees that were met before, by their session_uid: groups stand in several places."""
    if tree.session_uid in known:
        return known[tree.session_uid]
    order = {node.name: i for i, node in enumerate(tree.nodes)}
    interface = [
        (i.name, i.in_out, i.socket_type, _plain(getattr(i, "default_value", None), known))
        for i in tree.interface.items_tree
        if i.item_type == "SOCKET"
    ]
    switched = tree.get(SWITCHED_KEY, "")
    nodes = [(kind := n.bl_idname, _properties(n, kind, switched, known), _defaults(n, known)) for n in tree.nodes]
    links = sorted(
        (order[k.from_node.name], k.from_socket.identifier, order[k.to_node.name], k.to_socket.identifier)
        for k in tree.links
    )
    text = json.dumps([interface, nodes, links], default=str)
    known[tree.session_uid] = found = hashlib.sha256(text.encode()).hexdigest()
    return found


def _properties(node: Any, kind: str, switched: str, known: dict[int, str]) -> dict[str, Any]:
    names = _names.get((kind, switched))
    if names is None:
        skipped = _SKIPPED.union(switched.split())
        found = (p for p in node.bl_rna.properties if p.type != "COLLECTION" and not p.identifier.startswith("bl_"))
        names = _names[kind, switched] = tuple(
            (p.identifier, _is_plain(p)) for p in found if p.identifier not in skipped
        )
    return {name: getattr(node, name) if plain else _plain(getattr(node, name), known) for name, plain in names}


def _is_plain(setting: bpy.types.Property) -> bool:
    """Whether a setting is one number or word, which `_plain` would leave as it is."""
    if setting.type == "ENUM":
        return not setting.is_enum_flag
    return setting.type == "STRING" or (setting.type in ("BOOLEAN", "INT", "FLOAT") and not setting.is_array)


# Settings of nodes of a kind that count, where some are switched, and whether each is plain.
_names: dict[tuple[str, str], tuple[tuple[str, bool], ...]] = {}


def _defaults(node: Any, known: dict[int, str]) -> list[Any]:
    return [_plain(getattr(s, "default_value", None), known) for s in node.inputs if not s.is_linked]


def _plain(value: Any, known: dict[int, str]) -> Any:
    if type(value) in _NUMBERS_AND_WORDS:
        return value
    if isinstance(value, bpy.types.NodeTree):
        # Its content now, not the hash it was built with: an image it used may be gone since.
        return value.get(FAMILY_KEY) or _content_hash(value, known)
    if isinstance(value, bpy.types.ID):
        return value.name_full
    if isinstance(value, bpy.types.bpy_struct):
        # Settings of a sub-structure (an image user, a mapping) are never changed by us.
        return None
    return [float(x) for x in value]


_NUMBERS_AND_WORDS = frozenset({bool, int, float, str, type(None)})


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
