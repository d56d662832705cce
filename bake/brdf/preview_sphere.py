"""A small picture of a material for file browsers: a sphere under a lamp and a soft sky, shaded in numpy."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from ..directions import normalize, spherical
from ..source import Array

_LAMP = normalize(np.array([-0.45, 0.55, 0.7]))


class Reflects(Protocol):
    """What a material reflects."""

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """BRDF (..., 3) in 1/sr."""
        ...


def preview_sphere(table: Reflects, size: int = 128) -> Array:
    """(size, size, 3) 8-bit sRGB, row 0 on top; grey background outside the sphere."""
    inside, light = lit_sphere(table, size)
    picture = np.full((size, size, 3), 0.18)
    picture[inside] = light * exposure(light)
    return (to_srgb(picture) * 255 + 0.5).astype(np.uint8)


def lit_sphere(table: Reflects, size: int) -> tuple[Array, Array]:
    """Which pixels (size, size) show the sphere, and their light (P, 3), in reading order, row 0 on top."""
    x, y = np.meshgrid(np.linspace(-1.05, 1.05, size), np.linspace(1.05, -1.05, size))
    inside = x * x + y * y < 1
    normal = np.stack([x[inside], y[inside], np.sqrt(1 - x[inside] ** 2 - y[inside] ** 2)], -1)
    return inside, _radiance(table, normal)


def exposure(light: Array) -> float:
    """What the light of a sphere is multiplied by to be shown, white being 1."""
    return 0.7 / max(float(np.percentile(light, 90)), 1e-6)


def to_srgb(linear: Array) -> Array:
    """sRGB transfer function (IEC 61966-2-1), clipped to [0, 1]."""
    linear = np.clip(linear, 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def _radiance(table: Reflects, normal: Array) -> Array:
    """One lamp, and a ring of dim lights for the sky; the lamp's disk is spread so that sharp peaks show."""
    view = np.broadcast_to([0.0, 0.0, 1.0], normal.shape)
    total = np.zeros(normal.shape)
    lights = [(normalize(_LAMP + 0.03 * d), 3.0 / 7) for d in np.vstack([np.zeros(3), _ring(6, 1.2)])]
    lights += [(d, 0.35 / 12) for d in _ring(12, 1.0)]
    for direction, power in lights:
        cosine = np.maximum(normal @ direction, 0)[:, None]
        wi, wo = _local(normal, np.broadcast_to(direction, normal.shape)), _local(normal, view)
        total += power * cosine * table.evaluate(wi, wo)
    return total


def _ring(count: int, theta: float) -> Array:
    return spherical(theta, np.arange(count) * (2 * np.pi / count))


def _local(normal: Array, direction: Array) -> Array:
    """Directions in a frame about each normal; any tangent serves an isotropic table."""
    z = np.sum(normal * direction, -1)
    tangent = normalize(np.cross(normal, [0.31, 0.87, 0.38]))
    x = np.sum(direction * tangent, -1)
    y = np.sum(direction * np.cross(normal, tangent), -1)
    return normalize(np.stack([x, y, z], -1))
