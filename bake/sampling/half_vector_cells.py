"""Cells of an isotropic material's half vectors, per bin of theta_o: rectangles in (1 - cos theta_h, phi_h).

phi_h in [0, pi] is measured from the viewer's azimuth, and a fair coin chooses the side. Cell edges of
m = 1 - cos theta_h are m_k = (k / K)^(2 p): the square warp of the chord (p = 2) resolves a peak of 0.02 degrees with
64 cells, where a Bezier warp (densest at alpha = 0, linear in the chord at the pole) ends at 0.9 degrees; a matte
material does better with p = 1. Inside a cell the half vector is uniform in solid angle, and its density pdf_h per
solid angle, over both sides, is what is stored.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..directions import spherical
from ..source import Array
from .cell_sampler import HalfVector

# Elevations of the viewer per bin. One is not enough: a ridge of the table that two of its slices hold in two places
# moves within the bin, and what the bin's middle does not show is drawn by the cosine floor alone (fireflies of 400
# times the mean, against 30).
_ELEVATIONS = 4


@dataclass(frozen=True)
class SamplerLayout:
    """Sizes of a sampler's bins and cells; a `CellLayout` for viewers in the x-z plane.

    Parameters
    ----------
    n_o : bins of the viewer's elevation, equal in the chord sqrt(1 - cos theta_o)
    n_h, n_phi : half-vector cells in elevation and azimuth (over [0, pi])
    warp_power : p of the edges m_k = (k / n_h)^(2 p)
    """

    n_o: int = 64
    n_h: int = 64
    n_phi: int = 32
    warp_power: int = 2
    periodic = ()

    @property
    def shape(self) -> tuple[int, int, int]:
        """Bins, and rows and columns of cells."""
        return self.n_o, self.n_h, self.n_phi

    @property
    def cells(self) -> int:
        """Cells per bin."""
        return self.n_h * self.n_phi

    @property
    def width(self) -> int:
        """The texture's."""
        return self.cells

    @property
    def bins(self) -> int:
        """The texture's height."""
        return self.n_o

    def edges(self) -> Array:
        """1 - cos theta_h at the n_h + 1 cell edges."""
        return (np.arange(self.n_h + 1) / self.n_h) ** (2.0 * self.warp_power)

    def bin_of(self, xp: Any, wo: Any) -> Any:
        """Row of the texture for a viewer; a smooth normal may show its back, and indices are held inside."""
        chord = xp.length(wo - xp.vec(0.0, 0.0, 1.0)) * (1 / np.sqrt(2))
        return xp.minimum(xp.floor(chord * self.n_o), self.n_o - 1.0)

    def cell_of(self, xp: Any, wi: Any, wo: Any) -> tuple[Any, HalfVector]:
        """Cell in which the half vector lies, and that half vector with 1 - cos theta_h and phi_h."""
        half = xp.normalize(wi + wo)
        apart = half - xp.vec(0.0, 0.0, 1.0)
        m = xp.dot(apart, apart) * 0.5
        x, y, _ = xp.components(half)
        phi = xp.arctan2(y, x)
        angle = phi * (self.n_phi / np.pi)
        i_phi = xp.minimum(xp.floor(xp.maximum(angle, -angle)), self.n_phi - 1.0)
        i_h = xp.minimum(xp.floor(xp.power(m, 0.5 / self.warp_power) * self.n_h), self.n_h - 1.0)
        return i_h * self.n_phi + i_phi, HalfVector(half, m, phi)

    def half_vector(self, xp: Any, wo: Any, cell: Any, u: Any, v: Any) -> HalfVector:
        """Half vector at a place of a cell: `u` in elevation, `v` in azimuth and for the side."""
        i_h = xp.floor((cell + 0.5) * (1 / self.n_phi))
        i_phi = cell - i_h * self.n_phi
        low, high = self._edge(i_h), self._edge(i_h + 1)
        m = low + u * (high - low)
        # One number serves side and place in the cell: the upper half of [0, 1] is one side, the lower the other.
        side = v > 0.5
        place = xp.where(side, 2 * v - 1, 2 * v)
        phi = (i_phi + place) * (np.pi / self.n_phi)
        sine = xp.sqrt(m * (2 - m))
        half = xp.vec(sine * xp.cos(phi), sine * xp.sin(phi) * xp.where(side, 1.0, -1.0), 1 - m)
        return HalfVector(half, m, phi)

    def _edge(self, index: Any) -> Any:
        """1 - cos theta_h at a cell edge, by multiplications alone."""
        x = index * (1 / self.n_h)
        result = x * x
        for _ in range(self.warp_power - 1):
            result = result * (x * x)
        return result

    def pdf(self, xp: Any, value: Any, half: HalfVector, wo_half: Any) -> Any:
        """Density of wi per solid angle, of a cell's pdf_h."""
        return xp.divide(value, 4 * xp.maximum(wo_half, 1e-6))

    def weight(self, cosine: Array, half: HalfVector, wo_half: Array) -> Array:
        """Light's cosine over the density of wi where that of h is 1."""
        return cosine * 4 * wo_half

    def points(self, count: int) -> HalfVector:
        """Half vectors at count x count places of every cell, on one side."""
        edges = self.edges()
        offset = (np.arange(count) + 0.5) / count
        m = (edges[:-1, None] + offset * np.diff(edges)[:, None]).reshape(-1)[:, None]
        phi = (np.arange(self.n_phi * count) + 0.5) * np.pi / (self.n_phi * count)
        sine = np.sqrt(m * (2 - m))
        half = np.stack(np.broadcast_arrays(sine * np.cos(phi), sine * np.sin(phi), 1 - m), -1)
        return HalfVector(half, m, phi)

    def viewers(self) -> Array:
        """Viewers (bins, n, 3) at elevations even in the chord."""
        count = self.n_o * _ELEVATIONS
        chords = (np.arange(count) + 0.5) / count
        return spherical(2 * np.arcsin(chords / np.sqrt(2)), 0.0).reshape(self.n_o, _ELEVATIONS, 3)

    def areas(self) -> Array:
        """Solid angles (n_h, 1) of the cells, both sides together."""
        return np.diff(self.edges())[:, None] * (2 * np.pi / self.n_phi)

    def stored(self, probability: Array) -> Array:
        """Density of the half vector per solid angle."""
        return probability / self.areas()
