"""Coefficients >= 0 of a cubic B-spline table whose values come close to the samples.

Mallett & Yuksel 2016 use the samples themselves as coefficients ("plain"), which smooths. The coefficients that
reproduce the samples exactly ring and turn negative on glossy data. Between the two lies the least-squares fit under
the constraint of being >= 0; a spline with such coefficients is nowhere negative and can be stored as RGBE.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..source import Array
from .grids.grid import Grid
from .padding import continued

# By the number of axes.
_ITERATIONS = {3: 30, 4: 54}


def sample_spline(grid: Grid, coefficients: Array) -> Array:
    """Values (*grid.shape, 3) of the spline at its own nodes, with the ends continued as `padding.pad_slices` does."""
    values = coefficients
    for axis in reversed(range(len(grid.shape))):
        padded = continued(grid, values, axis, 1, 1)
        low, middle, high = (np.take(padded, range(k, k + values.shape[axis]), axis) for k in range(3))
        values = (low + 4 * middle + high) * np.float32(1 / 6)
    return values


def fit_coefficients(grid: Grid, samples: Array, progress: Callable[[float], None] | None = None) -> Array:
    """Non-negative coefficients, float32, whose spline is close to the samples (*grid.shape, 3) >= 0.

    Projected gradient descent with Nesterov's constant momentum on c B c / 2 - c f, where B samples the spline: its
    eigenvalues lie between 3^-d and 1 for d axes, so that the step is 1 and these iterations reach 1e-5 of the peak.
    Where no coefficient is held at 0 the spline then meets the samples.
    """
    root = 3 ** (len(grid.shape) / 2)
    iterations, momentum = _ITERATIONS[len(grid.shape)], np.float32((root - 1) / (root + 1))
    samples = samples.astype(np.float32)
    coefficients = ahead = samples.copy()
    for k in range(iterations):
        previous = coefficients
        coefficients = np.maximum(ahead + samples - sample_spline(grid, ahead), 0)
        ahead = coefficients + momentum * (coefficients - previous)
        if progress:
            progress((k + 1) / iterations)
    return coefficients
