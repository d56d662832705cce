"""Operator: bake a measured material again, with other settings or from another file, in place."""

# No postponed annotations here: Blender reads the properties from them.
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import bpy

from ...bake.errors import BakeError
from ...bake.shading_maps.record import ShadingMapRecord
from ..assets.mark import known_rights, refresh
from ..assets.words import Rights
from ..baking.request import BakeRequest
from ..material.adjust.parallax import without_unfit_parallax
from ..material.facts import record_of, source_file
from ..material.kinds import Source, kind_of
from ..summary.text import one_line
from .background.bake_queue import queue
from .background.tasks import AgainTask, with_source
from .background.window import push_for_script
from .context import OfMeasured, shown_material
from .import_photographs import say_warnings, tell_warnings
from .kind_forms import form_of
from .properties.rights import is_own, rights_beside, show_rights
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


class MEASURED_MATERIALS_OT_bake_again(OfMeasured, bpy.types.Operator):
    """Bake again with these settings; every object keeps the material"""

    bl_idname = "measured_materials.bake_again"
    bl_label = "Bake Again"
    bl_options = {"UNDO"}

    filepath: _FILEPATH
    files: _FILES
    directory: _DIRECTORY
    choose: _CHOOSE
    filter_glob: _FILTER_GLOB

    # Set where a person pressed the button: only then is there a window to bake beside.
    asked = False

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Ask for the file where the material's own is gone."""
        self.asked = True
        material = shown_material(context)
        kind = kind_of(material)
        lost = kind.why_not_bakeable(material)
        if not (self.choose or lost):
            return self.execute(context)
        if lost:
            self.report({"INFO"}, f"{lost}: choose it")
        file, form = source_file(material), form_of(kind)
        self.filter_glob = ";".join(f"*{suffix}" for suffix in form.suffixes)
        self.filepath = form.path(file) if file else ""
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Bake and rebuild."""
        material = shown_material(context)
        try:
            if self.asked and not bpy.app.background:
                self._bake_beside(material)
                return {"CANCELLED"}  # so far nothing has changed that could be undone
            told = self._bake(context, material)
        except BakeError as error:
            self.report({"ERROR"}, one_line(str(error)))
            return {"CANCELLED"}
        self.report({"INFO"}, f"{material.name}: {told}")
        push_for_script(self)
        return {"FINISHED"}

    def _bake_beside(self, material: bpy.types.Material) -> None:
        """Put the bake into the queue."""
        kind = kind_of(material)
        settings, pack, source, own, before = self._asked_for(material)
        if source is None:
            source = kind.bakeable_source(material)
        request = with_source(BakeRequest(Path(), settings), source)
        queue.add([AgainTask(request, material, pack, partial(_settle, own=own, before=before))])

    def _bake(self, context: bpy.types.Context, material: bpy.types.Material) -> str:
        kind = kind_of(material)
        error = kind.error(material)
        settings, pack, source, own, before = self._asked_for(material)
        with window_progress(context, settings) as progress_of:
            kind.bake_again(material, settings, pack=pack, source=source, progress=progress_of(0))
        tell_warnings(self, material)
        if lost := _lost(material, own):
            self.report({"WARNING"}, one_line(lost))
        _state(material, before)
        return kind.words(material) + (f", was {error}" if error else "")

    def _asked_for(self, material: bpy.types.Material) -> tuple[Any, bool, Source, bool, Rights | None]:
        """Settings, whether textures are packed, the chosen source, whether it is the material's own, and what its
        asset states of another one before."""
        form = form_of(kind_of(material))
        source = form.chosen(self)
        own = source is None or is_own(material, source)
        # A loaded bundle does not know its photographs: those that are chosen are taken for them.
        settings, pack = form.settings(material, own=own or source_file(material) is None)
        if own:
            return settings, pack, source, own, None
        settings = replace(settings, rights=rights_beside(material, settings.rights))
        return settings, pack, source, own, known_rights(material)


def _settle(material: bpy.types.Material, own: bool, before: Rights | None) -> None:
    """After a bake beside the window."""
    say_warnings(material)
    if lost := _lost(material, own):
        bpy.ops.measured_materials.tell(words=one_line(lost), kind="WARNING")
    _state(material, before)


def _lost(material: bpy.types.Material, own: bool) -> str:
    """What does not belong to the material any more, in words, and is gone; empty for nothing."""
    record = record_of(material)
    why = without_unfit_parallax(material, record, others=not own) if isinstance(record, ShadingMapRecord) else ""
    return f"{material.name}: {why}" if why else ""


def _state(material: bpy.types.Material, before: Rights | None) -> None:
    """Let asset and panel say of the material's rights what its bake says, where it is of another measurement."""
    if before is not None:
        show_rights(form_of(kind_of(material)).properties(material), record_of(material).rights)
    refresh(material, before)


classes = (MEASURED_MATERIALS_OT_bake_again,)
register, unregister = bpy.utils.register_classes_factory(classes)
