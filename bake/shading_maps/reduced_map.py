"""A shading map of fewer texels, for a swatch seen from far away.

S enters a picture linearly at every level, so the mean of neighbouring texels is what a pixel that holds them all sees;
it is a shading map itself, and its envelope and residual are the means of theirs.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..source import Array
from .slice_atlas import SliceLayout, pack_slices, unpack_slices


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
    height, width = reduced_size(layout, factor)
    down, across = area_weights(layout.height, height), area_weights(layout.width, width)

    def mean(tiles: Array) -> NDArray[np.float32]:
        return np.einsum("ih,nhwc,jw->nijc", down, tiles, across, optimize=True).astype(np.float32)

    tiles = mean(unpack_slices(residual, layout))
    return pack_slices(tiles), mean(envelope[None])[0], SliceLayout(layout.tiles, height, width)


def area_weights(n: int, m: int) -> Array:
    """(m, n) matrix that averages n texels to m <= n of equal extent, parts of texels included; rows sum to 1."""
    edges = np.arange(m + 1) * (n / m)
    low, high = edges[:-1, None], edges[1:, None]
    texel = np.arange(n)
    overlap = np.clip(np.minimum(high, texel + 1) - np.maximum(low, texel), 0, None)
    return overlap * (m / n)
