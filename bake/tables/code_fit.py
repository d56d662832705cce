"""Codes that a table of logarithms is closest with, in place of those of its samples.

A sample is right at its node, and what is interpolated between nodes is too bright or too dark wherever the BRDF bends.
The codes of least squared error at many directions leave the nodes a little and come closer everywhere else. They are
found by Gauss-Newton steps on

    sum over pairs of w (sum over slices of a_s gain (exp(range y_s) - 1) / c - f)^2 + stay sum of (code - first)^2

where y_s is what the image's filter makes of the four codes of a slice around the pair, and c the cosines that the grid
stores values times. Each step is solved by conjugate gradients with the diagonal as preconditioner (Nocedal & Wright
2006, "Numerical Optimization", sections 5.1 and 10.3). The second sum keeps codes that no light tells.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from .. import xp_numpy
from ..source import Array, BrdfSource
from .accuracy import direction_pairs
from .log_codes import LogCodes
from .table import Table, filter_taps

# Of pairs for each texel, and in all: far more than codes, or noise between the pairs would be fitted. (Of half as many
# tables of 48 KiB err a fifth more, with a hundredth of the stay a quarter more, in a tenth more bytes.)
_PAIRS_EACH, _MOST_PAIRS, _LEAST_PAIRS = 6, 1 << 18, 1 << 16
_STEPS, _GRADIENTS, _STAY = 3, 12, 1.0
# An exponential goes further than its slope says: a step that makes things worse is shortened.
_SHORTER = (1.0, 0.4, 0.15, 0.05)


@dataclass(frozen=True)
class _Taps:
    """What each pair reads: of either slice its weight (2, P), and the indices and weights of four texels (2, 4, P)."""

    share: Array
    index: Array
    weight: Array


def can_be_fitted(table: Table) -> bool:
    """Whether there are enough pairs for its codes, and the filter is the one that is fitted."""
    few = _PAIRS_EACH * np.prod(table.grid.shape) <= _MOST_PAIRS
    return bool(few) and table.isotropic and table.filter == "trilinear"


def fitted_values(source: BrdfSource, table: Table, codes: LogCodes) -> Array:
    """Values (*shape, 3), float32, of an isotropic, trilinear table that codes are to be made of.

    Parameters
    ----------
    source : what was tabulated
    table : its samples
    codes : ranges and gains
    """
    shape = table.grid.shape
    count = int(np.clip(_PAIRS_EACH * np.prod(shape), _LEAST_PAIRS, _MOST_PAIRS))
    pairs = direction_pairs(count, offset=0.25)
    taps = _taps(table, pairs.wi, pairs.wo)
    factor = table.grid.factor(xp_numpy, pairs.wi, pairs.wo)
    root = np.sqrt(pairs.weight / pairs.weight.sum()) * pairs.cosines[:, 0] / factor
    stored = source.evaluate(pairs.wi, pairs.wo) * np.reshape(factor, (-1, 1))
    values = np.array(table.values, np.float64)
    for channel, (range_, gain) in enumerate(zip(codes.ranges, codes.gains)):
        if gain > 0:
            first = np.log1p(values[..., channel].reshape(-1) / gain) / range_
            found = _fit(taps, stored[:, channel], root, np.clip(first, 0, 1), range_, gain)
            values[..., channel] = (gain * np.expm1(range_ * found[_tied(shape)])).reshape(shape)
    return np.minimum(values, codes.peaks).astype(np.float32)


def _tied(shape: tuple[int, ...]) -> Array:
    """Index of the texel that stands for each: at the poles, the ends of slices and rows, all azimuths are one."""
    tied = np.arange(int(np.prod(shape))).reshape(shape)
    tied[:, -1, :] = tied[:, -1, :1]
    tied[-1, :, :] = tied[-1, :, :1]
    return tied.reshape(-1)


def _taps(table: Table, wi: Array, wo: Array) -> _Taps:
    shape, tied = table.grid.shape, _tied(table.grid.shape)
    axes = [filter_taps(place, "trilinear") for place in table.grid.coordinates(xp_numpy, wi, wo)]
    slices, rows, columns = ([(np.clip(i, 0, n - 1), w) for i, w in taps] for taps, n in zip(axes, shape))
    index, weight = [], []
    for s, _ in slices:
        four = list(itertools.product(rows, columns))
        index.append([tied[(s * shape[1] + r) * shape[2] + c] for (r, _), (c, _) in four])
        weight.append([w_r * w_c for (_, w_r), (_, w_c) in four])
    return _Taps(np.array([w for _, w in slices]), np.array(index), np.array(weight))


def _fit(taps: _Taps, truth: Array, root: Array, first: Array, range_: float, gain: float) -> Array:
    """Codes (K,) of one channel, from those of the samples."""
    # Of the whole squared signal, shared out: a code that moves by 1 may cost so much.
    stay = _STAY * float(np.sum((root * truth) ** 2)) / len(first)

    def measured(codes: Array) -> tuple[float, Array, Array]:
        """The sum, the weighted differences (P,), and exp(range y_s), (2, P)."""
        grown = np.exp(range_ * (taps.weight * codes[taps.index]).sum(1))
        rest = root * ((taps.share * gain * (grown - 1)).sum(0) - truth)
        return float(rest @ rest + stay * np.sum((codes - first) ** 2)), rest, grown

    codes, (least, rest, grown) = first, measured(first)
    for _ in range(_STEPS):
        slope = (taps.share * grown * (gain * range_) * root)[:, None] * taps.weight
        step = _solved(slope, taps.index, rest, codes - first, stay)
        for shortened in _SHORTER:
            trial = np.clip(codes + shortened * step, 0, 1)
            found = measured(trial)
            if found[0] < least:
                codes, (least, rest, grown) = trial, found
                break
        else:
            break
    return codes


def _solved(slope: Array, index: Array, rest: Array, away: Array, stay: float) -> Array:
    """The step (K,) that J'J d + stay d = -(J'rest + stay away) has, J being `slope` (2, 4, P) at `index`."""
    size, flat = len(away), index.reshape(-1)

    def gathered(values: Array) -> Array:
        return np.bincount(flat, (slope * values).reshape(-1), size)

    diagonal = np.bincount(flat, (slope * slope).reshape(-1), size) + stay
    residual = -(gathered(rest) + stay * away)
    step = np.zeros(size)
    direction = ready = residual / diagonal
    old = residual @ ready
    for _ in range(_GRADIENTS):
        product = gathered((slope * direction[index]).sum((0, 1))) + stay * direction
        length = old / max(float(direction @ product), 1e-300)
        step, residual = step + length * direction, residual - length * product
        ready = residual / diagonal
        new = residual @ ready
        direction, old = ready + new / max(old, 1e-300) * direction, new
    return step
