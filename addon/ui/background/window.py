"""What the queue, which a timer calls, does to the window: it has no context of its own."""

from __future__ import annotations

import contextlib
from typing import Any

import bpy

from ...summary.text import one_line


def window() -> Any:
    """The first window as context."""
    windows = bpy.context.window_manager.windows
    return bpy.context.temp_override(window=windows[0]) if windows else contextlib.nullcontext()


def is_dragging() -> bool:
    """Whether an artist is in the middle of something."""
    return any(
        operator.bl_idname != "MEASURED_MATERIALS_OT_watch_bakes"
        for window in bpy.context.window_manager.windows
        for operator in getattr(window, "modal_operators", ())
    )


def push(words: str) -> None:
    """Close a step of undo, and have all drawn again."""
    if bpy.ops.ed.undo_push.poll():
        bpy.ops.ed.undo_push(message=words)
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            area.tag_redraw()


def push_for_script(operator: bpy.types.Operator) -> None:
    """Close a step of undo behind an operator that a script called, for which Blender closes none.

    Materials that no step knows of are gone with the next undo of whatever was done before them, and Blender 4.3
    crashes as it draws after that. Done again from its panel, the operator has Blender's own step.
    """
    if not bpy.app.background and not operator.options.is_repeat:
        with window():
            push(operator.bl_label)


def tell(words: str, kind: str = "INFO") -> None:
    """Report it."""
    bpy.ops.measured_materials.tell(words=one_line(words), kind=kind)
