"""Cells of an anisotropic material's half vectors, per bin of (theta_o, phi_o): rectangles in their warped slopes.

phi_o covers half a turn where the material looks the same after half a turn, and the cells then turn with the viewer.
A cell is a rectangle in the warped slopes u = x / (width + |x|) of h (see `bake.tables.grids.anisotropic_grids`): a
polar cell would cut across the ridge that brushing makes. Inside a cell (u, v) is even, hence

    pdf_h = p_cell cells / 4  du/dx dv/dy / h_z^3,   du/dx = width / (width + |x|)^2,   dx dy = d omega_h / h_z^3.

Stored is p_cell times the number of cells.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from .. import xp_numpy
from ..directions import spherical
from ..source import Array
from ..tables.grids.anisotropic_grids import azimuth_index, slope_unwarp, slope_warp
from .cell_sampler import HalfVector

# Of the warped slope: 1e-6 from its end, which float32 still separates from 1, slopes are a million times the width.
_EDGE = 1 - 1e-6


@dataclass(frozen=True)
class SlopeLayout:
    """Sizes of a sampler's bins and cells; a `CellLayout` for viewers all around.

    Parameters
    ----------
    n_theta : bins of the viewer's elevation, equal in the chord sqrt(1 - cos theta_o)
    n_phi : bins of the viewer's azimuth, the first one around 0
    n_x, n_y : cells of the half vector's slopes
    width_x, width_y : slopes at half of the way from the middle to the edge
    folded : the azimuth covers half a turn
    viewers_each_way : over which a bin's cells are averaged
    """

    n_theta: int = 16
    n_phi: int = 16
    n_x: int = 32
    n_y: int = 32
    width_x: float = 0.3
    width_y: float = 0.3
    folded: bool = False
    periodic = (1,)
    viewers_each_way: ClassVar[int] = 2

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Bins of elevation and azimuth, and rows and columns of cells."""
        return self.n_theta, self.n_phi, self.n_y, self.n_x

    @property
    def cells(self) -> int:
        """Cells per bin."""
        return self.n_x * self.n_y

    @property
    def width(self) -> int:
        """The texture's."""
        return self.cells

    @property
    def bins(self) -> int:
        """The texture's height."""
        return self.n_theta * self.n_phi

    def bin_of(self, xp: Any, wo: Any) -> Any:
        """Row of the texture for a viewer; a smooth normal may show its back, and indices are held inside."""
        x, y, _ = xp.components(wo)
        chord = xp.length(wo - xp.vec(0.0, 0.0, 1.0)) * (1 / np.sqrt(2))
        elevation = xp.minimum(xp.floor(chord * self.n_theta), self.n_theta - 1.0)
        azimuth = xp.floor(azimuth_index(xp, x, y, self.n_phi, self.folded) + 0.5)
        azimuth = xp.where(azimuth > self.n_phi - 0.5, 0.0, azimuth)
        return elevation * self.n_phi + azimuth

    def side(self, xp: Any, wo: Any) -> Any:
        """-1 for a viewer that sees the cells of a folded sampler after half a turn, else 1."""
        if not self.folded:
            return 1.0
        x, y, _ = xp.components(wo)
        index = azimuth_index(xp, x, y, self.n_phi, False) * 2
        # The bin around 0 begins half a bin before it.
        after = xp.where(index > self.n_phi - 0.5, 1.0, 0.0) * xp.where(index < 2 * self.n_phi - 0.5, 1.0, 0.0)
        return 1 - 2 * after

    def warped(self, xp: Any, wi: Any, wo: Any) -> tuple[Any, Any, HalfVector]:
        """Warped slopes in (-1, 1) as the viewer's bin has them, and the half vector with its own slopes."""
        xs, ys, zs = xp.components(wi + wo)
        zs = xp.maximum(zs, 1e-6)
        half = xp.normalize(xp.vec(xs, ys, zs))
        x, y = xp.divide(xs, zs), xp.divide(ys, zs)
        side = self.side(xp, wo)
        u, v = slope_warp(xp, x * side, self.width_x), slope_warp(xp, y * side, self.width_y)
        return u, v, HalfVector(half, x, y)

    def cell_of(self, xp: Any, wi: Any, wo: Any) -> tuple[Any, HalfVector]:
        """Cell in which the half vector lies, and that half vector with its slopes."""
        u, v, half = self.warped(xp, wi, wo)
        return _cell_index(xp, v, self.n_y) * self.n_x + _cell_index(xp, u, self.n_x), half

    def half_vector(self, xp: Any, wo: Any, cell: Any, u: Any, v: Any) -> HalfVector:
        """Half vector at a place of a cell, along x and along y."""
        i_y = xp.floor((cell + 0.5) * (1 / self.n_x))
        i_x = cell - i_y * self.n_x
        u = inside(xp, (i_x + u) * (2 / self.n_x) - 1)
        v = inside(xp, (i_y + v) * (2 / self.n_y) - 1)
        side = self.side(xp, wo)
        x, y = slope_unwarp(xp, u, self.width_x) * side, slope_unwarp(xp, v, self.width_y) * side
        return HalfVector(xp.normalize(xp.vec(x, y, 1.0)), x, y)

    def pdf(self, xp: Any, value: Any, half: HalfVector, wo_half: Any) -> Any:
        """Density of wi per solid angle, of a cell's probability times the number of cells."""
        x, y = half.first, half.second
        to_x = self.width_x + xp.maximum(x, -x)
        to_y = self.width_y + xp.maximum(y, -y)
        _, _, hz = xp.components(half.direction)
        spread = to_x * to_x * to_y * to_y * (hz * hz * hz) * xp.maximum(wo_half, 1e-6)
        return value * xp.divide(self.width_x * self.width_y / 16, spread)

    def weight(self, cosine: Array, half: HalfVector, wo_half: Array) -> Array:
        """Light's cosine over the density of wi where all cells are equally probable."""
        weight: Array = cosine / self.pdf(xp_numpy, 1.0, half, wo_half)
        return weight

    def points(self, count: int) -> HalfVector:
        """Half vectors at count x count places of every cell."""
        u, v = (((np.arange(n * count) + 0.5) / (n * count)) * 2 - 1 for n in (self.n_x, self.n_y))
        x = np.asarray(slope_unwarp(xp_numpy, u, self.width_x))[None, :]
        y = np.asarray(slope_unwarp(xp_numpy, v, self.width_y))[:, None]
        return HalfVector(xp_numpy.normalize(xp_numpy.vec(x, y, 1.0)), x, y)

    def viewers(self) -> Array:
        """Viewers (bins, n, 3), even in the chord and over each bin's azimuth."""
        count = self.viewers_each_way
        n_theta, n_phi = self.n_theta * count, self.n_phi * count
        chords = (np.arange(n_theta) + 0.5) / n_theta
        turn = np.pi if self.folded else 2 * np.pi
        azimuths = turn * (np.arange(n_phi) - 0.5 * (count - 1)) / n_phi
        viewers = spherical(2 * np.arcsin(chords / np.sqrt(2))[:, None], azimuths)
        by_bin = viewers.reshape(self.n_theta, count, self.n_phi, count, 3).swapaxes(1, 2)
        return by_bin.reshape(self.bins, count**2, 3)

    def areas(self) -> Array:
        """All cells are alike."""
        return np.ones((1, 1))

    def stored(self, probability: Array) -> Array:
        """Probability times the number of cells."""
        return probability * self.cells


def inside(xp: Any, u: Any) -> Any:
    """Random numbers include 0 and 1, where the slope is infinite."""
    return xp.minimum(xp.maximum(u, -_EDGE), _EDGE)


def _cell_index(xp: Any, u: Any, n: int) -> Any:
    return xp.minimum(xp.floor((u + 1) * (0.5 * n)), n - 1.0)
