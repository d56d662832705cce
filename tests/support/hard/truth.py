"""Truths in 40 digits (mpmath), from definitions rather than from the formulas that the product computes by."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mpmath as mp
import numpy as np
from measured_materials.bake.tables.grids.parameterization import LogWarp

DIGITS = 40
Array = np.ndarray


def each(function: Callable[..., Any]) -> Callable[..., Array]:
    """`function` of mpmath numbers, or lists of three for vectors, row by row: (P, K) float64."""

    def rows(*inputs: Array) -> Array:
        with mp.workdps(DIGITS):
            out = [function(*(_exact(i[k]) for i in inputs)) for k in range(len(inputs[0]))]
            return np.array([[float(x) for x in (row if isinstance(row, tuple) else (row,))] for row in out])

    return rows


def _exact(value: Any) -> Any:
    return mp.mpf(float(value)) if np.ndim(value) == 0 else [mp.mpf(float(x)) for x in value]


def parameter(kind: str, shape: Any, v: Any) -> Any:
    """Table parameter s of the chord v, cos g = F^-1(s) (Mallett & Yuksel 2016, section 4); "fitted" by its density."""
    if kind == "fitted":
        return 1 - _share(shape, v)
    x = 1 - v * v
    if kind == "identity":
        return x
    if kind == "uniform":
        return 1 - 2 / mp.pi * mp.acos(x)
    if kind == "squared":
        return 1 - mp.sqrt(2 / mp.pi * mp.acos(x))
    # The quadratic Bezier curve of the control points (0, 0), (1, alpha), (1, 1): x = 1 - (1 - t)^2.
    t, alpha = 1 - mp.sqrt(1 - x), mp.mpf(shape)
    return 2 * (1 - t) * t * alpha + t * t


def _share(warp: LogWarp, v: Any) -> Any:
    """Integral of 1 / (v + near) + 1 / (1 + far - v) up to v, as a share of all."""
    near, far = mp.mpf(warp.near), mp.mpf(warp.far)

    def up_to(x: Any) -> Any:
        return mp.log((x + near) / near) + mp.log((1 + far) / (1 + far - x))

    return up_to(v) / up_to(mp.mpf(1))


def angle(kind: str, shape: Any, s: Any) -> Any:
    """The angle in radians at parameter s."""
    if kind == "identity":
        return mp.acos(s)
    if kind == "uniform":
        return (1 - s) * mp.pi / 2
    if kind == "squared":
        return (1 - s) ** 2 * mp.pi / 2
    if kind == "fitted":
        v = mp.findroot(lambda v: _share(shape, v) - (1 - s), (mp.mpf(-1) / 10**5, mp.mpf(1)), solver="anderson")
        return 2 * mp.asin(v / mp.sqrt(2))
    alpha = mp.mpf(shape)
    t = s / (alpha + mp.sqrt(alpha**2 + (1 - 2 * alpha) * s)) if s else mp.mpf(0)
    return mp.acos(t * (2 - t))


def normal_angles(wi: Any, wo: Any) -> tuple[Any, Any, Any]:
    """(theta_o, theta_i, phi_delta) of vectors of any length; phi_delta NaN where it is undefined."""
    across, along = wi[0] * wo[1] - wi[1] * wo[0], wi[0] * wo[0] + wi[1] * wo[1]
    phi = mp.atan2(abs(across), along) if (wi[0] or wi[1]) and (wo[0] or wo[1]) else mp.nan
    return _theta(wo), _theta(wi), phi


def half_angles(wi: Any, wo: Any) -> tuple[Any, Any, Any]:
    """(theta_d, theta_h, phi_d in [0, pi / 2]) by Rusinkiewicz' rotations; NaN where they are undefined."""
    wi, wo = _unit(wi), _unit(wo)
    s = [a + b for a, b in zip(wi, wo)]
    if mp.norm(s) < mp.mpf(10) ** -30:
        return mp.pi / 2, mp.nan, mp.nan
    theta, phi = _theta(s), mp.atan2(s[1], s[0]) if s[0] or s[1] else mp.mpf(0)
    x, y = mp.cos(phi) * wi[0] + mp.sin(phi) * wi[1], mp.cos(phi) * wi[1] - mp.sin(phi) * wi[0]
    d = [mp.cos(theta) * x - mp.sin(theta) * wi[2], y, mp.sin(theta) * x + mp.cos(theta) * wi[2]]
    phi_d = mp.atan2(abs(d[1]), abs(d[0])) if s[0] or s[1] else mp.nan
    return _theta(d), theta, phi_d


