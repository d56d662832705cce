"""How much light tables lose or add where the viewer is low: what a cosine-weighted RMS hardly sees."""

from __future__ import annotations

import numpy as np

from ...source import Array, BrdfSource, Facts
from ..accuracy import DirectionPairs, linear_estimate
from ..albedo import directional_albedo
from ..grids.grid import Grid

_ANGLES = np.radians([80.0, 85.0, 88.0])
_AZIMUTHS = (0.1, 1.1, 2.1)
_NODES = 24


class HorizonLight:
    """Largest relative difference of a table's directional albedo to its source's at 80, 85 and 88 degrees.

    The mean over three azimuths of the viewer and the channels, of tables linear along each axis, which are not built.
    """

    def __init__(self, source: BrdfSource) -> None:
        self._source, self._truth = source, _albedo(source)

    def __call__(self, grid: Grid) -> float:
        """Of a table on this grid, a share; 0 of what is black there."""
        off = _albedo(_Estimate(self._source, grid)) - self._truth
        return float(np.max(np.abs(off) / np.where(self._truth > 0, self._truth, np.inf)))


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
    rows = [directional_albedo(source, _ANGLES, _NODES, phi).mean(-1) for phi in _AZIMUTHS]
    return np.asarray(np.mean(rows, 0))
