"""Where panels stand: each in the material properties and in the shader editor's sidebar."""

from __future__ import annotations

from typing import Any

import bpy

TITLE = "Measured Materials"
_PREFIX = "MEASURED_MATERIALS_PT"


class _InShaderEditor:
    """Polls for shader nodes of objects, then as the panel itself does."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Whether this is such an editor."""
        space: Any = context.space_data
        if space.tree_type != "ShaderNodeTree" or space.shader_type != "OBJECT":
            return False
        above = getattr(super(), "poll", None)
        return above is None or bool(above(context))


def in_both_places(panel: type, name: str = "", *, within: bool = True, on_top: bool = False) -> tuple[type, type]:
    """Classes to register for a panel, one for each place.

    Parameters
    ----------
    panel : with `draw`, `bl_label` and, where it is not for every material, `poll`
    name : ends the classes' names; none for the panel that the others stand in
    within : stands in that panel
    on_top : comes before Blender's own in the material properties, where that needs a panel without a heading; it
        heeds no negative `bl_order`
    """
    found = []
    for place, own in _PLACES.items():
        outer = f"{_PREFIX}_{place}"
        title = f"{outer}_{name}" if name else outer
        parent = {"bl_parent_id": outer} if within and name else {}
        heading = {"bl_options": {"HIDE_HEADER"}} if on_top and place == "material" else {}
        bases = (_InShaderEditor, panel, bpy.types.Panel) if place == "shader" else (panel, bpy.types.Panel)
        found.append(type(title, bases, {"__doc__": panel.__doc__, **own, **parent, **heading}))
    return found[0], found[1]


_PLACES: dict[str, dict[str, str]] = {
    "material": {"bl_space_type": "PROPERTIES", "bl_region_type": "WINDOW", "bl_context": "material"},
    "shader": {"bl_space_type": "NODE_EDITOR", "bl_region_type": "UI", "bl_category": TITLE},
}
