"""Operator: bake photographs of a swatch on a light arc and make a material of them; file menu, dropped light files."""

# No postponed annotations here: Blender reads the properties from them.
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy

from ...bake.errors import BakeError
from ...bake.photographs.photograph import IMAGE_SUFFIXES
from ...bake.shading_maps.bake import ArcSettings
from ..baking.request import BakeRequest, run_request
from ..material.bake_material import bundle_folder, told_place
from ..material.bake_photographs import folder_of, import_arc, map_words
from ..photographs.find_decoder import blender_decoder
from ..summary.text import one_line
from .background import warm_worker
from .background.bake_queue import queue
from .background.maps_task import MapsTask
from .background.tasks import ImportTask, Task, warnings_of
from .background.window import push_for_script, window
from .context import object_under
from .import_operator import ImportProperties, mark_and_tell, registration
from .photograph_look import WIDTH, draw_lines, draw_look, looking
from .properties.lighting import LightingProperties, draw_lighting, draw_transmission
from .properties.maps import MapsProperties, draw_maps, map_settings_of, width_of
from .properties.photographs import (
    ArcProperties,
    arc_settings_of,
    draw_arc_settings,
    show_arc_settings,
    stack_settings_of,
)
from .window_progress import window_progress

LIGHT_FILES = (".lp", ".csv", ".txt", ".tsv")

_FILTER_GLOB = bpy.props.StringProperty(
    default=";".join(f"*{suffix}" for suffix in sorted(IMAGE_SUFFIXES)), options={"HIDDEN"}
)

_LOOKED = bpy.props.BoolProperty(options={"HIDDEN", "SKIP_SAVE"})
# Letters that fit beside the file browser.
_SIDE = 26
_OF_LOOK = ("files", "looked", "quality", "full_size")


