"""An anisotropic interpolant of scattered samples at the nodes of a grid: looked up a tenth as long as it is computed.

A bake evaluates its source some ten million times, each of them thousands of distances to samples. The level, the asinh
that was interpolated, is smooth where the BRDF has a peak, so it loses little between nodes as close as these.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...directions import half_difference
from ...source import Array, Facts
from .lookup_source import Axis, interpolate
from .scattered import ScatteredBrdf
from .scattered_coordinates import HALF, TWO_MIRRORS, Coordinates

THETA_H, PHI_D = 24, 18
THETA_D = np.radians([0, 0.5, 1.5, 3, *range(5, 91, 5)])  # close at 0, where a retroreflector has its peak
PHI_H_PER_TURN = 48
_CHUNK = 1 << 14


@dataclass(frozen=True)
class GriddedBrdf:
    """What `ScatteredBrdf` is, by lookups; build it with `gridded`.

    Attributes
    ----------
    table : (theta_h, phi_h, theta_d, phi_d, C) levels, asinh(f / scale); theta_h in steps of its logarithm, theta_d as
        `THETA_D`, azimuths evenly and around; phi_d over half a turn, after which light and viewer change places
    """

    method: str
    facts: Facts
    coordinates: Coordinates
    scale: float
    axes: tuple[Axis, Axis, Axis, Axis]
    table: Array

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """BRDF (..., C) of direction pairs (..., 3), 0 on and below the horizon."""
        wi, wo = np.broadcast_arrays(np.asarray(wi, dtype=float), np.asarray(wo, dtype=float))
        shape, wi, wo = wi.shape[:-1], wi.reshape(-1, 3), wo.reshape(-1, 3)
        result = np.zeros((len(wi), self.table.shape[-1]))
        above = np.flatnonzero((wi[:, 2] > 0) & (wo[:, 2] > 0))
        for start in range(0, len(above), _CHUNK):
            part = above[start : start + _CHUNK]
            half = wi[part] + wo[part]
            theta_h, theta_d, phi_d = half_difference(wi[part], wo[part])
            place = _stretched(theta_h, self.coordinates.peak_width), np.arctan2(half[:, 1], half[:, 0]), theta_d, phi_d
            result[part] = self.scale * np.sinh(interpolate(self.axes, self.table, *place))
        return result.reshape(*shape, -1)


def gridded(fit: ScatteredBrdf) -> GriddedBrdf:
    """The fit at the nodes of a grid, which repeats itself after half a turn where its symmetry does."""
    width = fit.coordinates.peak_width
    period = np.pi if fit.coordinates.symmetry in (HALF, TWO_MIRRORS) else 2 * np.pi
    n_phi = round(PHI_H_PER_TURN * period / (2 * np.pi))
    axes = (
        Axis(np.linspace(0, 1, THETA_H)),
        Axis(np.arange(n_phi) * (period / n_phi), period),
        Axis(THETA_D),
        Axis(np.arange(PHI_D) * (np.pi / PHI_D), np.pi),
    )
    stretched, phi_h, theta_d, phi_d = np.meshgrid(*(axis.nodes for axis in axes), indexing="ij")
    sin_h = np.minimum(width * np.sqrt(np.expm1(stretched * np.log1p(1 / width**2))), 1.0)
    wi, wo = (_directions(sin_h, phi_h, theta_d, phi_d + turn).reshape(-1, 3) for turn in (0.0, np.pi))
    level = np.concatenate([fit.level(wi[k : k + _CHUNK], wo[k : k + _CHUNK]) for k in range(0, len(wi), _CHUNK)])
    table = level.reshape(*stretched.shape, -1)
    facts: Facts = {**fit.facts, "tabulated": list(stretched.shape)}
    return GriddedBrdf(fit.method, facts, fit.coordinates, fit.scale, axes, table)


def _stretched(theta_h: Array, width: float) -> Array:
    """theta_h in the logarithm that the interpolant's first coordinate has, 0 at the normal and 1 at the horizon."""
    return np.log1p((np.sin(theta_h) / width) ** 2) / np.log1p(1 / width**2)


def _directions(sin_h: Array, phi_h: Array, theta_d: Array, phi_d: Array) -> Array:
    """Unit vectors (..., 3) at (theta_d, phi_d) around the half vector; on either side of the horizon."""
    cos_h = np.sqrt(np.maximum(1 - sin_h**2, 0))
    x, y, z = np.sin(theta_d) * np.cos(phi_d), np.sin(theta_d) * np.sin(phi_d), np.cos(theta_d)
    across, up = cos_h * x + sin_h * z, cos_h * z - sin_h * x
    return np.stack([np.cos(phi_h) * across - np.sin(phi_h) * y, np.sin(phi_h) * across + np.cos(phi_h) * y, up], -1)
