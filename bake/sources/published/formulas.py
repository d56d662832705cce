"""The two published fits of the MERL materials, as formulas of direction pairs above the horizon.

Both as jdupuy/dj_brdf (public domain by its header) evaluates them, which published the parameters.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ... import xp_numpy
from ...lobes.metallic_paint import dielectric
from ...source import Array

Parameters = Mapping[str, Array]

# Name, how many numbers (three: one per channel), least and largest; published ones lie far within.
SGD_PARAMETERS: dict[str, tuple[int, float, float]] = {
    "rhoD": (3, 0, 1e3),
    "rhoS": (3, 0, 1e6),
    "alpha": (3, 1e-9, 1e3),
    "p": (3, -1e2, 1e2),
    "f0": (3, -1e3, 1e3),
    "f1": (3, -1e3, 1e3),
    "kap": (3, 0, 1e9),
    "lambda": (3, -1e9, 1e9),
    "c": (3, -1e40, 1e40),
    "k": (3, -1e4, 1e4),
    "theta0": (3, -10, 10),
}
ABC_PARAMETERS: dict[str, tuple[int, float, float]] = {
    "kD": (3, 0, 1e3),
    "A": (3, 0, 1e9),
    "B": (1, 0, 1e12),
    "C": (1, 0, 1e2),
    "ior": (1, 1, 1e4),
}


def shifted_gamma(wi: Array, wo: Array, of: Parameters) -> Array:
    """Shifted Gamma distribution (Bagher, Soler & Holzschuch 2012), (n, 3) in 1/sr.

    f = (rhoD + rhoS F D G / (cos_i cos_o)) / pi, all per channel. F = f0 - c f1 + (1 - c)^5 (1 - f0) with c = wi.h is
    a fit and no reflectance: in the published sets it goes below 0 and above 1.
    """
    total = wi + wo
    length = np.linalg.norm(total, axis=-1, keepdims=True)
    cos_d, cos_h = length / 2, total[:, 2:] / length
    fresnel = of["f0"] - cos_d * of["f1"] + (1 - cos_d) ** 5 * (1 - of["f0"])
    tan2 = (total[:, :1] ** 2 + total[:, 1:2] ** 2) / total[:, 2:] ** 2
    x = of["alpha"] + tan2 / of["alpha"]
    # In logarithms: at grazing, x^p overflows where exp(-x) has long been 0.
    exponent = np.log(np.maximum(of["kap"], 1e-300)) - x - of["p"] * np.log(x) - 4 * np.log(cos_h)
    spread = np.exp(np.minimum(exponent, 300)) / np.pi
    shadow = _gamma_shadow(wi[:, 2:], of) * _gamma_shadow(wo[:, 2:], of)
    return (of["rhoD"] + of["rhoS"] * fresnel * spread * shadow / (wi[:, 2:] * wo[:, 2:])) / np.pi


def _gamma_shadow(cosine: Array, of: Parameters) -> Array:
    """g(theta) = 1 + lambda (1 - exp(c max(0, theta - theta0)^k)), within 0 and 1."""
    beyond = np.maximum(np.arccos(np.minimum(cosine, 1.0)) - of["theta0"], 0)
    power = np.where(beyond > 0, np.exp(np.clip(of["k"] * np.log(np.maximum(beyond, 1e-300)), -700, 700)), 0.0)
    grown = -np.expm1(np.clip(of["c"] * power, -700, 700))
    return np.clip(1 + of["lambda"] * grown, 0, 1)


def abc(wi: Array, wo: Array, of: Parameters) -> Array:
    """ABC distribution in microfacets (Low, Kronander, Ynnerman & Unger 2012), (n, 3) in 1/sr.

    f = kD / pi + F D G / (pi cos_i cos_o), without a factor of 4; D = A / (1 + B (1 - cos_h))^C, F of a dielectric, and
    the shadowing of V-shaped grooves.
    """
    total = wi + wo
    length = np.linalg.norm(total, axis=-1, keepdims=True)
    half, cos_d = total / length, length / 2
    chord = 0.5 * (half[:, :1] ** 2 + half[:, 1:2] ** 2 + (1 - half[:, 2:]) ** 2)
    spread = of["A"] * np.exp(-of["C"] * np.log1p(of["B"] * chord))
    cos_i, cos_o = wi[:, 2:], wo[:, 2:]
    shadow = np.minimum(1, 2 * half[:, 2:] * np.minimum(cos_i, cos_o) / cos_d)
    reflected = dielectric(xp_numpy, cos_d, float(of["ior"][0]))
    return of["kD"] / np.pi + reflected * spread * shadow / (np.pi * cos_i * cos_o)
