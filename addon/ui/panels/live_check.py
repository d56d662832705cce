"""The last scene check in words, kept up to date with edits, undo and redo while a panel shows it."""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import bpy
from bpy.app.handlers import persistent

from ...events import listen, stop_listening, timer
from ...scene_check.check import check_scene
from ...scene_check.file_rules import not_whole, with_missing_parts
from ...scene_check.findings import NOTE, SLOW, WRONG, Finding

# Seconds without an edit before the scene is checked, and the share of the time that checks may take.
_REST, _SHARE = 0.4, 0.05
# Longer checks would be felt as a stall; they wait for the button.
_LONGEST = 0.08


@dataclass(frozen=True)
class Row:
    """A finding in words: datablocks may be gone by the next redraw."""

    key: str
    severity: str
    setting: str
    why: str
    mendable: bool


@dataclass
class Shown:
    """The last check.

    Attributes
    ----------
    scene : its name; empty before the first
    rows : the findings; None where the scene shows no measured material
    summary : in one line
    stale : something has changed since
    seconds : that a window stood still for it, or for the check of this scene before it, if that was quicker: now and
        then one has to wait for a busy machine, or until Blender has evaluated all of the scene anew
    """

    scene: str = ""
    rows: tuple[Row, ...] | None = None
    summary: str = ""
    stale: bool = True
    seconds: float = 0.0
    took: float = field(default=float("inf"), repr=False)
    edited: float = field(default=0.0, repr=False)
    ended: float = field(default=0.0, repr=False)
    wanted: str = field(default="", repr=False)

    @property
    def harmful(self) -> int:
        """How many rows bias or slow a picture."""
        return sum(row.severity != NOTE for row in self.rows or ())

    @property
    def fixable(self) -> bool:
        """Whether any of these can be fixed."""
        return any(row.mendable and row.severity != NOTE for row in self.rows or ())


shown = Shown()


def keep(scene: bpy.types.Scene, found: list[Finding] | None, seconds: float | None = None) -> None:
    """Show these findings from now on."""
    if shown.scene != scene.name:  # how long the check of another one took says nothing
        shown.seconds, shown.took = 0.0, float("inf")
    shown.scene, shown.summary, shown.stale = scene.name, summary(found), False
    rows = (Row(f.key, f.severity, f.setting, f.why, f.mend is not None) for f in found or ())
    shown.rows = None if found is None else tuple(rows)
    if seconds is not None:
        shown.seconds, shown.took = min(seconds, shown.took), seconds
    shown.ended = time.monotonic()


def summary(found: list[Finding] | None) -> str:
    """Findings of a scene check in one line."""
    if found is None:
        return "The scene shows no measured material"
    missing = not_whole(found)
    count = Counter(finding.severity for finding in found if finding not in missing)
    words = ((WRONG, "settings bias", "setting biases"), (SLOW, "settings slow", "setting slows"))
    told = [f"{count[kind]} {many if count[kind] > 1 else one}" for kind, many, one in words if count[kind]]
    whole = "The file did not load whole. " if missing else ""
    return whole + (
        f"{' and '.join(told)} measured materials" if told else "Nothing biases or slows measured materials"
    )


def check_now(scene: bpy.types.Scene) -> list[Finding] | None:
    """Check the scene and show what is found."""
    # By the clock: what a check evaluates is evaluated by threads of Blender's own, for which the window waits too.
    start = time.perf_counter()
    found = with_missing_parts(check_scene(scene))
    keep(scene, found, time.perf_counter() - start)
    return found


def is_current(scene: bpy.types.Scene) -> bool:
    """Whether the last check is of this scene as it is; if not, a check is asked for, as far as it is quick."""
    shown.wanted = scene.name
    if shown.scene == scene.name and not shown.stale:
        return True
    if follows(scene) and not bpy.app.background:
        _ask()
    return False


def follows(scene: bpy.types.Scene) -> bool:
    """Whether checks of this scene are quick enough to be made without being asked for."""
    return shown.scene != scene.name or shown.seconds <= _LONGEST


@persistent
def changed(*_: Any) -> None:
    """Something was edited, undone, redone or loaded."""
    shown.stale, shown.edited = True, time.monotonic()


@persistent
def loaded(*_: Any) -> None:
    """Another file: nothing that was found holds."""
    shown.scene, shown.rows, shown.seconds, shown.took = "", None, 0.0, float("inf")
    changed()


@timer
def look_again() -> float | None:
    """For a timer: check the scene that a panel asked for once the artist rests; seconds to the next try."""
    scene = bpy.data.scenes.get(shown.wanted)
    if scene is None or (shown.scene == scene.name and not shown.stale) or not follows(scene):
        return None
    now = time.monotonic()
    wait = max(shown.edited + _REST - now, shown.ended + shown.seconds / _SHARE - now)
    if wait > 0 or bpy.app.is_job_running("RENDER"):
        return max(wait, _REST)
    before = shown.rows
    check_now(scene)
    # Evaluated by the check itself, which is no edit.
    shown.stale = False
    if shown.rows != before:
        _redraw()
    return None


def _ask() -> None:
    if not bpy.app.timers.is_registered(look_again):
        bpy.app.timers.register(look_again, first_interval=_REST)


def _redraw() -> None:
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in ("PROPERTIES", "NODE_EDITOR"):
                area.tag_redraw()


_HANDLERS = {
    "depsgraph_update_post": changed,
    "undo_post": changed,
    "redo_post": changed,
    "load_post": loaded,
}


def register() -> None:
    """Follow the edits."""
    listen(_HANDLERS)


def unregister() -> None:
    """Stop following, and forget the last check."""
    if bpy.app.timers.is_registered(look_again):
        bpy.app.timers.unregister(look_again)
    stop_listening(_HANDLERS)
    loaded()
