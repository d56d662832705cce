"""Formulas of Mallett & Yuksel 2016 as printed or commonly coded, beside the product's."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from measured_materials.bake.directions import spherical
from measured_materials.bake.tables.grids import parameterization as par

from . import truth
from .formula import F32, Array, Formula, dot32, near_pairs, worst, xp_float32


def _angle_of_chord(v: Array) -> Array:
    return 2 * np.arcsin(np.minimum(v.astype(float), 1) / np.sqrt(2))


def _uniform() -> tuple[float, float]:
    a, b, theta = near_pairs()
    s = 1 - F32(2 / np.pi) * np.arccos(dot32(a, b))
    chord = par.chord(xp_float32, a, b)
    ours = par.uniform_forward(xp_float32, chord)
    exact = 1 - 2 / np.pi * theta
    return worst(s, exact), worst(ours, exact)


def _bezier() -> tuple[float, float]:
    a, b, theta = near_pairs()
    x, alpha = dot32(a, b), F32(0)
    t = 1 - np.sqrt(1 - x)
    s = 2 * alpha * t + (1 - 2 * alpha) * t * t
    exact = (1 - np.sqrt(2) * np.sin(theta / 2)) ** 2
    return worst(s, exact), worst(par.bezier_forward(xp_float32, par.chord(xp_float32, a, b), alpha), exact)


_ALPHAS = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0)


def _parameters() -> Array:
    return np.concatenate([np.linspace(0, 1, 201), 1 - np.geomspace(1e-7, 0.1, 100)]).astype(F32)


def _inverse(printed: Callable[[Array, Any], Array]) -> tuple[float, float]:
    s = _parameters()
    off = [0.0, 0.0]
    for alpha in _ALPHAS:
        exact = truth.each(lambda x, alpha=alpha: truth.angle("bezier", float(F32(alpha)), x))(s.astype(float))[:, 0]
        ours = _angle_of_chord(par.bezier_inverse(xp_float32, s, F32(alpha)))
        off = [max(off[0], worst(printed(s, F32(alpha)), exact)), max(off[1], worst(ours, exact))]
    return off[0], off[1]


def _one_sided(s: Array, alpha: Any) -> Array:
    """The root in t from s = 0 alone, and from it the cosine."""
    t = np.divide(s, alpha + np.sqrt(alpha * alpha + (1 - 2 * alpha) * s), out=np.zeros_like(s), where=s > 0)
    return np.arccos(np.minimum(t * (2 - t), 1)).astype(float)


def _by_cosine(s: Array, alpha: Any) -> Array:
    """cos g = F^-1(s), kept as a cosine."""
    v = par.bezier_inverse(xp_float32, s.astype(float), float(alpha))
    return np.arccos((1 - v * v).astype(F32)).astype(float)


def _textbook(s: Array, alpha: Any) -> Array:
    """The quadratic formula: (-alpha + sqrt(alpha^2 + (1 - 2 alpha) s)) / (1 - 2 alpha)."""
    with np.errstate(invalid="ignore", divide="ignore"):
        t = (np.sqrt(alpha * alpha + (1 - 2 * alpha) * s) - alpha) / (1 - 2 * alpha)
    return _angle_of_chord(1 - t)


def _azimuth_pairs() -> tuple[Array, Array, Array, Array]:
    """wi, wo, their exact phi_delta near 0 and pi and between, and the lesser sine, which an azimuth's error counts."""
    theta = np.radians([0.5, 5, 45, 85, 89.99])
    phi = np.concatenate([np.geomspace(1e-5, 1, 20), np.pi - np.geomspace(1e-5, 1, 20)])
    ti, to, p = (x.ravel() for x in np.meshgrid(theta, theta, phi))
    wi, wo = spherical(ti, p + 0.3).astype(F32), spherical(to, 0.3).astype(F32)
    exact = truth.each(lambda a, b: truth.normal_angles(a, b)[2])(wi.astype(float), wo.astype(float))[:, 0]
    return wi, wo, exact, np.minimum(np.sin(ti), np.sin(to))


def _phi_delta() -> tuple[float, float]:
    wi, wo, exact, sine = _azimuth_pairs()
    z = [w[:, 2] for w in (wi, wo)]
    sines = np.sqrt((1 - z[0] * z[0]) * (1 - z[1] * z[1]))
    with np.errstate(invalid="ignore", divide="ignore"):
        cosine = (np.sum(wi * wo, -1, dtype=F32) - z[0] * z[1]) / sines
        printed = np.arccos(np.clip(cosine, -1, 1)).astype(float)
    u = par.normal_basis_coordinates(xp_float32, wi, wo, "uniform", None, None)[2]
    return worst(printed * sine, exact * sine), worst((1 - u.astype(float)) * np.pi * sine, exact * sine)


