"""Panels: what a measured material is, how far it is from its measurement, how it is lit, and its next bake."""

from __future__ import annotations

from typing import Any

import bpy

from ...bake.errors import BakeError
from ...nodes.feature_passes import asks_for_passes
from ..material.choices import OSL
from ..material.facts import is_measured, record_of
from ..material.kinds import SHADING_MAP, kind_of
from ..material.rebuild import effects_of
from ..material.texture_repair import wrong_textures
from ..summary.parts import parts_of
from .bake_again import MEASURED_MATERIALS_OT_bake_again
from .context import ForMeasured, shown_material
from .fit_to_scene import (
    MEASURED_MATERIALS_OT_denoise,
    MEASURED_MATERIALS_OT_fit_to_scene,
    MEASURED_MATERIALS_OT_use_osl,
)
from .import_brdf import MEASURED_MATERIALS_OT_import_brdf
from .import_photographs import MEASURED_MATERIALS_OT_import_arc
from .kind_forms import form_of
from .properties.lighting import draw_lighting
from .properties.quality import draw_quality
from .tangent_rows import draw_tangent

_TITLE = "Measured Materials"


class _Panel:
    """What both places show."""

    bl_label = _TITLE

    def draw(self, context: bpy.types.Context) -> None:
        """Facts of a measured material; for any other the ways to import one."""
        layout, material = self.layout, shown_material(context)
        if not is_measured(material):
            layout.operator(MEASURED_MATERIALS_OT_import_brdf.bl_idname, text="Import Measured BRDF", icon="IMPORT")
            layout.operator(MEASURED_MATERIALS_OT_import_arc.bl_idname, text="Import Photographs", icon="IMAGE_DATA")
            return
        _draw_facts(layout, material)
        shows = "EEVEE approximates it"
        if context.engine != "CYCLES":
            layout.label(text=f"Cycles renders it, {shows}", icon="INFO")


class _LightingPanel:
    """How a shading map is lit; a change shows at once."""

    bl_label = "Lighting"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only for shading maps."""
        return kind_of(shown_material(context)) is SHADING_MAP

    def draw(self, context: bpy.types.Context) -> None:
        """The settings, or why they cannot be changed."""
        material, layout = shown_material(context), self.layout
        properties = material.measured_lighting
        draw_lighting(_where_rebuildable(layout, material, properties.problem), properties)


class _QualityPanel(ForMeasured):
    """What a sample is worth, and the account of what the scene made of it."""

    bl_label = "Quality"

    def draw(self, context: bpy.types.Context) -> None:
        """The knob, what is kept and left out, and the overrides."""
        material, layout = shown_material(context), self.layout
        properties, kind = material.measured_quality, kind_of(material)
        column = _where_rebuildable(layout, material, properties.problem)
        draw_quality(column, properties, kind.effective(material))
        draw_tangent(layout, material, context)
        if cost := kind.cost(material):
            layout.label(text=cost, icon="TIME")
        for effect in effects_of(material):
            layout.label(text=f"{effect.name}: {effect.why}", icon="CHECKMARK" if effect.kept else "REMOVE")
        row = layout.row(align=True)
        row.operator(MEASURED_MATERIALS_OT_fit_to_scene.bl_idname, icon="SCENE_DATA")
        if kind is not SHADING_MAP:
            scripted = properties.shader == OSL
            words = {"text": "Shade by Nodes"} if scripted else {}
            row.operator(MEASURED_MATERIALS_OT_use_osl.bl_idname, icon="FILE_SCRIPT", **words).nodes = scripted
        denoised = asks_for_passes(context.scene)
        words = {"text": "Stop Denoising"} if denoised else {}
        row.operator(MEASURED_MATERIALS_OT_denoise.bl_idname, icon="SHADERFX", **words).stop = denoised


class _BakePanel(ForMeasured):
    """The settings, folded away at first."""

    bl_label = "Bake"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Settings, then the button."""
        material = shown_material(context)
        kind = kind_of(material)
        form_of(kind).draw(self.layout, material)
        if kind.why_not_bakeable(material):
            self.layout.label(text=kind.lost_words, icon="ERROR")
        row = self.layout.row(align=True)
        row.operator(MEASURED_MATERIALS_OT_bake_again.bl_idname, icon="FILE_REFRESH")
        row.operator(MEASURED_MATERIALS_OT_bake_again.bl_idname, text="", icon="FILE_FOLDER").choose = True


