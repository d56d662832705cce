"""cos^n of an angle and four cheaper curves of its shape, from the chord: Romanyuk 2007 and its rivals.

A lobe is a function of u = 1 - cos x = |a - b|^2 / 2, x being the angle between two unit vectors, and of the exponent
n > 0. It is 1 at u = 0, never negative, and 0 from u = 1 (90 degrees) on. Formulas take `xp`, numpy's or the nodes'
namespace. From u nothing is lost near the peak, where 1 - u has no digits left of an angle below sqrt(2^-24).

power    (1 - u)^n (Phong 1975; Blinn 1977). The base is rounded to 1 - u + e; e is known exactly, and taken out again.
schlick  c / (n - n c + c), c = 1 - u (Schlick 1994, "A fast alternative to Phong's specular model").
lyon     (1 - n u / k)^k, k = 4 (Lyon 1993, Apple TR 43: the exponential's product, cut after k factors).
cosine   cos^k(sqrt(n / k) x), k = 4: of the same curvature at the peak.
cubic    A cubic in c down to the half value and beyond it a rational tail (Romanyuk 2007, "Approximation of BRDF with
         3-degree polynomial"). See `cubic_coefficients`. Below n = 1, where it is wrong by 0.2 and more, the power.

"schlick" and the tail of "cubic" fall off as 1 / (n u): they reflect far more beside the highlight than cos^n does,
hence `lobe_norm`, a factor for each.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from .. import xp_numpy
from ..source import Array

COSINE_LOBES = ("power", "schlick", "lyon", "cosine", "cubic")
# Those whose tails are too heavy to be drawn by cos^n.
HEAVY = ("schlick", "cubic")
FACTORS = 4  # k of "lyon" and "cosine"
# The coefficients of the cubic at n = infinity.
_LIMIT = (math.log(2), 0.5, 0.5 - 0.5 * math.log(2))
_LEAST_RANDOM = 2.0**-126
_POINTS, _WEIGHTS = (0.5 * (a + b) for a, b in zip(np.polynomial.legendre.leggauss(8), (1.0, 0.0)))


def half_chord_square(xp: Any, a: Any, b: Any) -> Any:
    """u = 1 - a.b of unit vectors, with all digits where they nearly agree."""
    apart = a - b
    return xp.dot(apart, apart) * 0.5


def cosine_lobe(xp: Any, name: str, u: Any, n: Any) -> Any:
    """Value in [0, 1] of one of COSINE_LOBES at u >= 0, with exponent n > 0.

    In float32 correct to a few roundings, but for "power": its logarithm is as large as n u, of which it takes the
    rounding. Where u itself stems from float32 vectors, its error of 1e-7 sqrt(u) counts n times.
    """
    return _VALUES[name](xp, u, n)


def cubic_coefficients(xp: Any, n: Any) -> tuple[Any, Any, Any]:
    """p, g, a of the cubic f = (1 - u)(1 - s (g + a (1 - s))), s = u / p, for n >= 1.

    f(1) = 1 and f(0) = 0 in c = 1 - u; at c = q = 0.5^(1/n), where cos^n is 1 / 2, value and slope are those of cos^n.
    Expanded in powers of c the coefficients grow as n^2 and cancel. About c = 1, and in units of p = 1 - q, they stay
    below 1. p itself is 2 tanh(y) / (1 + tanh(y)), y = ln 2 / (2 n), by a continued fraction whose terms are
    all positive, good to 1e-15.
    """
    y = (0.5 * math.log(2)) / n
    square = y * y
    odd = y * (square * (square * 21 + 1260) + 10395)
    even = square * (square * (square + 210) + 4725) + 10395
    p = 2 * odd / (even + odd)
    q = (even - odd) / (even + odd)
    g = (q - 0.5) / q
    return p, g, (p + (g * (2 * q - 1) - 0.5 * (n * p) / q)) / q


def coefficient_table(size: int = 64) -> Array:
    """Lookup table (size, 3) of n p, g and a, even in 1 / n from 0 to 1: what `tabulated_coefficients` reads.

    Romanyuk 2007 advises a table over n. The coefficients are nearly linear in 1 / n, so that a few rows reach from 1
    to infinity: 64 are wrong by 1e-5 of the peak at most. Linear in n, a table of 256 rows is wrong by 4e-2 between its
    first whole numbers, and ends (`bench lobes`).
    """
    inverse = np.linspace(0, 1, size)[1:]
    p, g, a = cubic_coefficients(np, 1 / inverse)
    return np.vstack([_LIMIT, np.stack([p / inverse, g, a], -1)])


def tabulated_coefficients(table: Array, n: Array) -> tuple[Array, Array, Array]:
    """`cubic_coefficients` by linear interpolation of `coefficient_table`, for n >= 1 of any shape."""
    inverse = 1 / np.asarray(n)
    position = inverse * (len(table) - 1)
    below = np.minimum(position.astype(int), len(table) - 2)
    t = (position - below)[..., None]
    row = table[below] * (1 - t) + table[below + 1] * t
    return row[..., 0] * inverse, row[..., 1], row[..., 2]


def cubic_lobe(xp: Any, u: Any, n: Any, coefficients: tuple[Any, Any, Any]) -> Any:
    """The cubic above its half value, its tail below, n >= 1."""
    p, g, a = coefficients
    s = u / p
    inside = (1 - u) * (1 - s * (g + a * (1 - s)))
    c = xp.maximum(1 - u, 0.0)
    # Half of Schlick's lobe of c / q, q = 1 - p.
    tail = c / (2 * (n * xp.maximum(u - p, 0.0) + c))
    return xp.where(u < p, inside, tail)


def lobe_norm(xp: Any, name: str, n: Any) -> Any:
    """Factor in 1/sr that makes the integral of lobe times cosine over the hemisphere around its peak 1.

    With it the lobe about the mirror direction reflects all light at normal incidence, and less elsewhere (Lewis 1994);
    of cos^n it is (n + 2) / (2 pi). Relative error below 3e-8, of "cosine"; the others are exact.
    """
    return (0.5 / math.pi) / _INTEGRALS[name](xp, n)


def half_vector_norm(name: str, n: float) -> float:
    """Factor in 1/sr of a lobe about the normal, of half vectors, that makes the albedo 1 at normal incidence.

    There theta_i = 2 theta_h. The integral is that of lobe times (2 c^2 - 1) 8 pi c over u, c = 1 - u, up to 45
    degrees, by 8 nodes on each of 320 panels of equal ratio: good to 1e-7 where the lobe has a kink, else to 1e-14.
    """
    end = 1 - math.sqrt(0.5)
    edges = np.append(0, np.geomspace(min(1e-3 / n, 1e-3), end, 320))
    u = edges[:-1, None] + np.diff(edges)[:, None] * _POINTS
    c = 1 - u
    integrand = cosine_lobe(xp_numpy, name, u, np.float64(n)) * (2 * c * c - 1) * (8 * math.pi) * c
    return 1 / float((integrand * _WEIGHTS * np.diff(edges)[:, None]).sum())


def draw_lobe(xp: Any, name: str, random: Any, n: Any) -> Any:
    """u in [0, 1] from a random number in [0, 1], with density `lobe_density` per solid angle.

    By cos^n for all but `HEAVY`, which are drawn by 1 / (1 + n u): they never exceed 1.002 times that. 1 - random^(1 /
    (n + 1)) is 2 t / (1 + t), t = tanh(-log(random) / (2 n + 2)): the difference would leave float32 three digits of u
    at n = 1e4. At random = 0, whose logarithm there is none, u is that of the smallest float32.
    """
    if name not in HEAVY:
        t = xp.tanh(xp.log(xp.maximum(random, _LEAST_RANDOM)) * (-0.5 / (n + 1)))
        return 2 * t / (1 + t)
    return xp.minimum((xp.power(1 + n, random) - 1) / n, 1.0)


def lobe_density(xp: Any, name: str, u: Any, n: Any) -> Any:
    """Density per solid angle with which `draw_lobe` and an even azimuth place a direction at u; 0 beyond u = 1."""
    if name not in HEAVY:
        return (n + 1) * (0.5 / math.pi) * _power(xp, u, n)
    return (u < 1) * n * (0.5 / math.pi) / ((1 + n * u) * xp.log(1 + n))


def steepest(xp: Any, name: str, n: Any) -> Any:
    """Upper bound of lobe times sine over all angles."""
    return _STEEPEST[name] / xp.sqrt(n)


def _power(xp: Any, u: Any, n: Any) -> Any:
    held = xp.minimum(u, 1.0)
    base = 1 - held
    lost = (1 - base) - held
    return xp.power(base, n) * xp.exp(n * lost / xp.maximum(base, 1e-30))


def _schlick(xp: Any, u: Any, n: Any) -> Any:
    c = xp.maximum(1 - u, 0.0)
    return c / (n * u + c)


def _lyon(xp: Any, u: Any, n: Any) -> Any:
    factor = xp.maximum(1 - u * n * (1 / FACTORS), 0.0)
    square = factor * factor
    return square * square * (u < 1)


def _cosine(xp: Any, u: Any, n: Any) -> Any:
    x = 2 * xp.arcsin(xp.sqrt(u * 0.5))
    factor = xp.cos(xp.minimum(x * xp.sqrt(n * (1 / FACTORS)), math.pi / 2))
    square = factor * factor
    return square * square * (u < 1)


def _cubic(xp: Any, u: Any, n: Any) -> Any:
    least = xp.maximum(n, 1.0)
    value = cubic_lobe(xp, u, least, cubic_coefficients(xp, least))
    if isinstance(n, float | int | np.ndarray | np.generic) and bool(np.all(np.asarray(n) >= 1)):
        return value
    # At n = 1 the cubic is c: what is left below is its power, and above the power 1.
    return xp.power(value, xp.minimum(n, 1.0))


# Largest value of lobe times sine times sqrt(n) over all n, which is that at n = infinity, rounded up.
_STEEPEST = {"power": 0.6066, "schlick": 0.7072, "lyon": 0.5887, "cosine": 0.5943, "cubic": 0.6087}

_Lobe = Callable[[Any, Any, Any], Any]
_VALUES: dict[str, _Lobe] = {
    "power": _power,
    "schlick": _schlick,
    "lyon": _lyon,
    "cosine": _cosine,
    "cubic": _cubic,
}


def _gauss(weighted: Callable[[Any], Any], upper: Any) -> Any:
    """Integral from 0 to `upper` by 8 nodes."""
    total = float(_WEIGHTS[0]) * weighted(upper * float(_POINTS[0]))
    for point, weight in zip(_POINTS[1:], _WEIGHTS[1:]):
        total = total + float(weight) * weighted(upper * float(point))
    return total * upper


def _power_integral(xp: Any, n: Any) -> Any:
    return 1 / (n + 2)


def _schlick_integral(xp: Any, n: Any) -> Any:
    """In closed form, which cancels near n = 1; there by quadrature, whose integrand is all but a polynomial."""
    m = n - 1
    near = (n > 0.5) * (n < 2.0)
    safe = xp.where(near, 1.0, m)
    wide = xp.where(near, 2.0, n)
    closed = (wide * (wide * xp.log(wide) / safe - 1) / safe - 0.5) / safe
    inner = xp.where(near, n, 1.0)
    smooth = _gauss(lambda u: (1 - u) * (1 - u) / (u * inner + (1 - u)), 1.0)
    return xp.where(near, smooth, closed)


def _lyon_integral(xp: Any, n: Any) -> Any:
    upper = xp.minimum(FACTORS / n, 1.0)
    return _gauss(lambda u: _lyon(xp, u, n) * (1 - u), upper)


def _cosine_integral(xp: Any, n: Any) -> Any:
    """Over the angle, where the lobe is smooth up to its end."""
    speed = xp.sqrt(n * (1 / FACTORS))

    def weighted(x: Any) -> Any:
        square = xp.cos(x * speed) * xp.cos(x * speed)
        return square * square * xp.sin(2 * x) * 0.5

    return _gauss(weighted, xp.divide(math.pi / 2, xp.maximum(speed, 1.0)))


def _cubic_integral(xp: Any, n: Any) -> Any:
    least = xp.maximum(n, 1.0)
    p, g, a = cubic_coefficients(xp, least)
    first, second = 1 - 0.5 * g - a / 6, p * (1 - g * (2 / 3) - a / 6)
    inside = p * (first - second + p * p * (1 / 3 - 0.25 * g - 0.05 * a))
    tail = 0.5 * (1 - p) * (1 - p) * _schlick_integral(xp, least)
    return xp.where(n < 1, 1 / (n + 2), inside + tail)


# Of u: lobe (1 - u) over [0, 1].
_INTEGRALS: dict[str, Callable[[Any, Any], Any]] = {
    "power": _power_integral,
    "schlick": _schlick_integral,
    "lyon": _lyon_integral,
    "cosine": _cosine_integral,
    "cubic": _cubic_integral,
}