def _half_pairs() -> tuple[Array, Array]:
    """Mirror pairs turned by 1e-5 to 0.1 rad, from the normal to 89 degrees."""
    to, tilt, phi = (
        x.ravel() for x in np.meshgrid(np.radians([1, 30, 60, 89]), np.geomspace(1e-5, 0.1, 20), np.linspace(0.2, 3, 6))
    )
    wo, half = spherical(to, 0.0), spherical(tilt, phi)
    wi = 2 * np.sum(wo * half, -1, keepdims=True) * half - wo
    keep = wi[:, 2] > 1e-3
    return wi[keep].astype(F32), wo[keep].astype(F32)


def _theta_h() -> tuple[float, float]:
    wi, wo = _half_pairs()
    exact = truth.each(lambda a, b: truth.half_angles(a, b)[1])(wi.astype(float), wo.astype(float))[:, 0]
    half = wi + wo
    half = half / np.sqrt(np.sum(half * half, -1, keepdims=True))
    scale = np.linalg.norm((wi + wo).astype(float), axis=-1) / 2
    ours = _angle_of_chord(par.chord(xp_float32, half, np.array([0, 0, 1], F32)))
    return worst(np.arccos(np.minimum(half[:, 2], 1)) * scale, exact * scale), worst(ours * scale, exact * scale)


def _theta_d() -> tuple[float, float]:
    a, b, theta = near_pairs()
    half = a + b
    half = half / np.sqrt(np.sum(half * half, -1, keepdims=True))
    printed = np.arccos(dot32(a, half)).astype(float)
    v = par.difference_chord(xp_float32, a + b, a - b)
    return worst(printed, theta / 2), worst(_angle_of_chord(v), theta / 2)


FORMULAS = (
    Formula(
        "Mallett & Yuksel 2016, section 4",
        "uniform parameter of an angle",
        "1 - (2 / pi) acos(a . b)",
        "1 - (4 / pi) asin(v / sqrt 2), v = |a - b| / sqrt 2",
        "angles from 1e-5 to 1 rad",
        "s",
        3e-7,
        _uniform,
    ),
    Formula(
        "Mallett & Yuksel 2016, equation 5",
        "Bezier parameter of an angle, alpha = 0",
        "t = 1 - sqrt(1 - a . b)",
        "t = 1 - v",
        "angles from 1e-5 to 1 rad",
        "s",
        3e-7,
        _bezier,
    ),
    Formula(
        "Mallett & Yuksel 2016, section 4",
        "Bezier inverse",
        "(sqrt(alpha^2 + (1 - 2 alpha) s) - alpha) / (1 - 2 alpha)",
        "s / (alpha + sqrt(...)), from the nearer end",
        "alpha 0 to 1, 0.5 among them",
        "rad",
        5e-7,
        lambda: _inverse(_textbook),
    ),
    Formula(
        "Mallett & Yuksel 2016, section 4",
        "Bezier inverse from s = 0 alone",
        "x = t (2 - t), g = acos x",
        "the chord v from s = 1 where s > 1/2",
        "alpha 0 to 1",
        "rad",
        5e-7,
        lambda: _inverse(_one_sided),
    ),
    Formula(
        "Mallett & Yuksel 2016, section 4",
        "where the samples lie",
        "cos g = F^-1(s), a float32 cosine",
        "the chord v of s",
        "alpha 0 to 1",
        "rad",
        5e-7,
        lambda: _inverse(_by_cosine),
    ),
    Formula(
        "Mallett & Yuksel 2016, section 4",
        "phi_delta of two directions",
        "acos((wi . wo - cos cos) / (sin sin)), sin by 1 - cos^2",
        "|ti - to| and |ti + to| of the unit vectors in the plane",
        "0.5 to 89.99 degrees, phi_delta to 1e-5 of 0, pi",
        "rad times sine",
        1e-6,
        _phi_delta,
    ),
    Formula(
        "Mallett & Yuksel 2016, half-vector basis",
        "theta_h",
        "acos(h . n)",
        "chord |h - n|",
        "1e-5 to 0.1 rad beside the mirror",
        "rad times cos theta_d",
        5e-7,
        _theta_h,
    ),
    Formula(
        "Mallett & Yuksel 2016, half-vector basis",
        "theta_d",
        "acos(wi . h)",
        "|wi - wo| / sqrt(2 |wi + wo| + 4), a chord",
        "5e-6 to 0.5 rad",
        "rad",
        5e-7,
        _theta_d,
    ),
)
