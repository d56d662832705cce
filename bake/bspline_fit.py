"""Coefficients >= 0 of a cubic B-spline table whose values come close to the samples.

Mallett & Yuksel 2016 use the samples themselves as coefficients ("plain"), which smooths. The coefficients that
reproduce the samples exactly ring and turn negative on glossy data. Between the two lies the least-squares fit under
the constraint of being >= 0; a spline with such coefficients is nowhere negative and can be stored as RGBE.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .source import Array
from .table import beyond_pole

_ITERATIONS = 30
_MOMENTUM = np.float32((27**0.5 - 1) / (27**0.5 + 1))


def sample_spline(coefficients: Array) -> Array:
    """Values (N, N, 2N, 3) of the spline at its own nodes, with the ends continued as `table.pad_slices` does."""
    values = coefficients
    for axis in (2, 1, 0):
        values = _along(values, axis)
    return values


def _along(values: Array, axis: int) -> Array:
    """The kernel (1, 4, 1) / 6 along one axis."""
    if axis == 2:
        before, after = values[:, :, 1:2], values[:, :, -2:-1]
    elif axis == 1:
        before, after = values[:, :1], beyond_pole(values[:, -2:-1])
    else:
        before, after = values[:1], beyond_pole(values[-2:-1])
    padded = np.concatenate([before, values, after], axis)
    n = values.shape[axis]
    low, middle, high = (np.take(padded, range(k, k + n), axis) for k in range(3))
    out: Array = (low + 4 * middle + high) * np.float32(1 / 6)
    return out


def fit_coefficients(samples: Array, progress: Callable[[float], None] | None = None) -> Array:
    """Non-negative coefficients, float32, whose spline is close to the samples (N, N, 2N, 3) >= 0.

    Projected gradient descent with Nesterov's constant momentum on c B c / 2 - c f, where B samples the spline: its
    eigenvalues lie between 1/27 and 1, so that the step is 1 and thirty iterations reach 1e-5 of the peak. Where
    no coefficient is held at 0 the spline then meets the samples.
    """
    samples = samples.astype(np.float32)
    coefficients = ahead = samples.copy()
    for k in range(_ITERATIONS):
        previous = coefficients
        coefficients = np.maximum(ahead + samples - sample_spline(ahead), 0)
        ahead = coefficients + _MOMENTUM * (coefficients - previous)
        if progress:
            progress((k + 1) / _ITERATIONS)
    return coefficients
