"""A shading map of fewer texels, for a swatch seen from far away: everywhere, or in levels by how far it is.

S enters a picture linearly at every level of light, so the mean of neighbouring texels is what a pixel that holds them
all sees; it is a shading map itself, and its envelope and residual are the means of theirs.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..source import Array
from .slice_atlas import GUTTER, MAX_EXTENT, SliceLayout, pack_slices, unpack_slices

# Pixels across that texels which are averaged may be: filtered between, those of a whole pixel would blur a pattern to
# twice a pixel's width.
UNSEEN = 0.5
# Texels across that become one in the first level of means: the level of two would be as large as all others together.
_FIRST = 4
# Texels across that the last level has at least, and those of the smallest map that has a level.
_LEAST = 4
SMALLEST = _FIRST * _LEAST


@dataclass(frozen=True)
class DetailLayout:
    """A map's tiles and their means, all in one image as wide as the finest tile, one level below the other.

    Of the first level across the image's own repetition closes the seam, as in a bundle. The means stand between
    gutters, and what is to the right of them repeats them.

    Parameters
    ----------
    levels : of tiles, the finest first
    factors : texels across that are one in each
    """

    levels: tuple[SliceLayout, ...]
    factors: tuple[int, ...]

    @property
    def width(self) -> int:
        """Of the image."""
        return self.levels[0].width

    @property
    def rows(self) -> int:
        """Height of the image."""
        return sum(level.rows for level in self.levels)

    @cached_property
    def _numbers(self) -> list[tuple[float, float, float]]:
        """Row at which each level would begin if it had one tile, and height and width of its tiles."""
        first = np.cumsum([0, *(level.pitch for level in self.levels)])
        return [(float(row), float(one.height), float(one.width)) for row, one in zip(first, self.levels)]

    def place(self, xp: Any, texels: Any, u: Any, v: Any) -> tuple[Any, Any, Any]:
        """Where a place of the swatch lies in the coarsest level whose texels are at most `UNSEEN` pixels across.

        Parameters
        ----------
        texels : of the finest level, that a pixel is across
        u, v : of the swatch, v in [0, 1]

        Returns
        -------
        Coordinate across, in [0, 1]; of tile 0 the row, from the top of the image; and the rows from tile to tile
        """
        first, height, width = self._numbers[0]
        chosen = xp.vec(first, height, width)
        gutter: Any = 0.0
        for before, here, factor in zip(self._numbers, self._numbers[1:], self.factors[1:]):
            coarser = (texels > factor / UNSEEN) * 1.0
            chosen = chosen + xp.scale(xp.vec(*(b - a for a, b in zip(before, here))), coarser)
            if factor == self.factors[1]:
                gutter = coarser * GUTTER
        first, height, width = xp.components(chosen)
        across = ((u - xp.floor(u)) * width + gutter) * (1 / self.width)
        return across, (1 - v) * height + (first * self.levels[0].tiles + GUTTER), height + 2 * GUTTER

    def image_v(self, top: Any, pitch: Any, index: Any) -> Any:
        """Image coordinate, upwards in [0, 1], of a place that `place` has found, in tile `index`."""
        row = top if self.levels[0].tiles == 1 else index * pitch + top
        return 1 - row * (1 / self.rows)


def detail_layout(layout: SliceLayout) -> DetailLayout | None:
    """Levels of a map; None where it is too small for any, or the image would be too large."""
    factors, levels = [1], [layout]
    factor = _FIRST
    while min(layout.height, layout.width) // factor >= _LEAST:
        levels.append(SliceLayout(layout.tiles, *reduced_size(layout, factor)))
        factors.append(factor)
        factor *= 2
    found = DetailLayout(tuple(levels), tuple(factors))
    # Of the first means, gutters and all have to fit into the width.
    fits = levels[-1] is not layout and levels[1].width + 2 * GUTTER <= layout.width
    return found if fits and found.rows <= MAX_EXTENT else None


def pack_levels(tiles: Array, averaged: Array, layout: DetailLayout) -> NDArray[np.float32]:
    """The image (rows, W, C) of tiles (n, H, W, C) and of means of `averaged` (n, H', W', C), the same or finer."""
    parts = [pack_slices(np.ascontiguousarray(tiles, np.float32))]
    for level in layout.levels[1:]:
        columns = np.arange(-GUTTER, layout.width - GUTTER) % level.width
        parts.append(pack_slices(mean_tiles(averaged, level.height, level.width))[:, columns])
    return np.concatenate(parts)


def mean_tiles(tiles: Array, height: int, width: int) -> NDArray[np.float32]:
    """Tiles (n, H, W, C) in fewer texels, each the mean of those that it covers."""
    down, across = area_weights(tiles.shape[1], height), area_weights(tiles.shape[2], width)
    return np.einsum("ih,nhwc,jw->nijc", down, tiles, across, optimize=True).astype(np.float32)


def reduced_size(layout: SliceLayout, factor: int) -> tuple[int, int]:
    """(height, width) of a tile when `factor` texels become one, at least one."""
    return max(1, layout.height // factor), max(1, layout.width // factor)


def reduced_slices(
    residual: NDArray[np.float32], envelope: NDArray[np.float32], layout: SliceLayout, factor: int
) -> tuple[NDArray[np.float32], NDArray[np.float32], SliceLayout]:
    """Mean texels of the images "slices" and "envelope" of a bundle, and the layout of the former.

    Parameters
    ----------
    residual : (rows, W, C) of `layout`
    envelope : (H, W, 4), the residual's share in alpha
    factor : texels across that become one

    Returns
    -------
    Images of the same kinds, each tile (H // factor, W // factor) or one texel at least
    """
    size = reduced_size(layout, factor)
    tiles = mean_tiles(unpack_slices(residual, layout), *size)
    return pack_slices(tiles), mean_tiles(envelope[None], *size)[0], SliceLayout(layout.tiles, *size)


def area_weights(n: int, m: int) -> Array:
    """(m, n) matrix that averages n texels to m <= n of equal extent, parts of texels included; rows sum to 1."""
    edges = np.arange(m + 1) * (n / m)
    low, high = edges[:-1, None], edges[1:, None]
    texel = np.arange(n)
    overlap = np.clip(np.minimum(high, texel + 1) - np.maximum(low, texel), 0, None)
    return overlap * (m / n)
