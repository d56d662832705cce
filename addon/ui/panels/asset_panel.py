"""Panel: the material as an asset."""

from __future__ import annotations

import bpy

from ..assets import (
    MEASURED_MATERIALS_OT_clear_asset,
    MEASURED_MATERIALS_OT_mark_asset,
    MEASURED_MATERIALS_OT_open_library,
)
from ..context import ForMeasured, shown_material
from .places import in_both_places
from .wrapped_text import Lines


class _AssetPanel(ForMeasured):
    """Into the asset browser, out of it, and to the files."""

    bl_label = "Asset"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """What the asset states, and the buttons."""
        material, layout = shown_material(context), self.layout
        data, lines = material.asset_data, Lines(context)
        column = layout.column(align=True)
        if data is None:
            column.operator(MEASURED_MATERIALS_OT_mark_asset.bl_idname, icon="ASSET_MANAGER")
        else:
            row = column.row(align=True)
            row.operator(MEASURED_MATERIALS_OT_mark_asset.bl_idname, text="Update Asset", icon="FILE_REFRESH")
            row.operator(MEASURED_MATERIALS_OT_clear_asset.bl_idname, text="", icon="X")
        column.operator(MEASURED_MATERIALS_OT_open_library.bl_idname, icon="FILE_FOLDER")
        if data is not None:
            stated = (("Author", data.author), ("License", data.license), ("Copyright", data.copyright))
            column = layout.column(align=True)
            for label, value in stated:
                lines.row(column, label, value or "Not stated")


classes = in_both_places(_AssetPanel, "asset")
register, unregister = bpy.utils.register_classes_factory(classes)
