"""Files dropped together, of any kinds: bundles are loaded, measurements and photographs ask for their settings."""

# No postponed annotations here: Blender reads the properties from them.
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

import bpy

from ...bake.bundle.bundle import SUFFIX
from ...bake.photographs.photograph import IMAGE_SUFFIXES
from .context import object_under
from .import_brdf import SUFFIXES
from .import_operator import DropTarget

# Files with the lights of a folder's photographs.
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
        wanted: list[tuple[Any, dict[str, Any]]] = []
        if bundles:
            wanted.append((calls.import_bundle, {"directory": folder, "files": _listed(bundles)}))
        wanted += [(calls.import_arc, {"filepath": str(Path(folder) / name)}) for name in lights]
        if measurements:
            wanted.append((calls.import_brdf, {"directory": folder, "files": _listed(measurements)}))
        problems = problems_of([partial(call, "INVOKE_DEFAULT", **given, **of_object) for call, given in wanted])
        if problems:
            self.report({"ERROR"}, "\n".join(problems))
        return {"FINISHED"} if names else {"CANCELLED"}


class MEASURED_MATERIALS_FH_all(DropTarget, bpy.types.FileHandler):
    """All that can be dropped on a 3D viewport or a shader editor, by one handler: of several Blender would ask."""

    bl_idname = "MEASURED_MATERIALS_FH_all"
    bl_label = "Measured Materials"
    bl_import_operator = "measured_materials.drop"
    bl_file_extensions = ";".join((*SUFFIXES, SUFFIX, *LIGHTS))


class MEASURED_MATERIALS_FH_photographs(DropTarget, bpy.types.FileHandler):
    """Pictures, which Blender makes nodes or empties of: beside those it offers to make a material of them.

    A handler is found by the suffix of what is dropped: a folder, which has none, never comes to any.
    """

    bl_idname = "MEASURED_MATERIALS_FH_photographs"
    bl_label = "Measured Material of Photographs"
    bl_import_operator = "measured_materials.import_arc"
    bl_file_extensions = ";".join(sorted(IMAGE_SUFFIXES))


def problems_of(calls: Iterable[Callable[[], object]]) -> list[str]:
    """What operators report, a line each: one that fails keeps no other from being called."""
    problems = []
    for call in calls:
        try:
            call()
        except RuntimeError as error:
            problems += [line.removeprefix("Error: ") for line in str(error).strip().splitlines()]
    return problems


def sorted_by_kind(names: list[str]) -> tuple[list[str], list[str], list[str]]:
    """Bundles, files with lights, and all else."""
    bundles = [name for name in names if name.lower().endswith(SUFFIX)]
    lights = [name for name in names if name.lower().endswith(LIGHTS)]
    return bundles, lights, [name for name in names if name not in {*bundles, *lights}]


def _listed(names: list[str]) -> list[dict[str, str]]:
    return [{"name": name} for name in names]


classes = (MEASURED_MATERIALS_OT_drop, MEASURED_MATERIALS_FH_all, MEASURED_MATERIALS_FH_photographs)
register, unregister = bpy.utils.register_classes_factory(classes)
