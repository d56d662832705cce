"""How the texels of a baked image are stored, and what that does to the values and to memory."""

from __future__ import annotations

import math
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import radiance

HALF_LARGEST = 65504.0


class Storage(StrEnum):
    """Format of a texel: OpenEXR float or half, or Radiance RGBE (4 bytes, shared exponent, values >= 0).

    A str, so that `Storage("half")`, the JSON of a bundle and the choices of a command line agree.
    """

    FLOAT32 = "float32"
    HALF = "half"
    RGBE = "rgbe"

    @property
    def suffix(self) -> str:
        """Of the file, with the dot."""
        return ".hdr" if self is Storage.RGBE else ".exr"

    def file_bytes(self, channels: int) -> int:
        """Bytes per texel in the file before its lossless compression."""
        return {Storage.FLOAT32: 4 * channels, Storage.HALF: 2 * channels, Storage.RGBE: 4}[self]

    def render_bytes(self, channels: int, packed: bool = False) -> int:
        """Bytes per texel that Cycles 4.5 holds while rendering, by its own statistics.

        Cycles pads RGB to RGBA and expands RGBE to float; what is packed into the .blend passes through
        Blender's own RGBA float buffer, whatever the file held.
        """
        if packed:
            return 16
        return (2 if self is Storage.HALF else 4) * (1 if channels == 1 else 4)


# Smallest magnitude that keeps every bit of precision, and the largest that can be stored.
_RANGE = {
    Storage.FLOAT32: (2.0**-126, float(np.finfo(np.float32).max)),
    Storage.HALF: (2.0**-14, HALF_LARGEST),
    Storage.RGBE: (2.0**-106, radiance.LARGEST),
}


def quantize(pixels: NDArray[Any], storage: Storage) -> NDArray[np.float32]:
    """Exactly the float32 values that come back after writing `pixels` in this storage and reading them.

    Parameters
    ----------
    pixels : any shape; RGBE needs 3 channels on the last axis

    Raises ValueError for values that are not finite or overflow the storage, and for negative ones in RGBE.
    """
    storage = Storage(storage)
    largest = _RANGE[storage][1]
    values = np.asarray(pixels)
    if not np.isfinite(values).all():
        raise ValueError("values that are not finite cannot be stored")
    if values.size and max(abs(float(values.min())), abs(float(values.max()))) > largest:
        raise ValueError(f"values above {largest:.6g} overflow {storage}; scale them first")
    with np.errstate(under="ignore"):
        values = values.astype(np.float32)
        if storage is Storage.HALF:
            return values.astype(np.float16).astype(np.float32)
    return radiance.decode(radiance.encode(values)) if storage is Storage.RGBE else values


def scale_for(pixels: NDArray[Any], storage: Storage) -> float:
    """Power of two to multiply by before storing, and to divide by after reading.

    The one nearest to 1 with which nothing overflows and no value falls below the storage's full precision;
    if the values span too much for both, the largest with which nothing overflows. Raises ValueError for
    values that are not finite.
    """
    storage = Storage(storage)
    magnitude = np.abs(np.asarray(pixels, np.float64))
    if not np.isfinite(magnitude).all():
        raise ValueError("values that are not finite cannot be stored")
    if storage is Storage.RGBE:
        magnitude = magnitude.max(axis=-1)  # the channels share the exponent of the largest
    magnitude = magnitude[magnitude > 0]
    if not magnitude.size:
        return 1.0
    smallest_kept, largest_kept = _RANGE[storage]
    lowest = math.ceil(math.log2(smallest_kept) - _log2_floor(float(magnitude.min())))
    highest = math.floor(math.log2(largest_kept)) - _log2_floor(float(magnitude.max()))
    if math.ldexp(float(magnitude.max()), highest) > largest_kept:
        highest -= 1
    exponent = min(max(lowest, 0), highest)
    return math.ldexp(1.0, min(max(exponent, -126), 126))  # scale and inverse are float32 numbers


def _log2_floor(value: float) -> int:
    return math.frexp(value)[1] - 1
