"""Operator: a Principled BSDF material of maps that were baked before; file menu and panel."""

# No postponed annotations here: Blender reads the properties from them.
from pathlib import Path
from typing import Any

import bpy

from ....bake.errors import BakeError
from ....bake.maps.folder import read_maps_folder
from ....bake.maps.write import DOCUMENT
from ....nodes.principled_maps import build_principled
from ...material.bake_material import told_place
from ...summary.text import one_line
from ..background.window import push_for_script
from ..import_operator import registration
from ..properties.maps import RELIEF, SWATCH_WIDTH, width_of

_HIDDEN = {"HIDDEN", "SKIP_SAVE"}
_FILEPATH = bpy.props.StringProperty(subtype="FILE_PATH", options=_HIDDEN)
_DIRECTORY = bpy.props.StringProperty(subtype="DIR_PATH", options=_HIDDEN)
_FILTER_GLOB = bpy.props.StringProperty(default=DOCUMENT, options={"HIDDEN"})
_OBJECT = bpy.props.StringProperty(
    name="Object", description="Object that gets the material; the active one by default", options=_HIDDEN
)
_PACK = bpy.props.BoolProperty(
    name="Pack into .blend", description="Keep the textures inside the .blend file", default=True
)


class MEASURED_MATERIALS_OT_import_maps(bpy.types.Operator):
    """Build a Principled BSDF material of maps that were baked of photographs. Choose maps.json, or its folder"""

    bl_idname = "measured_materials.import_maps"
    bl_label = "Build Material"
    bl_options = {"UNDO", "PRESET"}

    filepath: _FILEPATH
    directory: _DIRECTORY
    filter_glob: _FILTER_GLOB
    object_name: _OBJECT
    relief: RELIEF
    swatch_width: SWATCH_WIDTH
    pack: _PACK

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask for the folder."""
        if self.filepath or self.directory:
            return self.execute(context)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Build it, and put it onto the object."""
        chosen = self.filepath or self.directory
        if not chosen:
            self.report({"ERROR"}, f"No maps were chosen: a folder with {DOCUMENT}")
            return {"CANCELLED"}
        path = Path(bpy.path.abspath(chosen))
        try:
            maps = read_maps_folder(path if path.is_dir() else path.parent)
            material = build_principled(maps, relief=self.relief, width=width_of(self), pack=self.pack)
        except BakeError as error:
            self.report({"ERROR"}, one_line(str(error)))
            return {"CANCELLED"}
        target = bpy.data.objects.get(self.object_name) or context.object
        self.report({"INFO"}, f"{material.name}{told_place(self, material, target)}: maps of {maps.path}")
        push_for_script(self)
        return {"FINISHED"}


def _menu(self: Any, _context: bpy.types.Context) -> None:
    self.layout.operator(MEASURED_MATERIALS_OT_import_maps.bl_idname, text=f"Maps of a Swatch ({DOCUMENT})")


classes = (MEASURED_MATERIALS_OT_import_maps,)
register, unregister = registration(classes, "TOPBAR_MT_file_import", _menu)
