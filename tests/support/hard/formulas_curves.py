"""Formulas of Kautz et al. 2004 and of Romanyuk 2007 as printed or commonly coded, beside the product's."""

from __future__ import annotations

import math
from collections.abc import Callable

import mpmath as mp
import numpy as np
from measured_materials.bake import xp_numpy
from measured_materials.bake.lobes.cosine_lobes import cosine_lobe, cubic_coefficients, draw_lobe, half_chord_square
from measured_materials.bake.shading_maps.power_law import fit
from measured_materials.bake.shading_maps.shading_map import averages_of, linearise
from measured_materials.bake.shading_maps.slice_atlas import level_position

from . import truth
from .formula import F32, Array, Formula, dot32, near_pairs, worst


def _brackets() -> tuple[float, float]:
    """Averages of which two lie close together: the two nearest a level are on one side of it."""
    rng = np.random.default_rng(2)
    pattern = rng.uniform(0.5, 1.5, (3, 4, 5, 3))
    pattern /= pattern.mean((1, 2, 3), keepdims=True)
    levels = np.array([0.10, 0.1005, 1.0])
    images = (pattern * levels[:, None, None, None]).astype(F32)
    slices = 6
    made = averages_of(linearise(images, slices).map.slices)
    want = np.linspace(0, 1, slices)
    averages, printed = averages_of(images), []
    for level in want[1:]:
        # Weights by distance, as linear interpolation between the two nearest has them where they bracket.
        low, high = np.argsort(np.abs(averages - level))[:2]
        d = np.abs(averages[[low, high]] - level)
        printed.append(float((averages[low] * d[1] + averages[high] * d[0]) / (d[0] + d[1])))
    return worst(np.array(printed), want[1:]), worst(made, want)


def _last_slice() -> tuple[float, float]:
    """Slices read where r is a_max and an ulp above: base + 1 must exist, and weights sum to the level."""
    count, a_max = 8, F32(0.7)
    r = np.array([np.nextafter(a_max, F32(0)), a_max, np.nextafter(a_max, F32(1)), 2 * a_max, 0], F32)
    x = r / a_max
    position = x * (count - 1)
    slices = np.arange(count) / (count - 1)
    base = np.floor(position).astype(int)
    read = np.where(base + 1 < count, slices[np.minimum(base + 1, count - 1)], np.nan)
    printed = slices[np.minimum(base, count - 1)] * (1 - (position - base)) + read * (position - base)
    base, t = level_position(xp_numpy, count, x)
    ours = slices[base.astype(int)] * (1 - t) + slices[base.astype(int) + 1] * t
    exact = np.minimum(x.astype(float), 1)
    return worst(printed, exact), worst(ours, exact)


def _exponents() -> tuple[float, float]:
    """K of exact power laws, by 100 candidates even in K up to 20 and by the product's search."""
    exponent = np.geomspace(0.06, 18, 60)
    levels = np.linspace(0, 1, 8)
    slices = (levels[:, None] ** exponent)[:, None, :, None].astype(F32)
    candidates = np.linspace(0.05, 20, 100).astype(F32)
    cost = np.stack([((slices - levels[:, None, None, None].astype(F32) ** k) ** 2).sum(0).ravel() for k in candidates])
    found = fit(slices).exponent.ravel()
    return float(np.abs(candidates[cost.argmin(0)] / exponent - 1).max()), float(np.abs(found / exponent - 1).max())


def _log_of_zero() -> tuple[float, float]:
    """K of a texel that is black in one photograph, by logarithms and by least squares of the values."""
    levels = np.linspace(0, 1, 8)[1:]
    slices = np.concatenate([[0], np.where(levels < 0.2, 0, levels**2)])
    with np.errstate(divide="ignore", invalid="ignore"):
        log_s, log_x = np.log(slices[1:].astype(F32)), np.log(levels.astype(F32))
        by_log = np.sum(log_s * log_x) / np.sum(log_x * log_x)
    best = min(np.geomspace(1, 4, 30001), key=lambda k: ((slices[1:] - levels**k) ** 2).sum())
    found = fit(slices[:, None, None, None].astype(F32)).exponent.item()
    return worst(np.array([by_log]), best), worst(np.array([found]), best)


