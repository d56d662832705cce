"""Random fields and cells on the unit square that repeat with period 1."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Generator = np.random.Generator


def smooth_noise(rng: Generator, side: int, feature: float) -> Array:
    """Gaussian field (side, side) of mean 0 and deviation 1 with features of one size, in tiles."""
    radius = _frequencies(side)
    return _shaped(rng, side, np.exp(-((radius * feature) ** 2)))


def fractal_noise(rng: Generator, side: int, largest: float, slope: float = 2.0) -> Array:
    """Gaussian field (side, side) of mean 0 and deviation 1 with amplitude f^-slope below the size `largest`."""
    radius = _frequencies(side)
    return _shaped(rng, side, np.maximum(radius, 1 / largest) ** -slope)


def sample(values: Array, u: Array, v: Array) -> Array:
    """Bilinear look-up of a periodic field (side, side, ...) at u, v; values[j, i] lies at (i, j) / side."""
    side = len(values)
    column, row = np.floor(u * side).astype(int), np.floor(v * side).astype(int)
    s, t = u * side - column, v * side - row
    if values.ndim > 2:
        s, t = s[..., None], t[..., None]
    left, right, low, high = column % side, (column + 1) % side, row % side, (row + 1) % side
    return (1 - t) * ((1 - s) * values[low, left] + s * values[low, right]) + t * (
        (1 - s) * values[high, left] + s * values[high, right]
    )


class Cells(NamedTuple):
    """Voronoi cells of jittered points, looked up at places (...).

    index : of the cell; offset : (..., 2) from its point; nearest, second : distances to the closest two points
    """

    index: NDArray[np.int64]
    offset: Array
    nearest: Array
    second: Array


def voronoi(rng: Generator, count: int, u: Array, v: Array) -> Cells:
    """The cells of count x count points, one in every square of a periodic grid, at (u, v)."""
    nearest, second = np.full(u.shape, np.inf), np.full(u.shape, np.inf)
    index, offset = np.zeros(u.shape, np.int64), np.zeros((*u.shape, 2))
    for number, away in _neighbours(rng, count, u, v):
        distance = np.hypot(away[..., 0], away[..., 1])
        closer = distance < nearest
        second = np.where(closer, nearest, np.minimum(second, distance))
        nearest = np.where(closer, distance, nearest)
        index = np.where(closer, number, index)
        offset = np.where(closer[..., None], away, offset)
    return Cells(index, offset / count, nearest / count, second / count)


def domes(rng: Generator, count: int, u: Array, v: Array, sharpness: float) -> Array:
    """Paraboloids -d^2 over the cells of `voronoi`, d in grid squares, joined in rounded grooves."""
    total = np.zeros(u.shape)
    for _, away in _neighbours(rng, count, u, v):
        total += np.exp(-sharpness * (away**2).sum(-1))
    return np.log(total) / sharpness


def _neighbours(rng: Generator, count: int, u: Array, v: Array) -> Iterator[tuple[NDArray[np.int64], Array]]:
    """Number of a jittered point and the way from it to (u, v) in grid squares, for the 25 squares around."""
    points = (np.stack(np.meshgrid(np.arange(count), np.arange(count)), -1) + 0.5).astype(float)
    points += 0.9 * (rng.random(points.shape) - 0.5)
    place = np.stack([u, v], -1) * count
    base = np.floor(place).astype(int)
    # With this jitter the two closest points lie at most two squares away.
    for step in np.stack(np.meshgrid(np.arange(-2, 3), np.arange(-2, 3)), -1).reshape(-1, 2):
        square = base + step
        wrapped = square % count
        point = points[wrapped[..., 1], wrapped[..., 0]] + square - wrapped
        yield wrapped[..., 1] * count + wrapped[..., 0], place - point


def grid(side: int) -> tuple[Array, Array]:
    """u, v of the texels (side, side) of a periodic field, row j at v = j / side."""
    u, v = np.meshgrid(np.arange(side) / side, np.arange(side) / side)
    return u, v


def _frequencies(side: int) -> Array:
    frequency = np.fft.fftfreq(side, 1 / side)
    return np.hypot(frequency[:, None], frequency[None, :])


def _shaped(rng: Generator, side: int, gain: Array) -> Array:
    gain = gain.copy()
    gain[0, 0] = 0
    shaped = np.fft.ifft2(np.fft.fft2(rng.standard_normal((side, side))) * gain).real
    return shaped / shaped.std()
