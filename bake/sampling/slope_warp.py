"""Coordinates of an anisotropic material's half vectors for a warp: their warped slopes.

s runs across the tangent and t along it, both even over the warped slopes (-1, 1) of `slope_cells`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from ..tables.grids.anisotropic_grids import slope_unwarp
from .cell_sampler import HalfVector
from .slope_cells import SlopeLayout, inside


@dataclass(frozen=True)
class SlopeWarp(SlopeLayout):
    """Sizes of a warp's bins and cells, as those of a `SlopeLayout`; a `WarpLayout` for viewers all around."""

    n_theta: int = 8
    n_phi: int = 8
    n_x: int = 16
    n_y: int = 24
    viewers_each_way: ClassVar[int] = 4

    @property
    def strata(self) -> int:
        """Of the first random number."""
        return 2 * self.n_y

    @property
    def width(self) -> int:
        """Texels of a bin."""
        return self.strata + self.cells

    def place_of(self, xp: Any, wi: Any, wo: Any) -> tuple[Any, Any, HalfVector]:
        """Coordinates of the half vector in cells, and that half vector with its slopes."""
        along, across, half = self.warped(xp, wi, wo)
        return (across + 1) * (0.5 * self.n_y), (along + 1) * (0.5 * self.n_x), half

    def number_of_t(self, xp: Any, u: Any) -> Any:
        """As it is."""
        return u

    def half_at(self, xp: Any, wo: Any, s: Any, t: Any, u: Any) -> Any:
        """Half vector at a place."""
        side = self.side(xp, wo)
        x = slope_unwarp(xp, inside(xp, t * (2 / self.n_x) - 1), self.width_x) * side
        y = slope_unwarp(xp, inside(xp, s * (2 / self.n_y) - 1), self.width_y) * side
        return xp.normalize(xp.vec(x, y, 1.0))
