"""Panels: what a measured material is and costs, what spoils it, how it is lit, and its next bake."""

from __future__ import annotations

from typing import Any

import bpy

from ....bake.errors import BakeError
from ....nodes.feature_passes import asks_for_passes
from ...material.choices import OSL
from ...material.facts import is_measured, record_of
from ...material.kinds import SHADING_MAP, kind_of, lets_light_through
from ...material.rebuild import effects_of
from ...material.texture_repair import wrong_textures
from ...summary.parts import parts_of
from ..bake_again import MEASURED_MATERIALS_OT_bake_again
from ..context import ForMeasured, shown_material
from ..fit_to_scene import (
    MEASURED_MATERIALS_OT_denoise,
    MEASURED_MATERIALS_OT_fit_to_scene,
    MEASURED_MATERIALS_OT_use_osl,
)
from ..import_brdf import MEASURED_MATERIALS_OT_import_brdf
from ..import_photographs import MEASURED_MATERIALS_OT_import_arc
from ..kind_forms import form_of
from ..maps.build_material import MEASURED_MATERIALS_OT_import_maps
from ..properties.lighting import draw_lighting
from ..properties.quality import draw_quality
from .adjust_rows import AdjustPanel
from .check_scene import draw_status
from .pictures import picture_of
from .places import TITLE, in_both_places
from .tangent_rows import draw_tangent
from .wrapped_text import Lines

# Icons wide and high.
_PICTURE = 4.0


class _Panel(ForMeasured):
    """What is looked at most: picture, mode, what it costs, and whether the scene spoils it."""

    bl_label = TITLE

    def draw(self, context: bpy.types.Context) -> None:
        """The measured material."""
        layout, material = self.layout, shown_material(context)
        lines, kind = Lines(context), kind_of(material)
        _draw_title(layout, material, lines)
        if "mode" in kind.effective(material):
            column = _where_rebuildable(layout, material, material.measured_quality.problem, lines)
            draw_quality(column, material.measured_quality, ("mode",))
        if cost := kind.cost(material):
            lines.draw(layout, cost, "TIME")
        if context.engine != "CYCLES":
            lines.draw(layout, "Cycles renders it, EEVEE approximates it", "INFO")
        draw_status(layout, context, lines)


class _ImportPanel:
    """The ways to a measured material, below Blender's own panels of any other."""

    bl_label = TITLE

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Whether no such material is shown."""
        return not is_measured(shown_material(context))

    def draw(self, context: bpy.types.Context) -> None:
        """The buttons."""
        column = self.layout.column(align=True)
        column.operator(MEASURED_MATERIALS_OT_import_brdf.bl_idname, text="Import Measured BRDF", icon="IMPORT")
        column.operator(MEASURED_MATERIALS_OT_import_arc.bl_idname, text="Import Photographs", icon="IMAGE_DATA")
        maps = column.operator(MEASURED_MATERIALS_OT_import_arc.bl_idname, text="Maps of Photographs", icon="TEXTURE")
        maps.make = "maps"
        column.operator(MEASURED_MATERIALS_OT_import_maps.bl_idname, text="Build Material of Maps", icon="MATERIAL")


class _LightingPanel:
    """How a shading map is lit; a change shows at once."""

    bl_label = "Lighting"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only for shading maps."""
        return kind_of(shown_material(context)) is SHADING_MAP

    def draw(self, context: bpy.types.Context) -> None:
        """The settings, or why they cannot be changed."""
        material, layout = shown_material(context), self.layout
        properties = material.measured_lighting
        column = _where_rebuildable(layout, material, properties.problem, Lines(context))
        draw_lighting(column, properties, through=lets_light_through(material))


class _EffectsPanel(ForMeasured):
    """The account of what the scene made of the material, and what can be overridden."""

    bl_label = "Effects"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """What fits the material to the scene, what is kept and left out, and the overrides."""
        material, layout = shown_material(context), self.layout
        lines, kind = Lines(context), kind_of(material)
        _draw_scene_buttons(layout.column(align=True), context, material)
        for effect in effects_of(material):
            lines.draw(layout, f"{effect.name}: {effect.why}", "CHECKMARK" if effect.kept else "REMOVE")
        properties = material.measured_quality
        column = _where_rebuildable(layout, material, properties.problem, lines)
        draw_quality(column, properties, tuple(name for name in kind.effective(material) if name != "mode"))
        draw_tangent(layout, material, context)


