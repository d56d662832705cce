"""Photographs looked at before they are baked: a strip of them, brightness against elevation, and what is doubtful.

They are read in a process of their own, while Blender stays awake; the dialogue that shows them opens after that.
"""

from __future__ import annotations

import contextlib
import itertools
import tempfile
import textwrap
import time
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import bpy.utils.previews
import numpy as np
from bpy.app.handlers import persistent
from numpy.typing import NDArray

from ...bake.bundle.bundle import SUFFIX
from .. import events
from ..baking.hosts import hosts
from ..baking.job import DONE, RUNNING, WAITING, BakeJob
from ..baking.look import Look, sentence
from ..baking.request import BakeRequest

_PAUSE = 0.05
# Seconds after which the dialogue opens in any case: photographs of a large camera take longer.
_PATIENCE = 12.0
# Of the dialogue: pixels at a UI scale of 1, and letters that surely fit beside an icon.
WIDTH, LETTERS = 520, 72
# Photographs in the strip, and lines of doubts: all is to fit a screen of 1080 lines at a UI scale of 2.
_STRIP, _DOUBTS = 10, 4
# Texels of the plot's side, and of its border; icons that it is high.
_SIDE, _BORDER = 160, 12
_PLOT = 5.5
_INK, _GRID = (0.9, 0.55, 0.2, 1.0), (0.5, 0.5, 0.5, 0.5)


class _Looking:
    """The photographs that are looked at, or were last."""

    def __init__(self) -> None:
        self.source: Any = None
        self.look: Look | None = None
        self.problem = ""
        self._job: BakeJob | None = None
        self._then: Callable[[], None] | None = None
        self._until = 0.0
        self._icons: Any = None

    def begin(self, request: BakeRequest, then: Callable[[], None]) -> None:
        """Look at a request's photographs, and call `then` when that is done or takes long."""
        self.stop()
        self.source, self.look, self.problem = request.source, None, ""
        self._then, self._until = then, time.monotonic() + _PATIENCE
        target = Path(tempfile.gettempdir()) / f"{uuid.uuid4().hex[:12]}{SUFFIX}"
        self._job = BakeJob(request, target, hosts(request, bpy.app.binary_path))
        self._job.start()
        if not bpy.app.timers.is_registered(tick):
            bpy.app.timers.register(tick, first_interval=_PAUSE)

    def is_looking(self) -> bool:
        """Whether the process still reads."""
        return self._job is not None

    def step(self) -> bool:
        """Follow the process; whether there is more to follow."""
        job = self._job
        if job is not None and job.poll() not in (WAITING, RUNNING):
            self.look = job.look if job.state == DONE else None
            if job.error is not None:
                self.problem = sentence(f"{job.error.cause}: {job.error.remedy}")
            job.close()
            self._job = None
            self._forget_icons()
        then = self._then
        if then is not None and (self._job is None or time.monotonic() > self._until):
            self._then = None
            then()
        return self._job is not None

    def stop(self) -> None:
        """End the process; no datablock is touched."""
        job, self._job, self._then = self._job, None, None
        if job is not None:
            job.cancel()
            job.close()

    def icon(self, key: str, pixels: Callable[[], NDArray[Any]]) -> int:
        """Number of an icon of these (H, W, 4) linear values, row 0 at the bottom; 0 without a window."""
        if bpy.app.background:  # where the wheel 4.5 ends in a fault of memory after icons were made
            return 0
        if self._icons is None:
            self._icons = bpy.utils.previews.new()
        if key not in self._icons:
            values = pixels()
            made = self._icons.new(key)
            made.image_size = values.shape[1], values.shape[0]
            made.image_pixels_float.foreach_set(np.ascontiguousarray(values, np.float32).ravel())
        return int(self._icons[key].icon_id)

    def _forget_icons(self) -> None:
        if self._icons is not None:
            self._icons.clear()

    def end(self) -> None:
        """All goes."""
        self.stop()
        self.source = self.look = None
        if self._icons is not None:
            bpy.utils.previews.remove(self._icons)
            self._icons = None


looking = _Looking()


@events.timer
def tick() -> float | None:
    """The timer's function."""
    return _PAUSE if looking.step() else None


def draw_look(layout: bpy.types.UILayout, source: Any) -> bpy.types.UILayout:
    """Draw what is known of these photographs, a folder or a tuple of files, in a dialogue `WIDTH` wide.

    Returns
    -------
    where settings go: beside the plot, or below where there is none
    """
    if looking.source != source:
        return layout
    if looking.is_looking():
        layout.label(text="The photographs are being read", icon="TIME")
    elif looking.problem:
        draw_lines(layout, looking.problem, "ERROR")
    elif looking.look is not None:
        return _draw(layout, looking.look)
    return layout


