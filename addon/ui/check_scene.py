"""Operators and panel of the scene check: what biases or slows measured materials, fixed all at once or one by one."""

# No postponed annotations here: Blender reads the properties from them.
from collections import Counter
from dataclasses import dataclass
from typing import Any

import bpy

from ..scene_check.check import check_scene, mend, mend_scene
from ..scene_check.file_rules import not_whole, with_missing_parts
from ..scene_check.findings import NOTE, SLOW, WRONG, Finding
from ..summary.text import one_line
from .context import ForMeasured
from .quiet_camera import MEASURED_MATERIALS_OT_quiet_camera

_ICONS = {WRONG: "ERROR", SLOW: "TIME", NOTE: "INFO"}
_KEY = bpy.props.StringProperty(options={"HIDDEN", "SKIP_SAVE"})


@dataclass
class _Shown:
    """The last check, in words: datablocks may be gone by the next redraw."""

    scene: str = ""
    rows: tuple[tuple[str, str, str, str, bool], ...] = ()  # key, severity, setting, why, whether it can be fixed
    measured: bool = False


_shown = _Shown()


def _show(scene: bpy.types.Scene, found: list[Finding] | None) -> None:
    _shown.scene, _shown.measured = scene.name, found is not None
    _shown.rows = tuple((f.key, f.severity, f.setting, f.why, f.mend is not None) for f in found or ())


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
        found = with_missing_parts(check_scene(context.scene))
        _show(context.scene, found)
        if not found:
            self.report({"INFO"}, summary(found))
            return {"FINISHED"}
        if not any(finding.mend and finding.severity != NOTE for finding in found):
            return context.window_manager.invoke_popup(self, width=640)
        self.mend = True  # by the dialog's button
        return context.window_manager.invoke_props_dialog(self, width=640, title=summary(found), confirm_text="Fix All")

    def draw(self, _context: bpy.types.Context) -> None:
        """The list."""
        draw_findings(self.layout)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Check, and fix what is found if asked to."""
        mended = mend_scene(context.scene) if self.mend else []
        found = with_missing_parts(check_scene(context.scene))
        _show(context.scene, found)
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
        _show(context.scene, with_missing_parts(check_scene(context.scene)))
        if not mended:
            self.report({"INFO"}, "There is nothing left to fix here")
            return {"CANCELLED"}
        self.report({"INFO"}, one_line(mended[0].mended_line.capitalize()))
        return {"FINISHED"}


def draw_findings(layout: bpy.types.UILayout) -> None:
    """The last check: a row for each finding, its reason below it."""
    for key, severity, setting, why, mendable in _shown.rows:
        row = layout.row()
        words = row.column(align=True)
        words.label(text=setting, icon=_ICONS[severity])
        reason = words.row()
        reason.active = False
        reason.label(text=why, icon="BLANK1")
        if mendable:
            row.operator(MEASURED_MATERIALS_OT_mend_setting.bl_idname).key = key


class _CheckPanel(ForMeasured):
    """The list of the last check."""

    bl_label = "Scene Check"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self: Any, context: bpy.types.Context) -> None:
        """Button, then the list as far as it is this scene's."""
        row = self.layout.row(align=True)
        row.operator(MEASURED_MATERIALS_OT_check_scene.bl_idname, icon="VIEWZOOM")
        row.operator(MEASURED_MATERIALS_OT_quiet_camera.bl_idname, icon="CAMERA_DATA")
        if _shown.scene == context.scene.name:
            if _shown.measured and not _shown.rows:
                self.layout.label(text=summary([]), icon="CHECKMARK")
            draw_findings(self.layout)


class MEASURED_MATERIALS_PT_material_check(_CheckPanel, bpy.types.Panel):
    """Scene check in the material properties."""

    bl_space_type, bl_region_type, bl_context = "PROPERTIES", "WINDOW", "material"
    bl_parent_id = "MEASURED_MATERIALS_PT_material"


class MEASURED_MATERIALS_PT_shader_check(_CheckPanel, bpy.types.Panel):
    """Scene check in the shader editor's sidebar."""

    bl_space_type, bl_region_type, bl_category = "NODE_EDITOR", "UI", "Measured Materials"
    bl_parent_id = "MEASURED_MATERIALS_PT_shader"


classes = (
    MEASURED_MATERIALS_OT_mend_setting,
    MEASURED_MATERIALS_OT_check_scene,
    MEASURED_MATERIALS_PT_material_check,
    MEASURED_MATERIALS_PT_shader_check,
)
register, unregister = bpy.utils.register_classes_factory(classes)
