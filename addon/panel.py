"""Panels: what a measured material is, how far it is from its measurement, how it is lit, and its next bake."""

from __future__ import annotations

from typing import Any

import bpy

from ..bake.errors import BakeError
from . import describe, describe_map
from .arc_operator import MEASURED_MATERIALS_OT_import_arc
from .arc_properties import draw_arc_settings
from .arc_relight import why_not_relightable
from .bake_operator import MEASURED_MATERIALS_OT_bake_again
from .bake_properties import draw_settings
from .brdf_build import asks_for_passes
from .choices import choices_of
from .effects import plan_filter
from .expectation import expectation
from .facts import facts_of, is_measured, is_shading_map
from .fit_operator import MEASURED_MATERIALS_OT_denoise, MEASURED_MATERIALS_OT_fit_to_scene
from .import_operator import MEASURED_MATERIALS_OT_import_brdf
from .lighting_properties import draw_lighting
from .measured_material import why_not_bakeable
from .quality_properties import draw_quality
from .rebuild import effects_of, why_not_rebuildable
from .tangent_rows import draw_tangent
from .texture_repair import wrong_textures
from .ui_context import shown_material

_TITLE = "Measured Materials"
_BRDF_ROWS = (
    describe.source_rows,
    describe.error_rows,
    describe.envelope_rows,
    describe.table_rows,
    describe.albedo_rows,
    describe.size_rows,
)
_MAP_ROWS = (
    describe.source_rows,
    describe_map.photograph_rows,
    describe_map.map_rows,
    describe_map.energy_rows,
    describe_map.map_error_rows,
    describe_map.lighting_rows,
    describe.albedo_rows,
    describe.size_rows,
)


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
        return is_shading_map(shown_material(context))

    def draw(self, context: bpy.types.Context) -> None:
        """The settings, or why they cannot be changed."""
        material, layout = shown_material(context), self.layout
        properties = material.measured_lighting
        for text in filter(None, (why_not_relightable(material), properties.problem)):
            layout.label(text=text, icon="ERROR")
        column = layout.column()
        column.enabled = material.is_editable and not why_not_relightable(material)
        draw_lighting(column, properties)


class _QualityPanel:
    """What a sample is worth, and the account of what the scene made of it."""

    bl_label = "Quality"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only for measured materials."""
        return is_measured(shown_material(context))

    def draw(self, context: bpy.types.Context) -> None:
        """The knob, what is kept and left out, and the overrides."""
        material, layout = shown_material(context), self.layout
        properties, shading_map = material.measured_quality, is_shading_map(material)
        lost = "" if shading_map else why_not_rebuildable(material)
        for text in filter(None, (lost, properties.problem)):
            layout.label(text=text, icon="ERROR")
        column = layout.column()
        column.enabled = material.is_editable and not lost
        draw_quality(column, properties, shading_map=shading_map)
        draw_tangent(layout, material, context)
        if not shading_map:
            layout.label(text=_expected(material), icon="TIME")
        for effect in effects_of(material):
            layout.label(text=f"{effect.name}: {effect.why}", icon="CHECKMARK" if effect.kept else "REMOVE")
        row = layout.row(align=True)
        row.operator(MEASURED_MATERIALS_OT_fit_to_scene.bl_idname, icon="SCENE_DATA")
        if not shading_map:
            denoised = asks_for_passes(context.scene)
            words = {"text": "Stop Denoising"} if denoised else {}
            row.operator(MEASURED_MATERIALS_OT_denoise.bl_idname, icon="SHADERFX", **words).stop = denoised


class _BakePanel:
    """The settings, folded away at first."""

    bl_label = "Bake"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only for measured materials."""
        return is_measured(shown_material(context))

    def draw(self, context: bpy.types.Context) -> None:
        """Settings, then the button."""
        material = shown_material(context)
        shading_map = is_shading_map(material)
        if shading_map:
            draw_arc_settings(self.layout, material.measured_arc, material.measured_lighting)
        else:
            draw_settings(self.layout, material.measured_materials)
        missing = why_not_bakeable(material)
        if missing:
            what = "photographs are" if shading_map else "measurement is"
            self.layout.label(text=f"The {what} not there", icon="ERROR")
        row = self.layout.row(align=True)
        row.operator(MEASURED_MATERIALS_OT_bake_again.bl_idname, icon="FILE_REFRESH")
        row.operator(MEASURED_MATERIALS_OT_bake_again.bl_idname, text="", icon="FILE_FOLDER").choose = True


def _expected(material: bpy.types.Material) -> str:
    """Of the mode and filter that are set; empty where the facts are not what they should be."""
    try:
        facts, choices = facts_of(material), choices_of(material.measured_quality)
        return expectation(facts, choices.mode, plan_filter(facts, choices, material.name)[0])
    except BakeError:
        return ""


def _draw_facts(layout: bpy.types.UILayout, material: bpy.types.Material) -> None:
    facts = facts_of(material)
    if wrong := wrong_textures(material):
        words = f"Not the files of the bake: {', '.join(name.replace('_', ' ') for name in wrong)}"
        layout.label(text=f"{words}; see Scene Check, or bake again", icon="ERROR")
    column = layout.column(align=True)
    try:
        for part in _MAP_ROWS if is_shading_map(material) else _BRDF_ROWS:
            for label, value in part(facts, material.name):
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
    """In the material properties."""

    bl_space_type, bl_region_type, bl_context = "PROPERTIES", "WINDOW", "material"


class MEASURED_MATERIALS_PT_material_quality(_QualityPanel, bpy.types.Panel):
    """In the material properties."""

    bl_space_type, bl_region_type, bl_context = "PROPERTIES", "WINDOW", "material"
    bl_parent_id = "MEASURED_MATERIALS_PT_material"


class MEASURED_MATERIALS_PT_material_lighting(_LightingPanel, bpy.types.Panel):
    """In the material properties."""

    bl_space_type, bl_region_type, bl_context = "PROPERTIES", "WINDOW", "material"
    bl_parent_id = "MEASURED_MATERIALS_PT_material"


class MEASURED_MATERIALS_PT_material_bake(_BakePanel, bpy.types.Panel):
    """In the material properties."""

    bl_space_type, bl_region_type, bl_context = "PROPERTIES", "WINDOW", "material"
    bl_parent_id = "MEASURED_MATERIALS_PT_material"


class MEASURED_MATERIALS_PT_shader(_Panel, bpy.types.Panel):
    """In the shader editor's sidebar."""

    bl_space_type, bl_region_type, bl_category = "NODE_EDITOR", "UI", _TITLE

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only for shader nodes of objects."""
        space: Any = context.space_data
        return space.tree_type == "ShaderNodeTree" and space.shader_type == "OBJECT"


class MEASURED_MATERIALS_PT_shader_quality(_QualityPanel, bpy.types.Panel):
    """In the shader editor's sidebar."""

    bl_space_type, bl_region_type, bl_category = "NODE_EDITOR", "UI", _TITLE
    bl_parent_id = "MEASURED_MATERIALS_PT_shader"


class MEASURED_MATERIALS_PT_shader_lighting(_LightingPanel, bpy.types.Panel):
    """In the shader editor's sidebar."""

    bl_space_type, bl_region_type, bl_category = "NODE_EDITOR", "UI", _TITLE
    bl_parent_id = "MEASURED_MATERIALS_PT_shader"


class MEASURED_MATERIALS_PT_shader_bake(_BakePanel, bpy.types.Panel):
    """In the shader editor's sidebar."""

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
