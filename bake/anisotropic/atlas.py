"""A four-dimensional table as one two-dimensional texture: its slices (r, c) side by side, each with its gutter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..atlas import MAX_TEXTURE
from ..errors import BakeError
from ..source import Array
from ..table import GUTTER
from .grid import Grid
from .table import pad_slices

# 256 MiB in half floats of four channels, which is what Cycles holds while rendering.
MOST_TEXELS = 1 << 25


@dataclass(frozen=True)
class SliceLayout:
    """Slices in reading order from the top left, b running before a; b has one more than the grid, beyond its pole."""

    shape: tuple[int, int, int, int]

    @classmethod
    def of(cls, grid: Grid) -> SliceLayout:
        """Of a grid. Raises BakeError where the texture would be larger than Blender, a GPU or memory takes."""
        layout = cls(grid.shape)
        width, height = layout.size
        if max(width, height) > MAX_TEXTURE or width * height > MOST_TEXELS:
            cause = f"would need a texture of {width} x {height} texels, more than {MOST_TEXELS >> 20} million"
            raise BakeError("anisotropic table", cause, "choose a lower resolution")
        return layout

    @property
    def per_azimuth(self) -> int:
        """Slices of one a."""
        return self.shape[1] + 1

    @property
    def slices(self) -> int:
        """In all."""
        return self.shape[0] * self.per_azimuth

    @property
    def slice_size(self) -> tuple[int, int]:
        """(width, height) with the gutter."""
        return self.shape[3] + 2 * GUTTER, self.shape[2] + 2 * GUTTER

    @property
    def columns(self) -> int:
        """Slices per row: of the nearly square arrangements the one that leaves fewest places empty."""
        width, height = self.slice_size
        ideal = max(1, round((self.slices * height / width) ** 0.5))
        choices = range(max(1, ideal - ideal // 3), ideal + ideal // 3 + 1)
        return min(choices, key=lambda c: (-(-self.slices // c) * c, abs(c - ideal)))

    @property
    def rows(self) -> int:
        """Rows of slices."""
        return -(-self.slices // self.columns)

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the texture."""
        width, height = self.slice_size
        return self.columns * width, self.rows * height


def pack(grid: Grid, values: Array) -> Array:
    """Table (A, B, R, C, 3) -> texture (height, width, 3), row 0 on top; unused places are 0. Raises BakeError."""
    layout = SliceLayout.of(grid)
    width, height = layout.slice_size
    places = np.zeros((layout.rows * layout.columns, height, width, 3), values.dtype)
    places[: layout.slices] = pad_slices(grid, values).reshape(-1, height, width, 3)
    across = places.reshape(layout.rows, layout.columns, height, width, 3).transpose(0, 2, 1, 3, 4)
    return np.ascontiguousarray(across).reshape(layout.size[1], layout.size[0], 3)


def unpack(grid: Grid, pixels: Array) -> Array:
    """Texture -> table (A, B, R, C, 3); the inverse of `pack`."""
    layout = SliceLayout.of(grid)
    width, height = layout.slice_size
    across = pixels[..., :3].reshape(layout.rows, height, layout.columns, width, 3).transpose(0, 2, 1, 3, 4)
    places = across.reshape(-1, height, width, 3)[: layout.slices]
    inner = slice(GUTTER, -GUTTER)
    table = places.reshape(grid.shape[0], layout.per_azimuth, height, width, 3)
    return np.ascontiguousarray(table[:, : grid.shape[1], inner, inner])


def slice_uv(xp: Any, layout: SliceLayout, index: Any, r: Any, c: Any) -> tuple[Any, Any]:
    """Texture coordinates (u, v), v upwards as Blender counts, of a place (r, c) in the slice with this whole index."""
    width, height = layout.size
    slice_width, slice_height = layout.slice_size
    # Half a slice keeps a whole index clear of the rounding of index / columns.
    row = xp.floor((index + 0.5) * (1 / layout.columns))
    column = index - row * layout.columns
    x = column * slice_width + c + (GUTTER + 0.5)
    y = row * slice_height + r + (GUTTER + 0.5)
    return x * (1 / width), 1 - y * (1 / height)