_N = (1.5, 10.0, 256.0, 1e4, 1e6, 1e8)


def _over_n(
    printed: Callable[[Array, float], Array], ours: Callable[[Array, float], Array], name: str
) -> tuple[float, float]:
    """Worst of a peak of 1 over the cubic's or the power's own width and its tail."""
    off = [0.0, 0.0]
    for n in _N:
        p = -math.expm1(-math.log(2) / n)
        u = np.concatenate([[0], np.geomspace(1e-3, 0.999, 60) * p, np.geomspace(1.001 * p, 1, 20)]).astype(F32)
        exact = truth.each(lambda x, n=n: truth.cosine_lobe(name, x, mp.mpf(n)))(u.astype(float))[:, 0]
        with np.errstate(all="ignore"):
            off[0] = max(off[0], worst(printed(u, n), exact))
        off[1] = max(off[1], worst(ours(u, n), exact))
    return off[0], off[1]


def _lobe(name: str) -> Callable[[Array, float], Array]:
    return lambda u, n: np.asarray(cosine_lobe(xp_numpy, name, u, np.full(1, n, F32)))


def _expanded(u: Array, n: float) -> Array:
    """a x^3 + b x^2 + c x in x = cos with its coefficients in float32, and the rational tail."""
    one, two, half, m = (F32(k) for k in (1, 2, 0.5, n))
    q = half ** (one / m)
    a = half * (one - two * q + two * q * q + m * q - m) / (q * q * (q * q - two * q + one))
    b = (half - q) / (q * q - q) - a * (q + one)
    x = one - u
    tail = x / (two * m * (q - x) + two * x)
    return np.where(x > q, ((a * x + b) * x + (one - a - b)) * x, tail)


def _half_width() -> tuple[float, float]:
    n = np.geomspace(1, 1e8, 200).astype(F32)
    exact = truth.each(lambda m: 1 - mp.mpf(0.5) ** (1 / m))(n.astype(float))[:, 0]
    printed = 1 - F32(0.5) ** (F32(1) / n)
    ours = cubic_coefficients(xp_numpy, n)[0]
    return worst(printed / exact, 1.0), worst(ours / exact, 1.0)


def _cosine_of_vectors() -> tuple[float, float]:
    """The lobe of n = 1e4 between vectors: u from the dot product and from the chord."""
    a, b, theta = near_pairs()
    n = F32(1e4)
    exact = np.cos(theta) ** 1e4
    printed = np.maximum(dot32(a, b), F32(0)) ** n
    ours = cosine_lobe(xp_numpy, "power", half_chord_square(xp_numpy, a, b), np.full(1, n))
    return worst(printed, exact), worst(ours, exact)


def _below_one() -> tuple[float, float]:
    """n < 1: the cubic's own conditions solved exactly, against cos^n."""
    off = [0.0, 0.0]
    for n in (0.01, 0.1, 0.3, 0.5, 0.9):
        u = np.linspace(0, 1, 200).astype(F32)
        exact = truth.each(lambda x, n=n: (1 - x) ** mp.mpf(n) if x < 1 else mp.mpf(0))(u.astype(float))[:, 0]
        with mp.workdps(truth.DIGITS):
            k = [float(x) for x in truth.cubic_coefficients(mp.mpf(n))]
            q = float(mp.mpf(0.5) ** (1 / mp.mpf(n)))
        x = 1 - u.astype(float)
        bare = np.where(x > q, ((k[0] * x + k[1]) * x + k[2]) * x, x / (2 * n * (q - x) + 2 * x))
        off = [max(off[0], worst(bare, exact)), max(off[1], worst(_lobe("cubic")(u, n), exact))]
    return off[0], off[1]


