"""Operators: fit every measured material to the scene that it is in, shade by OSL, and denoise by what the materials
know."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Generator
from typing import Any

import bpy

from ...bake.errors import BakeError
from ...nodes.feature_passes import denoise_by_features, drop_feature_passes, stop_denoising
from ...nodes.osl_script import is_one_script, is_scripted, require_osl, use_osl
from ...nodes.portions import Pause, Portions
from ..lights import light_tables, world_survey
from ..material.choices import NODES, OSL
from ..material.facts import is_measured
from ..material.kinds import kind_of
from ..material.together import built_together
from ..scene_check.check import check_scene, mend
from ..summary.text import one_line
from .background.window import push_for_script


class MEASURED_MATERIALS_OT_fit_to_scene(bpy.types.Operator):
    """Rebuild this scene's measured materials with what its lamps, world and camera call for, and no more"""

    bl_idname = "measured_materials.fit_to_scene"
    bl_label = "Fit to Scene"
    bl_options = {"UNDO"}

    _steps: Generator[tuple[int, str], None, None]
    _timer: Any = None
    _fitted = 0

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Whether there is anything to fit."""
        if not any(is_measured(material) for material in bpy.data.materials):
            cls.poll_message_set("There is no measured material in this file")
            return False
        return True

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Rebuild one after the other, while Blender goes on drawing."""
        if bpy.app.background:
            return self.execute(context)
        learn_the_world(context.scene)
        self._steps = _rebuilding(self, context.scene)
        self._timer = context.window_manager.event_timer_add(0.01, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """One material; Esc leaves what was not reached as it is. All else waits, or undo would come between."""
        if event.type == "ESC" and event.value == "PRESS":
            return self._end(context, "Stopped: ")
        if event.type != "TIMER":
            return {"RUNNING_MODAL"}
        try:
            self._fitted, words = next(self._steps)
        except StopIteration:
            return self._end(context)
        context.workspace.status_text_set(f"Fitting to {context.scene.name}: {words}   |   Esc: Stop")
        return {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Called by Blender when the window or the file is closed."""
        self._steps.close()
        context.window_manager.event_timer_remove(self._timer)

    def _end(self, context: bpy.types.Context, stopped: str = "") -> set[str]:
        self.cancel(context)
        context.workspace.status_text_set(None)
        self.report({"INFO"}, f"{stopped}{_counted(self._fitted)} fitted to {context.scene.name}")
        return {"FINISHED"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Rebuild; a material that cannot be rebuilt is reported and does not stop the others."""
        scene = context.scene
        learn_the_world(scene)
        fitted = _each(self, materials_in(scene), lambda material: kind_of(material).refit(material, scene))
        self.report({"INFO"}, f"{_counted(fitted)} fitted to {scene.name}")
        push_for_script(self)
        return {"FINISHED"}


class MEASURED_MATERIALS_OT_use_osl(bpy.types.Operator):
    """Have this scene's measured materials sample lights themselves by OSL scripts, and render on the CPU"""

    bl_idname = "measured_materials.use_osl"
    bl_label = "Shade by OSL"
    bl_options = {"UNDO"}

    nodes: bpy.props.BoolProperty(name="Nodes", description="Build them of nodes again", options={"SKIP_SAVE"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Whether the engine is Cycles and there is anything to build."""
        return MEASURED_MATERIALS_OT_denoise.poll.__func__(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Rebuild, and set the scene; a material that cannot be rebuilt is reported and does not stop the others."""
        scene, shader = context.scene, NODES if self.nodes else OSL
        if not self.nodes:
            try:
                require_osl()
            except BakeError as error:
                self.report({"ERROR"}, one_line(f"{error.file} {error.cause}; {error.remedy}"))
                return {"CANCELLED"}
            use_osl(scene)
        learn_the_world(scene)
        built: list[bpy.types.Material] = []

        def build(material: bpy.types.Material) -> None:
            kind_of(material).shade_by(material, shader, scene)
            built.append(material)

        _each(self, materials_in(scene), build)
        if self.nodes and not any(is_scripted(material) for material in bpy.data.materials):
            scene.cycles.shading_system = False
        # Whatever is of nodes, where OSL is on: it would read their files at random.
        mend(found for found in check_scene(scene) or () if found.rule == "osl_files")
        self.report({"INFO"}, _built_words(built, self.nodes))
        return {"FINISHED"}


class MEASURED_MATERIALS_OT_denoise(bpy.types.Operator):
    """Denoise in the compositor, by albedo and normals that the measured materials write without noise"""

    bl_idname = "measured_materials.denoise"
    bl_label = "Denoise by Materials"
    bl_options = {"UNDO"}

    stop: bpy.props.BoolProperty(name="Stop", description="Remove the denoising again", options={"SKIP_SAVE"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Whether there is something to fit, as for `Fit to Scene`, and the engine is Cycles, which has these
        passes."""
        if context.scene.render.engine != "CYCLES":
            cls.poll_message_set("Choose Cycles as the scene's render engine first")
            return False
        return MEASURED_MATERIALS_OT_fit_to_scene.poll.__func__(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Set up or take away passes and compositor, and have the materials write the passes or not."""
        if self.stop:
            stop_denoising(context.scene)
            for layer in context.scene.view_layers:
                drop_feature_passes(layer)
        else:
            denoise_by_features(context.scene)
        return bpy.ops.measured_materials.fit_to_scene()


def _each(
    operator: bpy.types.Operator, materials: list[bpy.types.Material], build: Callable[[bpy.types.Material], None]
) -> int:
    """Call `build` with each and return how many it could build; the operator reports the others."""
    built = 0
    with built_together():
        for material in materials:
            try:
                build(material)
                built += 1
            except BakeError as error:
                operator.report({"WARNING"}, one_line(f"{material.name}: {error.cause}; {error.remedy}"))
    return built


def _rebuilding(operator: bpy.types.Operator, scene: bpy.types.Scene) -> Generator[tuple[int, str], None, None]:
    """Fit the scene's materials one by one, each in portions, and give how many are fitted, and words on the next."""
    materials, fitted = materials_in(scene), 0
    for number, material in enumerate(materials):
        words = f"{one_line(material.name)}, {number + 1} of {len(materials)}"
        work = Portions()
        while True:
            yield fitted, words
            with contextlib.suppress(Pause), work.portion():
                fitted += _each(operator, [material], lambda one: kind_of(one).refit(one, scene))
                break
        work.drop()
    yield fitted, ""


def _counted(materials: int) -> str:
    return f"{materials} material{'' if materials == 1 else 's'}"


def _built_words(materials: list[bpy.types.Material], nodes: bool) -> str:
    """What materials were built as: where scripts were asked for, one script each, nodes whose rays are scripts, as of
    a swatch, or nodes alone, as of what has no mirror."""
    if nodes:
        return f"{_counted(len(materials))} built as nodes"
    whole = sum(is_one_script(material) for material in materials)
    rays = sum(is_scripted(material) for material in materials) - whole
    others = len(materials) - whole - rays
    built = [f"{_counted(whole)} built as {'an OSL script' if whole == 1 else 'OSL scripts'}"] * (whole > 0)
    built += [f"{_counted(rays)} built of nodes that ask an OSL script what is seen"] * (rays > 0)
    words = [f"{', '.join(built)}: to be rendered on the CPU"] * bool(built)
    words += [f"{_counted(others)} {'stays' if others == 1 else 'stay'} of nodes"] * (others > 0)
    return "; ".join(words) or f"{_counted(0)} built as OSL scripts"


def learn_the_world(scene: bpy.types.Scene) -> None:
    """Look at a world whose nodes do not say what it shows, such as a sky texture, by rendering it small."""
    if "measure the world" in world_survey.world_light(scene.world).why_not:
        world_survey.measure_world(scene)
    light_tables.update_scene(scene)


def materials_in(scene: bpy.types.Scene) -> list[bpy.types.Material]:
    """Measured materials of a scene's objects that can be changed, each once."""
    found = {slot.material: None for obj in scene.objects for slot in obj.material_slots if slot.material}
    return [material for material in found if is_measured(material) and material.is_editable]


classes = (MEASURED_MATERIALS_OT_fit_to_scene, MEASURED_MATERIALS_OT_use_osl, MEASURED_MATERIALS_OT_denoise)
register, unregister = bpy.utils.register_classes_factory(classes)
