"""How far a four-dimensional table is from its source, at directions that were not used to build it."""

from __future__ import annotations

import itertools

import numpy as np

from ..accuracy import DirectionPairs, direction_pairs
from ..source import Array, BrdfSource
from .grid import Grid

_GOLDEN = 0.6180339887498949


def turned_pairs(count: int, offset: float = 0.5) -> DirectionPairs:
    """The pairs of `bake.accuracy.direction_pairs`, each turned about the normal by an angle of its own."""
    pairs = direction_pairs(count, offset)
    phi = 2 * np.pi * ((offset + np.arange(len(pairs.wi)) * _GOLDEN) % 1)
    cosine, sine = np.cos(phi), np.sin(phi)

    def turn(w: Array) -> Array:
        return np.stack([cosine * w[:, 0] - sine * w[:, 1], sine * w[:, 0] + cosine * w[:, 1], w[:, 2]], -1)

    return DirectionPairs(turn(pairs.wi), turn(pairs.wo), pairs.weight)


def quadrilinear_estimate(source: BrdfSource, grid: Grid, pairs: DirectionPairs) -> Array:
    """What a quadrilinear table on this grid would return at the pairs, (P, 3), without building it."""
    from .. import xp_numpy

    sizes = grid.shape
    position = grid.coordinates(xp_numpy, pairs.wi, pairs.wo)
    wraps = (True, False, False, grid.periodic_columns)
    base = [np.floor(p) if w else np.minimum(np.floor(p), n - 2) for p, n, w in zip(position, sizes, wraps)]
    total = np.zeros(pairs.wi.shape)
    for corner in itertools.product((0, 1), repeat=4):
        weight = np.ones(len(total))
        index = []
        for p, b, n, w, k in zip(position, base, sizes, wraps, corner):
            weight = weight * (p - b if k else 1 - (p - b))
            whole = (b + k).astype(np.intp)
            index.append(whole % n if w else whole)
        wi, wo = grid.directions(*index)
        total += source.evaluate(wi, wo) * (weight * np.ones(len(total)) * grid.factor(xp_numpy, wi, wo))[:, None]
    return total / np.reshape(grid.factor(xp_numpy, pairs.wi, pairs.wo), (-1, 1))
