"""A power law in place of the slices of a shading map: two numbers per texel and channel.

Kautz, Sattler, Sarlette, Klein & Seidel 2004, *Decoupling BRDFs from Surface Mesostructures*, the section on
compression: S(x) ~ k x^K with x = r / a_max and k the last slice. The paper finds K by brute force; `fit` finds
the same K by Newton's method from a coarse search, and can free k as well.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import BakeError

EXPONENT_BOUNDS = (0.05, 20.0)
BRUTE_FORCE_CANDIDATES = 512

_START_CANDIDATES = 64
_NEWTON_STEPS = 3
_GOLDEN_STEPS = 14
_BLOCK = 8192  # texels whose slices stay in the cache together
_GOLDEN = (math.sqrt(5) - 1) / 2

_F32 = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class PowerLaw:
    """S(x) ~ k x^exponent.

    Attributes
    ----------
    k : (H, W, C) float32 >= 0, the value at x = 1, relative to a_max
    exponent : (H, W, C) float32 within the bounds of the fit; 1 where k is 0
    """

    k: _F32
    exponent: _F32

    def evaluate(self, x: ArrayLike) -> _F32:
        """S(x) relative to a_max; x = r / a_max broadcasts against (H, W, C). Goes on above 1, is 0 from 0 down."""
        x = np.asarray(x, np.float32)
        lit = x > 0
        power = np.exp(np.log(np.where(lit, x, np.float32(1))) * self.exponent)
        return np.asarray(np.where(lit, self.k * power, np.float32(0)), np.float32)

    def rms(self, slices: NDArray[Any]) -> float:
        """`rms_error` against the slices."""
        return rms_error(slices, self.evaluate)


def fit(slices: NDArray[Any], *, free_k: bool = False, bounds: tuple[float, float] = EXPONENT_BOUNDS) -> PowerLaw:
    """Least-squares power law of each texel and channel.

    Parameters
    ----------
    slices : (N, H, W, C), slice i at x = i / (N - 1), slice 0 black, relative to a_max
    free_k : least squares in k too; otherwise k is the last slice, as in the paper
    bounds : of the exponent

    The error is measured at 64 exponents in one matrix product, which rules out false minima of data that
    is no power law at all; from the best, Newton steps kept between its neighbours converge to rounding. With
    free k the exponent alone is searched, since the best k of a given one is (S . b) / (b . b), b = x^K
    (variable projection). Raises BakeError.
    """
    candidates = _candidates(bounds, _START_CANDIDATES)
    with np.errstate(all="ignore"):  # a step that is not finite is replaced by a bisection
        return _fit_by(_newton, slices, candidates, free_k)


def fit_brute_force(
    slices: NDArray[Any],
    *,
    free_k: bool = False,
    bounds: tuple[float, float] = EXPONENT_BOUNDS,
    candidates: int = BRUTE_FORCE_CANDIDATES,
) -> PowerLaw:
    """Fit a power law by trying many exponents at each texel and refining the best, as the paper does.

    The candidates are evenly spaced in log K, by default 1.2 % apart; a golden-section search between the
    neighbours of the best one refines it. Kept as the truth that `fit` is measured against. Raises BakeError.
    """
    with np.errstate(under="ignore"):
        return _fit_by(_search, slices, _candidates(bounds, candidates), free_k)


def _fit_by(find: Callable[..., _F32], slices: NDArray[Any], candidates: Any, free_k: bool) -> PowerLaw:
    """Exponents by `find`, block by block, and the k that belongs to each."""
    slices = check_slices(slices)
    log_x = _log_x(len(slices))
    flat = slices.reshape(len(slices), -1)
    exponent, k = np.ones(flat.shape[1], np.float32), np.empty(flat.shape[1], np.float32)
    for start in range(0, flat.shape[1], _BLOCK):
        block = np.ascontiguousarray(flat[1:, start : start + _BLOCK], np.float32)
        here = slice(start, start + _BLOCK)
        if len(block) > 1:
            exponent[here] = find(block, log_x, candidates, free_k)
        k[here] = _best_k(block, np.exp(log_x * exponent[here])) if free_k else np.maximum(block[-1], 0)
    return _power_law(k, exponent, slices.shape[1:])


def check_slices(slices: NDArray[Any]) -> NDArray[Any]:
    """The slices as an array, refused unless (N >= 2, H, W, C) and finite in float32. Raises BakeError."""
    try:
        slices = np.asarray(slices)
        if slices.dtype.kind not in "fiub":
            raise TypeError
    except (TypeError, ValueError) as error:
        raise BakeError("slices", "are not an array of numbers", "give (N, H, W, C) float32") from error
    if slices.ndim != 4 or len(slices) < 2 or not slices.size:
        raise BakeError("slices", f"have shape {slices.shape}", "give (N, H, W, C) with N of at least 2")
    limit = np.finfo(np.float32).max
    for number, one in enumerate(slices):
        if not (np.abs(one) <= limit).all():  # false for NaN too
            raise BakeError("slices", f"hold values that are not finite (slice {number})", "fix the photographs")
    return slices


def rms_error(slices: NDArray[Any], evaluate: Any) -> float:
    """Root mean square of evaluate(x_i) - S_i over all slices, texels and channels, slice 0 included.

    In the unit of the slices, which is a_max; divided by the largest value of the slices it is relative to
    the display range of images that are just not clipped.
    """
    slices = check_slices(slices)
    last = len(slices) - 1
    total = 0.0
    for number, one in enumerate(slices):
        total += float(np.square(evaluate(number / last).astype(np.float64) - one).sum())
    return math.sqrt(total / slices.size)


def _log_x(n: int) -> _F32:
    """(N - 1, 1) logarithms of x_1 to x_N-1."""
    return np.log(np.arange(1, n) / (n - 1)).astype(np.float32)[:, None]


def _candidates(bounds: tuple[float, float], count: int) -> _F32:
    low, high = (float(bound) for bound in bounds)
    if not 1e-3 <= low < high <= 1e3:
        raise BakeError("exponent bounds", f"are {low:g} and {high:g}", "give two rising numbers from 0.001 to 1000")
    if not 2 <= count <= 1 << 16:
        raise BakeError("exponent candidates", f"are {count}", "give from 2 to 65536")
    return np.geomspace(low, high, count).astype(np.float32)


def _newton(block: _F32, log_x: _F32, candidates: _F32, free_k: bool) -> _F32:
    """Exponents of the texels of a block (N - 1, texels) whose last row is the last slice."""
    best = _coarse_cost(log_x, candidates, free_k, block).argmin(axis=1)
    exponent = candidates[best]
    low = candidates[np.maximum(best - 1, 0)]
    high = candidates[np.minimum(best + 1, len(candidates) - 1)]
    one = np.ones_like(log_x)
    # Rows: the sums p = S . b and q = b . b, and their first two derivatives by K, as matrix products.
    of_p = np.ascontiguousarray(np.hstack([one, log_x, log_x**2]).T)
    of_q = np.ascontiguousarray(np.hstack([one, 2 * log_x, 4 * log_x**2]).T)
    slope_of = _free_slope if free_k else _paper_slope
    for _ in range(_NEWTON_STEPS):
        power = np.exp(log_x * exponent)
        p, q = of_p @ (block * power), of_q @ (power * power)
        slope, curvature, safe = slope_of(p, q, block[-1])
        rising = slope > 0
        high = np.where(rising, exponent, high)
        low = np.where(rising, low, exponent)
        # Far from a power law the error can be concave; Gauss-Newton's curvature never is.
        step = exponent - slope / np.where(curvature > 0.1 * safe, curvature, safe)
        inside = (step >= low) & (step <= high)
        exponent = np.where(inside, step, np.where(slope == 0, exponent, 0.5 * (low + high)))
    return exponent


def _coarse_cost(log_x: _F32, candidates: _F32, free_k: bool, block: _F32) -> _F32:
    """(texels, candidates) numbers that rise with the squared error, texel by texel.

    |S - k b|^2 - |S|^2 is k (k q - 2 p) for given k, and -p^2 / q for the best k >= 0.
    """
    power = np.exp(log_x * candidates)
    q = (power * power).sum(axis=0)
    if free_k:
        return np.asarray(block.T @ (-power / np.sqrt(q)))
    weights = -2 * power
    weights[-1] = q - 1  # the last slice is k, and met exactly: left out, it cannot drown the others in rounding
    return np.asarray(block.T @ weights)


def _paper_slope(p: _F32, q: _F32, k: _F32) -> tuple[_F32, _F32, _F32]:
    """First and second derivative by K of (k^2 q - 2 k p) / k, and Gauss-Newton's second."""
    return k * q[1] - 2 * p[1], k * q[2] - 2 * p[2], 0.5 * k * q[2]


