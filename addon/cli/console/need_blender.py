"""What sub-commands say where there is no Blender."""

from __future__ import annotations

import importlib

from ....bake.errors import BakeError


def need_blender(command: str) -> None:
    """Raise BakeError where bpy cannot be imported."""
    try:
        importlib.import_module("bpy")
    except ImportError as error:
        remedy = (
            f"run it inside Blender: blender --background --command measured_materials {command} ..., "
            "or install the bpy module"
        )
        raise BakeError(command, "needs Blender", remedy) from error
