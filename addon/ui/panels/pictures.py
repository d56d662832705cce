"""The picture of a material: its bundle's, read when a panel first shows it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import bpy.utils.previews

from ....bake.bundle.bundle import PREVIEW
from ...material.textures.kept import bundle_path

_pictures: Any = None


def picture_of(material: bpy.types.Material) -> int:
    """Number of an icon: the bundle's picture, or Blender's own of the material where the bundle is gone.

    None is drawn without a window: the wheel 4.5 ends in a fault of memory after such icons were made.
    """
    if bpy.app.background:
        return 0
    file = bundle_path(material) / PREVIEW
    found = _known(file) if _pictures is not None else 0
    return found or int(bpy.types.UILayout.icon(material))


def _known(file: Path) -> int:
    """0 where there is no such file. A bundle that was baked again has another picture."""
    try:
        key = f"{file} {file.stat().st_mtime_ns}"
    except OSError:
        return 0
    if key not in _pictures:
        _pictures.load(key, str(file), "IMAGE")
    return int(_pictures[key].icon_id)


def register() -> None:
    """Make room for pictures."""
    global _pictures
    _pictures = bpy.utils.previews.new()


def unregister() -> None:
    """Forget them."""
    global _pictures
    bpy.utils.previews.remove(_pictures)
    _pictures = None
