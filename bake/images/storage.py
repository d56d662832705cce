"""How the texels of a baked image are stored, and what that does to the values and to memory."""

from __future__ import annotations

import math
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import radiance_hdr

HALF_LARGEST = 65504.0
BYTE_STEP = np.float32(1 / 255)  # Blender and Cycles multiply bytes by this rather than divide them by 255


class Storage(StrEnum):
    """Format of a texel: OpenEXR float or half, Radiance RGBE (4 bytes, shared exponent, values >= 0), or a PNG's byte.

    A byte holds 256 evenly spaced, linear values from 0 to 1: for data of little range such as the slices of a
    matte swatch, at a quarter of the memory of float32. The dark values of a glossy BRDF would be lost in it. "log" is
    a byte too, of the logarithm of a BRDF table's values: `bake.tables.log_codes` says how they come back.

    A str, so that `Storage("half")`, the JSON of a bundle and the choices of a command line agree.
    """

    FLOAT32 = "float32"
    HALF = "half"
    RGBE = "rgbe"
    BYTE = "byte"
    LOG = "log"

    @property
    def image(self) -> Storage:
        """Format of the image file."""
        return Storage.BYTE if self is Storage.LOG else self

    @property
    def suffix(self) -> str:
        """Suffix of the file, with the dot."""
        return {Storage.RGBE: ".hdr", Storage.BYTE: ".png"}.get(self.image, ".exr")

    def file_bytes(self, channels: int) -> int:
        """Bytes per texel in the file before its lossless compression."""
        return 4 if self is Storage.RGBE else self._sample_bytes * channels

    def render_bytes(self, channels: int, packed: bool = False) -> int:
        """Bytes per texel that Cycles 4.5 holds while rendering, by its own statistics.

        Cycles pads RGB to RGBA and expands RGBE to float; what is packed into the .blend passes through
        Blender's own RGBA buffer, of bytes for a PNG and of floats for everything else.
        """
        if packed:
            return 4 if self.image is Storage.BYTE else 16
        return self._sample_bytes * (1 if channels == 1 else 4)

    @property
    def _sample_bytes(self) -> int:
        return {Storage.HALF: 2, Storage.BYTE: 1}.get(self.image, 4)


IMAGE_STORAGES = tuple(storage for storage in Storage if storage.image is storage)
# 256 even steps do not reach from a shadow to a highlight of 10 000.
TABLE_STORAGES = tuple(str(storage) for storage in Storage if storage is not Storage.BYTE)

# Added to scaled values before they are stored as half floats. Cycles' conversion on the processor knows no denormals:
# a half of 0 comes back as 2^-15, which of a table scaled down by a bright peak was twice the light of all the rest.
HALF_OFFSET = 2.0**-14


def offset_for(storage: Storage) -> float:
    """Offset that is added to scaled values >= 0 in a table of this storage; subtracted after reading."""
    return HALF_OFFSET if Storage(storage) is Storage.HALF else 0.0


# Smallest magnitude that keeps every bit of precision, and the largest that can be stored.
_RANGE = {
    Storage.FLOAT32: (2.0**-126, float(np.finfo(np.float32).max)),
    Storage.HALF: (2.0**-14, HALF_LARGEST),
    Storage.RGBE: (2.0**-106, radiance_hdr.LARGEST),
    Storage.BYTE: (1.0, 1.0),
}


def _range(storage: Storage) -> tuple[float, float]:
    if storage not in _RANGE:
        raise ValueError(f"{storage} is of tables alone, see bake.tables.log_codes")
    return _RANGE[storage]


def quantize(pixels: NDArray[Any], storage: Storage) -> NDArray[np.float32]:
    """Exactly the float32 values that come back after writing `pixels` in this storage and reading them.

    Parameters
    ----------
    pixels : any shape; RGBE needs 3 channels on the last axis

    Raises ValueError for values that are not finite or overflow the storage, and for negative ones in RGBE and bytes.
    """
    storage = Storage(storage)
    largest = _range(storage)[1]
    values = np.asarray(pixels)
    if not np.isfinite(values).all():
        raise ValueError("values that are not finite cannot be stored")
    if values.size and max(abs(float(values.min())), abs(float(values.max()))) > largest:
        raise ValueError(f"values above {largest:.6g} overflow {storage}; scale them first")
    with np.errstate(under="ignore"):
        values = values.astype(np.float32)
        if storage is Storage.HALF:
            return values.astype(np.float16).astype(np.float32)
    if storage is Storage.BYTE:
        return to_bytes(values) * BYTE_STEP
    return radiance_hdr.decode(radiance_hdr.encode(values)) if storage is Storage.RGBE else values


