"""Operator: depth of field that nobody sees, whose lens gives measured materials even numbers."""

from __future__ import annotations

import bpy

from ...bake.errors import BakeError
from ...nodes.lens_group import LENS_KEY
from ..lights.moving_camera import camera_moves, follow_cameras
from ..rendering.quiet_camera import quiet_camera
from ..scene_check.findings import measured_trees, subject_of
from ..summary.text import one_line


class MEASURED_MATERIALS_OT_quiet_camera(bpy.types.Operator):
    """Turn depth of field on at f/64 or beyond, where nobody sees it, for measured materials to draw from its lens"""

    bl_idname = "measured_materials.quiet_camera"
    bl_label = "Quiet Camera"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Whether there is a camera, and Cycles looks through it."""
        if context.scene.camera is None or context.scene.render.engine != "CYCLES":
            cls.poll_message_set("Needs a camera, and Cycles as the scene's render engine")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Set the camera up, and say what was done."""
        subject = subject_of(context.scene)
        try:
            told = quiet_camera(context.scene, subject.shown)
        except BakeError as error:
            self.report({"ERROR"}, one_line(str(error)))
            return {"CANCELLED"}
        follow_cameras()
        if camera_moves(context.scene):
            told += "; while the camera moves under motion blur, measured materials do not use it"
        older = [m for m in subject.mirrors if not any(LENS_KEY in tree for tree in measured_trees(m))]
        if older:
            told += f"; {len(older)} materials were built before, and use it after Fit to Scene"
        self.report({"INFO"}, one_line(told[:1].upper() + told[1:]))
        return {"FINISHED"}


classes = (MEASURED_MATERIALS_OT_quiet_camera,)
register, unregister = bpy.utils.register_classes_factory(classes)
