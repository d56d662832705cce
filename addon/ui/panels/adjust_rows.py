"""The Adjust panel: the sockets of a material's own node, to be set, keyed and linked, and what stands before them."""

from __future__ import annotations

from typing import Any

import bpy

from ....nodes.adjustments import GLOSS, SOCKETS
from ....nodes.material_tree import measured_nodes
from ....nodes.second_group import MASK, mask_node, second_node
from ...material.adjust.blend import second_of
from ...material.adjust.energy import energy_of
from ...material.adjust.parallax import parallax_node
from ...material.adjust.relief import relief_nodes
from ...material.adjust.swatch import random_tiling_node, swatch_mapping
from ...material.facts import record_of
from ...material.kinds import SHADING_MAP, kind_of
from ..adjust import (
    MEASURED_MATERIALS_OT_add_bump,
    MEASURED_MATERIALS_OT_add_normal_map,
    MEASURED_MATERIALS_OT_blend,
    MEASURED_MATERIALS_OT_lay_out,
    MEASURED_MATERIALS_OT_parallax,
    MEASURED_MATERIALS_OT_random_tiling,
    MEASURED_MATERIALS_OT_remove_blend,
    MEASURED_MATERIALS_OT_safe_brightness,
)
from ..context import ForMeasured, shown_material
from ..fit_to_scene import MEASURED_MATERIALS_OT_fit_to_scene
from .wrapped_text import Lines


class AdjustPanel(ForMeasured):
    """What can be changed without a bake."""

    bl_label = "Adjust"

    def draw(self: Any, context: bpy.types.Context) -> None:
        """Colour, relief and, of photographs, how the swatch lies."""
        draw_adjust(self.layout, shown_material(context), Lines(context))


def draw_adjust(layout: Any, material: bpy.types.Material, lines: Lines) -> None:
    """Rows for the first of the material's measured nodes."""
    place = next(iter(measured_nodes(material.node_tree)), None)
    if place is None:
        lines.draw(layout, "Its measured group is no longer among its nodes", "ERROR")
        return
    layout.use_property_split, layout.use_property_decorate = True, True
    layout.enabled = material.is_editable
    _draw_colour(layout, material, *place, lines)
    _draw_relief(layout, material)
    _draw_blend(layout, material, lines)
    if kind_of(material) is SHADING_MAP:
        _draw_swatch(layout, material)


def _draw_colour(layout: Any, material: bpy.types.Material, tree: Any, node: Any, lines: Lines) -> None:
    """Sockets of the node, and whether too much light is reflected."""
    names = (*SOCKETS, *((GLOSS,) if kind_of(material) is not SHADING_MAP else ()))
    for name in names:
        if name in node.inputs:
            _draw_socket(layout, tree, node, name)
    if any(name not in node.inputs for name in names):
        lines.draw(layout, "An older version made this material; Fit to Scene adds what is missing here", "INFO")
        layout.operator(MEASURED_MATERIALS_OT_fit_to_scene.bl_idname, icon="SCENE_DATA")
    energy = energy_of(material)
    if energy is not None and energy.words:
        lines.draw(layout, energy.words, "ERROR" if energy.gains else "INFO")
        if energy.mend is not None:
            layout.operator(MEASURED_MATERIALS_OT_safe_brightness.bl_idname, icon="LIGHT")


def _draw_socket(layout: Any, tree: Any, node: Any, name: str) -> None:
    """An input as the material's Surface is drawn: a value to key, a dot to link a texture by, or what is linked."""
    layout.template_node_view(tree, node, node.inputs[name])


def _draw_blend(layout: Any, material: bpy.types.Material, lines: Lines) -> None:
    """The second material and the mask, or a button to choose one."""
    node, mask = second_node(material.node_tree), mask_node(material.node_tree)
    if node is None:
        layout.operator(MEASURED_MATERIALS_OT_blend.bl_idname, icon="NODE_COMPOSITING")
        return
    second = second_of(material)
    known = f"Blended with {second.name}" if second is not None else "Blended with a material that is gone"
    lines.draw(layout, known, "NODE_COMPOSITING")
    if mask is not None:
        _draw_socket(layout, material.node_tree, mask, MASK)
    layout.operator(MEASURED_MATERIALS_OT_remove_blend.bl_idname, icon="X")


def _draw_relief(layout: Any, material: bpy.types.Material) -> None:
    """Settings of the nodes before the normal, and buttons for those that are not there."""
    bump, normal_map = relief_nodes(material)
    for node, rows in ((bump, ("Strength", "Distance", "Height")), (normal_map, ("Strength", "Color"))):
        if node is not None:
            layout.label(text=node.label or node.bl_label)
            for name in rows:
                _draw_socket(layout, node.id_data, node, name)
    row = layout.row(align=True)
    if bump is None:
        row.operator(MEASURED_MATERIALS_OT_add_bump.bl_idname, icon="ADD")
    if normal_map is None:
        row.operator(MEASURED_MATERIALS_OT_add_normal_map.bl_idname, icon="ADD")


def _draw_swatch(layout: Any, material: bpy.types.Material) -> None:
    """Size, rotation, random tiling and parallax."""
    mapping, tiling = swatch_mapping(material), random_tiling_node(material)
    layout.operator(MEASURED_MATERIALS_OT_lay_out.bl_idname, icon="DRIVER_DISTANCE")
    if mapping is not None and not mapping.inputs["Rotation"].is_linked:
        layout.prop(mapping.inputs["Rotation"], "default_value", index=2, text="Rotation")
    # Beyond a swatch that is not repeated there is nothing to choose from.
    if tiling is not None or material.measured_lighting.tiling == "repeat":
        layout.operator(MEASURED_MATERIALS_OT_random_tiling.bl_idname, icon="MOD_ARRAY", depress=tiling is not None)
    for name in ("Patch Size", "Seed") if tiling is not None else ():
        _draw_socket(layout, tiling.id_data, tiling, name)
    parallax = parallax_node(material)
    row = layout.row()
    # The heights of a swatch that was made to tile are not those of its photographs.
    row.enabled = parallax is not None or record_of(material).tiling is None
    row.operator(MEASURED_MATERIALS_OT_parallax.bl_idname, icon="MOD_DISPLACE", depress=parallax is not None)
    if parallax is not None:
        _draw_socket(layout, parallax.id_data, parallax, "Depth")
