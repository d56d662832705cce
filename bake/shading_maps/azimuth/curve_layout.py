"""Curves over level and azimuth in one small texture, which its linear filter interpolates in both.

Levels run across, azimuths down, four curves in the channels of a texel. Every group of four has P + 1 rows, of which
the last repeats phi = 0: between the first row's texel centres and the last's the filter meets no other group's rows,
and needs no wrap.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .azimuth_basis import position

PER_TEXEL = 4


@dataclass(frozen=True)
class CurveLayout:
    """`rank` curves at `azimuths` and `levels`."""

    rank: int
    azimuths: int
    levels: int

    @property
    def groups(self) -> int:
        """Number of texels that hold the curves' values at one place."""
        return -(-self.rank // PER_TEXEL)

    @property
    def pitch(self) -> int:
        """Rows of a group."""
        return self.azimuths + 1

    @property
    def width(self) -> int:
        """Of the image."""
        return self.levels

    @property
    def rows(self) -> int:
        """Height of the image."""
        return self.groups * self.pitch


def pack_curves(curves: NDArray[np.float32]) -> NDArray[np.float32]:
    """(rank, P, N) to the image (rows, N, 4), channels beyond the rank 0."""
    layout = CurveLayout(*curves.shape)
    whole = np.zeros((layout.groups * PER_TEXEL, layout.pitch, layout.levels), np.float32)
    whole[: layout.rank] = np.concatenate([curves, curves[:, :1]], 1)
    tiles = whole.reshape(layout.groups, PER_TEXEL, layout.pitch, layout.levels)
    return np.ascontiguousarray(np.moveaxis(tiles, 1, -1).reshape(layout.rows, layout.width, PER_TEXEL))


def unpack_curves(image: NDArray[np.float32], layout: CurveLayout) -> NDArray[np.float32]:
    """Undo `pack_curves`. Raises ValueError where the image's size is another."""
    if image.shape != (layout.rows, layout.width, PER_TEXEL):
        raise ValueError(f"an image of {image.shape[1]} x {image.shape[0]}, not {layout.width} x {layout.rows}")
    tiles = np.moveaxis(image.reshape(layout.groups, layout.pitch, layout.levels, PER_TEXEL), -1, 1)
    whole = tiles.reshape(-1, layout.pitch, layout.levels)
    return np.ascontiguousarray(whole[: layout.rank, : layout.azimuths])


def curve_uv(xp: Any, layout: CurveLayout, group: int, x: Any, turns: Any) -> tuple[Any, Any]:
    """Image coordinates, v upwards in [0, 1], of four curves at level x >= 0 and azimuth phi.

    Parameters
    ----------
    group : curves 4 group to 4 group + 3, in the channels from red to alpha
    x : r / a_max; beyond 1 it stays there
    turns : phi / (2 pi), in [0, 1]
    """
    u = (position(xp, x) * (layout.levels - 1) + 0.5) * (1 / layout.width)
    v = 1 - (turns * layout.azimuths + (group * layout.pitch + 0.5)) * (1 / layout.rows)
    return u, v
