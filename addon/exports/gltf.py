"""glTF of measured materials, by what Blender's exporter asks of extensions while it writes a file.

The exporter follows the material's active output alone. While it runs that is the one of `nodes.exported_look`; before
and after it is the one that the engine shows, to which Blender's own operators link a node that is looked at.
"""

from __future__ import annotations

from typing import Any

import bpy

from ...nodes.exported_look import exported_closure, exported_output

# Material outputs that were active before, by the materials' session numbers.
_before: dict[int, str] = {}


def begin() -> None:
    """Make the outputs active that exporters are to see."""
    _before.clear()
    for material in bpy.data.materials:
        tree = material.node_tree
        output = None if tree is None else exported_output(tree)
        if output is None or output.is_active_output or not material.is_editable:
            continue
        active = next((n for n in tree.nodes if n.bl_idname == output.bl_idname and n.is_active_output), None)
        _before[material.session_uid] = "" if active is None else active.name
        output.is_active_output = True


def end() -> None:
    """Make active again what was."""
    for material in bpy.data.materials:
        name = _before.pop(material.session_uid, "")
        if name and name in material.node_tree.nodes:
            material.node_tree.nodes[name].is_active_output = True
    _before.clear()


def without_glow(written: Any, material: Any) -> None:
    """Take from glTF's material what it has of Emission nodes: those of a measured group emit what lamps light.

    Parameters
    ----------
    written : the exporter's own material
    material : the Blender material that it stands for
    """
    closure = None if material.node_tree is None else exported_closure(material.node_tree)
    if closure is None:
        return
    strength = closure.inputs["Emission Strength"]
    if strength.is_linked or strength.default_value > 0:
        return
    written.emissive_factor = written.emissive_texture = None
    (written.extensions or {}).pop("KHR_materials_emissive_strength", None)
