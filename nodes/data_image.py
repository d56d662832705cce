"""Images whose numbers reach the shader as they are in the file."""

from __future__ import annotations

import contextlib
from pathlib import Path

import bpy

from ..bake.errors import BakeError


def load_data_image(path: Path, name: str, *, half: bool = False, pack: bool = False) -> bpy.types.Image:
    """An image whose numbers reach the shader as they are in the file; `half` where they are half floats there."""
    try:
        image = bpy.data.images.load(str(path), check_existing=False)
    except RuntimeError as error:
        raise BakeError(path, "cannot be loaded by Blender", "bake it again") from error
    image.name = name
    if bpy.data.filepath and not pack:
        # Beside a saved .blend, so that the two can move together; on another drive there is no relative path.
        with contextlib.suppress(ValueError):
            image.filepath = bpy.path.relpath(str(path))
    image.colorspace_settings.name = "Non-Color"
    # RGBA data would otherwise be divided by alpha, and float32 cut to half when it goes to the device.
    image.alpha_mode = "CHANNEL_PACKED"
    image.use_half_precision = half
    if pack:
        image.pack()
    return image
