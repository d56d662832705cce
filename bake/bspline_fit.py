"""Coefficients >= 0 of a cubic B-spline table whose values come close to the samples.

Mallett & Yuksel 2016 use the samples themselves as coefficients ("plain"), which smooths. The coefficients that
reproduce the samples exactly ring and turn negative on glossy data. Between the two lies the least-squares fit under
the constraint of being >= 0; a spline with such coefficients is nowhere negative and can be stored as RGBE.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .source import Array

_ITERATIONS = 60


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
        before, after = values[:, :1], values[:, -2:-1, ::-1]
    else:
        before, after = values[:1], values[-2:-1, :, ::-1]
    padded = np.concatenate([before, values, after], axis)
    n = values.shape[axis]
    low, middle, high = (np.take(padded, range(k, k + n), axis) for k in range(3))
    out: Array = (low + 4 * middle + high) * np.float32(1 / 6)
    return out


def fit_coefficients(samples: Array, progress: Callable[[float], None] | None = None) -> Array:
    """Non-negative coefficients, float32, whose spline is close to the samples (N, N, 2N, 3) >= 0.

    Image-space reconstruction by multiplicative updates (Daube-Witherspoon & Muehllehner 1986, ISRA): the fixed
    point is the constrained least-squares solution, every step keeps the sign, and a sample of 0 beside a peak pulls
    its neighbours to 0 instead of below. The kernel is its own transpose but for the ends, where the difference is a
    weight that cancels in the ratio.
    """
    samples = samples.astype(np.float32)
    target = sample_spline(samples)
    coefficients = samples.copy()
    for k in range(_ITERATIONS):
        model = sample_spline(sample_spline(coefficients))
        coefficients *= np.divide(target, model, out=np.zeros_like(target), where=model > 0)
        if progress:
            progress((k + 1) / _ITERATIONS)
    return coefficients
