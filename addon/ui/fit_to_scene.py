"""Operators: fit every measured material to the scene that it is in, and denoise by what the materials know."""

from __future__ import annotations

import bpy

from ...bake.errors import BakeError
from ...nodes.feature_passes import denoise_by_features, drop_feature_passes, stop_denoising
from ..lights import light_tables, world_survey
from ..material.facts import is_measured
from ..material.kinds import kind_of
from ..material.together import built_together
from ..summary.text import one_line


class MEASURED_MATERIALS_OT_fit_to_scene(bpy.types.Operator):
    """Rebuild this scene's measured materials with what its lamps, world and camera call for, and no more"""

    bl_idname = "measured_materials.fit_to_scene"
    bl_label = "Fit to Scene"
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Whether there is anything to fit."""
        if not any(is_measured(material) for material in bpy.data.materials):
            cls.poll_message_set("There is no measured material in this file")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Rebuild; a material that cannot be rebuilt is reported and does not stop the others."""
        learn_the_world(context.scene)
        fitted = 0
        with built_together():
            for material in materials_in(context.scene):
                try:
                    kind_of(material).refit(material, context.scene)
                    fitted += 1
                except BakeError as error:
                    self.report({"WARNING"}, one_line(f"{material.name}: {error.cause}; {error.remedy}"))
        self.report({"INFO"}, f"{fitted} material{'' if fitted == 1 else 's'} fitted to {context.scene.name}")
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


def learn_the_world(scene: bpy.types.Scene) -> None:
    """Look at a world whose nodes do not say what it shows, such as a sky texture, by rendering it small."""
    if "measure the world" in world_survey.world_light(scene.world).why_not:
        world_survey.measure_world(scene)
    light_tables.update_scene(scene)


def materials_in(scene: bpy.types.Scene) -> list[bpy.types.Material]:
    """Measured materials of a scene's objects that can be changed, each once."""
    found = {slot.material: None for obj in scene.objects for slot in obj.material_slots if slot.material}
    return [material for material in found if is_measured(material) and material.is_editable]


classes = (MEASURED_MATERIALS_OT_fit_to_scene, MEASURED_MATERIALS_OT_denoise)
register, unregister = bpy.utils.register_classes_factory(classes)
