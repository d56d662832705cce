"""Operator and menu of the shader editor: Add > Measured Materials > Cosine Lobe, Highlight."""

# No postponed annotations here: Blender reads the properties from them.
from typing import Any

import bpy

from ...bake.lobes.cosine_lobes import COSINE_LOBES
from ...nodes import compat
from ...nodes.cosine_lobe_group import cosine_lobe_group, highlight_group
from ..lights.light_tables import lamp_image, update_scene
from .context import shown_material
from .import_operator import registration
from .properties.enum_items import enum

_WORDS = {
    "power": ("Power", "cos^n itself (Phong 1975, Blinn 1977)"),
    "schlick": ("Schlick", "A quotient; a wide foot around the highlight (Schlick 1994)"),
    "lyon": ("Lyon", "A fourth power of the squared chord; ends beside the highlight (Lyon 1993)"),
    "cosine": ("Cosine", "A fourth power of a stretched cosine; ends beside the highlight"),
    "cubic": ("Cubic", "A cubic, within 0.7 % of cos^n down to half of it, and a wide foot (Romanyuk 2007)"),
}
_KINDS = (
    ("VALUE", "Cosine Lobe", "A number: the lobe of the angle between two directions"),
    ("HIGHLIGHT", "Highlight", "A closure: a highlight of this shape, path traced by Cycles"),
)


def add_cosine_lobe(tree: bpy.types.NodeTree, lobe: str, kind: str) -> bpy.types.Node:
    """Add a node of one of `COSINE_LOBES` to a shader tree and make it the active one; kind "VALUE" or "HIGHLIGHT"."""
    compat.ensure_cycles()
    group = highlight_group(lobe, lamp_image()) if kind == "HIGHLIGHT" else cosine_lobe_group(lobe)
    node = tree.nodes.new("ShaderNodeGroup")
    node.node_tree, node.width = group, 200
    for other in tree.nodes:
        other.select = other == node
    tree.nodes.active = node
    return node


class MEASURED_MATERIALS_OT_add_cosine_lobe(bpy.types.Operator):
    """Add a cosine lobe of an exact or a cheaper shape: as a number, or as a highlight"""

    bl_idname = "measured_materials.add_cosine_lobe"
    bl_label = "Add Cosine Lobe"
    bl_options = {"REGISTER", "UNDO"}

    lobe: enum("Lobe", "Shape of the highlight", COSINE_LOBES, _WORDS, "power")  # type: ignore[valid-type]
    kind: bpy.props.EnumProperty(name="Kind", items=_KINDS, default="HIGHLIGHT")  # type: ignore[valid-type]

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Whether there is a shader tree that can be changed."""
        tree, _ = _tree(context)
        if tree is None or tree.library is not None:
            cls.poll_message_set("Needs a material that is not linked, in the shader editor or of the active object")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Add the node."""
        tree, material = _tree(context)
        node = add_cosine_lobe(tree, self.lobe, self.kind)
        if _in_editor(context):
            node.location = context.space_data.cursor_location
        if self.kind == "HIGHLIGHT":
            if material is not None:
                # Cycles would bend the mirror's facet where its reflection dips under the surface.
                material.cycles.use_bump_map_correction = False
            update_scene(context.scene)
        return {"FINISHED"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Add the node under the mouse and let it be dragged, as Blender's own entries do."""
        if not _in_editor(context):
            return self.execute(context)
        context.space_data.cursor_location_from_region(event.mouse_region_x, event.mouse_region_y)
        result = self.execute(context)
        bpy.ops.node.translate_attach_remove_on_cancel("INVOKE_DEFAULT")
        return result


class MEASURED_MATERIALS_MT_add_nodes(bpy.types.Menu):
    """Nodes of this extension."""

    bl_idname = "MEASURED_MATERIALS_MT_add_nodes"
    bl_label = "Measured Materials"

    def draw(self, _context: bpy.types.Context) -> None:
        """One submenu of lobes for each kind."""
        for kind, name, _ in _KINDS:
            operator = MEASURED_MATERIALS_OT_add_cosine_lobe.bl_idname
            self.layout.operator_menu_enum(operator, "lobe", text=name).kind = kind


def _in_editor(context: bpy.types.Context) -> bool:
    space = context.space_data
    return space is not None and space.type == "NODE_EDITOR" and space.tree_type == "ShaderNodeTree"


def _tree(context: bpy.types.Context) -> tuple[Any, bpy.types.Material | None]:
    """The shader editor's tree, else that of the active object's material; and the material it belongs to."""
    if _in_editor(context):
        owner = context.space_data.id
        return context.space_data.edit_tree, owner if isinstance(owner, bpy.types.Material) else None
    material = shown_material(context)
    return (material.node_tree if material is not None else None), material


def _menu(self: Any, context: bpy.types.Context) -> None:
    if _in_editor(context):
        self.layout.menu(MEASURED_MATERIALS_MT_add_nodes.bl_idname)


classes = (MEASURED_MATERIALS_OT_add_cosine_lobe, MEASURED_MATERIALS_MT_add_nodes)
register, unregister = registration(classes, "NODE_MT_add", _menu)