def largest_theta_d(theta_h: Any, phi_d: Any) -> Any:
    """The theta_d at which the lower of wi and wo meets the horizon."""
    return mp.atan2(mp.cos(theta_h), mp.sin(theta_h) * abs(mp.cos(phi_d)))


def chord(theta: Any) -> Any:
    """sqrt(1 - cos theta)."""
    return mp.sqrt(2) * mp.sin(theta / 2)


def cosine_lobe(name: str, u: Any, n: Any) -> Any:
    """A curve of bake/lobes/cosine_lobes.py as its author prints it, of the exact u."""
    c = 1 - u
    if c <= 0:
        return mp.mpf(0)
    if name == "power" or (name == "cubic" and n < 1):
        return c**n
    if name == "schlick":
        return c / (n - n * c + c)
    if name == "lyon":
        return max(1 - n * u / 4, mp.mpf(0)) ** 4
    if name == "cosine":
        return mp.cos(min(mp.sqrt(n / 4) * mp.acos(c), mp.pi / 2)) ** 4
    q = mp.mpf(0.5) ** (1 / n)
    if c < q:
        return c / (2 * n * (q - c) + 2 * c)
    k = cubic_coefficients(n)
    return ((k[0] * c + k[1]) * c + k[2]) * c


def cubic_coefficients(n: Any) -> Any:
    """a, b, c of a x^3 + b x^2 + c x (Romanyuk 2007): f(1) = 1, f(q) = 1 / 2, f'(q) = n / (2 q), q = 0.5^(1/n)."""
    q = mp.mpf(0.5) ** (1 / n)
    if n == 1:  # two conditions coincide; the curve itself is c
        return mp.mpf(0), mp.mpf(0), mp.mpf(1)
    return mp.lu_solve(
        mp.matrix([[1, 1, 1], [q**3, q**2, q], [3 * q**2, 2 * q, 1]]), mp.matrix([1, mp.mpf(0.5), n / (2 * q)])
    )


def lobe_norm(name: str, n: Any) -> Any:
    """1 / integral of lobe times cosine over the hemisphere, by closed forms, of "cosine" by quadrature."""
    return 1 / (2 * mp.pi * _integral(name, n))


def _integral(name: str, n: Any) -> Any:
    """Of lobe (1 - u) over u in [0, 1]."""
    if name == "power" or (name == "cubic" and n < 1):
        return 1 / (n + 2)
    if name == "schlick":
        return _schlick_part(n)
    if name == "lyon":
        top = min(4 / n, mp.mpf(1))
        return _polynomial([mp.binomial(4, k) * (-n / 4) ** k for k in range(5)], top)
    if name == "cosine":
        speed = mp.sqrt(n / 4)
        end = min(mp.pi / 2, mp.pi / 2 / speed)
        return mp.quad(lambda x: mp.cos(speed * x) ** 4 * mp.sin(2 * x) / 2, [0, end])
    q, k = mp.mpf(0.5) ** (1 / n), cubic_coefficients(n)
    inside = sum(k[j] * (1 - q ** (5 - j)) / (5 - j) for j in range(3))
    # The tail is half of Schlick's lobe of c / q.
    return inside + q * q * _schlick_part(n) / 2


def _schlick_part(n: Any) -> Any:
    """Integral of c^2 / (n - (n - 1) c) over c in [0, 1]."""
    if n == 1:
        return mp.mpf(1) / 3
    m = n - 1
    return (n * n * mp.log(n) / m**2 - n / m - mp.mpf(1) / 2) / m


def _polynomial(coefficients: list[Any], top: Any) -> Any:
    """Integral of sum c_k u^k (1 - u) over [0, top]."""
    return sum(c * (top ** (k + 1) / (k + 1) - top ** (k + 2) / (k + 2)) for k, c in enumerate(coefficients))


def _theta(w: Any) -> Any:
    return mp.atan2(mp.hypot(w[0], w[1]), w[2])


def _unit(w: Any) -> Any:
    length = mp.norm(w)
    return [x / length for x in w]
