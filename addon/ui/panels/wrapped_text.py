"""Text in lines that fit a panel, since Blender cuts what is wider than its label."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import blf
import bpy

from ...summary.text import one_line

# At a UI scale of 1, in pixels: what a panel keeps at its sides; a sidebar's tabs; an icon; what lies between the
# parts of a row; a panel's width and a letter's where there is no window to ask.
_MARGIN, _TABS, _ICON, _GAP, _USUAL_WIDTH, _USUAL_LETTER = 40, 22, 22, 14, 300, 6.0


def wrapped(text: str, width: float, measure: Callable[[str], float]) -> list[str]:
    """Break a text at its spaces, and a word that is wider than a line anywhere.

    Parameters
    ----------
    text : control characters become spaces
    width : of a line, in the units of `measure`
    measure : width of a text
    """
    lines, line = [], ""
    for word in one_line(text).split():
        if line and measure(f"{line} {word}") > width:
            lines.append(line)
            line = ""
        line = f"{line} {word}" if line else word
        while len(line) > 1 and measure(line) > width:
            fits = max(next((i for i in range(1, len(line)) if measure(line[: i + 1]) > width), 1), 1)
            lines.append(line[:fits])
            line = line[fits:]
    return [*lines, line] if line else lines or [""]


class Lines:
    """Draws text of any length into a layout.

    Parameters
    ----------
    context : whose region the layout is in
    width : of the layout, in pixels at a UI scale of 1; by default the region's
    """

    def __init__(self, context: bpy.types.Context, width: float | None = None) -> None:
        # Without a window there are neither fonts nor a scale.
        self._scale = 1.0 if bpy.app.background else context.preferences.system.ui_scale
        region = getattr(context, "region", None)
        shown = region.width / self._scale if region is not None and region.width > 1 else _USUAL_WIDTH
        tabs = _TABS if region is not None and getattr(region, "type", "") == "UI" else 0
        self.width = (shown - tabs if width is None else width) - _MARGIN
        self._points = context.preferences.ui_styles[0].widget.points

    def measure(self, text: str) -> float:
        """Width of a label in pixels at a UI scale of 1."""
        if bpy.app.background:
            return _USUAL_LETTER * len(text)
        blf.size(0, self._points * self._scale)
        return float(blf.dimensions(0, text)[0]) / self._scale

    def draw(self, layout: Any, text: str, icon: str = "NONE", *, faint: bool = False, part: float = 1.0) -> None:
        """Labels below each other, the first with the icon; `part` is the layout's share of the width."""
        room = max(self.width * part - (_ICON if icon != "NONE" else 0) - (_GAP if part < 1 else 0), 40)
        column = layout.column(align=True)
        column.active = not faint
        # Close together, as lines of one sentence.
        column.scale_y = 0.8
        for i, line in enumerate(wrapped(text, room, self.measure)):
            column.label(text=line, icon=icon if i == 0 or icon == "NONE" else "BLANK1")

    def row(self, layout: Any, name: str, value: str) -> None:
        """A name and its value, side by side where both fit."""
        if self.measure(name) <= 0.36 * self.width and self.measure(one_line(value)) <= 0.6 * self.width:
            split = layout.split(factor=0.38)
            left = split.row()
            left.active = False
            left.label(text=name)
            split.label(text=one_line(value))
        else:
            self.draw(layout, name, faint=True)
            self.draw(layout, value)
