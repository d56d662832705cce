"""Operators and panel of the scene check: what biases or slows measured materials, fixed all at once or one by one."""

# No postponed annotations here: Blender reads the properties from them.
from typing import Any

import bpy

from ...scene_check.check import check_scene, mend, mend_scene
from ...scene_check.findings import NOTE, SLOW, WRONG
from ...summary.text import capital, one_line
from ..context import ForMeasured
from ..quiet_camera import MEASURED_MATERIALS_OT_quiet_camera
from .live_check import check_now, follows, is_current, shown, summary
from .places import in_both_places
from .wrapped_text import Lines

_ICONS = {WRONG: "ERROR", SLOW: "TIME", NOTE: "INFO"}
_KEY = bpy.props.StringProperty(options={"HIDDEN", "SKIP_SAVE"})
# Pixels at a UI scale of 1: a dialog, and a button with one short word.
_DIALOG, _BUTTON = 640, 48


class MEASURED_MATERIALS_OT_check_scene(bpy.types.Operator):
    """List every setting of the scene that biases or slows measured materials"""

    bl_idname = "measured_materials.check_scene"
    bl_label = "Check Scene"
    bl_options = {"REGISTER", "UNDO"}

    mend: bpy.props.BoolProperty(
        name="Fix", description="Fix everything that is found except notes", options={"SKIP_SAVE"}
    )  # type: ignore[valid-type]

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Show the list, with a button that fixes all of it."""
        if self.mend:
            return self.execute(context)
        found = check_now(context.scene)
        if not found:
            self.report({"INFO"}, summary(found))
            return {"FINISHED"}
        if not any(finding.mend and finding.severity != NOTE for finding in found):
            return context.window_manager.invoke_popup(self, width=_DIALOG)
        self.mend = True  # by the dialog's button
        return context.window_manager.invoke_props_dialog(
            self, width=_DIALOG, title=summary(found), confirm_text="Fix All"
        )

    def draw(self, context: bpy.types.Context) -> None:
        """The list."""
        draw_findings(self.layout, Lines(context, _DIALOG))

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Check, and fix what is found if asked to."""
        mended = mend_scene(context.scene) if self.mend else []
        found = check_now(context.scene)
        done = f"{len(mended)} fixed. " if mended else ""
        wrong = any(finding.severity == WRONG for finding in found or ())
        self.report({"WARNING" if wrong else "INFO"}, done + summary(found))
        return {"FINISHED"}


class MEASURED_MATERIALS_OT_mend_setting(bpy.types.Operator):
    """Fix this setting"""

    bl_idname = "measured_materials.mend_setting"
    bl_label = "Fix"
    bl_options = {"REGISTER", "UNDO"}

    key: _KEY

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Look again, since it may have been fixed by now."""
        mended = mend(finding for finding in check_scene(context.scene) or () if finding.key == self.key)
        check_now(context.scene)
        if not mended:
            self.report({"INFO"}, "There is nothing left to fix here")
            return {"CANCELLED"}
        self.report({"INFO"}, capital(one_line(mended[0].mended_line)))
        return {"FINISHED"}


def draw_status(layout: Any, context: bpy.types.Context, lines: Lines) -> None:
    """One line on what the scene does to measured materials, with a button that fixes it."""
    current = is_current(context.scene)
    if shown.scene != context.scene.name or not (current or follows(context.scene)):
        words = "Check Scene" if shown.scene != context.scene.name else "Scene Changed: Check Again"
        layout.operator(MEASURED_MATERIALS_OT_check_scene.bl_idname, text=words, icon="VIEWZOOM")
        # What was found is likely to hold still, and Fix looks again by itself.
        if shown.scene != context.scene.name or not shown.harmful:
            return
    if shown.rows is None:
        lines.draw(layout, "No object that is rendered wears it", "INFO")
        return
    if not shown.harmful:
        lines.draw(layout, "The scene suits this material", "CHECKMARK")
        return
    many = shown.harmful > 1
    words = f"{shown.harmful} scene setting{'s' if many else ''} spoil{'' if many else 's'} measured materials"
    column = layout.column(align=True)
    lines.draw(column, words, "ERROR")
    if shown.fixable:
        column.operator(MEASURED_MATERIALS_OT_check_scene.bl_idname, text="Fix").mend = True


def draw_findings(layout: Any, lines: Lines) -> None:
    """The last check: a row for each finding, its reason below it."""
    part = max(1 - _BUTTON / max(lines.width, 1), 0.5)
    for row in shown.rows or ():
        whole = layout.column(align=True)
        place = whole.split(factor=part) if row.mendable else whole.row()
        room = part if row.mendable else 1.0
        lines.draw(place.column(align=True), capital(row.setting), _ICONS[row.severity], part=room)
        if row.mendable:
            place.operator(MEASURED_MATERIALS_OT_mend_setting.bl_idname).key = row.key
        lines.draw(whole, capital(row.why), "BLANK1", faint=True)
        layout.separator()


class _CheckPanel(ForMeasured):
    """What the scene check finds."""

    bl_label = "Scene Check"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self: Any, context: bpy.types.Context) -> None:
        """Buttons, then the list as far as it is this scene's."""
        lines, column = Lines(context), self.layout.column(align=True)
        column.operator(MEASURED_MATERIALS_OT_check_scene.bl_idname, icon="VIEWZOOM")
        column.operator(MEASURED_MATERIALS_OT_quiet_camera.bl_idname, icon="CAMERA_DATA")
        is_current(context.scene)
        if shown.scene == context.scene.name:
            if shown.rows == ():
                lines.draw(self.layout, summary([]), "CHECKMARK")
            draw_findings(self.layout, lines)


classes = (
    MEASURED_MATERIALS_OT_mend_setting,
    MEASURED_MATERIALS_OT_check_scene,
    *in_both_places(_CheckPanel, "check"),
)
register, unregister = bpy.utils.register_classes_factory(classes)
