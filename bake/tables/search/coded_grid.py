"""Where the samples of a table lie that is kept as logarithms: by the error of codes, not of values, between them.

A highlight bends less in its logarithm than in its value. So a table of codes wants fewer samples across the peak and
more where the codes bend than the grid that serves values best; on coarse tables that is up to half of the error.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, cast

import numpy as np

from ... import xp_numpy
from ...source import Array, BrdfSource
from ..accuracy import DirectionPairs, corner_samples, direction_pairs
from ..grids.grid import Grid
from ..grids.half_vector_grid import MAX_SAMPLES, HalfVectorGrid
from ..log_codes import LEAST_PEAK
from .grid_fit import fit_warps
from .isotropic_search import half_sizes, with_cosine_powers

# Of the descent, and of the last word among what it found, which may owe its place to the luck of its directions. (The
# best of an iridescent purple at 4096 of them, 28 x 56 x 28 samples, erred 3.6 times as much as those before.)
_PAIRS, _JUDGING = 8192, 16384
# Codes bend less across a peak, and leave more samples for the other two axes, or the reverse.
_SPLITS = ((1.5, 0.5), (1.5, 1.0), (3.0, 0.25), (3.0, 0.5), (6.0, 0.25), (8.0, 0.25))
_RANGES = (4.0, 6.0, 8.0, 10.0, 12.0, 14.0)
LEAST_SAMPLES = 4  # of an axis
# By how much one axis grows and another shrinks, and how often at most: a material whose samples lie in other
# proportions than those above (cc_green_malachite: 2 : 2.6 : 0.8) errs a fifth less by it.
_TRADED, _TRADES, _WORTH = (1.5, 1.25), 8, 0.99


@dataclass
class CodedErrors:
    """Cosine-weighted RMS of tables of codes at one set of directions; each grid measured once.

    Parameters
    ----------
    truth : the source's values (P, 3) at the pairs
    range_ : of the codes of all channels
    """

    source: BrdfSource
    pairs: DirectionPairs
    truth: Array
    range_: float
    found: dict[Grid, float] = field(default_factory=dict)

    def __call__(self, grid: Grid) -> float:
        """RMS in 1/sr."""
        if grid not in self.found:
            self.found[grid] = self.pairs.rms(coded_estimate(self.source, grid, self.pairs, self.range_) - self.truth)
        return self.found[grid]


def coded_estimate(source: BrdfSource, grid: Grid, pairs: DirectionPairs, range_: float) -> Array:
    """What an isotropic table of codes of this range would return at the pairs, (P, 3).

    Only the eight samples around each pair are evaluated. Codes are interpolated within a slice and decoded, then the
    two slices are blended, as `table.Table` does it.
    """
    values, weights, factor = corner_samples(source, grid, pairs)
    values = values * np.reshape(factor, (*np.shape(factor), 1))
    peak = values.max((0, 1))
    gain = np.maximum(peak, LEAST_PEAK) / np.expm1(range_)
    codes = np.rint(np.log1p(values / gain) * (255 / range_)) * (range_ / 255) * weights[..., None]
    # Corners come slice by slice; a slice's weights sum to its own part of 1.
    share = weights.reshape(len(weights), 2, 4).sum(-1)[..., None]
    within = codes.reshape(len(codes), 2, 4, 3).sum(2) / np.maximum(share, 1e-30)
    estimate: Array = (share * gain * np.expm1(np.minimum(within, range_))).sum(1)
    return estimate / np.reshape(grid.factor(xp_numpy, pairs.wi, pairs.wo), (-1, 1))


def coded_grid(source: BrdfSource, grid: Any, n: int) -> Any:
    """The grid with the sizes and the spacing that serve codes best; unchanged where its spacing is not a fitted one.

    Parameters
    ----------
    n : resolution, as of an N x N x 2N table
    """
    if not source.isotropic or grid.parameterization != "fitted":
        return grid
    pairs = direction_pairs(_PAIRS, 0.25)
    truth = source.evaluate(pairs.wi, pairs.wo)
    kinds = [CodedErrors(source, pairs, truth, range_) for range_ in _RANGES]
    trials = ((one, errors) for one in with_cosine_powers(grid) for errors in kinds)
    start, measure = min(trials, key=lambda trial: trial[1](trial[0]))
    fitted = fit_warps(start, measure)
    candidates = [grid, start, fitted]
    if isinstance(grid, HalfVectorGrid):
        sized = min((replace(fitted, sizes=sizes) for sizes in half_sizes(n, grid.reciprocal, _SPLITS)), key=measure)
        candidates += [sized, traded(fit_warps(sized, measure), measure)]
    judging = direction_pairs(_JUDGING, 0.625)
    judge = CodedErrors(source, judging, source.evaluate(judging.wi, judging.wo), measure.range_)
    return min(candidates, key=judge)


def traded(grid: HalfVectorGrid, measure: Callable[[HalfVectorGrid], float]) -> HalfVectorGrid:
    """The grid with about as many samples, of which one axis gives another some as long as that errs less."""
    for step in _TRADED:
        for _ in range(_TRADES):
            best = min((_trade(grid, *axes, step) for axes in itertools.permutations(range(3), 2)), key=measure)
            if measure(best) > _WORTH * measure(grid):
                break
            grid = best
    return grid


def _trade(grid: HalfVectorGrid, gains: int, loses: int, step: float) -> HalfVectorGrid:
    """The same grid where an axis is as long or as short as it may be."""
    sizes = list(grid.sizes)
    sizes[gains], sizes[loses] = round(sizes[gains] * step), round(sizes[loses] / step)
    if sizes[gains] > MAX_SAMPLES or sizes[loses] < LEAST_SAMPLES:
        return grid
    return replace(grid, sizes=cast(tuple[int, int, int], tuple(sizes)))