def round_down(values: NDArray[np.float32], storage: Storage, scale: float = 1.0) -> NDArray[np.float32]:
    """The largest values >= 0 that `storage` holds at `scale` and that are not above `values`. RGBE is not for this."""
    inverse = np.float32(1 / scale)
    stored = quantize(values * np.float32(scale), storage)
    if storage is Storage.HALF:
        lower = np.nextafter(stored.astype(np.float16), np.float16(0)).astype(np.float32)
    elif storage is Storage.BYTE:
        lower = np.maximum(stored - np.float32(1 / 255), 0)
    else:
        lower = np.nextafter(stored, np.float32(0))
    return np.where(stored * inverse > values, quantize(lower, storage), stored) * inverse


def raised(values: NDArray[Any], scale: float, storage: Storage) -> NDArray[np.float32]:
    """Values as the file of a table holds them: scaled, and raised by `offset_for`."""
    texels: NDArray[np.float32] = values * np.float32(scale) + np.float32(offset_for(storage))
    return texels


def as_stored(values: NDArray[Any], scale: float, storage: Storage) -> NDArray[np.float32]:
    """The values of a table as they come back from its file, scale and offset undone."""
    back = quantize(raised(values, scale, storage), storage) - np.float32(offset_for(storage))
    return back * np.float32(1 / scale)


def to_bytes(values: NDArray[np.float32]) -> NDArray[np.uint8]:
    """The nearest of the bytes that stand for 0 to 1. Raises ValueError for values outside."""
    if (values < 0).any():
        raise ValueError("byte cannot hold negative values")
    if (values > 1).any():
        raise ValueError("values above 1 overflow byte; scale them first")
    return np.rint(values * np.float32(255)).astype(np.uint8)


def scale_for(pixels: NDArray[Any], storage: Storage) -> float:
    """Float32 number to multiply by before storing, and to divide by after reading.

    A power of two, so that scaling changes no digit: the one nearest to 1 with which nothing overflows and no
    value falls below the storage's full precision; if the values span too much for both, the largest with
    which nothing overflows. Bytes have too few steps to give up to half of them away: there it is the
    number that brings the largest value to 1 (rounded down, so that float32 products never exceed 1). Raises
    ValueError for values that are not finite.
    """
    storage = Storage(storage)
    magnitude = np.abs(np.asarray(pixels, np.float64))
    if not np.isfinite(magnitude).all():
        raise ValueError("values that are not finite cannot be stored")
    if storage is Storage.BYTE:
        return _byte_scale(float(magnitude.max(initial=0)))
    if storage is Storage.RGBE:
        magnitude = magnitude.max(axis=-1)  # the channels share the exponent of the largest
    magnitude = magnitude[magnitude > 0]
    if not magnitude.size:
        return 1.0
    smallest_kept, largest_kept = _range(storage)
    lowest = math.ceil(math.log2(smallest_kept) - _log2_floor(float(magnitude.min())))
    highest = math.floor(math.log2(largest_kept)) - _log2_floor(float(magnitude.max()))
    if math.ldexp(float(magnitude.max()), highest) > largest_kept:
        highest -= 1
    exponent = min(max(lowest, 0), highest)
    return math.ldexp(1.0, min(max(exponent, -126), 126))  # scale and inverse are float32 numbers


def _byte_scale(largest: float) -> float:
    if largest == 0:
        return 1.0
    scale = np.float32(min(max(1 / largest, 2.0**-126), 2.0**126))
    if float(scale) * largest > 1:
        scale = np.nextafter(scale, np.float32(0))
    return float(scale)


def _log2_floor(value: float) -> int:
    return math.frexp(value)[1] - 1
