"""Metallic paint as one formula for numpy and for shader nodes: the demo's simulated measurement and its truth."""

from __future__ import annotations

import math
from typing import Any


def metallic_paint(
    xp: Any, wi: Any, wo: Any, diffuse: Any, flake: Any, flake_alpha: float, coat_alpha: float, coat_eta: float
) -> Any:
    """BRDF in 1/sr of metal flakes and a pigment under a smooth clear coat, directions strictly above the horizon.

    coat GGX(coat_alpha) F(coat_eta) + T(theta_i) T(theta_o) (Schlick(flake) GGX(flake_alpha) + diffuse / pi), where T
    is what Fresnel leaves the coat at that angle; light reflected back up inside the coat is lost.

    Parameters
    ----------
    wi, wo : vectors of the namespace `xp`
    diffuse, flake : colours, vectors of `xp`
    """
    cos_i, cos_o = xp.components(wi)[2], xp.components(wo)[2]
    # |wi + wo| = 2 cos theta_d: a dot product could round to 0 above the horizon.
    cos_d = 0.5 * xp.length(wi + wo)
    half = xp.normalize(wi + wo)
    coat = dielectric(xp, cos_d, coat_eta) * ggx_lobe(xp, half, cos_i, cos_o, coat_alpha)
    through = (1 - dielectric(xp, cos_i, coat_eta)) * (1 - dielectric(xp, cos_o, coat_eta))
    flakes = ggx_lobe(xp, half, cos_i, cos_o, flake_alpha)
    below = 1 - xp.minimum(cos_d, 1.0)
    schlick = below * below * (below * below) * below
    metal = xp.scale(flake, flakes * (1 - schlick) * through)
    grey = coat + schlick * flakes * through
    return metal + xp.scale(diffuse, through * (1 / math.pi)) + xp.vec(grey, grey, grey)


def ggx_lobe(xp: Any, half: Any, cos_i: Any, cos_o: Any, alpha: float) -> Any:
    """D G / (4 cos_i cos_o) of isotropic GGX with height-correlated Smith shadowing (Heitz 2014, equation 99)."""
    x, y, z = xp.components(half)
    stretched = (x * x + y * y) * (1 / alpha**2) + z * z
    ndf = 1 / (stretched * stretched * (math.pi * alpha**2))
    a2 = alpha**2

    def length(cosine: Any) -> Any:
        return xp.sqrt(cosine * cosine * (1 - a2) + a2)

    return ndf * (0.5 / (cos_o * length(cos_i) + cos_i * length(cos_o)))


def dielectric(xp: Any, cosine: Any, eta: float) -> Any:
    """Unpolarised Fresnel reflectance at relative index eta >= 1."""
    refracted = xp.sqrt(cosine * cosine + (eta**2 - 1))
    perpendicular = (cosine - refracted) / (cosine + refracted)
    parallel = (cosine * eta**2 - refracted) / (cosine * eta**2 + refracted)
    return 0.5 * (perpendicular * perpendicular + parallel * parallel)
