"""How narrow the lobes are that a material's sampler draws by: a lamp wider than these it finds by itself."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..directions import spherical
from ..source import Array

# Viewers, at even steps of the cosine, and azimuths, of which an isotropic sampler sees no difference.
_VIEWERS, _AZIMUTHS = 8, 4
_DRAWS = 128

# wo (..., 3) and numbers (..., 4) in [0, 1] to wi (..., 3) and its density (...).
Draw = Callable[[Array, Array], tuple[Array, Array]]


def concentration(draw: Draw, anisotropic: bool = False) -> float:
    """Mean density of a sampler's own draws, 1/sr, of the median viewer: 1 over the solid angle that they fill.

    To three digits. It is the integral of the density's square above the horizon, 2/(3 pi) of a cosine's draws.
    """
    cosines = (np.arange(_VIEWERS) + 0.5) / _VIEWERS
    azimuths = np.arange(_AZIMUTHS) / _AZIMUTHS * np.pi if anisotropic else np.zeros(1)
    theta, phi = np.meshgrid(np.arccos(cosines), azimuths, indexing="ij")
    wo = np.broadcast_to(spherical(theta.ravel(), phi.ravel())[:, None], (theta.size, _DRAWS, 3))
    # The same numbers at every build.
    wi, pdf = draw(wo, np.random.default_rng(0).random((*wo.shape[:2], 4)))
    # Of draws below the horizon, which carry no light, it has no mean: they crowd where wo . h vanishes.
    found = np.median(np.where(wi[..., 2] > 0, pdf, 0.0).mean(-1))
    return float(f"{found:.3g}")  # as exact as it is, and the same on every machine
