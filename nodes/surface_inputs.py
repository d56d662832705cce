"""What a measured group is told of the surface: links to normal, tangent, coordinates, and how the swatch lies."""

from __future__ import annotations

import bpy

from .exchanged_group import exchange_group
from .parallax_group import is_parallax
from .random_tiling_group import is_random_tiling
from .swatch_frame_group import ALONG_U, ALONG_V, is_swatch_frame, swatch_frame_group
from .tangent_frame_group import surface_tangent_group

# Label of the node that lays a swatch out.
SWATCH_MAPPING = "Swatch size and rotation"
_MOST_REROUTES = 10_000


def exchange_linked(tree: bpy.types.NodeTree, node: bpy.types.Node, group: bpy.types.ShaderNodeTree) -> None:
    """Give a node another group, and link the tangent and the swatch's frame where the old group took none."""
    before = exchange_group(tree, node, group)
    if "Tangent" in node.inputs and "Tangent" not in before:
        _connect_tangent(tree, node)
    if ALONG_U in node.inputs and ALONG_U not in before:
        connect_frame(tree, node)


def connect_inputs(tree: bpy.types.NodeTree, node: bpy.types.Node) -> None:
    """Link a node that has just got its group to a normal and, where it takes them, a tangent and coordinates."""
    geometry = tree.nodes.new("ShaderNodeNewGeometry")
    geometry.location = (-220, 200)
    tree.links.new(geometry.outputs["Normal"], node.inputs["Normal"])
    if "Tangent" in node.inputs:
        _connect_tangent(tree, node)
    if "UV" in node.inputs:
        coordinates, mapping = tree.nodes.new("ShaderNodeUVMap"), tree.nodes.new("ShaderNodeMapping")
        coordinates.location, mapping.location = (-420, -60), (-220, -60)
        mapping.label = SWATCH_MAPPING
        tree.links.new(coordinates.outputs["UV"], mapping.inputs["Vector"])
        tree.links.new(mapping.outputs["Vector"], node.inputs["UV"])
    if ALONG_U in node.inputs:
        connect_frame(tree, node)


def _connect_tangent(tree: bpy.types.NodeTree, node: bpy.types.Node) -> None:
    """The direction in which UVs run; an artist may choose Radial, turn it, or link another vector.

    Where an anisotropic material was isotropic for a while, the nodes that turned it are still there.
    """
    group = surface_tangent_group()
    on_surface = next((n for n in tree.nodes if getattr(n, "node_tree", None) == group), None)
    if on_surface is None:
        made, on_surface = tree.nodes.new("ShaderNodeTangent"), tree.nodes.new("ShaderNodeGroup")
        made.direction_type, made.location = "UV_MAP", (-420, 40)
        on_surface.node_tree, on_surface.location = group, (-220, 40)
        geometry = next((n for n in tree.nodes if n.bl_idname == "ShaderNodeNewGeometry"), None)
        geometry = geometry or tree.nodes.new("ShaderNodeNewGeometry")
        tree.links.new(geometry.outputs["Normal"], on_surface.inputs["Normal"])
        tree.links.new(made.outputs["Tangent"], on_surface.inputs["Tangent"])
    tree.links.new(on_surface.outputs["Tangent"], node.inputs["Tangent"])


def connect_frame(tree: bpy.types.NodeTree, node: bpy.types.Node) -> None:
    """How the swatch lies on the surface, by the coordinates that the group is given, before they are tiled at random
    or moved by parallax: from one patch to the next these jump.

    An artist's own vectors stay, and so does the frame of another swatch in the tree, which may lie otherwise.
    """
    source = coordinates_before_tiling(node)
    loose = [name for name in (ALONG_U, ALONG_V) if not _own_vector(node, name)]
    frame = _frame_for(tree, node, source)
    if source is not None and source_of(frame.inputs["UV"]) != source:
        tree.links.new(source, frame.inputs["UV"])
    for name in loose:
        tree.links.new(frame.outputs[name], node.inputs[name])


def _own_vector(node: bpy.types.Node, name: str) -> bool:
    """Whether something other than a swatch frame gives this input."""
    source = source_of(node.inputs[name])
    return source is not None and not is_swatch_frame(source.node)


def _frame_for(tree: bpy.types.NodeTree, node: bpy.types.Node, source: bpy.types.NodeSocket | None) -> bpy.types.Node:
    """A frame of these coordinates, else one that no other node reads, else a new one."""
    frames = [n for n in tree.nodes if is_swatch_frame(n)]
    found = next((n for n in frames if source_of(n.inputs["UV"]) == source), None)
    found = found or next((n for n in frames if _readers(n) <= {node}), None)
    if found is None:
        found = tree.nodes.new("ShaderNodeGroup")
        found.node_tree = swatch_frame_group()
        found.location, found.parent = (node.location.x - 220, node.location.y - 600), node.parent
    return found


def _readers(frame: bpy.types.Node) -> set[bpy.types.Node]:
    """Nodes that are given what a frame finds, past reroutes."""
    pending = [*frame.outputs]
    found: set[bpy.types.Node] = set()
    while pending and len(found) < _MOST_REROUTES:
        for reader in (link.to_node for link in pending.pop().links):
            if reader not in found and reader.bl_idname == "NodeReroute":
                pending.append(reader.outputs[0])
            found.add(reader)
    return {reader for reader in found if reader.bl_idname != "NodeReroute"}


def frame_before(node: bpy.types.Node) -> bpy.types.Node | None:
    """The frame that gives both vectors; None where an artist's own nodes give either."""
    sources = [source_of(node.inputs[name]) for name in (ALONG_U, ALONG_V)]
    frames = {source.node for source in sources if source is not None}
    frame = frames.pop() if len(frames) == 1 and None not in sources else None
    return frame if frame is not None and is_swatch_frame(frame) else None


def coordinates_before_tiling(node: bpy.types.Node) -> bpy.types.NodeSocket | None:
    """The socket that gives a measured group its texture coordinates, or those that are tiled at random, and moved by
    parallax, before it."""
    source = source_of(node.inputs["UV"])
    for moves in (is_parallax, is_random_tiling):
        if source is not None and moves(source.node):
            source = source_of(source.node.inputs["UV"])
    return source


def source_of(socket: bpy.types.NodeSocket) -> bpy.types.NodeSocket | None:
    """The output that feeds an input, past reroutes; None where nothing does."""
    for _ in range(_MOST_REROUTES):
        if not socket.is_linked:
            return None
        source = socket.links[0].from_socket
        if source.node.bl_idname != "NodeReroute":
            return source
        socket = source.node.inputs[0]
    return None
