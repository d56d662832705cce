"""Operator: bake measured BRDF files and make materials of them; file menu, drag and drop."""

# No postponed annotations here: Blender reads the properties from them.
from pathlib import Path
from typing import Any

import bpy

from ...bake.errors import BakeError
from ...bake.sources import READERS, known_formats
from ..material.bake_material import assign, bundle_folder, error_words, import_brdf, told_place
from ..material.together import built_together
from ..summary.text import one_line
from .context import object_under
from .properties.bake import BakeProperties, draw_settings, settings_of, show_settings
from .window_progress import window_progress

SUFFIXES = tuple(dict.fromkeys(suffix for reader in READERS for suffix in reader.suffixes))

_FILES = bpy.props.CollectionProperty(type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"})
_FILEPATH = bpy.props.StringProperty(subtype="FILE_PATH", options={"HIDDEN", "SKIP_SAVE"})
_DIRECTORY = bpy.props.StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})
_FILTER_GLOB = bpy.props.StringProperty(default=";".join(f"*{s}" for s in SUFFIXES), options={"HIDDEN"})
_OBJECT = bpy.props.StringProperty(
    name="Object",
    description="Object that gets the material; the active one by default",
    options={"HIDDEN", "SKIP_SAVE"},
)
_BUNDLES = bpy.props.StringProperty(
    name="Bundles",
    description="Folder for the baked textures. Empty: beside the .blend file or, before it is saved, beside the "
    "measurement",
    subtype="DIR_PATH",
    options={"SKIP_SAVE"},
)


class MEASURED_MATERIALS_OT_import_brdf(BakeProperties, bpy.types.Operator):
    """Bake measured BRDFs and make Cycles materials of them"""

    bl_idname = "measured_materials.import_brdf"
    bl_label = "Import BRDF"
    bl_options = {"UNDO", "PRESET"}

    files: _FILES
    filepath: _FILEPATH
    directory: _DIRECTORY
    filter_glob: _FILTER_GLOB
    object_name: _OBJECT
    bundles: _BUNDLES

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask for files, or, when they were dropped, for settings only."""
        if not self._paths():
            context.window_manager.fileselect_add(self)
            return {"RUNNING_MODAL"}
        target = object_under(context, event)
        self.object_name = target.name if target else ""
        title = self._paths()[0].name if len(self._paths()) == 1 else f"{len(self._paths())} measurements"
        return context.window_manager.invoke_props_dialog(self, title=f"Import {title}", confirm_text="Bake")

    def draw(self, _context: bpy.types.Context) -> None:
        """Draw the settings in the file browser's sidebar or in the dialogue."""
        draw_settings(self.layout, self)
        column = self.layout.column()
        column.use_property_split, column.use_property_decorate = True, False
        column.prop(self, "bundles")
        if self.object_name:
            column.label(text=f"For {self.object_name}", icon="OBJECT_DATA")

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Bake every file; a bad one is reported and does not keep the others from being imported."""
        paths = self._paths()
        if not paths:
            self.report({"ERROR"}, f"No file was chosen; known formats: {known_formats()}")
            return {"CANCELLED"}
        try:
            settings = settings_of(self)
        except BakeError as error:
            self.report({"ERROR"}, one_line(str(error)))
            return {"CANCELLED"}
        made = []
        with window_progress(context, settings, len(paths)) as progress_of, built_together():
            for number, path in enumerate(paths):
                try:
                    folder = bundle_folder(self.bundles, path)
                    made.append(import_brdf(path, folder, settings, pack=self.pack, progress=progress_of(number)))
                except BakeError as error:
                    self.report({"ERROR"}, one_line(str(error)))
        for material in made:
            show_settings(material.measured_materials, settings)
            material.measured_materials.pack = self.pack
        if not made:
            return {"CANCELLED"}
        obj = bpy.data.objects.get(self.object_name) or context.object
        for material in made[1:]:
            assign(material, None)
        place = told_place(self, made[0], obj)
        self.report({"INFO"}, f"{made[0].name}{place}: {error_words(made[0])}" + _others(len(made) - 1))
        return {"FINISHED"}

    def _paths(self) -> list[Path]:
        names = [element.name for element in self.files if element.name]
        if names and self.directory:
            return [Path(self.directory) / name for name in names]
        return [Path(bpy.path.abspath(self.filepath))] if self.filepath else []


class MEASURED_MATERIALS_FH_brdf(bpy.types.FileHandler):
    """Measurements dropped on a 3D viewport or a shader editor are imported."""

    bl_idname = "MEASURED_MATERIALS_FH_brdf"
    bl_label = "Measured BRDF"
    bl_import_operator = "measured_materials.import_brdf"
    bl_file_extensions = ";".join(SUFFIXES)

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        """Whether the area under the mouse takes an import."""
        return context.area is not None and context.area.type in {"VIEW_3D", "NODE_EDITOR"}


def _others(count: int) -> str:
    return f", and {count} more without an object" if count else ""


def _menu(self: Any, _context: bpy.types.Context) -> None:
    self.layout.operator(MEASURED_MATERIALS_OT_import_brdf.bl_idname, text=f"Measured BRDF ({' '.join(SUFFIXES)})")


classes = (MEASURED_MATERIALS_OT_import_brdf, MEASURED_MATERIALS_FH_brdf)
_register_classes, _unregister_classes = bpy.utils.register_classes_factory(classes)


def register() -> None:
    """Called by `addon.register`."""
    _register_classes()
    bpy.types.TOPBAR_MT_file_import.append(_menu)


def unregister() -> None:
    """Called by `addon.unregister`."""
    bpy.types.TOPBAR_MT_file_import.remove(_menu)
    _unregister_classes()
