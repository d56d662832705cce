"""Inverses of cumulative distributions as tables that one look-up answers, with no search.

The distribution is even over cells, and equal over runs of cells that join into pieces. Its inverse is then a broken
line over the random number. A table of equal strata of that number can hold it if no stratum has more than one corner,
which is so if no piece is less probable than a stratum: cells of less are joined, so that the variance grows least (the
table is the guide of Chen and Asau 1974, made so fine that what is left of their search is one comparison). An entry
holds

    the corner, as the whole number of its cell plus the probability before it, and the line's slope on either side.

The inverse is continuous, its slope is the reciprocal of the density to the last digit, and cells of no probability at
either end are never drawn.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..source import Array

# Probabilities before a corner are multiples of this: float32 holds them behind whole numbers below 64.
STEP = 2.0**-18
MOST_CELLS = 63
BELOW_ONE = 1 - 2.0**-24


def joined(weights: Array, strata: int) -> tuple[Array, Array]:
    """Probabilities in proportion to weights, but joined into pieces that are no less probable than a stratum.

    Where a density is even over a piece, the variance is least if its probability goes with sqrt(cells sum(w^2)), and
    all of it with the square of the sum of these roots; which cells join is found by dynamic programming.

    Parameters
    ----------
    weights : (R, n) of the cells, not negative; a row of zeros stands for even ones

    Returns
    -------
    probabilities (R, n) of cells, multiples of a piece's; and the sum of the roots (R,) in the units of the weights
    """
    w = np.where(weights.any(1, keepdims=True), weights, 1.0)
    roots = w.sum(1)
    for _ in range(2):  # what is least goes by the sum of the roots, which is known only then
        pieces, roots = _pieces(w, (1 / strata + 4 * STEP) * roots)
    probability = np.zeros(w.shape)
    for row, (edges, values) in enumerate(zip(pieces, w)):
        lengths = np.diff(edges)
        squares = np.add.reduceat(values * values, edges[:-1])  # the last goes on into zeros
        mass = _at_least(np.sqrt(lengths * squares), 1 / strata + 2 * STEP)
        probability[row, edges[0] : edges[-1]] = np.repeat(mass / lengths, lengths)
    return probability, np.where(weights.any(1), roots, 0)


def _pieces(w: Array, least: Array) -> tuple[list[list[int]], Array]:
    """Edges of the pieces of each row (R, n), none of whose roots is below `least` (R,), and the least sum of roots."""
    rows, n = w.shape
    first = (w > 0).argmax(1)
    end = n - (w[:, ::-1] > 0).argmax(1)
    squares = np.concatenate([np.zeros((rows, 1)), np.cumsum(w * w, 1)], 1)
    best = np.full((rows, n + 1), np.inf)
    best[np.arange(rows), first] = 0
    begin = np.zeros((rows, n + 1), np.intp)
    for stop in range(1, n + 1):
        lengths = stop - np.arange(stop)
        root = np.sqrt(lengths * np.maximum(squares[:, stop : stop + 1] - squares[:, :stop], 0))
        enough = (root >= least[:, None]) | ((np.arange(stop) == first[:, None]) & (stop == end)[:, None])
        total = best[:, :stop] + np.where(enough, root, np.inf)
        begin[:, stop] = total.argmin(1)
        best[:, stop] = np.minimum(best[:, stop], total.min(1))
    edges = []
    for row in range(rows):
        found = [int(end[row])]
        while found[-1] > first[row]:
            found.append(int(begin[row, found[-1]]))
        edges.append(found[::-1])
    return edges, best[np.arange(rows), end]


def _at_least(weights: Array, least: float) -> Array:
    """Probabilities in proportion to weights, but none below `least`; multiples of STEP."""
    low = np.zeros(len(weights), bool)
    p = weights / weights.sum()
    while (p[~low] < least).any():
        low |= p < least
        if low.all():
            p = np.full(len(p), 1 / len(p))
            break
        p = np.where(low, least, weights * ((1 - least * low.sum()) / weights[~low].sum()))
    edges = np.rint(np.concatenate([[0.0], np.cumsum(p)]) / STEP) * STEP
    edges[-1] = 1
    return np.diff(edges)


def inverse_table(probability: Array, strata: int) -> Array:
    """Entries (R, strata, 3) of the inverses of distributions (R, n) that `joined` has made."""
    table = np.zeros((len(probability), strata, 3))
    for row, p in enumerate(probability):
        held = np.flatnonzero(p)
        corners = np.append(held[0] + np.flatnonzero(np.diff(p[held[0] : held[-1] + 1], prepend=-1.0)), held[-1] + 1)
        before = np.rint(np.append(0.0, np.cumsum(p))[corners] / STEP) * STEP
        slopes = np.diff(corners) / np.diff(before)
        at = np.searchsorted(before[1:-1], (np.arange(strata) + 1) / strata, "left")
        table[row, :, 0] = corners[at] + before[at]
        table[row, :, 1] = slopes[np.maximum(at - 1, 0)]
        table[row, :, 2] = slopes[at]
    return table


def stratum(xp: Any, u: Any, strata: int) -> Any:
    """Entry for a random number; these include 1, which is held inside by the last digit of a float32."""
    return xp.floor(u * (strata * BELOW_ONE))


def inverted(xp: Any, u: Any, entry: Any) -> Any:
    """Place in cells, counted from the first one's edge, for the entry of `stratum`."""
    corner, left, right = xp.components(entry)
    cell = xp.floor(corner)
    beyond = u - (corner - cell)
    return beyond * xp.where(beyond > 0, right, left) + cell
