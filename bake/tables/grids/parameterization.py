"""Parameterisations of one angular table axis (Mallett & Yuksel 2016, section 4, and two more), in stable chord form.

An axis stores the value at parameter s where cos g = F^-1(s). F maps the cosine x in [0, 1] to s in [0, 1] and is
odd in x, so that an azimuth uses s in [-1, 1]. Nothing here ever sees the cosine: 1 - x loses every digit of a
small angle, so all functions speak of the chord

    v = sqrt(1 - cos g) = |a - b| / sqrt(2)      for the angle g between unit vectors a and b,

v in [0, 1] for g in [0, pi/2]. By the formula alpha = 0 is densest at the normal (v = 0) and leaves the sparsest
samples at grazing, alpha = 1 the reverse. The paper's sentence about alpha_theta says the opposite; the formula is
right (its own figure 4 agrees with it), so do not "correct" this.

Beyond the paper: "squared" is MERL's theta = (pi / 2) (1 - s)^2 (Matusik et al. 2003), densest at v = 0 by far.
"fitted" is a warp of two parameters, `LogWarp`, found for each axis by the error that it leaves (`grid_search`).

Functions take `xp`, numpy's or the shader nodes' namespace, as their first argument.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from ... import xp_numpy
from ...source import Array

Parameterization = Literal["identity", "uniform", "bezier", "squared", "fitted"]
PARAMETERIZATIONS: tuple[str, ...] = get_args(Parameterization)

# Of `LogWarp`: a narrower end would ask for chords that float32 directions do not distinguish; a wider one is even.
NARROWEST_END, WIDEST_END = 3e-4, 4.0


@dataclass(frozen=True)
class LogWarp:
    """A monotone warp whose samples have the density 1 / (v + near) + 1 / (1 + far - v) over the chord v.

    A logarithm gives every octave of distance to a peak as many samples, down to the distance where the peak is flat:
    where f falls as a power of v, piecewise linear interpolation then errs by the same share in every cell. One end
    may be a highlight and the other the horizon. The derivative is bounded both ways, as no Bezier of alpha 0 is.
    (Tried for theta_h: 400 free knots that equalise the second differences of the source leave 0.6 to 0.7 of this error
    on a chrome and an acrylic, 0.95 to 1 on a bronze, a plastic and a genuine paint. They would cost a texture tap on
    every axis, whose fractions GPUs round to 1/256; a logarithm costs seven nodes.)

    Parameters
    ----------
    near, far : distances from v = 0 and v = 1, in chords, within which samples lie evenly; `WIDEST_END` is even
    """

    near: float = WIDEST_END
    far: float = WIDEST_END

    @property
    def constants(self) -> tuple[float, float, float]:
        """(K, L, C) of s = 1 - C log(1 + K v / (L - v))."""
        gain = (1 + self.near + self.far) / self.near
        return gain, 1 + self.far, 1 / math.log1p(gain / self.far)


# Of an axis: Bezier's alpha, or a fitted warp; the other parameterisations have none.
Shape = Any


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
    """Quadratic Bezier F of Mallett & Yuksel 2016, equation 5: s = 2 alpha t + (1 - 2 alpha) t^2 with t = 1 - v."""
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


def squared_forward(xp: Any, v: Any) -> Any:
    """s = 1 - sqrt(theta / (pi / 2)), the spacing of MERL's theta_h."""
    return 1 - xp.sqrt((4 / np.pi) * xp.arcsin(v * (1 / np.sqrt(2))))


def squared_inverse(xp: Any, s: Any) -> Any:
    """Chord from s for MERL's spacing."""
    return xp.sin((1 - s) * (1 - s) * (np.pi / 4)) * np.sqrt(2)


def fitted_forward(xp: Any, v: Any, warp: LogWarp) -> Any:
    """s from the chord by a fitted warp."""
    gain, length, unit = warp.constants
    return 1 - xp.log(1 + xp.divide(v * gain, length - v)) * unit


def fitted_inverse(xp: Any, s: Any, warp: LogWarp) -> Any:
    """Chord from s by a fitted warp; exact, and in float32 within 2e-6 rad."""
    _, length, unit = warp.constants
    grown = xp.exp((1 - s) * (1 / unit))
    return xp.minimum(xp.divide((grown - 1) * (warp.near * length), length + warp.near * grown), 1.0)


_PLAIN = {
    "identity": (identity_forward, identity_inverse),
    "uniform": (uniform_forward, uniform_inverse),
    "squared": (squared_forward, squared_inverse),
}


def forward(xp: Any, kind: str, v: Any, shape: Shape = None) -> Any:
    """Table parameter s in [0, 1] from the chord v in [0, 1]; `shape` is alpha of "bezier", a LogWarp of "fitted"."""
    if kind == "bezier":
        return bezier_forward(xp, v, shape)
    if kind == "fitted":
        return fitted_forward(xp, v, shape)
    return _PLAIN[kind][0](xp, v)


def inverse(xp: Any, kind: str, s: Any, shape: Shape = None) -> Any:
    """Chord v in [0, 1] from the table parameter s in [0, 1]."""
    if kind == "bezier":
        return bezier_inverse(xp, s, shape)
    if kind == "fitted":
        return fitted_inverse(xp, s, shape)
    return _PLAIN[kind][1](xp, s)


def shape_constants(shape: Shape) -> tuple[float, float, float]:
    """The numbers from which `forward` computes, for a shader that is given them as a vector."""
    return shape.constants if isinstance(shape, LogWarp) else (float(shape), 0.0, 0.0)


def chord_to_theta(xp: Any, v: Any) -> Any:
    """Angle in radians from its chord."""
    return 2 * xp.arcsin(v * (1 / np.sqrt(2)))


