"""Files dropped together, of any kinds: bundles are loaded, measurements and photographs ask for their settings."""

# No postponed annotations here: Blender reads the properties from them.
from pathlib import Path

import bpy

from ...bake.bundle.bundle import SUFFIX
from .context import object_under
from .import_brdf import SUFFIXES
from .import_operator import DropTarget

# Files with the lights of a folder's photographs. Pictures themselves are left to Blender, which makes nodes of them.
LIGHTS = (".lp", ".csv")
_HIDDEN = {"HIDDEN", "SKIP_SAVE"}
_FILES = bpy.props.CollectionProperty(type=bpy.types.OperatorFileListElement, options=_HIDDEN)
_DIRECTORY = bpy.props.StringProperty(subtype="DIR_PATH", options=_HIDDEN)
_FILEPATH = bpy.props.StringProperty(subtype="FILE_PATH", options=_HIDDEN)


class MEASURED_MATERIALS_OT_drop(bpy.types.Operator):
    """Import measurements, baked materials, and photographs by the file of their lights"""

    bl_idname = "measured_materials.drop"
    bl_label = "Import Measured Materials"
    bl_options = {"INTERNAL"}

    files: _FILES
    directory: _DIRECTORY
    filepath: _FILEPATH

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Hand each kind to its own import."""
        names = [element.name for element in self.files if element.name]
        folder = self.directory
        if not names and self.filepath:
            path = Path(bpy.path.abspath(self.filepath))
            names, folder = [path.name], str(path.parent)
        target = object_under(context, event)
        of_object = {"object_name": target.name if target else ""}
        bundles, lights, measurements = sorted_by_kind(names)
        calls = bpy.ops.measured_materials
        if bundles:
            calls.import_bundle("INVOKE_DEFAULT", directory=folder, files=_listed(bundles), **of_object)
        for name in lights:
            calls.import_arc("INVOKE_DEFAULT", filepath=str(Path(folder) / name), **of_object)
        if measurements:
            calls.import_brdf("INVOKE_DEFAULT", directory=folder, files=_listed(measurements), **of_object)
        return {"FINISHED"} if names else {"CANCELLED"}


class MEASURED_MATERIALS_FH_all(DropTarget, bpy.types.FileHandler):
    """All that can be dropped on a 3D viewport or a shader editor, by one handler: of several Blender would ask."""

    bl_idname = "MEASURED_MATERIALS_FH_all"
    bl_label = "Measured Materials"
    bl_import_operator = "measured_materials.drop"
    bl_file_extensions = ";".join((*SUFFIXES, SUFFIX, *LIGHTS))


def sorted_by_kind(names: list[str]) -> tuple[list[str], list[str], list[str]]:
    """Bundles, files with lights, and all else."""
    bundles = [name for name in names if name.lower().endswith(SUFFIX)]
    lights = [name for name in names if name.lower().endswith(LIGHTS)]
    return bundles, lights, [name for name in names if name not in {*bundles, *lights}]


def _listed(names: list[str]) -> list[dict[str, str]]:
    return [{"name": name} for name in names]


classes = (MEASURED_MATERIALS_OT_drop, MEASURED_MATERIALS_FH_all)
register, unregister = bpy.utils.register_classes_factory(classes)