def _where_rebuildable(layout: bpy.types.UILayout, material: bpy.types.Material, problem: str) -> Any:
    """A column for what rebuilds the material, below what keeps it from that and what the last change met."""
    lost = kind_of(material).why_not_rebuildable(material)
    for text in filter(None, (lost, problem)):
        layout.label(text=text, icon="ERROR")
    column = layout.column()
    column.enabled = material.is_editable and not lost
    return column


def _draw_facts(layout: bpy.types.UILayout, material: bpy.types.Material) -> None:
    if wrong := wrong_textures(material):
        words = f"Not the files of the bake: {', '.join(name.replace('_', ' ') for name in wrong)}"
        layout.label(text=f"{words}; see Scene Check, or bake again", icon="ERROR")
    column = layout.column(align=True)
    try:
        record = record_of(material)
        for rows in parts_of(record):
            for label, value in rows:
                _draw_row(column, label, value)
            column.separator()
    except BakeError as error:
        column.label(text=f"{error.cause}; {error.remedy}", icon="ERROR")


def _draw_row(column: bpy.types.UILayout, label: str, value: str) -> None:
    row = column.split(factor=0.33)
    name = row.row()
    name.active = False
    name.alignment = "RIGHT"
    name.label(text=label)
    row.label(text=value)


class MEASURED_MATERIALS_PT_material(_Panel, bpy.types.Panel):
    """Measured material in the material properties."""

    bl_space_type, bl_region_type, bl_context = "PROPERTIES", "WINDOW", "material"


class MEASURED_MATERIALS_PT_material_quality(_QualityPanel, bpy.types.Panel):
    """Quality in the material properties."""

    bl_space_type, bl_region_type, bl_context = "PROPERTIES", "WINDOW", "material"
    bl_parent_id = "MEASURED_MATERIALS_PT_material"


class MEASURED_MATERIALS_PT_material_lighting(_LightingPanel, bpy.types.Panel):
    """Lighting in the material properties."""

    bl_space_type, bl_region_type, bl_context = "PROPERTIES", "WINDOW", "material"
    bl_parent_id = "MEASURED_MATERIALS_PT_material"


class MEASURED_MATERIALS_PT_material_bake(_BakePanel, bpy.types.Panel):
    """Bake settings in the material properties."""

    bl_space_type, bl_region_type, bl_context = "PROPERTIES", "WINDOW", "material"
    bl_parent_id = "MEASURED_MATERIALS_PT_material"


class MEASURED_MATERIALS_PT_shader(_Panel, bpy.types.Panel):
    """Measured material in the shader editor's sidebar."""

    bl_space_type, bl_region_type, bl_category = "NODE_EDITOR", "UI", _TITLE

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only for shader nodes of objects."""
        space: Any = context.space_data
        return space.tree_type == "ShaderNodeTree" and space.shader_type == "OBJECT"


class MEASURED_MATERIALS_PT_shader_quality(_QualityPanel, bpy.types.Panel):
    """Quality in the shader editor's sidebar."""

    bl_space_type, bl_region_type, bl_category = "NODE_EDITOR", "UI", _TITLE
    bl_parent_id = "MEASURED_MATERIALS_PT_shader"


class MEASURED_MATERIALS_PT_shader_lighting(_LightingPanel, bpy.types.Panel):
    """Lighting in the shader editor's sidebar."""

    bl_space_type, bl_region_type, bl_category = "NODE_EDITOR", "UI", _TITLE
    bl_parent_id = "MEASURED_MATERIALS_PT_shader"


class MEASURED_MATERIALS_PT_shader_bake(_BakePanel, bpy.types.Panel):
    """Bake settings in the shader editor's sidebar."""

    bl_space_type, bl_region_type, bl_category = "NODE_EDITOR", "UI", _TITLE
    bl_parent_id = "MEASURED_MATERIALS_PT_shader"


classes = (
    MEASURED_MATERIALS_PT_material,
    MEASURED_MATERIALS_PT_material_quality,
    MEASURED_MATERIALS_PT_material_lighting,
    MEASURED_MATERIALS_PT_material_bake,
    MEASURED_MATERIALS_PT_shader,
    MEASURED_MATERIALS_PT_shader_quality,
    MEASURED_MATERIALS_PT_shader_lighting,
    MEASURED_MATERIALS_PT_shader_bake,
)
register, unregister = bpy.utils.register_classes_factory(classes)
