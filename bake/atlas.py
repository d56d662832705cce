"""A three-dimensional table as one two-dimensional texture: the theta_o slices side by side, each with its gutter."""

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
    """Slices of (theta_i, phi_delta) in reading order from the top left; one slice beyond theta_o = 0 is last."""

    n: int

    @property
    def slices(self) -> int:
        """Number of slices, the continuation over the pole included."""
        return self.n + 1

    @property
    def slice_width(self) -> int:
        """Texels across: phi_delta with its gutter."""
        return 2 * self.n + 2 * GUTTER

    @property
    def slice_height(self) -> int:
        """Texels down: theta_i with its gutter."""
        return self.n + 2 * GUTTER

    @property
    def columns(self) -> int:
        """Slices per row: of the nearly square arrangements the one that leaves fewest places empty."""
        ideal = max(1, round((self.slices / 2) ** 0.5))
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
    """Table (N, N, 2N, 3) -> texture (height, width, 3), row 0 on top; unused places are 0."""
    layout = AtlasLayout(values.shape[0])
    padded = pad_slices(values)
    places = np.zeros((layout.rows * layout.columns, *padded.shape[1:]), values.dtype)
    places[: layout.slices] = padded
    grid = places.reshape(layout.rows, layout.columns, layout.slice_height, layout.slice_width, 3)
    width, height = layout.size
    return np.ascontiguousarray(grid.transpose(0, 2, 1, 3, 4)).reshape(height, width, 3)


def unpack(pixels: Array, n: int) -> Array:
    """Texture -> table (N, N, 2N, 3); the inverse of `pack`."""
    layout = AtlasLayout(n)
    grid = (
        pixels[..., :3]
        .reshape(layout.rows, layout.slice_height, layout.columns, layout.slice_width, 3)
        .transpose(0, 2, 1, 3, 4)
    )
    places = grid.reshape(-1, layout.slice_height, layout.slice_width, 3)
    inner = slice(GUTTER, -GUTTER)
    return np.ascontiguousarray(places[:n, inner, inner])


def atlas_uv(xp: Any, layout: AtlasLayout, index: Any, u_i: Any, u_phi: Any) -> tuple[Any, Any]:
    """Texture coordinates (u, v), v upwards as Blender counts, of a position in the slice with this whole index."""
    width, height = layout.size
    # Half a slice keeps a whole index clear of the rounding of index / columns.
    row = xp.floor((index + 0.5) * (1 / layout.columns))
    column = index - row * layout.columns
    x = column * layout.slice_width + u_phi * (2 * layout.n - 1) + (GUTTER + 0.5)
    y = row * layout.slice_height + u_i * (layout.n - 1) + (GUTTER + 0.5)
    return x * (1 / width), 1 - y * (1 / height)
