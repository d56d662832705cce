"""glTF of measured materials, by what Blender's exporter asks of extensions while it writes a file.

The exporter follows the material's active output alone. While it runs that is the one of `nodes.exported_look`; before
and after it is the one that the engine shows, to which Blender's own operators link a node that is looked at. Blender
does not tell of an export that fails: then the former output is active again when a file is saved or loaded, or with
the next export. Materials of a linked library are treated alike, in memory.
"""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.handlers import persistent

from ...nodes.exported_look import exported_closure, exported_output
from ..events import listen, stop_listening

# On a material's tree while it is exported: name of the output that was active before, "" for none.
_BEFORE = "measured_materials_active_output"


def begin() -> None:
    """Make the outputs active that exporters are to see."""
    end()  # of one that failed
    for material in bpy.data.materials:
        tree = material.node_tree
        output = None if tree is None else exported_output(tree)
        if output is None or output.is_active_output:
            continue
        active = next((n for n in tree.nodes if n.bl_idname == output.bl_idname and n.is_active_output), None)
        tree[_BEFORE] = "" if active is None else active.name
        output.is_active_output = True


def end() -> None:
    """Make active again what was."""
    for material in bpy.data.materials:
        tree = material.node_tree
        if tree is None or _BEFORE not in tree:
            continue
        if (output := tree.nodes.get(tree.pop(_BEFORE))) is not None:
            output.is_active_output = True


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


@persistent
def _of_a_failed_one(*_: Any) -> None:
    end()


_HANDLERS = {"save_pre": _of_a_failed_one, "load_post": _of_a_failed_one}


def register() -> None:
    """Called by `addon.register`."""
    listen(_HANDLERS)


def unregister() -> None:
    """Called by `addon.unregister`."""
    stop_listening(_HANDLERS)
