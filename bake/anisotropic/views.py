"""An anisotropic BRDF seen from viewers all around, sampled over the light where the half vector's slopes gather."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .. import xp_numpy
from ..directions import spherical
from ..envelope.views import Views
from ..errors import BakeError
from ..source import Array, BrdfSource
from ..tables.anisotropic_grids import slope_unwarp

_CHORDS = 1e-5, np.sqrt(1 - 1e-3)
_CHUNK = 1 << 17


@dataclass(frozen=True)
class ViewerGrid:
    """Nodes of viewers: n_theta even in the chord sqrt(1 - cos theta_o) from 0 to 1, n_phi even over the azimuth."""

    n_theta: int
    n_phi: int
    folded: bool

    @property
    def turn(self) -> float:
        """Radians that the azimuth covers."""
        return np.pi if self.folded else 2 * np.pi

    def nodes(self, parts: int = 1) -> tuple[Array, Array]:
        """Chords and azimuths of all nodes and of `parts` - 1 viewers between each two, (V,), theta before phi."""
        chords = np.linspace(0, 1, (self.n_theta - 1) * parts + 1)
        phi = np.arange(self.n_phi * parts) * (self.turn / (self.n_phi * parts))
        return np.repeat(chords, len(phi)), np.tile(phi, len(chords))

    def interpolated(self, values: Array, chords: Array, phi: Array) -> Array:
        """Bilinear values (..., x) at viewers (...), of (n_theta, n_phi, x)."""
        t = np.clip(chords, 0, 1) * (self.n_theta - 1)
        p = np.remainder(phi, self.turn) * (self.n_phi / self.turn)
        i, j = np.minimum(t.astype(np.intp), self.n_theta - 2), np.floor(p).astype(np.intp)
        t, p = (t - i)[..., None], (p - j)[..., None]
        j, k = j % self.n_phi, (j + 1) % self.n_phi
        low = values[i, j] * (1 - p) + values[i, k] * p
        high = values[i + 1, j] * (1 - p) + values[i + 1, k] * p
        result: Array = low * (1 - t) + high * t
        return result


def slope_views(
    source: BrdfSource, chords: Array, phi: Array, widths: tuple[float, float], sizes: tuple[int, int]
) -> Views:
    """Sample a source from viewers (V,), by the midpoint rule over warped slopes of the half vector.

    The slopes are warped as those of `AnisotropicHalfGrid`. Other sizes give other directions. The views' wo is
    (V, 1, 3) and in all azimuths; wi is on all sides.

    Raises BakeError for values that are not finite.
    """
    axes = [
        np.asarray(slope_unwarp(xp_numpy, (np.arange(n) + 0.5) / n * 2 - 1, width)) for n, width in zip(sizes, widths)
    ]
    steps = [(2 / n) * (width + np.abs(x)) ** 2 / width for n, width, x in zip(sizes, widths, axes)]
    x, y = (g.ravel() for g in np.meshgrid(*axes))
    half = xp_numpy.normalize(np.stack([x, y, np.ones_like(x)], -1))
    solid = np.outer(steps[1], steps[0]).ravel() * half[:, 2] ** 3
    wo = spherical(2 * np.arcsin(np.clip(chords, *_CHORDS) / np.sqrt(2)), phi)
    cos_d = wo @ half.T
    wi = 2 * cos_d[..., None] * half - wo[:, None]
    areas = np.where((wi[..., 2] > 0) & (cos_d > 0), 4 * cos_d * solid, 0)
    values = np.zeros(wi.shape)
    lit = np.flatnonzero(areas)
    flat, viewers = wi.reshape(-1, 3), lit // len(half)
    for start in range(0, len(lit), _CHUNK):
        part = slice(start, start + _CHUNK)
        values.reshape(-1, 3)[lit[part]] = source.evaluate(flat[lit[part]], wo[viewers[part]])
    if not np.isfinite(values).all():
        raise BakeError(source.name, "holds values that are not finite", "check the file")
    return Views(chords, wo[:, None], wi, areas, values * np.maximum(wi[..., 2:], 0))
