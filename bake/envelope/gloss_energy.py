"""How much more native closures reflect under another gloss (`bake.sampling.gloss`).

The mirror's part keeps its light. A GGX closure made narrower loses less of it to its own masking: it brightens, at
grazing angles most. By that the sum may come to reflect more than arrives, where the measurement is close to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from ..directions import spherical
from ..lobes.lobes import Lobe
from ..source import Array
from .anisotropic_lobes import AnisotropicLobe
from .fitted import ClosureFit

# Between these the gain is as good as linear; softer closures gain nothing.
GLOSSES = (1.0, 1.25, 1.5, 2.0, 3.0, 4.0)
Rows = tuple[tuple[float, float, float], ...]
# Of the light that arrives.
_NEGLIGIBLE = 1e-4
_POINTS = 24
_AZIMUTHS = 8


def ggx_albedo(alpha_x: float, alpha_y: float, wo: Array) -> Array:
    """Share of light (V,) that GGX of Fresnel reflectance 1, scattering once, reflects to viewers (V, 3).

    The mean of G_2 / G_1 over visible normals, of height-correlated Smith masking, drawn at the middles of a regular
    grid (Heitz 2018, "Sampling the GGX distribution of visible normals", listing 1 and equation 19).
    """
    width = np.array([alpha_x, alpha_y, 1.0])
    view = wo * width
    view /= np.linalg.norm(view, axis=-1, keepdims=True)
    first = np.stack([-view[:, 1], view[:, 0], np.zeros(len(wo))], -1)
    size = np.linalg.norm(first, axis=-1, keepdims=True)
    first = np.where(size > 1e-7, first / np.maximum(size, 1e-7), np.array([1.0, 0, 0]))
    second = np.cross(view, first)
    u = (np.arange(_POINTS) + 0.5) / _POINTS
    radius, phi = np.sqrt(u)[:, None], 2 * np.pi * u
    t1, t2 = (radius * np.cos(phi)).ravel()[:, None], (radius * np.sin(phi)).ravel()[:, None]
    s = 0.5 * (1 + view[:, 2])
    t2 = (1 - s) * np.sqrt(1 - t1**2) + s * t2
    t3 = np.sqrt(np.maximum(1 - t1**2 - t2**2, 0))
    normal = t1[..., None] * first + t2[..., None] * second + t3[..., None] * view
    half = normal * np.array([alpha_x, alpha_y, 1.0])
    half[..., 2] = np.maximum(half[..., 2], 0)
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    wi = 2 * (half * wo).sum(-1, keepdims=True) * half - wo
    seen, lit = 1 + _masked(wo, alpha_x, alpha_y), _masked(wi, alpha_x, alpha_y)
    albedo: Array = np.where(wi[..., 2] > 0, seen / (seen + lit), 0).mean(0)
    return albedo


def _masked(w: Array, alpha_x: float, alpha_y: float) -> Array:
    """Smith's Lambda of GGX."""
    slope = ((alpha_x * w[..., 0]) ** 2 + (alpha_y * w[..., 1]) ** 2) / np.maximum(w[..., 2], 1e-6) ** 2
    value: Array = 0.5 * (np.sqrt(1 + slope) - 1)
    return value


@cache
def _albedo(closure: Lobe | AnisotropicLobe, gloss: float, degrees: tuple[float, ...], azimuths: int) -> Array:
    """Of a GGX closure under a gloss: (len(degrees), azimuths)."""
    widths = (closure.alpha_x, closure.alpha_y) if isinstance(closure, AnisotropicLobe) else (closure.p1, closure.p1)
    alpha_x, alpha_y = (min(width / gloss, 1.0) for width in widths)
    wo = _viewers(degrees, azimuths)
    return ggx_albedo(alpha_x, alpha_y, wo.reshape(-1, 3)).reshape(wo.shape[:-1])


def _viewers(degrees: Sequence[float], azimuths: int) -> Array:
    return spherical(np.radians(degrees)[:, None], np.arange(azimuths) * (2 * np.pi / azimuths))


def brightened(fit: ClosureFit, gloss: float, degrees: tuple[float, ...]) -> Array:
    """How much more a material's closures reflect under a gloss, by channel, to viewers at these angles: (n, 3).

    Of an anisotropic material the most of eight azimuths.
    """
    azimuths = _AZIMUTHS if len(fit.viewers.shape) > 1 else 1
    weights = fit.weights_at(_viewers(degrees, azimuths))
    more = np.zeros((len(degrees), azimuths, 3))
    for k, closure in enumerate(fit.closures):
        if closure.name == "ggx":
            gain = _albedo(closure, gloss, degrees, azimuths) - _albedo(closure, 1.0, degrees, azimuths)
            more += gain[..., None] * weights[..., k, :]
    most: Array = more.max(1)
    return most


def brightened_by_gloss(fit: ClosureFit, degrees: tuple[float, ...]) -> tuple[tuple[float, Rows], ...]:
    """`brightened` at `GLOSSES`, for what is told beside a slider: nothing where no closure gains."""
    tables = [(gloss, brightened(fit, gloss, degrees)) for gloss in GLOSSES]
    if max(float(rows.max()) for _, rows in tables) < _NEGLIGIBLE:
        return ()
    return tuple((gloss, tuple((float(r), float(g), float(b)) for r, g, b in rows)) for gloss, rows in tables)