class MEASURED_MATERIALS_OT_import_arc(
    ImportProperties, MapsProperties, ArcProperties, LightingProperties, bpy.types.Operator
):
    """Bake photographs of a flat swatch, lit from several elevations, and make a material of them.
    Choose the photographs, or none or one of them for the whole folder"""

    bl_idname = "measured_materials.import_arc"
    bl_label = "Import Photographs"
    bl_options = {"UNDO", "PRESET"}

    filter_glob: _FILTER_GLOB
    looked: _LOOKED

    usual_settings = ArcSettings()

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask for photographs; of those given look at them first, and then ask for settings."""
        source = chosen_photographs(self)
        if source is None or bpy.app.background:
            return self.ask(context, event, "" if source is None else _title(source))
        if not self.looked:
            target = object_under(context, event)
            self.object_name = self.object_name or (target.name if target else "")
            return self._look_first(source)
        self.asked = True
        return context.window_manager.invoke_props_dialog(
            self, width=WIDTH, title=f"Import {_title(source)}", confirm_text="Bake"
        )

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the settings in the dialogue; the file browser comes before it."""
        if getattr(context.area, "type", "") == "FILE_BROWSER":
            draw_lines(self.layout, "Choose the photographs, or one of them for the whole folder.", letters=_SIDE)
            draw_lines(self.layout, "They are shown, and settings offered, before the bake.", letters=_SIDE)
            return
        place = self.layout
        if not self.advanced:  # both together are higher than many a screen
            place = draw_look(place, _given(chosen_photographs(self)))
        draw_maps(place, self)
        draw_arc_settings(place, self, self, self._draw_in_part)
        if not self.advanced or self.part == "files":
            self.draw_results(as_asset=self.make != "maps")  # which are of measured materials

    def _draw_in_part(self, layout: bpy.types.UILayout) -> None:
        if self.part == "rendering":
            draw_lighting(layout, self, fitted=self.fit_lobe, with_mode=True)
        elif self.part == "through" and self.through:
            draw_transmission(layout, self)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Bake, and put the material onto the object."""
        source = chosen_photographs(self)
        if source is None:
            self.report({"ERROR"}, "No photographs were chosen: JPEG, PNG, TIFF, EXR or HDR, or their folder")
            return {"CANCELLED"}
        if self.asked and not self.looked and not bpy.app.background:
            self._look_first(source)  # chosen in the file browser
            return {"CANCELLED"}
        try:
            settings = self._settings()
            folder = bundle_folder(self.bundles, folder_of(source))
            if self.asked and not bpy.app.background:
                self._bake_beside(context, source, folder, settings)
                return {"CANCELLED"}  # so far nothing has changed that could be undone
            if self.make == "maps":
                self._maps_here(context, source, folder, settings)
                push_for_script(self)
                return {"FINISHED"}
            with window_progress(context, settings) as progress_of:
                material = import_arc(source, folder, settings, pack=self.pack, progress=progress_of(0))
        except BakeError as error:
            self.report({"ERROR"}, one_line(str(error)))
            return {"CANCELLED"}
        show_arc_settings(material.measured_arc, settings, pack=self.pack)
        tell_warnings(self, material)
        if self.as_asset:
            mark_and_tell(material)
        place = told_place(self, material, self.target(context))
        self.report({"INFO"}, f"{material.name}{place}: {map_words(material)}")
        if self.make == "both":
            try:
                self._maps_here(context, source, folder, settings)
            except BakeError as error:  # the measured material is there all the same
                self.report({"WARNING"}, one_line(f"there are no maps: {error}"))
        push_for_script(self)
        return {"FINISHED"}

    def _settings(self) -> ArcSettings:
        """Of the bake; for maps alone, how the photographs are read. Raises BakeError."""
        if self.make == "maps":
            return ArcSettings(stack=stack_settings_of(self))
        return arc_settings_of(self, self, self.mode)

    def _look_first(self, source: Path | list[Path]) -> set[str]:
        """Have the photographs read beside the window, and come back with the same settings."""
        try:
            settings = self._settings()
        except BakeError as error:
            self.report({"ERROR"}, one_line(str(error)))
            return {"CANCELLED"}
        given = {name: _plain(getattr(self, name)) for name in self.properties.keys() if name not in _OF_LOOK}
        given["files"] = [{"name": element.name} for element in self.files]

        def come_back() -> None:
            with window():
                bpy.ops.measured_materials.import_arc("INVOKE_DEFAULT", **given, looked=True)

        looking.begin(BakeRequest(_given(source), settings, look=True), come_back)
        warm_worker.prepare(settings)
        self.report({"INFO"}, f"Looking at {_title(source)}")
        return {"CANCELLED"}

    def _bake_beside(
        self, context: bpy.types.Context, source: Path | list[Path], folder: Path, settings: ArcSettings
    ) -> None:
        """Put the bake into the queue."""
        pack, as_asset = self.pack, self.as_asset

        def settle(material: bpy.types.Material) -> None:
            show_arc_settings(material.measured_arc, settings, pack=pack)
            say_warnings(material)
            if as_asset:
                mark_and_tell(material)

        stem, target = folder_of(source).resolve().name or "swatch", self.target(context)
        tasks: list[Task] = []
        if self.make != "maps":
            request = BakeRequest(_given(source), settings, quick=True)
            tasks.append(ImportTask(request, folder, stem, pack, target, settle, "Import Photographs"))
        if self.make != "shading":
            tasks.append(self._maps_task(source, folder, settings, None if tasks else target, _say_all))
        queue.add(tasks)
        self.remember(context, MapsProperties, ArcProperties, LightingProperties)

    def _maps_task(
        self,
        source: Path | list[Path],
        folder: Path,
        settings: ArcSettings,
        target: bpy.types.Object | None,
        settled: Callable[[bpy.types.Material, tuple[str, ...]], None],
    ) -> MapsTask:
        """Maps of the photographs as they are read for a shading map. Raises BakeError."""
        request = BakeRequest(_given(source), map_settings_of(self, settings.stack))
        stem = f"{folder_of(source).resolve().name or 'swatch'}_maps"
        return MapsTask(request, folder, stem, self.relief, width_of(self), self.pack, target, settled)

    def _maps_here(
        self, context: bpy.types.Context, source: Path | list[Path], folder: Path, settings: ArcSettings
    ) -> None:
        """Bake maps while Blender waits, and make their material. Raises BakeError."""

        def settle(material: bpy.types.Material, warnings: tuple[str, ...]) -> None:
            for warning in warnings:
                self.report({"WARNING"}, one_line(warning))

        target = self.target(context) if self.make == "maps" else None
        task = self._maps_task(source, folder, settings, target, settle)
        with window_progress(context, task.request.settings) as progress_of:
            result = run_request(task.request, task.target(), progress_of(0), blender_decoder())
        self.report({"INFO"}, task.finish(result))


def _given(source: Path | list[Path] | None) -> Any:
    """As a request has it."""
    return tuple(source) if isinstance(source, list) else source


def _title(source: Path | list[Path]) -> str:
    return source.name if isinstance(source, Path) else f"{len(source)} photographs"


def _plain(value: Any) -> Any:
    """A property's value as an operator takes it."""
    return tuple(value) if hasattr(value, "__len__") and not isinstance(value, str) else value


def chosen_photographs(operator: Any) -> Path | list[Path] | None:
    """The chosen files, or the folder where none, only one, or the file with the lights is chosen; None for nothing."""
    names = [element.name for element in operator.files if element.name]
    folder = Path(bpy.path.abspath(operator.directory)) if operator.directory else None
    photographs = [name for name in names if Path(name).suffix.lower() in IMAGE_SUFFIXES]
    if folder is not None and len(photographs) > 1:
        return [folder / name for name in photographs]
    if operator.filepath:
        path = Path(bpy.path.abspath(operator.filepath))
        one_of_them = path.suffix.lower() in IMAGE_SUFFIXES or path.suffix.lower() in LIGHT_FILES
        return path.parent if one_of_them and not path.is_dir() else path
    return folder


def tell_warnings(operator: bpy.types.Operator, material: bpy.types.Material) -> None:
    """Report what is doubtful about the photographs."""
    for warning in warnings_of(material):
        operator.report({"WARNING"}, one_line(warning))


def say_warnings(material: bpy.types.Material) -> None:
    """The same, where the operator is gone."""
    _say_all(material, warnings_of(material))


def _say_all(_material: bpy.types.Material, warnings: tuple[str, ...]) -> None:
    for warning in warnings:
        bpy.ops.measured_materials.tell(words=one_line(warning), kind="WARNING")


def _menu(self: Any, _context: bpy.types.Context) -> None:
    self.layout.operator(MEASURED_MATERIALS_OT_import_arc.bl_idname, text="Photographs of a Swatch (folder)")


classes = (MEASURED_MATERIALS_OT_import_arc,)
register, unregister = registration(classes, "TOPBAR_MT_file_import", _menu)
