"""The first level of a bake's dialogue: Draft, Standard or Fine, with what each takes; the second is closed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import bpy

from ....bake.errors import BakeError
from ...summary.quality_levels import CUSTOM, LEVELS, expectation_words, level_of

Levels = Mapping[str, Mapping[str, Any]]
_ITEMS = [
    ("draft", "Draft", "For a first look"),
    ("standard", "Standard", "For nearly everything"),
    ("fine", "Fine", "For what fills the picture"),
    (CUSTOM, "Custom", "Settings of your own, under Advanced"),
]
# Side by side, at the usual width of a panel.
_TABS = 3
_NUMBERS = {name: number for number, (name, *_) in enumerate(_ITEMS)}


def quality_choice(levels: Levels) -> Any:
    """A property that sets the others of a level, and says which level they are; so it never contradicts them."""

    def get(properties: Any) -> int:
        return _NUMBERS[level_of(properties, levels)]

    def put(properties: Any, number: int) -> None:
        for name, value in levels.get(_ITEMS[number][0], {}).items():
            setattr(properties, name, value)

    return bpy.props.EnumProperty(
        name="Quality",
        description="How much of the measurement the bake keeps, for how much time and memory",
        items=_ITEMS,
        get=get,
        set=put,
        options={"SKIP_SAVE"},
    )


def advanced() -> Any:
    """Whether the second level is open."""
    return bpy.props.BoolProperty(
        name="Advanced",
        description="Show all settings of the bake",
        default=False,
        options={"SKIP_SAVE"},
    )


def draw_quality_choice(
    layout: bpy.types.UILayout, properties: Any, levels: Levels, settings_of: Callable[[Any], Any] | None
) -> bpy.types.UILayout | None:
    """Draw the choice, each level with what it is expected to take, and where the second level goes if it is open.

    Parameters
    ----------
    settings_of : the bake's settings of such properties; raises BakeError. None where nothing is known of it
    """
    column = layout.column(align=True)
    column.label(text="Quality")
    shown = LEVELS if level_of(properties, levels) != CUSTOM else (*LEVELS, CUSTOM)
    for name in shown:
        title = next(words for key, words, _ in _ITEMS if key == name)
        column.prop_enum(properties, "quality", name, text=f"{title}{_expected(properties, levels, name, settings_of)}")
    row = layout.row()
    row.alignment = "LEFT"
    row.prop(
        properties,
        "advanced",
        icon="DISCLOSURE_TRI_DOWN" if properties.advanced else "DISCLOSURE_TRI_RIGHT",
        emboss=False,
    )
    return layout.column() if properties.advanced else None


def part_choice(parts: Mapping[str, str]) -> Any:
    """A property: which part of the second level is shown, of these keys with their words. All at once are higher than
    many a screen.
    """
    return bpy.props.EnumProperty(
        name="Part",
        description="Part of the settings that is shown",
        items=[(key, words, f"Show these settings: {words}") for key, words in parts.items()],
        options={"SKIP_SAVE"},
    )


def draw_part(
    layout: bpy.types.UILayout, properties: Any, parts: Sequence[str], columns: int = _TABS
) -> bpy.types.UILayout:
    """Draw the tabs of these parts in rows; returns the column for the settings of the one that is open."""
    tabs = layout.grid_flow(row_major=True, columns=min(len(parts), columns), even_columns=True, align=True)
    for name in parts:
        tabs.prop_enum(properties, "part", name)
    column = layout.column()
    column.use_property_split, column.use_property_decorate = True, False
    return column


class _At:
    """Properties, with what a level sets in their place."""

    def __init__(self, properties: Any, level: Mapping[str, Any]) -> None:
        self._properties, self._level = properties, level

    def __getattr__(self, name: str) -> Any:
        return self._level[name] if name in self._level else getattr(self._properties, name)


def _expected(properties: Any, levels: Levels, name: str, settings_of: Callable[[Any], Any] | None) -> str:
    """Time and size of a level, all else being as it is."""
    if settings_of is None:
        return ""
    try:
        words = expectation_words(settings_of(_At(properties, levels.get(name, {}))))
    except BakeError:  # told when the bake is asked for
        return ""
    return f": {words}"
