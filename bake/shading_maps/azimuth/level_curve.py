"""The level x = r / a_max that a light of each angle to the normal stands for, by the averages of the photographs.

Kautz et al. 2004 take a photograph's own average for its level. Of an arc that is all there is; of lights all around
averages also differ by azimuth: lamps are uneven, a surface leans. Which way the shadows fall and how long they are
follows the direction of the light and not its strength, so a level here is that of all lights of an elevation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Rise of the curve from knot to knot that keeps its inverse from having steps.
_LEAST_RISE = 1e-6


@dataclass(frozen=True, eq=False)
class LevelCurve:
    """Rising straight lines between knots.

    Attributes
    ----------
    cosines : (k,) of the light's angle to the normal, from 0 to 1
    levels : (k,) x, from 0 to 1
    a_max : radiance of level 1, in the unit of the photographs
    """

    cosines: Array
    levels: Array
    a_max: float

    @classmethod
    def of(cls, cosines: Array, averages: Array) -> LevelCurve:
        """By least squares of curves that rise (isotonic regression, Ayer et al. 1955).

        Below the lowest light it falls to black in proportion to the cosine, and beyond the highest it rises so.
        """
        order = np.argsort(cosines, kind="stable")
        x, y = _pooled(cosines[order], averages[order])
        if x[-1] < 1:
            x, y = np.append(x, 1.0), np.append(y, y[-1] / x[-1])
        x, y = np.insert(x, 0, 0.0), np.insert(y, 0, 0.0)
        levels = y / y[-1] + _LEAST_RISE * np.arange(len(y))
        return cls(x, levels / levels[-1], float(y[-1]))

    def level(self, cosine: Array) -> Array:
        """x at cosines of the light's angle."""
        return np.interp(cosine, self.cosines, self.levels)

    def cosine(self, level: Array) -> Array:
        """Cosines of the light's angle at levels from 0 to 1."""
        return np.interp(level, self.levels, self.cosines)


def _pooled(x: Array, y: Array) -> tuple[Array, Array]:
    """Means of neighbours whose values fall, as few of them as it takes for the means to rise (pool adjacent
    violators)."""
    groups: list[tuple[float, float, int]] = []
    for place, value in zip(x, y, strict=True):
        groups.append((float(place), float(value), 1))
        while len(groups) > 1 and groups[-2][1] >= groups[-1][1]:
            (a, u, m), (b, v, n) = groups[-2:]
            groups[-2:] = [((m * a + n * b) / (m + n), (m * u + n * v) / (m + n), m + n)]
    found = np.array([group[:2] for group in groups])
    return found[:, 0], found[:, 1]
