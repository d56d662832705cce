"""Operators: mark a measured material as an asset, make it an ordinary one again, open the folder it lies in."""

# No postponed annotations here: Blender reads the properties from them.
from pathlib import Path

import bpy

from ...bake.errors import BakeError
from ..assets.mark import library_folder, mark, stated_rights, unmark
from ..assets.words import Rights
from ..material.bake_material import exists
from ..material.facts import is_measured
from ..material.textures.kept import bundle_path
from ..summary.text import one_line
from .context import OfMeasured, shown_material

_AUTHOR = bpy.props.StringProperty(name="Author", description="Who measured it or took the photographs")
_LICENSE = bpy.props.StringProperty(
    name="License", description="What others may do with it, for example CC0 or CC-BY 4.0; empty where it is not known"
)
_COPYRIGHT = bpy.props.StringProperty(name="Copyright", description="The copyright notice that must go with it, if any")


class MEASURED_MATERIALS_OT_mark_asset(OfMeasured, bpy.types.Operator):
    """Show the material in the asset browser, with its picture, a catalog, tags, and what is known of its source"""

    bl_idname = "measured_materials.mark_asset"
    bl_label = "Mark as Asset"
    bl_options = {"REGISTER", "UNDO"}

    author: _AUTHOR
    license: _LICENSE
    copyright: _COPYRIGHT

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Ask for what no file can tell, with what is known filled in."""
        try:
            rights = stated_rights(shown_material(context))
        except BakeError as error:
            self.report({"ERROR"}, one_line(str(error)))
            return {"CANCELLED"}
        self.author, self.license, self.copyright = rights.author, rights.license, rights.copyright
        return context.window_manager.invoke_props_dialog(self, title="Mark as Asset", confirm_text="Mark")

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Mark it; whatever is given replaces what was stated before."""
        material = shown_material(context)
        given = any(self.properties.is_property_set(name) for name in ("author", "license", "copyright"))
        try:
            left = mark(material, Rights(self.author, self.license, self.copyright) if given else None)
        except BakeError as error:
            self.report({"ERROR"}, one_line(str(error)))
            return {"CANCELLED"}
        if left:
            self.report({"WARNING"}, f"{material.name} is an asset, but not all is set: {left}")
        else:
            self.report({"INFO"}, f"{material.name} is an asset; save the file for other files to find it")
        return {"FINISHED"}


class MEASURED_MATERIALS_OT_clear_asset(OfMeasured, bpy.types.Operator):
    """Take the material out of the asset browser; the material itself stays as it is"""

    bl_idname = "measured_materials.clear_asset"
    bl_label = "Clear Asset"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Unmark it."""
        material = shown_material(context)
        unmark(material)
        kept = "; nothing uses it, and a fake user keeps it" if material.use_fake_user else ""
        self.report({"INFO"}, f"{material.name} is no asset any more{kept}")
        return {"FINISHED"}


class MEASURED_MATERIALS_OT_open_library(bpy.types.Operator):
    """Open the folder with the material's baked textures in the file manager; without one, the folder of the .blend
    file's asset library"""

    bl_idname = "measured_materials.open_library"
    bl_label = "Open Library Folder"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Open it."""
        folder = folder_to_open(shown_material(context))
        if folder is None:
            self.report({"ERROR"}, "There is no folder yet; save the .blend file first")
            return {"CANCELLED"}
        try:
            bpy.ops.wm.path_open(filepath=str(folder))
        except RuntimeError as error:
            self.report({"ERROR"}, f"{folder} cannot be opened: {one_line(str(error))}")
            return {"CANCELLED"}
        return {"FINISHED"}


def folder_to_open(material: bpy.types.Material | None) -> Path | None:
    """Folder in which the material's bundle lies beside others, else that of the .blend's library; None for none."""
    if is_measured(material):
        bundle = bundle_path(material)
        if bundle.is_absolute() and exists(bundle.parent):
            return bundle.parent
    return library_folder()


classes = (MEASURED_MATERIALS_OT_mark_asset, MEASURED_MATERIALS_OT_clear_asset, MEASURED_MATERIALS_OT_open_library)
register, unregister = bpy.utils.register_classes_factory(classes)
