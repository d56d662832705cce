"""How much a material spends on a sample, as Blender properties: a change rebuilds it at once."""

# No postponed annotations here: Blender reads the properties from them.
from typing import Any

import bpy

from ....bake.brdf.modes import MODES
from ....bake.tables.table import FILTERS
from ...material.choices import AUTO, NODES, OSL
from ...material.kinds import rebuild_or_say
from .enum_items import enum
from .registration import registration

# What a choice is called and does; choices themselves are those of the settings, in their order.
_MODE_WORDS = {
    "preview": (
        "Preview",
        "Cycles' own shaders fitted to the measurement; as quick as Principled, and what EEVEE shows",
    ),
    "balanced": ("Balanced", "Exact where it is seen directly or in a mirror, Preview after a diffuse bounce"),
    "exact": ("Exact", "Cycles' own shaders where they fit, a mirror for the rest: less noise"),
    "reference": ("Reference", "All of it by a mirror, in directions drawn at random"),
}
_FILTER_WORDS = {"nearest": "Nearest", "trilinear": "Linear", "bspline": "B-Spline"}


def mode_property(**options: Any) -> Any:
    """The one choice of a mode, for both kinds of material."""
    return enum("Mode", "What accuracy is worth here", MODES, _MODE_WORDS, "exact", **options)


_MODE = mode_property(options=set(), update=rebuild_or_say)
_AIM = bpy.props.EnumProperty(
    name="Aim at Lights",
    description="Send the mirror towards the scene's lamps and the bright parts of its world",
    items=[
        (AUTO, "Automatic", "Where the scene has something to aim at"),
        ("always", "Always", "Also prepared for lights added later"),
        ("never", "Never", "Lights are hit by chance"),
    ],
    default=AUTO,
    options=set(),
    update=rebuild_or_say,
)
_SAMPLE = bpy.props.EnumProperty(
    name="Sample Lamps",
    description="Let the shader sample lamps, and the picture of the world, itself rather than aim a mirror",
    items=[
        (AUTO, "Automatic", "Where this Blender can, and the lamps' light is known exactly"),
        ("always", "Always", "Also where aiming is worth more; refused where the picture would be wrong"),
        ("never", "Never", "A mirror meets them"),
    ],
    default=AUTO,
    options=set(),
    update=rebuild_or_say,
)
_RESIDUAL = bpy.props.EnumProperty(
    name="Mirror Part",
    description="The mirror for the part of the measurement that Cycles' own shaders do not carry",
    items=[
        (AUTO, "Automatic", "Where it carries light"),
        ("always", "Always", "Even if it carries next to nothing"),
        ("never", "Never", "Refused where it carries light; mode Preview omits it"),
    ],
    default=AUTO,
    options=set(),
    update=rebuild_or_say,
)
_FILTER = bpy.props.EnumProperty(
    name="Filter",
    description="How the table is reconstructed between samples",
    items=[(AUTO, "As Baked", "What the table was measured with")] + [(f, _FILTER_WORDS[f], "") for f in FILTERS],
    default=AUTO,
    options=set(),
    update=rebuild_or_say,
)
_SHADER = bpy.props.EnumProperty(
    name="Shader",
    description="What the material is built of",
    items=[
        (NODES, "Nodes", "Renders on every device, and in EEVEE"),
        (
            OSL,
            "OSL",
            "Scripts, for Cycles on the CPU alone: sample lamps before Blender 5.1 too, and the world's picture",
        ),
    ],
    default=NODES,
    options=set(),
    update=rebuild_or_say,
)
_DETAIL = bpy.props.EnumProperty(
    name="Swatch Detail",
    description="The pattern of the swatch",
    items=[
        (AUTO, "Automatic", "Its means where it is far finer than a pixel: everywhere, or by distance"),
        ("always", "Always", "Every texel at any distance"),
        ("never", "Never", "The swatch's mean; refused where the pattern can be seen"),
    ],
    default=AUTO,
    options=set(),
    update=rebuild_or_say,
)


class MEASURED_MATERIALS_PG_quality(bpy.types.PropertyGroup):
    """Mode, and what is not left to the scene."""

    mode: _MODE
    aim: _AIM
    sample: _SAMPLE
    residual: _RESIDUAL
    filter: _FILTER
    detail: _DETAIL
    shader: _SHADER
    problem: bpy.props.StringProperty(description="Why the last change had no effect", options={"HIDDEN", "SKIP_SAVE"})


def draw_quality(layout: bpy.types.UILayout, properties: Any, names: tuple[str, ...]) -> None:
    """Draw the quality settings of these names, which have an effect."""
    column = layout.column()
    column.use_property_split, column.use_property_decorate = True, False
    for name in names:
        column.prop(properties, name)


register, unregister = registration(MEASURED_MATERIALS_PG_quality, "measured_quality")
