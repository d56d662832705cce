"""Photographs read by Blender itself, where its Python has no OpenImageIO, as in some distributions' builds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ...bake.errors import BakeError
from ...bake.photographs.photograph import MAX_PIXELS, Photograph
from .image_headers import Header, read_photo_header

_ENCODED = {8: (np.uint8, 255), 16: (np.uint16, 65535)}


def decode(path: Path) -> Photograph:
    """A JPEG, PNG or TIFF file as `bake.photographs.photograph.Decoder` needs it: codes as stored. Raises BakeError.

    The header is checked before Blender, which takes memory for any size, sees the file.
    """
    header = read_photo_header(path)
    info = header.info
    if info.width < 1 or info.height < 1:
        raise BakeError(path, f"declares {info.width} x {info.height} pixels", "export it again")
    if info.width * info.height > MAX_PIXELS:
        cause = f"declares {info.width} x {info.height} pixels, more than {MAX_PIXELS / 1e6:g} megapixels"
        raise BakeError(path, cause, "use a smaller photograph")
    if not info.is_float and header.bits not in _ENCODED:
        raise BakeError(path, f"has {header.bits} bits per channel", "export it with 8 or 16 bits or as floating point")
    return Photograph(info, _codes(_pixels(path, header), header))


def _codes(values: NDArray[np.float32], header: Header) -> NDArray[Any]:
    values = values[..., : 3 if header.info.channels >= 3 else 1]
    if header.info.is_float:
        return np.ascontiguousarray(values)
    kind, levels = _ENCODED[header.bits]
    return np.rint(np.clip(values, 0, 1) * np.float32(levels)).astype(kind)


def _pixels(path: Path, header: Header) -> NDArray[np.float32]:
    """(H, W, channels) as Blender holds them, row 0 at the top, without colour management."""
    try:
        image = bpy.data.images.load(str(path), check_existing=False)
    except RuntimeError as error:
        raise BakeError(path, "cannot be read by Blender", "export it again") from error
    try:
        image.colorspace_settings.name = "Non-Color"
        image.alpha_mode = "CHANNEL_PACKED"  # else 16-bit colours come multiplied by alpha
        width, height = image.size
        if (width, height) != (header.info.width, header.info.height):
            raise BakeError(path, "is damaged or cut short", "copy it again from the camera")
        values = np.empty(width * height * image.channels, np.float32)
        image.pixels.foreach_get(values)
    finally:
        bpy.data.images.remove(image)
    return values.reshape(height, width, -1)[::-1]
