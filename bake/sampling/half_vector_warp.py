"""Coordinates of an isotropic material's half vectors for a warp: the logarithm of the elevation, and phi_h.

    s = log(1 + m / a) / log(1 + 1 / a),  m = 1 - cos theta_h,     t = |phi_h| / pi

phi_h is measured from the viewer's azimuth, and the second random number runs once around. Rows are even in m up to
`a`, which follows the width of the highlight, and even in its logarithm beyond: a peak of any width is resolved, and so
is what surrounds it. The density of h per solid angle is p(s, t) ds/dm / (2 pi).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import xp_numpy
from ..directions import spherical
from ..source import Array
from .cell_sampler import HalfVector

# Elevations of the viewer per bin: a ridge that moves within it must not be left to the cosine alone.
_ELEVATIONS = 16


@dataclass(frozen=True)
class HalfVectorWarp:
    """Sizes of a warp's bins and cells; a `WarpLayout` for viewers in the x-z plane.

    Parameters
    ----------
    n_o : bins of the viewer's elevation, equal in the chord sqrt(1 - cos theta_o)
    n_h, n_phi : half-vector cells in elevation and azimuth (over [0, pi])
    linear : a, of 1 - cos theta_h; 0 in settings, where it is to be chosen
    """

    n_o: int = 16
    n_h: int = 48
    n_phi: int = 16
    linear: float = 0.0
    periodic = ()

    @property
    def shape(self) -> tuple[int, int, int]:
        """Bins, and rows and columns of cells."""
        return self.n_o, self.n_h, self.n_phi

    @property
    def strata(self) -> int:
        """Of the first random number."""
        return 2 * self.n_h

    @property
    def width(self) -> int:
        """Texels of a bin."""
        return self.strata + self.n_h * self.n_phi

    @property
    def bins(self) -> int:
        """The texture's height."""
        return self.n_o

    def bin_of(self, xp: Any, wo: Any) -> Any:
        """Row of the texture for a viewer; a smooth normal may show its back, and indices are held inside."""
        chord = xp.length(wo - xp.vec(0.0, 0.0, 1.0)) * (1 / np.sqrt(2))
        return xp.minimum(xp.floor(chord * self.n_o), self.n_o - 1.0)

    @property
    def _range(self) -> float:
        return math.log1p(1 / self.linear)

    def place_of(self, xp: Any, wi: Any, wo: Any) -> tuple[Any, Any, HalfVector]:
        """Coordinates of the half vector in cells, and that half vector with 1 - cos theta_h and phi_h."""
        half = xp.normalize(wi + wo)
        apart = half - xp.vec(0.0, 0.0, 1.0)
        square = xp.dot(apart, apart)
        x, y, _ = xp.components(half)
        phi = xp.arctan2(y, x)
        s = xp.log(square * (0.5 / self.linear) + 1) * (self.n_h / self._range)
        angle = phi * (self.n_phi / np.pi)
        return s, xp.maximum(angle, -angle), HalfVector(half, square * 0.5, phi)

    def number_of_t(self, xp: Any, u: Any) -> Any:
        """Away from the viewer's plane on either side, so that directions are continuous all around."""
        turned = 2 * u - 1
        return xp.maximum(turned, -turned)

    def half_at(self, xp: Any, wo: Any, s: Any, t: Any, u: Any) -> Any:
        """Half vector at a place, on the side of the second random number."""
        m = (xp.exp(s * (self._range / self.n_h)) - 1) * self.linear
        sine, phi = xp.sqrt(m * (2 - m)), t * (np.pi / self.n_phi)
        return xp.vec(sine * xp.cos(phi), sine * xp.sin(phi) * xp.where(u > 0.5, 1.0, -1.0), 1 - m)

    def pdf(self, xp: Any, value: Any, half: HalfVector, wo_half: Any) -> Any:
        """Density of wi per solid angle, of a density over the unit square."""
        spread = (half.first + self.linear) * (8 * np.pi * self._range) * xp.maximum(wo_half, 1e-6)
        return xp.divide(value, spread)

    def weight(self, cosine: Array, half: HalfVector, wo_half: Array) -> Array:
        """Light's cosine over the density of wi where all cells are equally probable."""
        weight: Array = cosine / self.pdf(xp_numpy, 1.0, half, wo_half)
        return weight

    def points(self, count: int) -> HalfVector:
        """Half vectors at count x count places of every cell, on one side."""
        s, t = ((np.arange(n * count) + 0.5) / (n * count) for n in (self.n_h, self.n_phi))
        m = (np.expm1(s * self._range) * self.linear)[:, None]
        phi = t * np.pi
        sine = np.sqrt(m * (2 - m))
        half = np.stack(np.broadcast_arrays(sine * np.cos(phi), sine * np.sin(phi), 1 - m), -1)
        return HalfVector(half, m, phi)

    def viewers(self) -> Array:
        """Viewers (bins, n, 3) at elevations even in the chord."""
        count = self.n_o * _ELEVATIONS
        chords = (np.arange(count) + 0.5) / count
        return spherical(2 * np.arcsin(chords / np.sqrt(2)), 0.0).reshape(self.n_o, _ELEVATIONS, 3)

    def areas(self) -> Array:
        """All cells are alike."""
        return np.ones((1, 1))
