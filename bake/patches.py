"""The hemisphere in patches: rings of the polar angle, each of equal azimuths, over which matrices of windows lie.

Klems (1994, "A New Method for Predicting the Solar Heat Gain of Complex Fenestration Systems") divides it so; the
bounds are those of Radiance's library, which goes by the name of a basis, whatever a file says of its rings.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from .directions import polar_angle, spherical
from .source import Array


@dataclass(frozen=True)
class PatchBasis:
    """Upper bounds of the rings in degrees, the last of them 90, and the number of azimuths in each.

    The first azimuth of a ring is centred on phi = 0, and every number is even but that of the ring about the normal,
    which is 1. So a frame that is turned by half a turn or mirrored in an axis has the same patches.
    """

    bounds: tuple[float, ...]
    azimuths: tuple[int, ...]

    @property
    def count(self) -> int:
        """Number of patches."""
        return sum(self.azimuths)

    def bins(self, direction: Array) -> Array:
        """Index of the patch of directions (n, 3) above the horizon; a bound belongs to the outer ring."""
        ring = np.searchsorted(np.radians(self.bounds[:-1]), polar_angle(direction), side="right")
        number = np.array(self.azimuths)[ring]
        turns = np.arctan2(direction[:, 1], direction[:, 0]) / (2 * np.pi)
        turn = np.floor(turns * number + 0.5).astype(np.intp) % number
        first = np.concatenate([[0], np.cumsum(self.azimuths)[:-1]])
        bins: Array = first[ring] + turn
        return bins

    def index(self, xp: Any, w: Any) -> Any:
        """`bins` in the namespace `xp`, numpy's or the nodes', as a number; at a bound either neighbour's."""
        x, y, z = xp.components(w)
        number, first = float(self.azimuths[0]), 0.0
        for bound, count, following in zip(self.bounds, self.azimuths, self.azimuths[1:], strict=False):
            beyond = z < math.cos(math.radians(bound))
            first = beyond * float(count) + first
            number = beyond * float(following - count) + number if following != count else number
        # From -n / 2 to n / 2, of which the ends are one azimuth; about the normal both lie in the only patch.
        turn = xp.floor(xp.arctan2(y, x) * (0.5 / math.pi) * number + 0.5)
        return first + xp.where(number < 1.5, 0.0, xp.where(turn < -0.5, turn + number, turn))

    def centres(self) -> Array:
        """Unit vectors (count, 3) in the middle of the patches; of the first ring the normal."""
        edges = np.radians([0.0, *self.bounds])
        middle = np.concatenate([[0.0], (edges[1:-1] + edges[2:]) / 2])
        theta = np.repeat(middle, self.azimuths)
        phi = np.concatenate([2 * np.pi * np.arange(n) / n for n in self.azimuths])
        return spherical(theta, phi)


KLEMS = {
    "klems full": PatchBasis((5, 15, 25, 35, 45, 55, 65, 75, 90), (1, 8, 16, 20, 24, 24, 24, 16, 12)),
    "klems half": PatchBasis((6.5, 19.5, 32.5, 46.5, 61.5, 76.5, 90), (1, 8, 12, 16, 20, 12, 4)),
    "klems quarter": PatchBasis((9, 27, 46, 66, 90), (1, 8, 12, 12, 8)),
}


def patches_of(source: object) -> str:
    """Name in `KLEMS` of the patches within which a source is constant, of either direction; "" where there are none.

    A source tells it by an attribute `patches`.
    """
    name: str = getattr(source, "patches", "")
    return name
