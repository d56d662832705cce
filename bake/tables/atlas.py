"""A table as one two-dimensional texture: its slices side by side, each with its gutter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import BakeError
from ..source import Array
from ..tables.padding import GUTTER, pad_slices
from .grids.grid import Grid

# Blender and every GPU it runs on take textures of this size.
MAX_TEXTURE = 16384
# 280 MiB in half floats of four channels, which is what Cycles holds while rendering; an isotropic table of the
# largest resolution still fits.
MOST_TEXELS = 35 << 20


@dataclass(frozen=True)
class AtlasLayout:
    """Slices in reading order from the top left, the last slice axis first, with one slice beyond its pole.

    Parameters
    ----------
    shape : of the table's grid: one or two slice axes, rows, columns
    """

    shape: tuple[int, ...]

    @classmethod
    def of(cls, grid: Grid) -> AtlasLayout:
        """Layout of a grid's atlas. Raises BakeError where the texture would be larger than Blender, a GPU or memory
        takes."""
        layout = cls(grid.shape)
        if not layout.is_texture:
            width, height = layout.size
            cause = f"would need a texture of {width} x {height} texels, more than {MOST_TEXELS >> 20} million"
            kind = "table" if len(grid.shape) == 3 else "anisotropic table"
            raise BakeError(kind, cause, "choose a lower resolution")
        return layout

    @property
    def is_texture(self) -> bool:
        """Whether Blender, a GPU and memory take a texture of this size."""
        width, height = self.size
        return max(width, height) <= MAX_TEXTURE and width * height <= MOST_TEXELS

    @property
    def run(self) -> int:
        """Slices of the last slice axis, the continuation over the pole included."""
        return self.shape[-3] + 1

    @property
    def slices(self) -> int:
        """Number of slices in all."""
        return int(np.prod(self.shape[:-3], dtype=int)) * self.run

    @property
    def slice_size(self) -> tuple[int, int]:
        """(width, height) in texels, the columns and rows with their gutters."""
        return self.shape[-1] + 2 * GUTTER, self.shape[-2] + 2 * GUTTER

    @property
    def columns(self) -> int:
        """Slices per row: of the nearly square arrangements the one that leaves fewest places empty.

        Bundles do not tell it. Of one slice axis it has always been reckoned without the gutters.
        """
        width, height = self.slice_size if len(self.shape) > 3 else self.shape[:0:-1]
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
    """Table (*shape, 3) -> texture (height, width, 3), row 0 on top; unused places are 0."""
    layout = AtlasLayout(grid.shape)
    width, height = layout.slice_size
    places = np.zeros((layout.rows * layout.columns, height, width, 3), values.dtype)
    places[: layout.slices] = pad_slices(grid, values).reshape(-1, height, width, 3)
    across = places.reshape(layout.rows, layout.columns, height, width, 3).transpose(0, 2, 1, 3, 4)
    return np.ascontiguousarray(across).reshape(layout.size[1], layout.size[0], 3)


def unpack(grid: Grid, pixels: Array) -> Array:
    """Texture -> table (*shape, 3); the inverse of `pack`."""
    layout = AtlasLayout(grid.shape)
    width, height = layout.slice_size
    across = pixels[..., :3].reshape(layout.rows, height, layout.columns, width, 3).transpose(0, 2, 1, 3, 4)
    places = across.reshape(-1, height, width, 3)[: layout.slices]
    inner = slice(GUTTER, -GUTTER)
    table = places.reshape(*grid.shape[:-3], layout.run, height, width, 3)
    return np.ascontiguousarray(table[..., : grid.shape[-3], inner, inner, :])


def atlas_uv(xp: Any, layout: AtlasLayout, index: Any, row: Any, column: Any) -> tuple[Any, Any]:
    """Texture coordinates (u, v), v upwards as Blender counts, of a place in the slice with this whole index.

    Parameters
    ----------
    row, column : fractional indices within the slice
    """
    width, height = layout.size
    slice_width, slice_height = layout.slice_size
    # Half a slice keeps a whole index clear of the rounding of index / columns.
    down = xp.floor((index + 0.5) * (1 / layout.columns))
    across = index - down * layout.columns
    x = across * slice_width + column + (GUTTER + 0.5)
    y = down * slice_height + row + (GUTTER + 0.5)
    return x * (1 / width), 1 - y * (1 / height)
