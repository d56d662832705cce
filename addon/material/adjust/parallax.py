"""Parallax of a shading map: its relief where an oblique view sees it, by heights of `bake maps`."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np

from ....bake.errors import BakeError
from ....bake.maps.folder import MapsFolder
from ....bake.shading_maps.record import ShadingMapRecord
from ....bake.shading_maps.slice_atlas import SliceLayout
from ....nodes.data_image import PART_KEY
from ....nodes.group import trees_below
from ....nodes.material_tree import measured_nodes
from ....nodes.parallax_group import Relief, is_parallax, parallax_group
from ....nodes.principled_maps import map_image
from ....nodes.surface_inputs import connect_frame, source_of
from ....nodes.swatch_frame_group import ALONG_U, is_swatch_frame
from .swatch import uv_socket

# Pictures whose proportions differ by more are not of one swatch.
_SAME_SHAPE = 0.02


def parallax_node(material: bpy.types.Material) -> bpy.types.Node | None:
    """The node that moves the swatch's coordinates; None where there is none."""
    socket = uv_socket(material)
    source = source_of(socket) if socket is not None else None
    return source.node if source is not None and is_parallax(source.node) else None


def add_parallax(
    material: bpy.types.Material,
    record: ShadingMapRecord,
    maps: MapsFolder,
    *,
    pack: bool = False,
    tiling: str | None = None,
) -> bpy.types.Node:
    """Move the swatch's coordinates by the heights of these maps, of the same photographs. Nothing else of it changes.

    Parameters
    ----------
    record : of the material
    pack : keep the heights inside the .blend
    tiling : that the material was built by, by default the record's

    Raises
    ------
    BakeError : the material has parallax already, its group or coordinates are gone, its swatch was made to tile or is
        of another shape than the heights, or these cannot be loaded
    """
    socket = uv_socket(material)
    if socket is None:
        raise BakeError(material.name, "its measured group is no longer among its nodes", "undo its removal")
    if parallax_node(material) is not None:
        raise BakeError(material.name, "already has parallax", "switch it off first")
    if not socket.is_linked:
        raise BakeError(material.name, "nothing is linked to the UV of its measured group", "link a UV map to it")
    if record.tiling is not None:
        cause = "its swatch was made to tile, which the heights of its photographs were not"
        raise BakeError(material.name, cause, "bake the photographs without --tileable")
    before = set(bpy.data.images)
    try:
        relief = _relief(maps, record.map.layout, pack)
    except BaseException:
        bpy.data.batch_remove(set(bpy.data.images) - before)
        raise
    tree, source = socket.id_data, socket.links[0].from_socket
    made = tree.nodes.new("ShaderNodeGroup")
    made.node_tree = parallax_group(relief, tiling or record.render.tiling)
    made.location, made.parent = (socket.node.location.x - 220, socket.node.location.y - 860), socket.node.parent
    tree.links.new(source, made.inputs["UV"])
    tree.links.new(made.outputs["UV"], socket)
    connect_frame(tree, made)
    return made


def remove_parallax(material: bpy.types.Material) -> None:
    """Show the swatch flat again; nothing happens where it is."""
    node, socket = parallax_node(material), uv_socket(material)
    if node is None:
        return
    tree, source = socket.id_data, source_of(node.inputs["UV"])
    frame = source_of(node.inputs[ALONG_U])
    tree.nodes.remove(node)
    if source is not None:
        tree.links.new(source, socket)
    if frame is not None and is_swatch_frame(frame.node) and not any(o.is_linked for o in frame.node.outputs):
        tree.nodes.remove(frame.node)


def without_unfit_parallax(material: bpy.types.Material, record: ShadingMapRecord, *, others: bool) -> str:
    """Switch parallax off where its relief is not that of the swatch any more; why, or empty.

    Parameters
    ----------
    record : of what the material was baked of by now
    others : these are other photographs than before
    """
    node = parallax_node(material)
    if node is None:
        return ""
    layout = record.map.layout
    images = [part.image for part in node.node_tree.nodes if part.bl_idname == "ShaderNodeTexImage" and part.image]
    if others:
        why = "its heights are those of other photographs"
    elif record.tiling is not None:
        why = "the swatch was made to tile, which its heights were not"
    elif images and _differ(images[0].size, layout):
        why = "its heights are of another part of the photographs"
    else:
        return ""
    remove_parallax(material)
    return f"parallax is off now: {why}"


def _differ(size: Sequence[int], layout: SliceLayout) -> bool:
    """Whether heights of so many texels are of another shape than a swatch."""
    return abs(size[0] / max(size[1], 1) / (layout.width / layout.height) - 1) > _SAME_SHAPE


def keeps_textures(material: bpy.types.Material) -> bool:
    """Whether the measured group's textures are packed into the .blend."""
    return any(
        part.bl_idname == "ShaderNodeTexImage" and part.image and part.image.get(PART_KEY) and part.image.packed_file
        for _, node in measured_nodes(material.node_tree)
        for tree in trees_below(node.node_tree)
        for part in tree.nodes
    )


def _relief(maps: MapsFolder, layout: SliceLayout, pack: bool) -> Relief:
    """The heights as an image, and its range. Raises BakeError."""
    file = maps.files["height"]
    zero, scale = file.number("midlevel"), file.number("scale")
    image = map_image(file, f"{maps.name} height", pack)
    width, height = image.size
    if _differ((width, height), layout):
        cause = f"is of {width} x {height} texels, and the swatch of {layout.width} x {layout.height}"
        raise BakeError(file.path, cause, "give the maps of the same photographs")
    values = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(values)
    red = values[:: image.channels]
    if not (np.isfinite(red).all() and scale >= 0):
        raise BakeError(file.path, "holds heights that are not finite, or a scale below 0", "bake the maps again")
    return Relief(image, float(red.min()), float(red.max()), zero, scale)
