"""Directions in the local frame (t, b, n): z is the normal, angles in radians."""

from __future__ import annotations

import numpy as np

from .source import Array


def spherical(theta: Array | float, phi: Array | float) -> Array:
    """Unit vectors (..., 3) from polar angle and azimuth; shapes broadcast."""
    theta, phi = np.broadcast_arrays(theta, phi)
    sin_theta = np.sin(theta)
    return np.stack([sin_theta * np.cos(phi), sin_theta * np.sin(phi), np.cos(theta)], -1)


def normalize(vector: Array) -> Array:
    """Unit vectors along the last axis; the zero vector stays zero."""
    length = np.linalg.norm(vector, axis=-1, keepdims=True)
    return vector / np.where(length > 0, length, 1)


def polar_angle(direction: Array) -> Array:
    """Angle to +z of unit vectors, from arctan2 because arccos loses half the digits near the pole."""
    return np.arctan2(np.hypot(direction[..., 0], direction[..., 1]), direction[..., 2])


def half_difference(wi: Array, wo: Array) -> tuple[Array, Array, Array]:
    """Rusinkiewicz angles (theta_h, theta_d, phi_d) of direction pairs, each of shape (...).

    phi_d is in (-pi, pi] and is measured so that wi = wo's mirror image about h has it; the formula uses the
    half vector's own frame (Rusinkiewicz 1998, section 3) and is exact at theta_h = 0, where phi_h is taken as 0.
    """
    wi, wo = np.broadcast_arrays(wi, wo)
    half = normalize(wi + wo)
    sin_h = np.hypot(half[..., 0], half[..., 1])
    safe = np.where(sin_h > 0, sin_h, 1)
    cos_phi, sin_phi = np.where(sin_h > 0, half[..., 0] / safe, 1.0), half[..., 1] / safe
    x = cos_phi * wi[..., 0] + sin_phi * wi[..., 1]
    y = cos_phi * wi[..., 1] - sin_phi * wi[..., 0]
    dx = half[..., 2] * x - sin_h * wi[..., 2]
    dz = sin_h * x + half[..., 2] * wi[..., 2]
    return np.arctan2(sin_h, half[..., 2]), np.arctan2(np.hypot(dx, y), dz), np.arctan2(y, dx)