def theta_nodes(kind: str, n: int, shape: Shape = None) -> Array:
    """Chords (n,) of an elevation axis; sample 0 lies at the horizon, the last at the normal."""
    return np.asarray(inverse(xp_numpy, kind, np.arange(n) / (n - 1), shape))


def phi_nodes(kind: str, n: int, shape: Shape = None) -> tuple[Array, Array]:
    """Cosine and sine (n,) of an azimuth axis over [0, pi]; sample 0 lies at phi = pi, the last at 0."""
    s = np.arange(n) * (2 / (n - 1)) - 1
    v = np.asarray(inverse(xp_numpy, kind, np.abs(s), shape))
    cosine = np.where(s < 0, -1, 1) * (1 - v) * (1 + v)
    return cosine, v * np.sqrt(2 - v * v)


def normal_basis_coordinates(
    xp: Any, wi: Any, wo: Any, kind: str, shape_theta: Shape, shape_phi: Shape
) -> tuple[Any, Any, Any]:
    """Table coordinates (u_o, u_i, u_phi) in [0, 1] of a direction pair, normal-vector basis.

    u_theta = 1 at the normal and 0 at the horizon, u_phi = 1 at phi_delta = 0 and 0 at pi. At a pole phi_delta is
    undefined; the unit vector in the plane is then zero, which lands on some phi_delta, and the table is constant in
    phi there. The azimuth, too, is taken from chords: |ti - to| near 0 and |ti + to| near pi.
    """
    normal = xp.vec(0.0, 0.0, 1.0)
    u_i = forward(xp, kind, chord(xp, wi, normal), shape_theta)
    u_o = forward(xp, kind, chord(xp, wo, normal), shape_theta)
    xi, yi, _ = xp.components(wi)
    xo, yo, _ = xp.components(wo)
    ti, to = xp.normalize(xp.vec(xi, yi, 0.0)), xp.normalize(xp.vec(xo, yo, 0.0))
    near, far = xp.length(ti - to), xp.length(ti + to)
    s = forward(xp, kind, xp.minimum(xp.minimum(near, far) * (1 / np.sqrt(2)), 1.0), shape_phi)
    return u_o, u_i, xp.where(near > far, 0.5 - 0.5 * s, 0.5 + 0.5 * s)


def half_basis_coordinates(
    xp: Any, wi: Any, wo: Any, kinds: tuple[str, str, str], shapes: tuple[Shape, Shape, Shape], reciprocal: bool
) -> tuple[Any, Any, Any]:
    """Table coordinates (u_d, u_h, u_phi) in [0, 1] of a direction pair, half-vector basis (Rusinkiewicz 1998).

    u = 1 at theta_d = 0, theta_h = 0 and phi_d = 0. theta_d counts as a share, in chords, of the largest for which
    wi and wo lie above the horizon, `largest_chord_d`: so every entry of the table can be met.

    From s = wi + wo and d = wi - wo: theta_h is the angle of s, |s| = 2 cos theta_d, |d| = 2 sin theta_d, and
    cos phi_d : sin phi_d = -|s| d_z : (s x d)_z, whose signs matter only without reciprocity. Where theta_h or
    theta_d is 0, phi_d is rounding noise, and the table is constant in phi_d there.

    Parameters
    ----------
    kinds, shapes : of (theta_d, theta_h, phi_d)
    reciprocal : phi_d and pi - phi_d are one, and u_phi = 0 at pi / 2; otherwise at pi
    """
    total, apart = wi + wo, wi - wo
    half = xp.normalize(total)
    x, y, z = xp.components(total)
    dx, dy, dz = xp.components(apart)
    along, across = xp.length(total) * dz, x * dy - y * dx
    back = xp.minimum(along, -along)
    phi = xp.normalize(xp.vec(-back, xp.maximum(across, -across), 0.0))
    cos_phi, _, _ = xp.components(phi)
    # Below the horizon there is no table; a lookup there must be finite all the same.
    most = largest_chord_d(xp, xp.maximum(z, 0.0), xp.length(xp.vec(x, y, 0.0)) * cos_phi)
    v_d = xp.minimum(xp.divide(difference_chord(xp, total, apart), most), 1.0)
    u_d = forward(xp, kinds[0], v_d, shapes[0])
    u_h = forward(xp, kinds[1], chord(xp, half, xp.vec(0.0, 0.0, 1.0)), shapes[1])
    u_phi = forward(xp, kinds[2], chord(xp, phi, xp.vec(1.0, 0.0, 0.0)), shapes[2])
    if not reciprocal:
        u_phi = xp.where(dz > 0, 0.5 - 0.5 * u_phi, 0.5 + 0.5 * u_phi)
    return u_d, u_h, u_phi


def difference_chord(xp: Any, total: Any, apart: Any) -> Any:
    """Chord of theta_d from wi + wo and wi - wo: sin / sqrt(1 + cos), the same to the bit for wi and wo exchanged."""
    return xp.length(apart) / xp.sqrt(xp.length(total) * 2 + 4)


def largest_chord_d(xp: Any, up: Any, aside: Any) -> Any:
    """Chord of the theta_d at which the lower of wi and wo meets the horizon, tan theta_d = up / aside.

    Parameters
    ----------
    up, aside : in proportion to cos theta_h and to sin theta_h |cos phi_d|
    """
    radius = xp.sqrt(up * up + aside * aside)
    return xp.divide(up, xp.sqrt(radius * (radius + aside)))


def chord(xp: Any, a: Any, b: Any) -> Any:
    """sqrt(1 - cos g) of the angle g between unit vectors, at most 1."""
    return xp.minimum(xp.length(a - b) * (1 / np.sqrt(2)), 1.0)
