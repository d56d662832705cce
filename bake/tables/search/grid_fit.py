"""Fitting the shapes of a grid's axes by the error that they leave: coordinate descent over a few choices."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from ...source import Array, BrdfSource
from ..accuracy import DirectionPairs, direction_pairs, linear_estimate
from ..grids.grid import Grid
from ..grids.parameterization import NARROWEST_END, WIDEST_END, LogWarp

Measure = Callable[[Grid], float]

_ENDS = (WIDEST_END, 0.4, 0.1, 0.03, 0.01, 0.003, 0.001, NARROWEST_END)
# What has to be gained for a step of the descent: less is chance.
_GAIN = 0.995


@dataclass
class GridErrors:
    """Cosine-weighted RMS of tables linear along each axis, at one set of directions; each grid measured once.

    Parameters
    ----------
    truth : the source's values (P, 3) at the pairs
    """

    source: BrdfSource
    pairs: DirectionPairs
    truth: Array
    found: dict[Grid, float] = field(default_factory=dict)

    @classmethod
    def at(cls, source: BrdfSource, count: int, offset: float) -> GridErrors:
        """At `accuracy.direction_pairs`, turned about the normal where the source is anisotropic."""
        pairs = direction_pairs(count, offset, turned=not source.isotropic)
        return cls(source, pairs, source.evaluate(pairs.wi, pairs.wo))

    def __call__(self, grid: Grid) -> float:
        """RMS in 1/sr."""
        if grid not in self.found:
            self.found[grid] = self.pairs.rms(linear_estimate(self.source, grid, self.pairs) - self.truth)
        return self.found[grid]


def fit_warps(grid: Any, measure: Measure, rounds: int = 1) -> Any:
    """The grid with the fitted warps of least error, one end of one axis after the other."""

    def with_ends(ends: tuple[float, ...]) -> Grid:
        warps: Any = tuple(LogWarp(*ends[k : k + 2]) for k in range(0, len(ends), 2))
        return replace(grid, warps=warps)

    start = tuple(end for warp in grid.warps for end in (warp.near, warp.far))
    return with_ends(descend(lambda ends: measure(with_ends(ends)), start, _ENDS, rounds))


def descend(
    measure: Callable[[tuple[float, ...]], float], start: tuple[float, ...], choices: Sequence[float], rounds: int
) -> tuple[float, ...]:
    """Coordinate descent over a few choices for every number."""
    best = (measure(start), start)
    for _ in range(rounds):
        before = best
        for place in range(len(start)):
            base = best[1]
            for choice in choices:
                if choice != base[place]:
                    trial = (*base[:place], choice, *base[place + 1 :])
                    rms = measure(trial)
                    best = (rms, trial) if rms < _GAIN * best[0] else best
        if best == before:
            break
    return best[1]
