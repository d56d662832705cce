"""What the import operators have in common: the files given, the object that gets the material, and the menu entry."""

# No postponed annotations here: Blender reads the properties from them.
from collections.abc import Callable
from typing import Any

import bpy

from ...bake.brdf.settings import BakeSettings
from ...bake.shading_maps.bake import ArcSettings
from ..assets.mark import mark_or_say
from ..baking import spare
from .background import warm_worker
from .context import object_under

_HIDDEN = {"HIDDEN", "SKIP_SAVE"}
_FILES = bpy.props.CollectionProperty(type=bpy.types.OperatorFileListElement, options=_HIDDEN)
_FILEPATH = bpy.props.StringProperty(subtype="FILE_PATH", options=_HIDDEN)
_DIRECTORY = bpy.props.StringProperty(subtype="DIR_PATH", options=_HIDDEN)
_OBJECT = bpy.props.StringProperty(
    name="Object", description="Object that gets the material; the active one by default", options=_HIDDEN
)
_BUNDLES = bpy.props.StringProperty(
    name="Baked Files",
    description="Folder for the baked textures. Automatic: beside the .blend file or, before it is saved, beside the "
    "measurement or the photographs' folder",
    subtype="DIR_PATH",
    options={"SKIP_SAVE"},
)
AS_ASSET = bpy.props.BoolProperty(
    name="Mark as Asset",
    description="Show the material in the asset browser, with its picture, a catalog and tags",
    default=False,
)
_Draw = Callable[[Any, bpy.types.Context], None]


class ImportProperties:
    """Mixed into an import operator: what a file browser or a drop gives it, and where its results go."""

    files: _FILES
    filepath: _FILEPATH
    directory: _DIRECTORY
    object_name: _OBJECT
    bundles: _BUNDLES
    as_asset: AS_ASSET

    # Set where a person was asked: only then is there a window to bake beside; scripts wait for the result.
    asked = False
    # Of the kind that is baked.
    usual_settings: BakeSettings | ArcSettings

    def ask(self: Any, context: bpy.types.Context, event: bpy.types.Event, title: str) -> set[str]:
        """Ask for files or, where they were dropped and have a title, for settings only."""
        self.asked = True
        warm_worker.prepare(self.usual_settings)
        if not title:
            context.window_manager.fileselect_add(self)
            return {"RUNNING_MODAL"}
        target = object_under(context, event)
        self.object_name = self.object_name or (target.name if target else "")
        return context.window_manager.invoke_props_dialog(self, title=f"Import {title}", confirm_text="Bake")

    def cancel(self, _context: bpy.types.Context) -> None:
        """Called by Blender where the dialogue or the file browser was closed without confirming it."""
        spare.drop()

    def draw_results(self: Any, *, as_asset: bool = True) -> None:
        """Draw where the results go, and whether they become assets where they can."""
        column = self.layout.column()
        column.use_property_split, column.use_property_decorate = True, False
        column.prop(self, "bundles", placeholder="Automatic")
        if as_asset:
            column.prop(self, "as_asset")
        if self.object_name:
            column.label(text=f"For {self.object_name}", icon="OBJECT_DATA")

    def remember(self: Any, context: bpy.types.Context, *of: type) -> None:
        """Have Blender offer these settings the next time, as it does of operators that end at once."""
        last = context.window_manager.operator_properties_last(self.bl_idname)
        bases = (base for group in of for base in group.__mro__)
        for name in (name for base in bases for name in vars(base).get("__annotations__", ())):
            setattr(last, name, getattr(self, name))

    def target(self: Any, context: bpy.types.Context) -> bpy.types.Object | None:
        """Object that gets the material."""
        return bpy.data.objects.get(self.object_name) or context.object


def mark_and_tell(material: bpy.types.Material) -> None:
    """Make the material an asset, and say what of that was not possible."""
    if left := mark_or_say(material):
        bpy.ops.measured_materials.tell(words=f"{material.name} as an asset: {left}", kind="WARNING")


class DropTarget:
    """Mixed into a file handler: files can be dropped on a 3D viewport or a shader editor."""

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        """Whether the area under the mouse takes an import."""
        area, region = context.area, context.region
        if area is None or region is None or region.type != "WINDOW":
            return False
        shading = area.type == "NODE_EDITOR" and context.space_data.tree_type == "ShaderNodeTree"
        return area.type == "VIEW_3D" or shading


def registration(classes: tuple[type, ...], menu: str, draw: _Draw) -> tuple[Callable[[], None], Callable[[], None]]:
    """Functions that register classes and an entry of one of Blender's menus, by its name, and that take both back."""
    register_classes, unregister_classes = bpy.utils.register_classes_factory(classes)

    def register() -> None:
        register_classes()
        getattr(bpy.types, menu).append(draw)

    def unregister() -> None:
        getattr(bpy.types, menu).remove(draw)
        unregister_classes()

    return register, unregister
