"""What the window points at: the material that is shown, the object under the mouse."""

from __future__ import annotations

import bpy
from bpy_extras import view3d_utils

from ..material.facts import is_measured


def shown_material(context: bpy.types.Context) -> bpy.types.Material | None:
    """The material of the properties editor, else of the active object."""
    material = getattr(context, "material", None)
    if material is None and context.object is not None:
        material = context.object.active_material
    return material


class ForMeasured:
    """Mixed into a panel that is of measured materials only."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Whether such a material is shown."""
        return is_measured(shown_material(context))


class OfMeasured:
    """Mixed into an operator that changes the measured material that is shown."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Whether there is one that can be changed."""
        material = shown_material(context)
        if not is_measured(material):
            cls.poll_message_set("There is no measured material here; import a measurement first")
            return False
        if not material.is_editable:
            cls.poll_message_set(f"{material.name} is linked from another .blend file")
            return False
        return True


def object_under(context: bpy.types.Context, event: bpy.types.Event) -> bpy.types.Object | None:
    """Object under the mouse in a viewport, where files are dropped."""
    region, view = context.region, context.region_data
    if region is None or view is None or context.area is None or context.area.type != "VIEW_3D":
        return None
    mouse = (event.mouse_region_x, event.mouse_region_y)
    origin = view3d_utils.region_2d_to_origin_3d(region, view, mouse)
    direction = view3d_utils.region_2d_to_vector_3d(region, view, mouse)
    hit = context.scene.ray_cast(context.evaluated_depsgraph_get(), origin, direction)
    return hit[4].original if hit[0] and hit[4] else None
