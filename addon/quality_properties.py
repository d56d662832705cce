"""How much a measured BRDF spends on a sample, as Blender properties: a change rebuilds the material at once."""

# No postponed annotations here: Blender reads the properties from them.
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy

from ..bake.modes import MODES
from ..bake.tables.table import FILTERS
from .effects import Choices

# What a choice is called and does; choices themselves are those of the settings, in their order.
MODE_WORDS = {
    "preview": (
        "Preview",
        "Cycles' own closures fitted to the measurement; as quick as Principled, and what EEVEE shows",
    ),
    "balanced": ("Balanced", "Exact where it is seen directly or in a mirror, Preview after a diffuse bounce"),
    "exact": ("Exact", "Cycles' own closures as far as they go, the rest by a stochastic mirror: less noise"),
    "reference": ("Reference", "All of it by a stochastic mirror"),
}
AUTO = "auto"
_FILTER_WORDS = {"nearest": "Nearest", "trilinear": "Linear", "bspline": "B-Spline"}


def _items(words: dict[str, tuple[str, str]], choices: tuple[str, ...]) -> list[tuple[str, str, str]]:
    return [(choice, *words[choice]) for choice in choices]


_quiet = False


@contextmanager
def without_rebuilding() -> Iterator[None]:
    """Inside, a change of these properties rebuilds nothing."""
    global _quiet
    before, _quiet = _quiet, True
    try:
        yield
    finally:
        _quiet = before


def _changed(properties: Any, _context: bpy.types.Context) -> None:
    if not _quiet:
        # Imported here: it needs what is defined in this module.
        from .rebuild import rebuild_or_say

        with without_rebuilding():
            rebuild_or_say(properties.id_data)


_MODE = bpy.props.EnumProperty(
    name="Mode",
    description="What accuracy is worth here",
    items=_items(MODE_WORDS, MODES),
    default="exact",
    options=set(),
    update=_changed,
)
_AIM = bpy.props.EnumProperty(
    name="Aim at Lights",
    description="Send the mirror towards the scene's lamps and the bright parts of its world",
    items=[
        (AUTO, "Automatic", "Where the scene has something to aim at"),
        ("always", "Always", "Ready for lamps that are still to come"),
        ("never", "Never", "Meet lights by chance"),
    ],
    default=AUTO,
    options=set(),
    update=_changed,
)
_RESIDUAL = bpy.props.EnumProperty(
    name="Residual",
    description="The mirror for what Cycles' own closures leave of the measurement",
    items=[
        (AUTO, "Automatic", "Where it carries light"),
        ("always", "Always", "Even if it carries next to nothing"),
        ("never", "Never", "Refused where it carries light; mode Preview does without"),
    ],
    default=AUTO,
    options=set(),
    update=_changed,
)
_FILTER = bpy.props.EnumProperty(
    name="Filter",
    description="How the table is reconstructed between samples",
    items=[(AUTO, "As Baked", "What the table was measured with")] + [(f, _FILTER_WORDS[f], "") for f in FILTERS],
    default=AUTO,
    options=set(),
    update=_changed,
)
_DETAIL = bpy.props.EnumProperty(
    name="Detail",
    description="The swatch's texels",
    items=[
        (AUTO, "Automatic", "Left out where a texel is far below a pixel everywhere"),
        ("always", "Always", "Kept at any distance"),
        ("never", "Never", "The swatch's mean; refused where texels can be seen"),
    ],
    default=AUTO,
    options=set(),
    update=_changed,
)


class MEASURED_MATERIALS_PG_quality(bpy.types.PropertyGroup):
    """Mode, and what is not left to the scene."""

    mode: _MODE
    aim: _AIM
    residual: _RESIDUAL
    filter: _FILTER
    detail: _DETAIL
    problem: bpy.props.StringProperty(description="Why the last change had no effect", options={"HIDDEN", "SKIP_SAVE"})


def choices_of(properties: Any) -> Choices:
    """The properties as choices."""
    return Choices(
        mode=properties.mode,
        aim=properties.aim,
        residual=properties.residual,
        filter=properties.filter,
        detail=properties.detail,
    )


def show_choices(properties: Any, choices: Choices) -> None:
    """Set the properties to how a material is built; nothing is rebuilt."""
    with without_rebuilding():
        for name in ("mode", "aim", "residual", "filter", "detail"):
            setattr(properties, name, getattr(choices, name))


def draw_quality(layout: bpy.types.UILayout, properties: Any, *, shading_map: bool) -> None:
    """Those that have an effect."""
    column = layout.column()
    column.use_property_split, column.use_property_decorate = True, False
    if shading_map:
        column.prop(properties, "aim")
        column.prop(properties, "detail")
        return
    column.prop(properties, "mode")
    if properties.mode == "preview":
        return
    column.prop(properties, "aim")
    if properties.mode != "reference":
        column.prop(properties, "residual")
    column.prop(properties, "filter")


classes = (MEASURED_MATERIALS_PG_quality,)
_register_classes, _unregister_classes = bpy.utils.register_classes_factory(classes)


def register() -> None:
    """Called by `addon.register`."""
    _register_classes()
    bpy.types.Material.measured_quality = bpy.props.PointerProperty(type=MEASURED_MATERIALS_PG_quality)


def unregister() -> None:
    """Called by `addon.unregister`."""
    del bpy.types.Material.measured_quality
    _unregister_classes()
