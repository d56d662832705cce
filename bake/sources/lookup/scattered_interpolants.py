"""Interpolants of scattered samples: a polyharmonic smoothing spline and a kernel regression, of any dimension."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ...source import Array

_NEIGHBOURS = 4
_CACHE_ROWS = 128  # twice as fast as rows that overflow the cache


def squared_distance(x: Array, centres: Array) -> Array:
    """Of points (Q, K) and (N, K): (Q, N), by |x|^2 - 2 x.c + |c|^2 as one matrix product."""
    left = np.column_stack([x, (x**2).sum(-1), np.ones(len(x))])
    right = np.column_stack([-2 * centres, np.ones(len(centres)), (centres**2).sum(-1)])
    d2 = left @ right.T
    return np.maximum(d2, 0, out=d2)


class Interpolant(Protocol):
    """(n, K) coordinates to (n, C) values."""

    def __call__(self, x: Array) -> Array: ...


@dataclass(frozen=True)
class Spline:
    """r^3 with a linear tail (Duchon 1977)."""

    centres: Array  # (N, K), relative to `origin`
    origin: Array
    weights: Array  # (N, C)
    tail: Array  # (K + 1, C)

    def __call__(self, x: Array) -> Array:
        x = x - self.origin
        level: Array = self.tail[0] + x @ self.tail[1:]
        for start in range(0, len(x), _CACHE_ROWS):
            rows = slice(start, start + _CACHE_ROWS)
            cube = squared_distance(x[rows], self.centres)
            cube *= np.sqrt(cube)
            level[rows] += cube @ self.weights
        return level


@dataclass(frozen=True)
class Kernel:
    """Nadaraya 1964, Watson 1964, with a bandwidth per sample."""

    centres: Array  # (N, K)
    rate: Array  # (N,) 1 / (2 bandwidth^2)
    values: Array  # (N, C)

    def __call__(self, x: Array) -> Array:
        exponent = squared_distance(x, self.centres) * self.rate
        exponent = exponent - exponent.min(-1, keepdims=True)  # so that the nearest sample never underflows
        weight = np.exp(-exponent)
        return (weight @ self.values) / weight.sum(-1, keepdims=True)


def spline_matrix(x: Array, smoothing: Array) -> Array:
    """Bordered spline matrix, (N + K + 1, N + K + 1), for coordinates x (N, K) about their mean."""
    n, k = len(x), x.shape[1] + 1
    matrix = np.zeros((n + k, n + k))
    cube = squared_distance(x, x)
    matrix[:n, :n] = cube * np.sqrt(cube)
    matrix[np.arange(n), np.arange(n)] = smoothing
    matrix[:n, n] = matrix[n, :n] = 1
    matrix[:n, n + 1 :] = x
    matrix[n + 1 :, :n] = x.T
    # Samples in one plane leave the tail undetermined; this tiny ridge picks its flattest version.
    matrix[np.arange(n, n + k), np.arange(n, n + k)] = -1e-8
    return matrix


def spline_inverse(x: Array, smoothing: Array) -> Array:
    """Inverse of the bordered spline matrix."""
    return np.linalg.inv(spline_matrix(x, smoothing))


def spline_fit(x: Array, y: Array, smoothing: Array) -> Spline:
    """The spline through samples y (N, C) at coordinates x (N, K). Raises LinAlgError."""
    origin = x.mean(0)
    matrix = spline_matrix(x - origin, smoothing)
    right = np.zeros((len(matrix), y.shape[1]))
    right[: len(x)] = y
    solved = np.linalg.solve(matrix, right)
    return Spline(x - origin, origin, solved[: len(x)], solved[len(x) :])


def kernel_fit(x: Array, y: Array) -> tuple[Kernel, Array]:
    """Kernel regression and its leave-one-out predictions; a bandwidth reaches the fourth neighbour."""
    d2 = squared_distance(x, x)
    np.fill_diagonal(d2, np.inf)
    reach = np.partition(d2, _NEIGHBOURS - 1, axis=0)[_NEIGHBOURS - 1]
    rate = 2.0 / np.maximum(reach, 1e-9)
    exponent = d2 * rate
    exponent -= exponent.min(-1, keepdims=True)
    weight = np.exp(-exponent)
    left_out = (weight @ y) / weight.sum(-1, keepdims=True)
    return Kernel(x, rate, y), left_out


def spread_subset(x: Array, count: int) -> Array:
    """Indices of `count` points by farthest-point sampling from the first; deterministic, keeps the peak."""
    chosen = np.zeros(count, dtype=int)
    d2 = ((x - x[0]) ** 2).sum(-1)
    for k in range(1, count):
        chosen[k] = np.argmax(d2)
        d2 = np.minimum(d2, ((x - x[chosen[k]]) ** 2).sum(-1))
    return np.sort(chosen)
