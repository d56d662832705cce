"""Codes that a table of logarithms is closest with, in place of those of its samples.

A sample is right at its node, and what is interpolated between nodes is too bright or too dark wherever the BRDF bends;
a B-spline through samples is too smooth everywhere. The codes of least squared error at many directions leave the
samples and come closer. They are found by Gauss-Newton steps on

    sum over pairs of w (sum over slices of a_s gain (exp(range y_s) - 1) / c - f)^2 + stay sum of (code - first)^2

where y_s is what the image's filter makes of the codes of a slice around the pair (four of them, of a B-spline
sixteen), and c the cosines that the grid stores values times. Each step is solved by conjugate gradients with the
diagonal as preconditioner (Nocedal & Wright 2006, "Numerical Optimization", sections 5.1 and 10.3). The second sum
keeps codes that no light tells.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .. import xp_numpy
from ..source import Array, BrdfSource
from .accuracy import direction_pairs
from .grids.grid import Grid
from .log_codes import LogCodes
from .padding import GUTTER, PAD_MODES, pad_slices
from .table import Filter, Table, filter_taps

# Of pairs for each texel: far more than codes, or their noise would be fitted. (Of a quarter as many, tables
# of 48 KiB err up to twice as much; with a hundredth of the stay a quarter more, in a tenth more bytes. A B-spline
# reads eight times as many texels of each, in as many times the time.)
_PAIRS_EACH, _LEAST_PAIRS = {"trilinear": 24, "bspline": 12}, 1 << 16
FITTED_FILTERS: tuple[Filter, ...] = ("trilinear", "bspline")
MOST_TEXELS = 1 << 16
# One step is not enough for coarse tables of a highlight, and neither a third nor more gradients gain a hundredth.
_STEPS, _GRADIENTS, _STAY = 2, 8, 1.0
_AT_ONCE = 1 << 14
# An exponential goes further than its slope says: a step that makes things worse is shortened.
_SHORTER = (1.0, 0.4, 0.15, 0.05)


def can_be_fitted(table: Table) -> bool:
    """Whether there are few enough codes for many pairs of each, and the filter is one that is fitted."""
    few = np.prod(table.grid.shape) <= MOST_TEXELS
    return bool(few) and table.isotropic and table.filter in FITTED_FILTERS


def fitted_values(source: BrdfSource, table: Table, codes: LogCodes) -> Array:
    """Values (*shape, 3), float32, of an isotropic table that codes are to be made of, for the table's own filter.

    Parameters
    ----------
    source : what was tabulated
    table : its samples
    codes : ranges and gains
    """
    shape = table.grid.shape
    pairs = direction_pairs(max(_PAIRS_EACH[table.filter] * int(np.prod(shape)), _LEAST_PAIRS), offset=0.25)
    factor = table.grid.factor(xp_numpy, pairs.wi, pairs.wo)
    root = np.sqrt(pairs.weight / pairs.weight.sum()) * pairs.cosines[:, 0] / factor
    stored = source.evaluate(pairs.wi, pairs.wo) * np.reshape(factor, (-1, 1))
    reading = Reading(table, pairs.wi, pairs.wo)
    values = np.array(table.values, np.float64)
    for channel, (range_, gain) in enumerate(zip(codes.ranges, codes.gains)):
        if gain > 0:
            first = np.log1p(values[..., channel].reshape(-1) / gain) / range_
            fit = _Fit(reading, stored[:, channel], root, np.clip(first, 0, 1), range_, gain)
            values[..., channel] = (gain * np.expm1(range_ * fit.codes()[reading.tied])).reshape(shape)
    return np.minimum(values, codes.peaks).astype(np.float32)


class Reading:
    """What pairs read of a table: of its slices a share each, and within a slice texels, the gutter's among them.

    Attributes
    ----------
    tied : of each texel (K,) the one that stands for it: at the poles, the ends of slices and rows, all azimuths are
        one
    share : (S, P), weights of the slices that a pair is read of
    weight : (T, P), of the texels within each
    index : (S, T, P), of these among all texels of the continued table
    texels : how many those are
    """

    def __init__(self, table: Table, wi: Array, wo: Array) -> None:
        self.grid, shape = table.grid, table.grid.shape
        tied = np.arange(int(np.prod(shape))).reshape(shape)
        tied[:, -1, :] = tied[:, -1, :1]
        tied[-1, :, :] = tied[-1, :, :1]
        self.tied = tied.reshape(-1)
        slices, rows, columns = (filter_taps(place, table.filter) for place in table.grid.coordinates(xp_numpy, wi, wo))
        width = shape[2] + 2 * GUTTER
        within = [(r + GUTTER) * width + c + GUTTER for (r, _), (c, _) in itertools.product(rows, columns)]
        starts = [np.clip(s, 0, shape[0]) * (shape[1] + 2 * GUTTER) * width for s, _ in slices]
        self.share = np.array([weight for _, weight in slices])
        self.weight = np.array([w_r * w_c for (_, w_r), (_, w_c) in itertools.product(rows, columns)])
        self.index = np.array([[start + place for place in within] for start in starts], np.int32)
        self._copies, self._turned = _continuation(self.grid)
        self.texels = len(self._copies)

    def continued(self, values: Array) -> Array:
        """Values of a channel (K,) at all texels of the continued table."""
        return pad_slices(self.grid, values[self.tied].reshape(*self.grid.shape, 1)).reshape(-1)

    def moved(self, codes: Array) -> Array:
        """By how much all texels move if the codes do by these (K,): beyond a pole by 2 mean - code, as values do."""
        tied = codes[self.tied]
        found = tied[self._copies]
        found[self._turned] = 2 * self._means(tied)[self._copies[self._turned]] - found[self._turned]
        return found

    def gathered(self, texels: Array) -> Array:
        """The transpose of `moved`: for each code (K,) what these of all texels come to."""
        size = len(self.tied)
        signed = texels.copy()
        signed[self._turned] *= -1
        found = np.bincount(self._copies, signed, size)
        found += 2 * self._means(np.bincount(self._copies[self._turned], texels[self._turned], size))
        return np.bincount(self.tied, found, size)

    def counted(self, texels: Array) -> Array:
        """For each code (K,) the sum of these over the texels that repeat it."""
        size = len(self.tied)
        return np.bincount(self.tied, np.bincount(self._copies, texels, size), size)

    def _means(self, values: Array) -> Array:
        """Each the mean over its row."""
        rows = values.reshape(-1, self.grid.shape[2])
        return np.repeat(rows.mean(1), rows.shape[1])

    def interpolated(self, texels: Array) -> Array:
        """What the filter makes of them in each slice, (S, P)."""
        found = np.empty(self.share.shape)
        for part in self._parts():
            for row, index in zip(found, self.index):
                row[part] = np.einsum("tp,tp->p", self.weight[:, part], texels.take(index[:, part]))
        return found

    def spread(self, shares: Array, squared: bool = False) -> Array:
        """The transpose of `interpolated`, of (S, P), or of its square: for all texels."""
        found = np.zeros(self.texels)
        for part in self._parts():
            weight = self.weight[:, part]
            weight = weight * weight if squared else weight
            for index, row in zip(self.index, shares):
                found += np.bincount(index[:, part].reshape(-1), (weight * row[part]).reshape(-1), self.texels)
        return found

    def _parts(self) -> list[slice]:
        """Of the pairs, so many that a processor keeps what is made of them near: a third of the time."""
        return [slice(start, start + _AT_ONCE) for start in range(0, self.share.shape[1], _AT_ONCE)]


def _continuation(grid: Grid) -> tuple[Array, Array]:
    """Of each texel of the continued table the one that it repeats, and whether it does so beyond a pole."""
    copies = np.arange(int(np.prod(grid.shape))).reshape(grid.shape)
    turned = np.zeros(grid.shape, bool)
    for axis, (n, ends) in enumerate(zip(grid.shape, ((0, 1), (GUTTER, GUTTER), (GUTTER, GUTTER)))):
        boundary = grid.boundaries[axis]
        places = np.pad(np.arange(n), ends, PAD_MODES.get(boundary, "edge"))  # type: ignore[call-overload]
        beyond = np.arange(len(places)) - ends[0] >= n
        if boundary == "pole":
            places[beyond] = n - 2
        copies, turned = np.take(copies, places, axis), np.take(turned, places, axis)
        if boundary == "pole":
            turned ^= beyond.reshape([-1 if k == axis else 1 for k in range(3)])
    return copies.reshape(-1), np.flatnonzero(turned)


@dataclass(frozen=True)
class _Fit:
    """One channel's codes: what pairs are to read (P,), the roots of their weights, and the codes of the samples."""

    reading: Reading
    truth: Array
    root: Array
    first: Array
    range_: float
    gain: float

    @cached_property
    def stay(self) -> float:
        """Of the whole squared signal, shared out: a code that moves by 1 may cost so much."""
        return _STAY * float(np.sum((self.root * self.truth) ** 2)) / len(self.first)

    def codes(self) -> Array:
        """Codes (K,) of least sum, from those of the samples."""
        codes, (least, rest, grown) = self.first, self._measured(self.first)
        for _ in range(_STEPS):
            step = self._step(self.reading.share * grown * (self.gain * self.range_) * self.root, rest, codes)
            for shortened in _SHORTER:
                trial = np.clip(codes + shortened * step, 0, 1)
                found = self._measured(trial)
                if found[0] < least:
                    codes, (least, rest, grown) = trial, found
                    break
            else:
                break
        return codes

    def _measured(self, codes: Array) -> tuple[float, Array, Array]:
        """The sum, the weighted differences (P,), and exp(range y_s), (S, P)."""
        values = self.reading.continued(self.gain * np.expm1(self.range_ * codes))
        texels = np.minimum(np.log1p(values / self.gain) / self.range_, 1)
        grown = np.exp(self.range_ * self.reading.interpolated(texels))
        rest = self.root * ((self.reading.share * self.gain * (grown - 1)).sum(0) - self.truth)
        return float(rest @ rest + self.stay * np.sum((codes - self.first) ** 2)), rest, grown

    def _step(self, slope: Array, rest: Array, codes: Array) -> Array:
        """The step (K,) that J'J d + stay d = -(J'rest + stay (codes - first)) has; J reads, times `slope` (S, P)."""
        reading = self.reading

        def product(codes: Array) -> Array:
            return (slope * reading.interpolated(reading.moved(codes))).sum(0)

        def transposed(differences: Array) -> Array:
            return reading.gathered(reading.spread(slope * differences))

        diagonal = reading.counted(reading.spread(slope * slope, squared=True)) + self.stay
        residual = -(transposed(rest) + self.stay * (codes - self.first))
        step = np.zeros(len(codes))
        direction = ready = residual / diagonal
        old = residual @ ready
        for _ in range(_GRADIENTS):
            result = transposed(product(direction)) + self.stay * direction
            length = old / max(float(direction @ result), 1e-300)
            step, residual = step + length * direction, residual - length * result
            ready = residual / diagonal
            new = residual @ ready
            direction, old = ready + new / max(old, 1e-300) * direction, new
        return step
