"""Slices of a shading map in one image: a column of tiles, each with rows of its own other end above and below.

Across, a tile is as wide as the image, whose own repetition closes the seam; down the column the gutter does. So the
swatch tiles without a seam under any rotation or scale of the texture coordinates. Slice 0 is black and not stored.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import BakeError

# Two rows serve the cubic filter; four also the first mip level that a real-time viewport may use.
GUTTER = 4
MAX_EXTENT = 16384  # of an image that every GPU takes


@dataclass(frozen=True)
class SliceLayout:
    """`tiles` images of `height` x `width` texels, one below the other."""

    tiles: int
    height: int
    width: int

    def __post_init__(self) -> None:
        if max(self.rows, self.width) > MAX_EXTENT:
            cause = f"would be an image of {self.width} x {self.rows}, beyond {MAX_EXTENT}"
            raise BakeError("shading map", cause, "choose a smaller --size or fewer --slices")

    @property
    def pitch(self) -> int:
        """Rows from one tile to the next."""
        return self.height + 2 * GUTTER

    @property
    def rows(self) -> int:
        """Height of the image."""
        return self.tiles * self.pitch


def pack_slices(tiles: NDArray[np.float32]) -> NDArray[np.float32]:
    """(n, H, W, C) to the image, top tile first."""
    SliceLayout(*tiles.shape[:3])
    height = tiles.shape[1]
    rows = np.arange(-GUTTER, height + GUTTER) % height
    return np.ascontiguousarray(tiles[:, rows].reshape(-1, *tiles.shape[2:]))


def unpack_slices(image: NDArray[np.float32], layout: SliceLayout) -> NDArray[np.float32]:
    """The tiles (n, H, W, C) of an image. Raises ValueError where its size is another."""
    if image.shape[:2] != (layout.rows, layout.width):
        raise ValueError(f"an image of {image.shape[1]} x {image.shape[0]}, not {layout.width} x {layout.rows}")
    tiles = image.reshape(layout.tiles, layout.pitch, layout.width, -1)
    return tiles[:, GUTTER : GUTTER + layout.height]


def tile_v(xp: Any, layout: SliceLayout, index: Any, v: Any) -> Any:
    """Image coordinate, upwards in [0, 1], of v in [0, 1] inside a tile."""
    from_top = (index + 1) * layout.pitch - GUTTER - v * layout.height
    return 1 - from_top * (1 / layout.rows)


def level_position(xp: Any, slices: int, x: Any) -> tuple[Any, Any]:
    """(base, t) of level x >= 0: between slice `base` and the next, at t in [0, 1]; beyond the last it stays there."""
    position = xp.minimum(x, 1.0) * (slices - 1)
    base = xp.minimum(xp.floor(position), slices - 2.0)
    return base, position - base
