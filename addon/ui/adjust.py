"""Operators that change a measured material without a bake: relief before its normal, how a swatch lies."""

# No postponed annotations here: Blender reads the properties from them.
from collections.abc import Callable

import bpy

from ...bake.errors import BakeError
from ..material.adjust.energy import energy_of
from ..material.adjust.relief import add_bump, add_normal_map
from ..material.adjust.swatch import WIDTH_KEY, lay_out, random_tiling_node, set_random_tiling
from ..material.facts import is_measured
from ..material.kinds import SHADING_MAP, kind_of
from ..summary.text import one_line
from .context import shown_material

_USUAL_WIDTH = 0.1


class _OfMaterial:
    """Mixed into an operator on the material that is shown."""

    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Whether it is a measured material that can be changed."""
        material = shown_material(context)
        return is_measured(material) and material.is_editable

    def _done(self, action: Callable[[], str]) -> set[str]:
        """Do it and say what was done, or why not."""
        try:
            self.report({"INFO"}, action())  # type: ignore[attr-defined]
        except BakeError as error:
            self.report({"ERROR"}, one_line(f"{error.cause}; {error.remedy}"))  # type: ignore[attr-defined]
            return {"CANCELLED"}
        return {"FINISHED"}


class MEASURED_MATERIALS_OT_add_bump(_OfMaterial, bpy.types.Operator):
    """Let a texture of heights shape the surface: puts a Bump node before the material's normal"""

    bl_idname = "measured_materials.add_bump"
    bl_label = "Add Bump"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Put the node there."""
        material = shown_material(context)
        return self._done(lambda: f"Added {add_bump(material).name}; link a texture to its Height")


class MEASURED_MATERIALS_OT_add_normal_map(_OfMaterial, bpy.types.Operator):
    """Let a texture of normals shape the surface: puts a Normal Map node before the material's normal"""

    bl_idname = "measured_materials.add_normal_map"
    bl_label = "Add Normal Map"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Put the node there."""
        material = shown_material(context)
        return self._done(lambda: f"Added {add_normal_map(material).name}; link a Non-Color texture to its Color")


class MEASURED_MATERIALS_OT_safe_brightness(_OfMaterial, bpy.types.Operator):
    """Lower the brightness until no more light leaves the material than arrives"""

    bl_idname = "measured_materials.safe_brightness"
    bl_label = "Lower Brightness"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Lower it."""
        energy = energy_of(shown_material(context))
        if energy is None or energy.mend is None:
            self.report({"INFO"}, "There is nothing to lower")
            return {"CANCELLED"}
        energy.mend()
        self.report({"INFO"}, f"Brightness is {energy.safe_brightness:.4g}")
        return {"FINISHED"}


class _OfSwatch(_OfMaterial):
    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Whether it is one of photographs."""
        return super().poll(context) and kind_of(shown_material(context)) is SHADING_MAP


class MEASURED_MATERIALS_OT_lay_out(_OfSwatch, bpy.types.Operator):
    """Size the swatch as it is in truth: scales it by the active object's UV map and size"""

    bl_idname = "measured_materials.lay_out"
    bl_label = "Set Physical Size"

    width: bpy.props.FloatProperty(  # type: ignore[valid-type]
        name="Swatch Width",
        description="Of the photographed piece",
        default=_USUAL_WIDTH,
        min=1e-4,
        soft_max=10.0,
        unit="LENGTH",
        precision=4,
    )

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Ask for the width, by default the one that was stated last."""
        unit = context.scene.unit_settings.scale_length
        self.width = shown_material(context).get(WIDTH_KEY, _USUAL_WIDTH) / unit
        return context.window_manager.invoke_props_dialog(self)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Scale it."""
        material, obj, unit = shown_material(context), context.object, context.scene.unit_settings.scale_length

        def sized() -> str:
            if obj is None or material.name not in obj.material_slots:
                raise BakeError(material.name, "the active object does not wear it", "select one that does")
            times = lay_out(material, obj, self.width * unit, unit)
            return f"The swatch repeats {times:.3g} times across the UV map of {obj.name}"

        return self._done(sized)


class MEASURED_MATERIALS_OT_random_tiling(_OfSwatch, bpy.types.Operator):
    """Hide that the swatch repeats: shows patches of it in random places, blended at their borders and never turned"""

    bl_idname = "measured_materials.random_tiling"
    bl_label = "Random Tiling"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Switch it on or off."""
        material = shown_material(context)
        on = random_tiling_node(material) is None

        def switched() -> str:
            set_random_tiling(material, on)
            return "The swatch is laid out at random" if on else "The swatch repeats"

        return self._done(switched)


classes = (
    MEASURED_MATERIALS_OT_add_bump,
    MEASURED_MATERIALS_OT_add_normal_map,
    MEASURED_MATERIALS_OT_safe_brightness,
    MEASURED_MATERIALS_OT_lay_out,
    MEASURED_MATERIALS_OT_random_tiling,
)
register, unregister = bpy.utils.register_classes_factory(classes)
