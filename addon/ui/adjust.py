"""Operators that change a measured material without a bake: relief before its normal, how a swatch lies."""

# No postponed annotations here: Blender reads the properties from them.
from collections.abc import Callable
from pathlib import Path

import bpy

from ...bake.errors import BakeError
from ...bake.maps.folder import read_maps_folder
from ..material.adjust.blend import blend_with, partners_of, remove_blend
from ..material.adjust.energy import energy_of
from ..material.adjust.parallax import add_parallax, keeps_textures, parallax_node, remove_parallax
from ..material.adjust.relief import add_bump, add_normal_map
from ..material.adjust.swatch import WIDTH_KEY, lay_out, random_tiling_node, set_random_tiling
from ..material.facts import record_of
from ..material.kinds import SHADING_MAP, kind_of
from ..summary.text import one_line
from .context import OfMeasured, shown_material

_USUAL_WIDTH = 0.1


class _OfMaterial(OfMeasured):
    """Mixed into an operator on the material that is shown."""

    bl_options = {"REGISTER", "UNDO"}

    def _done(self, action: Callable[[], str], of_file: bool = False) -> set[str]:
        """Do it and say what was done, or why not; errors `of_file` name it."""
        try:
            self.report({"INFO"}, action())  # type: ignore[attr-defined]
        except BakeError as error:
            self.report({"ERROR"}, one_line(str(error) if of_file else f"{error.cause}; {error.remedy}"))  # type: ignore[attr-defined]
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


class MEASURED_MATERIALS_OT_parallax(_OfSwatch, bpy.types.Operator):
    """Show the swatch's relief where an oblique view sees it, by the heights of a folder of maps; or flat again"""

    bl_idname = "measured_materials.parallax"
    bl_label = "Parallax"

    directory: bpy.props.StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})  # type: ignore[valid-type]

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Ask for the folder, where it is to be switched on."""
        if parallax_node(shown_material(context)) is not None:
            return self.execute(context)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Switch it on or off."""
        material = shown_material(context)

        def switched() -> str:
            if parallax_node(material) is not None:
                remove_parallax(material)
                return "Parallax is off"
            maps, pack = read_maps_folder(Path(bpy.path.abspath(self.directory))), keeps_textures(material)
            add_parallax(material, record_of(material), maps, pack=pack)
            return "Parallax is on"

        return self._done(switched, of_file=True)


def _partners(_self: object, context: bpy.types.Context | None) -> list[tuple[str, str, str]]:
    """Materials to choose from; Blender needs the words to stay where they are."""
    global _listed
    material = shown_material(context) if context is not None else None
    names = [other.name for other in partners_of(material)] if material is not None else []
    _listed = [(name, name, "") for name in names] or [("", "No other measured material", "")]
    return _listed


_listed: list[tuple[str, str, str]] = []


class MEASURED_MATERIALS_OT_blend(_OfMaterial, bpy.types.Operator):
    """Blend with another measured material by a mask: 0 shows this one, 1 the other"""

    bl_idname = "measured_materials.blend"
    bl_label = "Blend With"
    bl_property = "second"

    second: bpy.props.EnumProperty(name="Material", items=_partners)  # type: ignore[valid-type]

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Ask which."""
        context.window_manager.invoke_search_popup(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Blend them."""
        material, second = shown_material(context), bpy.data.materials.get(self.second)

        def blended() -> str:
            if second is None:
                raise BakeError(material.name, "there is no other measured material", "import one first")
            blend_with(material, second)
            return f"Blended with {second.name}; link a texture to the Mask"

        return self._done(blended)


class MEASURED_MATERIALS_OT_remove_blend(_OfMaterial, bpy.types.Operator):
    """Show this material alone again"""

    bl_idname = "measured_materials.remove_blend"
    bl_label = "Remove Blend"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Take the second material out."""
        remove_blend(shown_material(context))
        return {"FINISHED"}


classes = (
    MEASURED_MATERIALS_OT_blend,
    MEASURED_MATERIALS_OT_remove_blend,
    MEASURED_MATERIALS_OT_add_bump,
    MEASURED_MATERIALS_OT_add_normal_map,
    MEASURED_MATERIALS_OT_safe_brightness,
    MEASURED_MATERIALS_OT_lay_out,
    MEASURED_MATERIALS_OT_random_tiling,
    MEASURED_MATERIALS_OT_parallax,
)
register, unregister = bpy.utils.register_classes_factory(classes)
