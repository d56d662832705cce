"""How a shading map's swatch lies on the surface: its size in metres, its rotation, and its repetition hidden."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ....bake.errors import BakeError
from ....nodes.material_tree import measured_nodes
from ....nodes.parallax_group import is_parallax
from ....nodes.random_tiling_group import is_random_tiling, random_tiling_group
from ....nodes.surface_inputs import SWATCH_MAPPING, source_of
from ..facts import record_of
from ..texel_footprint import uv_triangles

# The swatch's width in metres, as last laid out by it.
WIDTH_KEY = "measured_materials_swatch_width"


def swatch_mapping(material: bpy.types.Material) -> bpy.types.Node | None:
    """The Mapping node that lays the swatch out; None where an artist has taken it out."""
    nodes = material.node_tree.nodes
    return next((n for n in nodes if n.label == SWATCH_MAPPING and n.bl_idname == "ShaderNodeMapping"), None)


def lay_out(material: bpy.types.Material, obj: bpy.types.Object, width: float, unit: float = 1.0) -> float:
    """Scale the swatch so that it is as wide on an object as it is in truth; returns how often it repeats across u.

    Its height follows from its texels, which are square. The object's UV map is taken as even: by the mean of its area.

    Parameters
    ----------
    obj : that shows the material, with a UV map
    width : of the swatch in metres
    unit : metres in a unit of the scene

    Raises
    ------
    BakeError : there is no Mapping node, its Scale is linked, or the object has no area in its UV map
    """
    mapping = swatch_mapping(material)
    if mapping is None or mapping.inputs["Scale"].is_linked:
        cause = "the Mapping node that sizes its swatch is gone, or its Scale is linked"
        raise BakeError(material.name, cause, "size the swatch by your own nodes")
    metres = metres_per_uv(obj) * unit
    layout = record_of(material).map.layout
    across, up = metres / width, metres / width * layout.width / layout.height
    _turn_before_scaling(mapping, (1 / across, 1 / up, 1))
    material[WIDTH_KEY] = width
    return across


def _turn_before_scaling(mapping: bpy.types.Node, scale: tuple[float, float, float]) -> None:
    """Let the node turn first and scale after, where otherwise it would shear a swatch that is not square.

    Its rotation looks as before, and what lay at the origin of the UV map still does.
    """
    place, turn = mapping.inputs["Location"], mapping.inputs["Rotation"]
    mapping.inputs["Scale"].default_value = scale
    if mapping.vector_type != "TEXTURE":
        mapping.vector_type = "TEXTURE"
        turn.default_value[2] *= -1
        stretched = Vector(a * b for a, b in zip(place.default_value, scale))
        place.default_value = -(Matrix.Rotation(turn.default_value[2], 3, "Z") @ stretched)


def metres_per_uv(obj: bpy.types.Object) -> float:
    """Units of the world along an edge of the UV square, by the areas of all triangles. Raises BakeError."""
    triangles = uv_triangles(obj, np.array(obj.matrix_world)[:3, :3])
    if triangles is None:
        raise BakeError(obj.name, "it has no faces with a UV map", "unwrap it")
    corners, uv = triangles
    edges, steps = corners[:, 1:] - corners[:, :1], uv[:, 1:] - uv[:, :1]
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1).sum()
    of_uv = np.abs(steps[:, 0, 0] * steps[:, 1, 1] - steps[:, 0, 1] * steps[:, 1, 0]).sum()
    if not (of_uv > 1e-12 and area > 0):
        raise BakeError(obj.name, "its UV map has no area", "unwrap it")
    return float(np.sqrt(area / of_uv))


def random_tiling_node(material: bpy.types.Material) -> bpy.types.Node | None:
    """The node that hides the repetition, where it is linked to the swatch."""
    socket = tiled_socket(material)
    source = source_of(socket) if socket is not None else None
    return source.node if source is not None and is_random_tiling(source.node) else None


def set_random_tiling(material: bpy.types.Material, on: bool) -> None:
    """Put the node that hides the repetition before the swatch's UV, or take it out again. Raises BakeError."""
    node, socket = random_tiling_node(material), tiled_socket(material)
    if socket is None:
        raise BakeError(material.name, "its measured group is no longer among its nodes", "undo its removal")
    if on == (node is not None):
        return
    tree = socket.id_data
    if node is not None:
        before = node.inputs["UV"].links[0].from_socket if node.inputs["UV"].is_linked else None
        tree.nodes.remove(node)
        if before is not None:
            tree.links.new(before, socket)
        return
    if not socket.is_linked:
        raise BakeError(material.name, "nothing is linked to the UV of its measured group", "link a UV map to it")
    source = socket.links[0].from_socket
    made = tree.nodes.new("ShaderNodeGroup")
    made.node_tree = random_tiling_group()
    # Below the Mapping node, which is the highest of those before the group.
    made.location, made.parent = (socket.node.location.x - 220, socket.node.location.y - 660), socket.node.parent
    tree.links.new(source, made.inputs["UV"])
    tree.links.new(made.outputs["UV"], socket)


def uv_socket(material: bpy.types.Material) -> Any:
    """The UV of the measured group, None where that is gone."""
    return next((node.inputs["UV"] for _, node in measured_nodes(material.node_tree) if "UV" in node.inputs), None)


def tiled_socket(material: bpy.types.Material) -> Any:
    """Where coordinates that are tiled at random belong: before parallax, which looks at the heights of the patch."""
    socket = uv_socket(material)
    source = source_of(socket) if socket is not None else None
    return source.node.inputs["UV"] if source is not None and is_parallax(source.node) else socket
