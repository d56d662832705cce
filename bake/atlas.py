"""A three-dimensional table as one two-dimensional texture: its slices side by side, each with its gutter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .source import Array
from .table import GUTTER, pad_slices

# Blender and every GPU it runs on take textures of this size.
MAX_TEXTURE = 16384


@dataclass(frozen=True)
class AtlasLayout:
    """Slices in reading order from the top left; one slice beyond the pole of the first axis is last.

    Parameters
    ----------
    shape : of the table, (slices, rows, columns): (theta_o, theta_i, phi_delta) or (theta_d, theta_h, phi_d)
    """

    shape: tuple[int, int, int]

    @property
    def slices(self) -> int:
        """Number of slices, the continuation over the pole included."""
        return self.shape[0] + 1

    @property
    def slice_width(self) -> int:
        """Texels across: the azimuth with its gutter."""
        return self.shape[2] + 2 * GUTTER

    @property
    def slice_height(self) -> int:
        """Texels down: the elevation with its gutter."""
        return self.shape[1] + 2 * GUTTER

    @property
    def columns(self) -> int:
        """Slices per row: of the nearly square arrangements the one that leaves fewest places empty."""
        ideal = max(1, round((self.slices * self.shape[1] / self.shape[2]) ** 0.5))
        choices = range(max(1, ideal - ideal // 3), ideal + ideal // 3 + 1)
        return min(choices, key=lambda c: (-(-self.slices // c) * c, abs(c - ideal)))

    @property
    def rows(self) -> int:
        """Rows of slices."""
        return -(-self.slices // self.columns)

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the texture."""
        return self.columns * self.slice_width, self.rows * self.slice_height


def pack(values: Array) -> Array:
    """Table (S, R, C, 3) -> texture (height, width, 3), row 0 on top; unused places are 0."""
    slices, height, width, _ = values.shape
    layout = AtlasLayout((slices, height, width))
    padded = pad_slices(values)
    places = np.zeros((layout.rows * layout.columns, *padded.shape[1:]), values.dtype)
    places[: layout.slices] = padded
    grid = places.reshape(layout.rows, layout.columns, layout.slice_height, layout.slice_width, 3)
    atlas_width, atlas_height = layout.size
    return np.ascontiguousarray(grid.transpose(0, 2, 1, 3, 4)).reshape(atlas_height, atlas_width, 3)


def unpack(pixels: Array, shape: tuple[int, int, int]) -> Array:
    """Texture -> table (*shape, 3); the inverse of `pack`."""
    layout = AtlasLayout(shape)
    grid = (
        pixels[..., :3]
        .reshape(layout.rows, layout.slice_height, layout.columns, layout.slice_width, 3)
        .transpose(0, 2, 1, 3, 4)
    )
    places = grid.reshape(-1, layout.slice_height, layout.slice_width, 3)
    inner = slice(GUTTER, -GUTTER)
    return np.ascontiguousarray(places[: shape[0], inner, inner])


def atlas_uv(xp: Any, layout: AtlasLayout, index: Any, u_row: Any, u_phi: Any) -> tuple[Any, Any]:
    """Texture coordinates (u, v), v upwards as Blender counts, of a position in the slice with this whole index."""
    width, height = layout.size
    # Half a slice keeps a whole index clear of the rounding of index / columns.
    row = xp.floor((index + 0.5) * (1 / layout.columns))
    column = index - row * layout.columns
    x = column * layout.slice_width + u_phi * (layout.shape[2] - 1) + (GUTTER + 0.5)
    y = row * layout.slice_height + u_row * (layout.shape[1] - 1) + (GUTTER + 0.5)
    return x * (1 / width), 1 - y * (1 / height)
