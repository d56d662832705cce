"""Which of several grids errs least where a first measurement cannot decide: more directions as long as it matters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...source import Array, BrdfSource
from ..accuracy import direction_pairs, linear_estimate
from ..grids.grid import Grid

# Sets of directions, (count, start of the sequence); bakes measure at 0.5, searches descend at 0.25.
_SETS = ((8192, 0.75), (8192, 0.125), (16384, 0.375), (32768, 0.625))
# Interleaved parts of the directions, whose scatter gives the standard error of a difference, and how many such
# errors a grid must be behind the leader to drop out: once in a thousand by chance, with sixteen parts.
_PARTS, _CERTAIN = 16, 4.0


@dataclass(frozen=True)
class Candidate:
    """A grid and its cosine-weighted RMS at the directions that rank."""

    grid: Grid
    rms: float


def race(source: BrdfSource, grids: Sequence[Grid]) -> tuple[Candidate, ...]:
    """Measure grids at directions that fitted none of them, as often as it takes to decide which is the best.

    The squared error of a table on a matte material has a heavy tail (a thousandth of the directions holds a third of
    the sum), and good tables lie within a few per cent of each other. After each set of directions those that are
    surely behind drop out, judged by differences at the same directions (a race: Maron and Moore 1994).
    """
    squares: dict[Grid, list[Array]] = {grid: [] for grid in grids}
    weights: list[int] = []
    running = list(squares)
    for count, offset in _SETS:
        pairs = direction_pairs(count, offset, turned=not source.isotropic)
        truth = source.evaluate(pairs.wi, pairs.wo)
        weights.append(len(truth))
        for grid in running:
            error = (linear_estimate(source, grid, pairs) - truth) * pairs.cosines
            square = pairs.weight * (error**2).mean(-1)
            squares[grid].append(np.array([square[k::_PARTS].sum() for k in range(_PARTS)]))
        running = _not_behind({grid: np.sum(squares[grid], 0) for grid in running})
        if len(running) == 1:
            break
    best = min(running, key=lambda grid: float(np.sum(squares[grid])))
    least = np.sum(squares[best]) / sum(weights)

    def rms(grid: Grid) -> float:
        """By what it is behind the best at the directions both have met."""
        met = len(squares[grid])
        behind = (np.sum(squares[grid]) - np.sum(squares[best][:met])) / sum(weights[:met])
        return float(np.sqrt(least + max(behind, 0.0)))

    return tuple(Candidate(grid, rms(grid)) for grid in squares)


def _not_behind(sums: dict[Grid, Array]) -> list[Grid]:
    """Those whose sum does not surely exceed the least."""
    leader = min(sums.values(), key=np.sum)

    def behind(mine: Array) -> bool:
        difference = mine - leader
        return bool(difference.mean() > _CERTAIN * difference.std(ddof=1) / np.sqrt(_PARTS))

    return [grid for grid, mine in sums.items() if not behind(mine)]
