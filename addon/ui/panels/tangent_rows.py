"""The direction of brushing of an anisotropic material in its panel: the tree's own nodes, drawn where artists look."""

from __future__ import annotations

from typing import Any

import bpy

from ....nodes.material_tree import measured_nodes

_ROTATION = "Rotation"


def tangent_nodes(material: bpy.types.Material) -> tuple[Any, Any]:
    """The Tangent node and the group that keeps it to the surface; None for what is not there or not linked."""
    nodes = [node for _, node in measured_nodes(material.node_tree) if "Tangent" in node.inputs]
    group = _source(nodes[0].inputs["Tangent"]) if nodes else None
    if group is None or _ROTATION not in group.inputs or "Tangent" not in group.inputs:
        return None, None
    made = _source(group.inputs["Tangent"])
    return (made if made is not None and made.bl_idname == "ShaderNodeTangent" else None), group


def draw_tangent(layout: bpy.types.UILayout, material: bpy.types.Material, context: bpy.types.Context) -> None:
    """Draw the tangent's source and rotation; nothing for isotropic materials and an artist's own nodes."""
    made, group = tangent_nodes(material)
    if group is None:
        return
    column = layout.column()
    column.use_property_split, column.use_property_decorate = True, False
    column.enabled = material.is_editable
    if made is not None:
        column.prop(made, "direction_type", text="Tangent")
        mesh = getattr(context.object, "data", None)
        if made.direction_type == "RADIAL":
            column.prop(made, "axis")
        elif isinstance(mesh, bpy.types.Mesh):
            column.prop_search(made, "uv_map", mesh, "uv_layers", text="UV Map")
    if not group.inputs[_ROTATION].is_linked:
        column.prop(group.inputs[_ROTATION], "default_value", text=_ROTATION)


def _source(socket: Any) -> Any:
    return socket.links[0].from_node if socket.is_linked else None
