"""What limits the noise of mode Exact under one small lamp, worked out from the bundle alone.

A sample is the native closures' light E over 1 - P, or the residual's R over P and over the share a of draws that are
aimed. Its variance, summed over the pixels of the sphere of `engine_scenes`,

    E^2 / (1 - P) + R^2 / (P a) - (E + R)^2,

has two causes: P follows the share of the residual in all the light of one theta_o, but the lamp sees another
share, and 1 - a of the draws miss the lamp. Each is corrected here on paper. Cycles' lamp samples are taken as exact.
"""

from __future__ import annotations

import math

import numpy as np
from measured_materials.addon.lights.light_tables import LARGEST_SHARE
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.bundle.bundle import Bundle
from measured_materials.bake.envelope.views import chord_of
from measured_materials.bake.source import Array

_LAMP = 3 * np.array([0.5, -0.62, 0.6]) / np.linalg.norm([0.5, -0.62, 0.6])
_VIEWER = np.array([0, -5, 1.5]) / np.linalg.norm([0, -5, 1.5])
_EDGE = 40
_FEWEST = 0.02
LIMITS = ("as it is", "P of the lamp's direction", "97 % aimed", "both")


def noise_limits(bundle: Bundle, samples: int) -> dict[str, float]:
    """RMS noise of direct light at so many samples over its mean, for each of `LIMITS`."""
    wi, wo, irradiance = _lamp_seen()
    fit = BrdfRecord.read(bundle).load_envelope()
    rest = BrdfRecord.read(bundle).load_table("residual")
    native = fit.evaluate(wi, wo) * irradiance[:, None]
    mirror = rest.evaluate(wi, wo) * (irradiance * wi[:, 2])[:, None]
    share = bundle.load("envelope")[0, :, 3]
    usual = np.interp(chord_of(wo) * (len(share) - 1), np.arange(len(share)), share)
    local = mirror.sum(-1) / np.maximum((mirror + native).sum(-1), 1e-30)
    # Some draws must be left for all other light.
    local = np.clip(np.maximum(local, usual / 4), _FEWEST, 1 - _FEWEST)

    def noise(chance: Array, aimed: float) -> float:
        p = chance[:, None]
        second = mirror**2 / (p * aimed) + native**2 / (1 - p)
        variance = np.maximum(second - (mirror + native) ** 2, 0).mean()
        return math.sqrt(float(variance) / samples) / float((mirror + native).mean())

    values = (
        noise(usual, LARGEST_SHARE),
        noise(local, LARGEST_SHARE),
        noise(usual, 0.97),
        noise(local, 0.97),
    )
    return dict(zip(LIMITS, values, strict=True))


def _lamp_seen() -> tuple[Array, Array, Array]:
    """Local directions (P, 3) to lamp and viewer at the sphere's pixels that the lamp lights, and its light there."""
    grid = (np.arange(_EDGE) + 0.5) / _EDGE * 2 - 1
    x, y = (a.ravel() for a in np.meshgrid(grid, grid))
    seen = x**2 + y**2 < 0.97
    x, y = x[seen], y[seen]
    right = np.array([1.0, 0, 0])
    up = np.cross(_VIEWER, right)
    normal = x[:, None] * right + y[:, None] * up + np.sqrt(1 - x * x - y * y)[:, None] * _VIEWER
    to_lamp = _LAMP - normal
    distance = np.linalg.norm(to_lamp, axis=-1, keepdims=True)
    to_lamp /= distance
    tangent = _VIEWER - normal * (normal @ _VIEWER)[:, None]
    tangent /= np.linalg.norm(tangent, axis=-1, keepdims=True)
    frame = np.stack([tangent, np.cross(normal, tangent), normal], 1)
    wi, wo = np.einsum("pij,pj->pi", frame, to_lamp), frame @ _VIEWER
    facing = np.maximum(to_lamp @ _LAMP, 0) / np.linalg.norm(_LAMP)
    lit = (wi[:, 2] > 0.01) & (wo[:, 2] > 0.05)
    return wi[lit], wo[lit], (facing / distance[:, 0] ** 2)[lit]
