"""How much light tables lose or add where the viewer is low: what a cosine-weighted RMS hardly sees."""

from __future__ import annotations

import numpy as np

from ...source import Array, BrdfSource, Facts
from ..accuracy import DirectionPairs, linear_estimate
from ..albedo import directional_albedo
from ..grids.grid import Grid

_ANGLES = np.radians([80.0, 85.0, 88.0])
# Along the tangent, across it, and between: a ridge that is drawn out one way loses its light in one of them.
_AZIMUTHS = np.radians([0.0, 45.0, 90.0])
_NODES = 24


class HorizonLight:
    """RMS of the relative differences of a table's directional albedo to its source's at 80, 85 and 88 degrees.

    At three azimuths of the viewer, of the mean of the channels, of tables linear along each axis, which are not built.

    Parameters
    ----------
    source : what the tables hold
    whole : what the light is compared with, where the tables hold a part of it
    """

    def __init__(self, source: BrdfSource, whole: BrdfSource | None = None) -> None:
        self._source, self._truth = source, _albedo(source)
        light = self._truth if whole is None else _albedo(whole)
        self._light = np.where(light > 0, light, np.inf)

    def __call__(self, grid: Grid) -> float:
        """Of a table on this grid, a share; 0 of what is black there."""
        off = _albedo(_Estimate(self._source, grid)) - self._truth
        return float(np.sqrt(np.mean((off / self._light) ** 2)))


class _Estimate:
    """A table that is not built, as a source."""

    isotropic = bilateral = False
    name = "estimate"

    def __init__(self, source: BrdfSource, grid: Grid) -> None:
        self._source, self._grid = source, grid
        self.facts: Facts = {}

    def evaluate(self, wi: Array, wo: Array) -> Array:
        wi, wo = np.broadcast_arrays(wi, wo)
        found = np.zeros(wi.shape)
        above = (wi[..., 2] > 0) & (wo[..., 2] > 0)
        pairs = DirectionPairs(wi[above], wo[above], np.ones(int(above.sum())))
        found[above] = linear_estimate(self._source, self._grid, pairs)
        return found


def _albedo(source: BrdfSource) -> Array:
    """(azimuths, angles)."""
    return np.array([directional_albedo(source, _ANGLES, _NODES, float(phi)).mean(-1) for phi in _AZIMUTHS])