def _draw(layout: bpy.types.UILayout, look: Look) -> bpy.types.UILayout:
    count, known = len(look.names), look.elevations
    span = f", lit from {known[0]:.0f}° to {known[-1]:.0f}°" if known else ", in order of brightness"
    shown = range(count) if count <= _STRIP else np.linspace(0, count - 1, _STRIP).round().astype(int).tolist()
    layout.label(text=f"{count} photographs{span}{f'; {_STRIP} of them' if count > _STRIP else ''}")
    strip = layout.grid_flow(row_major=True, columns=len(shown), even_columns=True, align=True)
    for k in shown:
        cell = strip.column(align=True)
        cell.template_icon(icon_value=looking.icon(f"picture {k}", lambda k=k: _as_pixels(look.pictures[k])), scale=2.4)
        if known:
            below = cell.row()
            below.alignment = "CENTER"  # as the picture is
            below.label(text=f"{known[k]:.0f}°")
    _draw_doubts(layout, look.doubts)
    return _draw_plot(layout, known, look.brightness) if known else layout


def _draw_doubts(layout: bpy.types.UILayout, doubts: tuple[str, ...]) -> None:
    """Whole ones as far as there is room; one at least."""
    left = _DOUBTS
    for number, doubt in enumerate(doubts):
        left -= len(textwrap.wrap(doubt, LETTERS))
        if number and left < (number < len(doubts) - 1):
            layout.label(text=f"{len(doubts) - number} more, which are told after the bake", icon="ERROR")
            break
        draw_lines(layout, doubt, "ERROR")


def _draw_plot(
    layout: bpy.types.UILayout, elevations: tuple[float, ...], brightness: tuple[float, ...]
) -> bpy.types.UILayout:
    """On the left; returns what is beside it."""
    split = layout.split(factor=0.42)
    column = split.column(align=True)
    column.label(text="Brightness over elevation")
    column.template_icon(icon_value=looking.icon("plot", lambda: plot(elevations, brightness)), scale=_PLOT)
    return split.column()


def draw_lines(layout: bpy.types.UILayout, text: str, icon: str = "NONE", letters: int = LETTERS) -> None:
    """Labels below each other of so many letters at most, the first with the icon."""
    column = layout.column(align=True)
    for number, line in enumerate(textwrap.wrap(text, letters)):
        column.label(text=line, icon="BLANK1" if number and icon != "NONE" else icon)


def _as_pixels(picture: NDArray[np.uint8]) -> NDArray[np.float64]:
    """A square of an icon's values, the picture in its middle."""
    height, width = picture.shape[:2]
    side = max(height, width)
    values = np.zeros((side, side, 4))
    top, left = (side - height) // 2, (side - width) // 2
    values[top : top + height, left : left + width] = np.dstack([picture / 255, np.ones((height, width))])
    return values[::-1]


def plot(elevations: tuple[float, ...], brightness: tuple[float, ...]) -> NDArray[np.float64]:
    """Brightness from 0 to 1 against elevation from 0 to 90 degrees, as (side, side, 4), row 0 at the bottom."""
    values = np.zeros((_SIDE, _SIDE, 4))
    inner = _SIDE - 2 * _BORDER
    for share in (0.0, 1 / 3, 2 / 3, 1.0):
        at = _BORDER + round(share * (inner - 1))
        values[_BORDER : _SIDE - _BORDER, at] = values[at, _BORDER : _SIDE - _BORDER] = _GRID
    x = _BORDER + np.clip(np.array(elevations) / 90, 0, 1) * (inner - 1)
    y = _BORDER + np.clip(np.array(brightness), 0, 1) * (inner - 1)
    order = np.argsort(x, kind="stable")
    steps = np.linspace(0, 1, 200)[:, None]
    for a, b in itertools.pairwise(order):
        _dot(values, x[a] + (x[b] - x[a]) * steps[:, 0], y[a] + (y[b] - y[a]) * steps[:, 0], 0)
    _dot(values, x, y, 3)
    return values


def _dot(values: NDArray[np.float64], x: NDArray[np.float64], y: NDArray[np.float64], radius: int) -> None:
    for dx in range(-radius, radius + 1):
        for dy in range(-radius, radius + 1):
            if dx * dx + dy * dy <= radius * radius + 1:
                values[np.rint(y).astype(int) + dy, np.rint(x).astype(int) + dx] = _INK


@persistent
def _before_load(*_: Any) -> None:
    looking.stop()


_HANDLERS = {"load_pre": _before_load}


def register() -> None:
    """Called by `addon.register`."""
    events.listen(_HANDLERS)


def unregister() -> None:
    """Called by `addon.unregister`."""
    events.stop_listening(_HANDLERS)
    if bpy.app.timers.is_registered(tick):
        bpy.app.timers.unregister(tick)
    with contextlib.suppress(KeyError):
        looking.end()
