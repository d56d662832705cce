"""Operator: bake a measured material again, with other settings or from another file, in place."""

# No postponed annotations here: Blender reads the properties from them.
from pathlib import Path
from typing import Any

import bpy

from ..bake.errors import BakeError
from ..bake.photographs.photograph import IMAGE_SUFFIXES
from .arc_material import bake_arc_again, map_words
from .arc_operator import chosen_photographs, tell_warnings
from .arc_properties import arc_settings_of
from .bake_properties import settings_of
from .describe import error_rows
from .facts import facts_of, is_measured, is_shading_map, source_file
from .import_operator import SUFFIXES, error_words
from .measured_material import bake_again, why_not_bakeable
from .text import one_line
from .ui_context import shown_material
from .window_progress import window_progress

_FILEPATH = bpy.props.StringProperty(
    name="Measurement",
    description="Another file, or folder of photographs, to bake; the material's own by default",
    subtype="FILE_PATH",
    options={"HIDDEN", "SKIP_SAVE"},
)
_FILES = bpy.props.CollectionProperty(type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"})
_DIRECTORY = bpy.props.StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})
_CHOOSE = bpy.props.BoolProperty(
    name="Choose File", description="Ask for the measurement or the photographs", options={"HIDDEN", "SKIP_SAVE"}
)
_FILTER_GLOB = bpy.props.StringProperty(default="", options={"HIDDEN", "SKIP_SAVE"})


class MEASURED_MATERIALS_OT_bake_again(bpy.types.Operator):
    """Bake again with these settings; every object keeps the material"""

    bl_idname = "measured_materials.bake_again"
    bl_label = "Bake Again"
    bl_options = {"UNDO"}

    filepath: _FILEPATH
    files: _FILES
    directory: _DIRECTORY
    choose: _CHOOSE
    filter_glob: _FILTER_GLOB

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Whether there is a measured material that can be changed."""
        material = shown_material(context)
        if not is_measured(material):
            cls.poll_message_set("There is no measured material here; import a measurement first")
            return False
        if not material.is_editable:
            cls.poll_message_set(f"{material.name} is linked from another .blend file")
            return False
        return True

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Ask for the file where the material's own is gone."""
        material = shown_material(context)
        lost = why_not_bakeable(material)
        if not (self.choose or lost):
            return self.execute(context)
        if lost:
            self.report({"INFO"}, f"{lost}: choose it")
        file = source_file(material)
        suffixes = sorted(IMAGE_SUFFIXES) if is_shading_map(material) else SUFFIXES
        self.filter_glob = ";".join(f"*{suffix}" for suffix in suffixes)
        self.filepath = f"{file}/" if file and is_shading_map(material) else str(file) if file else ""
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Bake and rebuild."""
        material = shown_material(context)
        bake = _bake_photographs if is_shading_map(material) else _bake_measurement
        try:
            told = bake(self, context, material)
        except BakeError as error:
            self.report({"ERROR"}, one_line(str(error)))
            return {"CANCELLED"}
        self.report({"INFO"}, f"{material.name}: {told}")
        return {"FINISHED"}


def _bake_measurement(operator: Any, context: bpy.types.Context, material: bpy.types.Material) -> str:
    properties, facts = material.measured_materials, facts_of(material)
    before = dict(error_rows(facts, material.name)) if facts else {}
    file = Path(bpy.path.abspath(operator.filepath)) if operator.filepath else None
    settings = settings_of(properties)
    with window_progress(context, settings) as progress_of:
        bake_again(material, settings, pack=properties.pack, file=file, progress=progress_of(0))
    return error_words(material) + (f", was {before['RMS error']}" if before else "")


def _bake_photographs(operator: Any, context: bpy.types.Context, material: bpy.types.Material) -> str:
    properties = material.measured_arc
    settings = arc_settings_of(properties, material.measured_lighting)
    source = chosen_photographs(operator)
    with window_progress(context, settings) as progress_of:
        bake_arc_again(material, settings, pack=properties.pack, source=source, progress=progress_of(0))
    tell_warnings(operator, material)
    return map_words(material)


classes = (MEASURED_MATERIALS_OT_bake_again,)
register, unregister = bpy.utils.register_classes_factory(classes)
