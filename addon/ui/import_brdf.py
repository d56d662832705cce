"""Operator: bake measured BRDF files and make materials of them; file menu, drag and drop."""

# No postponed annotations here: Blender reads the properties from them.
from pathlib import Path
from typing import Any

import bpy

from ...bake.brdf.settings import BakeSettings
from ...bake.errors import BakeError
from ...bake.sources import known_formats, known_suffixes, measurements_in, title_of
from ..baking.request import BakeRequest
from ..material.bake_material import assign, bundle_folder, error_words, import_brdf, told_place
from ..material.together import built_together
from ..summary.text import one_line
from .background.bake_queue import queue
from .background.tasks import ImportTask
from .background.window import push_for_script
from .import_operator import ImportProperties, mark_and_tell, registration
from .properties.bake import BakeProperties, draw_settings, settings_of, show_settings
from .window_progress import window_progress

SUFFIXES = known_suffixes()

# Of pictures only one kind is a measurement: they are browsed for, but where they are dropped, taken for photographs.
BROWSED = (*SUFFIXES, ".exr")
_FILTER_GLOB = bpy.props.StringProperty(default=";".join(f"*{s}" for s in BROWSED), options={"HIDDEN"})
# Suffixes that the menu names.
_TOLD = 3


class MEASURED_MATERIALS_OT_import_brdf(ImportProperties, BakeProperties, bpy.types.Operator):
    """Bake measured BRDFs and make Cycles materials of them. Choose files, or none for all in the folder"""

    bl_idname = "measured_materials.import_brdf"
    bl_label = "Import BRDF"
    bl_options = {"UNDO", "PRESET"}

    filter_glob: _FILTER_GLOB

    usual_settings = BakeSettings()

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask for files, or, when they were dropped, for settings only."""
        names = [path.name for path in self._paths()]
        return self.ask(context, event, f"{len(names)} measurements" if len(names) > 1 else "".join(names))

    def draw(self, _context: bpy.types.Context) -> None:
        """Draw the settings in the file browser's sidebar or in the dialogue."""
        draw_settings(self.layout, self)
        self.draw_results()

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Bake every file; a bad one is reported and does not keep the others from being imported."""
        paths, bad = _files_meant(self._paths())
        for error in bad:
            self.report({"ERROR"}, one_line(str(error)))
        if not paths:
            if not bad:
                self.report({"ERROR"}, f"No file was chosen; known formats: {known_formats()}")
            return {"CANCELLED"}
        try:
            settings = settings_of(self)
        except BakeError as error:
            self.report({"ERROR"}, one_line(str(error)))
            return {"CANCELLED"}
        if self.asked and not bpy.app.background:
            self._bake_beside(context, paths, settings)
            return {"CANCELLED"}  # so far nothing has changed that could be undone
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
            if self.as_asset:
                mark_and_tell(material)
        if not made:
            return {"CANCELLED"}
        for material in made[1:]:
            assign(material, None)
        place = told_place(self, made[0], self.target(context))
        self.report({"INFO"}, f"{made[0].name}{place}: {error_words(made[0])}" + _others(len(made) - 1))
        push_for_script(self)
        return {"FINISHED"}

    def _bake_beside(self, context: bpy.types.Context, paths: list[Path], settings: BakeSettings) -> None:
        """Put the bakes into the queue; the first one's material goes to the object."""
        pack, as_asset = self.pack, self.as_asset

        def settle(material: bpy.types.Material) -> None:
            show_settings(material.measured_materials, settings)
            material.measured_materials.pack = pack
            if as_asset:
                mark_and_tell(material)

        target = self.target(context)
        tasks = [
            ImportTask(
                BakeRequest(path, settings, quick=True),
                bundle_folder(self.bundles, path),
                title_of(path, settings.reading),
                pack,
                target if number == 0 else None,
                settle,
                "Import Measured BRDF",
            )
            for number, path in enumerate(paths)
        ]
        queue.add(tasks)
        self.remember(context, BakeProperties)

    def _paths(self) -> list[Path]:
        names = [element.name for element in self.files if element.name]
        if names and self.directory:
            return [Path(self.directory) / name for name in names]
        return [Path(bpy.path.abspath(self.filepath))] if self.filepath else []


def _files_meant(chosen: list[Path]) -> tuple[list[Path], list[BakeError]]:
    """Measurements that an artist means by these paths, of a folder all in it; and folders without any."""
    found: list[Path] = []
    errors = []
    for path in chosen:
        try:
            found += measurements_in(path) if _is_folder(path) else [path]
        except BakeError as error:
            errors.append(error)
    return found, errors


def _is_folder(path: Path) -> bool:
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


def _others(count: int) -> str:
    return f", and {count} more without an object" if count else ""


def _menu(self: Any, _context: bpy.types.Context) -> None:
    # Some of the suffixes, as of Blender's own entries: all of them would make the menu twice as wide.
    words = "/".join(SUFFIXES[:_TOLD])
    self.layout.operator(MEASURED_MATERIALS_OT_import_brdf.bl_idname, text=f"Measured BRDF ({words} ...)")


classes = (MEASURED_MATERIALS_OT_import_brdf,)
register, unregister = registration(classes, "TOPBAR_MT_file_import", _menu)
