"""Operator: materials of bundles that were baked before; file menu, drag and drop."""

# No postponed annotations here: Blender reads the properties from them.
from pathlib import Path
from typing import Any

import bpy

from ...bake.bundle.bundle import SUFFIX
from ...bake.errors import BakeError
from ..material.bake_material import assign, told_place
from ..material.kinds import kind_of
from ..material.load_bundle import load_bundle
from ..material.together import built_together
from ..summary.text import one_line
from .background.bake_queue import queue
from .background.load_bundle import LoadTask, bundles_meant
from .background.window import push_for_script
from .context import object_under
from .import_operator import AS_ASSET, mark_and_tell, registration
from .properties.next_bake import show_next_bake

_HIDDEN = {"HIDDEN", "SKIP_SAVE"}
_FILES = bpy.props.CollectionProperty(type=bpy.types.OperatorFileListElement, options=_HIDDEN)
_DIRECTORY = bpy.props.StringProperty(subtype="DIR_PATH", options=_HIDDEN)
_FILEPATH = bpy.props.StringProperty(subtype="FILE_PATH", options=_HIDDEN)
_FILTER_GLOB = bpy.props.StringProperty(default=f"*{SUFFIX};material.json;preview.png", options={"HIDDEN"})
_OBJECT = bpy.props.StringProperty(
    name="Object", description="Object that gets the first material; the active one by default", options=_HIDDEN
)
_PACK = bpy.props.BoolProperty(
    name="Pack into .blend", description="Keep the textures inside the .blend file, too", default=True
)


class MEASURED_MATERIALS_OT_import_bundle(bpy.types.Operator):
    """Load materials that were baked before, without baking again. Choose folders NAME.mmat, or go into one, or into
    a folder with some"""

    bl_idname = "measured_materials.import_bundle"
    bl_label = "Import Measured Material"
    bl_options = {"UNDO", "PRESET"}

    files: _FILES
    dirs: _FILES
    directory: _DIRECTORY
    filepath: _FILEPATH
    filter_glob: _FILTER_GLOB
    object_name: _OBJECT
    pack: _PACK
    as_asset: AS_ASSET

    # Set where a person was asked: only then is there a window to keep awake; scripts wait for the result.
    asked = False

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask for bundles; dropped ones are loaded at once."""
        if not self._chosen():
            self.asked = True
            context.window_manager.fileselect_add(self)
            return {"RUNNING_MODAL"}
        self.asked = True
        target = object_under(context, event)
        self.object_name = self.object_name or (target.name if target else "")
        return self.execute(context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Load every bundle; a bad one is reported and does not keep the others from being loaded."""
        bundles, errors = bundles_meant(self._chosen())
        if not bundles and not errors:
            self.report({"ERROR"}, f"No measured material was chosen: a folder NAME{SUFFIX}")
            return {"CANCELLED"}
        if self.asked and not bpy.app.background and bundles:
            self._load_beside(context, bundles, errors)
            return {"CANCELLED"}  # so far nothing has changed that could be undone
        made = []
        with built_together():
            for path in bundles:
                try:
                    made.append(load_bundle(path, pack=self.pack))
                except BakeError as error:
                    errors.append(error)
        for error in errors:
            self.report({"ERROR"}, one_line(str(error)))
        if not made:
            return {"CANCELLED"}
        for material in made:
            show_next_bake(material, self.pack)
            if self.as_asset:
                mark_and_tell(material)
        for material in made[1:]:
            assign(material, None)
        place = told_place(self, made[0], bpy.data.objects.get(self.object_name) or context.object)
        others = f", and {len(made) - 1} more without an object" if len(made) > 1 else ""
        self.report({"INFO"}, f"{made[0].name}{place}: {kind_of(made[0]).words(made[0])}{others}")
        push_for_script(self)
        return {"FINISHED"}

    def _load_beside(self, context: bpy.types.Context, bundles: list[Path], errors: list[BakeError]) -> None:
        """Have the queue load them, which keeps Blender awake; the first one's material goes to the object."""
        for error in errors:
            self.report({"ERROR"}, one_line(str(error)))
        target = bpy.data.objects.get(self.object_name) or context.object
        pack, as_asset = self.pack, self.as_asset

        def settle(material: bpy.types.Material) -> None:
            show_next_bake(material, pack)
            if as_asset:
                mark_and_tell(material)

        queue.add([LoadTask(path, pack, None if number else target, settle) for number, path in enumerate(bundles)])

    def _chosen(self) -> list[Path]:
        """Paths that were given, the folder that the file browser stands in where nothing in it was chosen."""
        names = [element.name for element in (*self.dirs, *self.files) if element.name]
        folder = Path(bpy.path.abspath(self.directory)) if self.directory else None
        if names and folder is not None:
            return [folder / name for name in names]
        if self.filepath:
            return [Path(bpy.path.abspath(self.filepath))]
        return [folder] if folder is not None else []


def _menu(self: Any, _context: bpy.types.Context) -> None:
    self.layout.operator(MEASURED_MATERIALS_OT_import_bundle.bl_idname, text=f"Measured Material ({SUFFIX})")


classes = (MEASURED_MATERIALS_OT_import_bundle,)
register, unregister = registration(classes, "TOPBAR_MT_file_import", _menu)
