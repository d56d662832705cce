"""Operators of the queue: one listens for Esc while something is baked, one reports what was done beside the window."""

# No postponed annotations here: Blender reads the properties from them.
from typing import Any

import bpy

from .bake_queue import queue

_WORDS = bpy.props.StringProperty(options={"HIDDEN", "SKIP_SAVE"})
_KIND = bpy.props.StringProperty(default="INFO", options={"HIDDEN", "SKIP_SAVE"})


class MEASURED_MATERIALS_OT_watch_bakes(bpy.types.Operator):
    """Listen for Esc while something is baked; all else passes"""

    bl_idname = "measured_materials.watch_bakes"
    bl_label = "Watch Bakes"
    bl_options = {"INTERNAL"}

    _timer: Any = None

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Begin to listen; the timer's events end it where nothing else happens."""
        self._timer = context.window_manager.event_timer_add(0.25, window=context.window)
        context.window_manager.modal_handler_add(self)
        queue.listening = True
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Esc cancels the bake that runs; the next begins."""
        if not queue.is_busy():
            self.cancel(context)
            return {"FINISHED", "PASS_THROUGH"}
        if event.type == "ESC" and event.value == "PRESS":
            queue.cancel()
            return {"RUNNING_MODAL"}
        return {"PASS_THROUGH"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Also called by Blender, when the window or the file is closed."""
        queue.listening = False
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
            self._timer = None


class MEASURED_MATERIALS_OT_tell(bpy.types.Operator):
    """Say something in the status bar, for what is done beside the window"""

    bl_idname = "measured_materials.tell"
    bl_label = "Measured Materials"
    bl_options = {"INTERNAL"}

    words: _WORDS
    kind: _KIND

    def execute(self, _context: bpy.types.Context) -> set[str]:
        """Report it."""
        self.report({self.kind}, self.words)
        return {"FINISHED"}


classes = (MEASURED_MATERIALS_OT_watch_bakes, MEASURED_MATERIALS_OT_tell)
register, unregister = bpy.utils.register_classes_factory(classes)
