"""GGX microfacets of one or two widths, and Fresnel reflectances, for sources and envelopes in float64."""

from __future__ import annotations

import math

import numpy as np

from ..source import Array


def ggx_ndf(half: Array, alpha_x: float, alpha_y: float) -> Array:
    """GGX distribution of normals in 1/sr at unit half vectors (..., 3); integrates to 1 over cos theta_h."""
    stretched = (half[..., 0] / alpha_x) ** 2 + (half[..., 1] / alpha_y) ** 2 + half[..., 2] ** 2
    return 1 / (math.pi * alpha_x * alpha_y * stretched**2)


def ggx_lobe(wi: Array, wo: Array, alpha_x: float, alpha_y: float) -> Array:
    """D G / (4 cos_i cos_o) of GGX with height-correlated Smith shadowing, (n, 3) directions -> (n,)."""

    def stretched(w: Array) -> Array:
        length: Array = np.sqrt((alpha_x * w[:, 0]) ** 2 + (alpha_y * w[:, 1]) ** 2 + w[:, 2] ** 2)
        return length

    shadowed = 0.5 / (wo[:, 2] * stretched(wi) + wi[:, 2] * stretched(wo))
    s = wi + wo
    return ggx_ndf(s / np.linalg.norm(s, axis=-1, keepdims=True), alpha_x, alpha_y) * shadowed


def schlick(cosine: Array, f0: Array) -> Array:
    """Fresnel reflectance by Schlick 1994, broadcast over `cosine` (..., 1) and `f0` (3,)."""
    return f0 + (1 - f0) * np.maximum(1 - cosine, 0) ** 5


def dielectric(cosine: Array, eta: Array) -> Array:
    """Unpolarised Fresnel reflectance at relative index `eta`; 1 beyond the critical angle."""
    refracted = np.sqrt(np.maximum(eta**2 - 1 + cosine**2, 0))  # eta cos theta_t
    perpendicular = (cosine - refracted) / (cosine + refracted)
    parallel = (eta**2 * cosine - refracted) / (eta**2 * cosine + refracted)
    reflectance: Array = 0.5 * (perpendicular**2 + parallel**2)
    return reflectance


def conductor(cosine: Array, eta: Array, k: Array) -> Array:
    """Unpolarised Fresnel reflectance of a metal of index `eta` + i `k` (Born & Wolf, section 14.2)."""
    sine2 = 1 - cosine**2
    t = eta**2 - k**2 - sine2
    modulus = np.sqrt(t**2 + 4 * eta**2 * k**2)
    a = np.sqrt(np.maximum(0.5 * (modulus + t), 0))
    perpendicular = (modulus + cosine**2 - 2 * a * cosine) / (modulus + cosine**2 + 2 * a * cosine)
    along, mixed = cosine**2 * modulus + sine2**2, 2 * a * cosine * sine2
    reflectance: Array = 0.5 * perpendicular * (1 + (along - mixed) / (along + mixed))
    return reflectance