def _free_slope(p: _F32, q: _F32, _: _F32) -> tuple[_F32, _F32, _F32]:
    """The same of -p^2 / q, divided by the positive p / q^2."""
    slope = p[0] * q[1] - 2 * p[1] * q[0]
    curvature = p[0] * q[2] - p[1] * q[1] - 2 * p[2] * q[0]
    return slope, curvature, 0.5 * p[0] * (q[2] - q[1] * q[1] / q[0])


def _best_k(block: _F32, power: _F32) -> _F32:
    return np.asarray(np.maximum((block * power).sum(axis=0) / (power * power).sum(axis=0), 0), np.float32)


def _squared_error(block: _F32, power: _F32, free_k: bool) -> _F32:
    k = _best_k(block, power) if free_k else np.maximum(block[-1], 0)
    difference = k * power - block
    return np.asarray((difference * difference).sum(axis=0))


def _search(block: _F32, log_x: _F32, candidates: _F32, free_k: bool) -> _F32:
    least = np.full(block.shape[1], np.inf, np.float32)
    best = np.zeros(block.shape[1], np.intp)
    for number, power in enumerate(np.exp(log_x * candidates).T[:, :, None]):
        error = _squared_error(block, power, free_k)
        better = error < least
        least, best = np.where(better, error, least), np.where(better, number, best)
    low = np.log(candidates[np.maximum(best - 1, 0)])
    high = np.log(candidates[np.minimum(best + 1, len(candidates) - 1)])

    def error_at(log_k: _F32) -> _F32:
        return _squared_error(block, np.exp(log_x * np.exp(log_k)), free_k)

    for _ in range(_GOLDEN_STEPS):
        width = _GOLDEN * (high - low)
        left, right = high - width, low + width
        lower_left = error_at(left) < error_at(right)
        low, high = np.where(lower_left, low, left), np.where(lower_left, right, high)
    refined = np.exp(0.5 * (low + high))
    return np.asarray(np.where(error_at(np.log(refined)) < least, refined, candidates[best]), np.float32)


def _power_law(k: _F32, exponent: _F32, shape: tuple[int, ...]) -> PowerLaw:
    exponent = np.where(k > 0, exponent, np.float32(1))
    return PowerLaw(k.reshape(shape), exponent.reshape(shape))