def _drawn() -> tuple[float, float]:
    """u by n = 1e4, relative."""
    random, n = np.linspace(0.01, 0.999, 300).astype(F32), F32(1e4)
    exact = truth.each(lambda r: 1 - r ** (1 / (mp.mpf(1e4) + 1)))(random.astype(float))[:, 0]
    printed = 1 - random ** (F32(1) / (n + 1))
    return worst(printed / exact, 1.0), worst(draw_lobe(xp_numpy, "power", random, n) / exact, 1.0)


def _schlick() -> Callable[[Array, float], Array]:
    def value(u: Array, n: float) -> Array:
        c, m = 1 - u, F32(n)
        return c / (m - m * c + c)

    return value


FORMULAS = (
    Formula(
        "Kautz et al. 2004, equation 1",
        "slices by interpolation",
        "the two nearest photographs",
        "the two that bracket the level, black being one",
        "two averages 0.5 % apart, one far above",
        "of a_max",
        1e-6,
        _brackets,
    ),
    Formula(
        "Kautz et al. 2004, lookup with r",
        "slices around r / a_max (N - 1)",
        "floor and floor + 1",
        "r held to a_max, the lower slice to N - 2",
        "r at a_max and an ulp beside, 2 a_max",
        "of a_max",
        1e-6,
        _last_slice,
    ),
    Formula(
        "Kautz et al. 2004, compression",
        "K by brute force",
        "the best of 100 even steps to 20",
        "64 steps even in log K, then Newton between its neighbours",
        "K from 0.06 to 18, exact laws",
        "relative",
        1e-5,
        _exponents,
    ),
    Formula(
        "beside Kautz et al. 2004, compression",
        "K of a texel black in one photograph",
        "straight line through log S over log r",
        "least squares of S itself",
        "a shadow below 0.2 a_max",
        "K",
        1e-3,
        _log_of_zero,
    ),
    Formula(
        "Romanyuk 2007, coefficients",
        "the cubic's a, b, c",
        "in powers of cos, growing as n^2",
        "about cos = 1, in parts of p",
        "n from 1.5 to 1e8",
        "of a peak of 1",
        1e-6,
        lambda: _over_n(_expanded, _lobe("cubic"), "cubic"),
    ),
    Formula(
        "Romanyuk 2007, half width",
        "p = 1 - q, q = 0.5^(1/n)",
        "1 - 0.5^(1/n)",
        "2 tanh(y) / (1 + tanh(y)), y = ln 2 / 2n",
        "n from 1 to 1e8",
        "relative",
        1e-6,
        _half_width,
    ),
    Formula(
        "Romanyuk 2007, cos^n",
        "cos^n of an angle given by u = 1 - cos",
        "pow(1 - u, n)",
        "the base's rounding taken out again",
        "n from 1.5 to 1e8",
        "of a peak of 1",
        1e-6,
        lambda: _over_n(lambda u, n: (1 - u) ** F32(n), _lobe("power"), "power"),
    ),
    Formula(
        "Romanyuk 2007, N . H",
        "cos^n between vectors",
        "pow(N . H, n)",
        "u = |N - H|^2 / 2",
        "n = 1e4, 1e-5 to 1 rad",
        "of a peak of 1",
        1e-5,
        _cosine_of_vectors,
    ),
    Formula(
        "Schlick 1994, rival of Romanyuk 2007",
        "c / (n - n c + c)",
        "n - n c + c",
        "n u + c",
        "n from 1.5 to 1e8",
        "of a peak of 1",
        1e-6,
        lambda: _over_n(_schlick(), _lobe("schlick"), "schlick"),
    ),
    Formula(
        "Romanyuk 2007, exponents below 1",
        "the cubic for n < 1",
        "the cubic itself",
        "the power",
        "n from 0.01 to 0.9",
        "of a peak of 1",
        1e-6,
        _below_one,
    ),
    Formula(
        "beside Romanyuk 2007, sampling cos^n",
        "u of a random number",
        "1 - random^(1 / (n + 1))",
        "2 t / (1 + t), t = tanh(-log(random) / (2 n + 2))",
        "n = 1e4",
        "relative",
        1e-6,
        _drawn,
    ),
)
