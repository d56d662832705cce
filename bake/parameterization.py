"""Parameterisations of one angular table axis (Mallett & Yuksel 2016, section 4), in the stable chord form.

An axis stores the value at parameter s where cos g = F^-1(s). F maps the cosine x in [0, 1] to s in [0, 1] and is
odd in x, so that an azimuth uses s in [-1, 1]. Nothing here ever sees the cosine: 1 - x loses every digit of a
small angle, so all functions speak of the chord

    v = sqrt(1 - cos g) = |a - b| / sqrt(2)      for the angle g between unit vectors a and b,

v in [0, 1] for g in [0, pi/2]. By the formula alpha = 0 is densest at the normal (v = 0) and leaves the sparsest
samples at grazing, alpha = 1 the reverse. The paper's sentence about alpha_theta says the opposite; the formula is
right (its own figure 4 agrees with it), so do not "mend" this.

Functions take `xp`, numpy's or the shader nodes' namespace, as their first argument.
"""

from __future__ import annotations

from typing import Any, Literal, get_args

import numpy as np

from . import xp_numpy
from .source import Array

Parameterization = Literal["identity", "uniform", "bezier"]
PARAMETERIZATIONS: tuple[str, ...] = get_args(Parameterization)


def identity_forward(xp: Any, v: Any) -> Any:
    """F(x) = x: s from the chord."""
    return (1 - v) * (1 + v)


def identity_inverse(xp: Any, s: Any) -> Any:
    """Chord from s for F(x) = x."""
    return xp.sqrt(1 - s)


def uniform_forward(xp: Any, v: Any) -> Any:
    """F(x) = 1 - (2 / pi) acos x, with acos x = 2 asin(v / sqrt 2)."""
    return 1 - (4 / np.pi) * xp.arcsin(v * (1 / np.sqrt(2)))


def uniform_inverse(xp: Any, s: Any) -> Any:
    """Chord from s for the uniform parameterisation."""
    return xp.sin((1 - s) * (np.pi / 4)) * np.sqrt(2)


def bezier_forward(xp: Any, v: Any, alpha: Any) -> Any:
    """Quadratic Bezier F of MY16 equation 5: s = 2 alpha t + (1 - 2 alpha) t^2 with t = 1 - v."""
    t = 1 - v
    return t * (2 * alpha + (1 - 2 * alpha) * t)


def bezier_inverse(xp: Any, s: Any, alpha: Any) -> Any:
    """Chord from s for the Bezier parameterisation, alpha in [0, 1].

    Worked from the nearer end: the textbook root from s = 0 alone loses up to 1.4e-4 rad in float32 near the
    peak, the two-sided one stays within 1.3e-7 rad for every alpha.
    """
    beta = 1 - alpha
    rest = 1 - s
    t = xp.divide(s, alpha + xp.sqrt(alpha * alpha + (1 - 2 * alpha) * s))
    v = xp.divide(rest, beta + xp.sqrt(beta * beta + (1 - 2 * beta) * rest))
    return xp.where(s > 0.5, v, 1 - t)


def forward(xp: Any, kind: str, v: Any, alpha: Any) -> Any:
    """Table parameter s in [0, 1] from the chord v in [0, 1]; `alpha` is used by "bezier" only."""
    if kind == "bezier":
        return bezier_forward(xp, v, alpha)
    return {"identity": identity_forward, "uniform": uniform_forward}[kind](xp, v)


def inverse(xp: Any, kind: str, s: Any, alpha: Any) -> Any:
    """Chord v in [0, 1] from the table parameter s in [0, 1]."""
    if kind == "bezier":
        return bezier_inverse(xp, s, alpha)
    return {"identity": identity_inverse, "uniform": uniform_inverse}[kind](xp, s)


def chord_to_theta(xp: Any, v: Any) -> Any:
    """Angle in radians from its chord."""
    return 2 * xp.arcsin(v * (1 / np.sqrt(2)))


def theta_nodes(kind: str, n: int, alpha: float) -> Array:
    """Chords (n,) of an elevation axis; sample 0 lies at the horizon, the last at the normal."""
    return np.asarray(inverse(xp_numpy, kind, np.arange(n) / (n - 1), alpha))


def phi_nodes(kind: str, n: int, alpha: float) -> tuple[Array, Array]:
    """Cosine and sine (n,) of an azimuth axis over [0, pi]; sample 0 lies at phi = pi, the last at 0."""
    s = np.arange(n) * (2 / (n - 1)) - 1
    v = np.asarray(inverse(xp_numpy, kind, np.abs(s), alpha))
    cosine = np.where(s < 0, -1, 1) * (1 - v) * (1 + v)
    return cosine, v * np.sqrt(2 - v * v)


def normal_basis_coordinates(
    xp: Any, wi: Any, wo: Any, kind: str, alpha_theta: Any, alpha_phi: Any
) -> tuple[Any, Any, Any]:
    """Table coordinates (u_o, u_i, u_phi) in [0, 1] of a direction pair, normal-vector basis.

    u_theta = 1 at the normal and 0 at the horizon, u_phi = 1 at phi_delta = 0 and 0 at pi. At a pole phi_delta is
    undefined; the unit vector in the plane is then zero, which lands on some phi_delta, and the table is constant in
    phi there. The azimuth, too, is taken from chords: |ti - to| near 0 and |ti + to| near pi.
    """
    normal = xp.vec(0.0, 0.0, 1.0)
    u_i = forward(xp, kind, _elevation_chord(xp, wi, normal), alpha_theta)
    u_o = forward(xp, kind, _elevation_chord(xp, wo, normal), alpha_theta)
    xi, yi, _ = xp.components(wi)
    xo, yo, _ = xp.components(wo)
    ti, to = xp.normalize(xp.vec(xi, yi, 0.0)), xp.normalize(xp.vec(xo, yo, 0.0))
    near, far = xp.length(ti - to), xp.length(ti + to)
    s = forward(xp, kind, xp.minimum(xp.minimum(near, far) * (1 / np.sqrt(2)), 1.0), alpha_phi)
    return u_o, u_i, xp.where(near > far, 0.5 - 0.5 * s, 0.5 + 0.5 * s)


def _elevation_chord(xp: Any, w: Any, normal: Any) -> Any:
    return xp.minimum(xp.length(w - normal) * (1 / np.sqrt(2)), 1.0)
