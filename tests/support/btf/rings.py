"""Directions in rings about the normal, as goniometers take them, and the four of them around any other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Rings:
    """Directions at equal steps of azimuth from 0 on, ring by ring.

    rings : (polar angle in degrees, number), of rising angle; the first (0, 1), the normal itself
    """

    rings: tuple[tuple[float, int], ...]

    def __post_init__(self) -> None:
        thetas = [theta for theta, _ in self.rings]
        if len(thetas) < 2 or self.rings[0] != (0, 1) or sorted(set(thetas)) != thetas or thetas[-1] >= 90:
            raise ValueError(f"invalid rings {self.rings}")

    @property
    def angles(self) -> list[tuple[float, float]]:
        """(theta, phi) of every direction in degrees."""
        return [(theta, 360.0 * k / count) for theta, count in self.rings for k in range(count)]

    @property
    def steepest(self) -> float:
        """Polar angle of the last ring, radians."""
        return float(np.radians(self.rings[-1][0]))

    def around(self, directions: Array) -> list[tuple[NDArray[np.intp], Array]]:
        """Index and weight, each (...), of the four directions around each of `directions` (..., 3).

        Linear in the polar angle and, along either ring, in the azimuth; what lies beyond the last ring is on it.
        """
        theta = np.arccos(np.clip(directions[..., 2], -1, 1))
        turn = np.mod(np.arctan2(directions[..., 1], directions[..., 0]) / (2 * np.pi), 1.0)
        thetas = np.radians([theta for theta, _ in self.rings])
        counts = np.array([count for _, count in self.rings])
        first = np.cumsum(counts) - counts
        high = np.clip(np.searchsorted(thetas, theta, "right"), 1, len(thetas) - 1)
        share = np.clip((theta - thetas[high - 1]) / (thetas[high] - thetas[high - 1]), 0, 1)
        found = []
        for ring, part in ((high - 1, 1 - share), (high, share)):
            position = turn * counts[ring]
            step = np.floor(position).astype(np.intp)
            for k, weight in ((step, 1 - (position - step)), (step + 1, position - step)):
                found.append((first[ring] + k % counts[ring], part * weight))
        return found