class _DetailsPanel(ForMeasured):
    """All figures of the bake."""

    bl_label = "Details"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Rows as `inspect` tells them."""
        material, lines = shown_material(context), Lines(context)
        column = self.layout.column(align=True)
        try:
            for rows in parts_of(record_of(material)):
                for label, value in rows:
                    lines.row(column, label, value)
                column.separator()
        except BakeError as error:
            lines.draw(column, f"{error.cause}; {error.remedy}", "ERROR")


class _BakePanel(ForMeasured):
    """The settings of the next bake."""

    bl_label = "Bake"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Settings, then the button."""
        material = shown_material(context)
        kind = kind_of(material)
        form_of(kind).draw(self.layout, material)
        if kind.why_not_bakeable(material):
            Lines(context).draw(self.layout, kind.lost_words, "ERROR")
        row = self.layout.row(align=True)
        row.operator(MEASURED_MATERIALS_OT_bake_again.bl_idname, icon="FILE_REFRESH")
        row.operator(MEASURED_MATERIALS_OT_bake_again.bl_idname, text="", icon="FILE_FOLDER").choose = True


def _draw_title(layout: bpy.types.UILayout, material: bpy.types.Material, lines: Lines) -> None:
    """Picture, name and source, or why they are not to be had; and textures that are not those of the bake."""
    split = layout.split(factor=0.3)
    split.column().template_icon(icon_value=picture_of(material), scale=_PICTURE)
    words = split.column()
    lines.draw(words, material.name, part=0.62)
    try:
        for label, value in parts_of(record_of(material))[0]:
            if value != material.name:
                lines.draw(words, value if label == "Source" else f"{label}: {value}", faint=True, part=0.62)
    except BakeError as error:
        lines.draw(layout, f"{error.cause}; {error.remedy}", "ERROR")
    if wrong := wrong_textures(material):
        names = ", ".join(name.replace("_", " ") for name in wrong)
        lines.draw(layout, f"Not the files of the bake: {names}; see Scene Check, or bake again", "ERROR")


def _draw_scene_buttons(column: bpy.types.UILayout, context: bpy.types.Context, material: bpy.types.Material) -> None:
    column.operator(MEASURED_MATERIALS_OT_fit_to_scene.bl_idname, icon="SCENE_DATA")
    scripted = material.measured_quality.shader == OSL
    words = {"text": "Shade by Nodes"} if scripted else {}
    column.operator(MEASURED_MATERIALS_OT_use_osl.bl_idname, icon="FILE_SCRIPT", **words).nodes = scripted
    denoised = asks_for_passes(context.scene)
    words = {"text": "Stop Denoising"} if denoised else {}
    column.operator(MEASURED_MATERIALS_OT_denoise.bl_idname, icon="SHADERFX", **words).stop = denoised


def _where_rebuildable(layout: bpy.types.UILayout, material: bpy.types.Material, problem: str, lines: Lines) -> Any:
    """A column for what rebuilds the material, below what keeps it from that and what the last change met."""
    lost = kind_of(material).why_not_rebuildable(material)
    for text in filter(None, (lost, problem)):
        lines.draw(layout, text, "ERROR")
    column = layout.column()
    column.enabled = material.is_editable and not lost
    return column


classes = (
    *in_both_places(_Panel, on_top=True),
    *in_both_places(_ImportPanel, "import", within=False),
    *in_both_places(AdjustPanel, "adjust"),
    *in_both_places(_LightingPanel, "lighting"),
    *in_both_places(_EffectsPanel, "effects"),
    *in_both_places(_BakePanel, "bake"),
    *in_both_places(_DetailsPanel, "details"),
)
register, unregister = bpy.utils.register_classes_factory(classes)
