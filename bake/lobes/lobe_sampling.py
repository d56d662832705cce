"""Directions drawn in proportion to a lobe, in closed form: a handful of nodes, no tables.

A shading map reflects S(r) of r = sigma f_r cos(theta_i), which can be far from 0 where r is tiny beside its peak. So a
glossy lobe shares its draws with the cosine, and the pdf returned is that of the whole mixture (balance heuristic).

lambert, oren_nayar   cosine
ggx                   normals visible to the viewer (Heitz 2018, as spherical caps: Dupuy & Benyoub 2023) and cosine
sheen                 uniform: its light comes from near the horizon, where the cosine has next to none
phong, phong_*        the lobe about the mirror direction, or one like it, and cosine
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .. import xp_numpy
from ..source import Array
from .cosine_lobes import draw_lobe, lobe_density
from .lobes import PHONG, Lobe, ggx_ndf, ggx_stretched, mirror_distance

# Share of a glossy lobe's draws that follow the cosine.
COSINE_SHARE = 0.2


def sample_lobe(
    xp: Any, name: str, wo: Any, u1: Any, u2: Any, u_choice: Any, p1: Any, p2: Any, cosine_share: float = COSINE_SHARE
) -> tuple[Any, Any]:
    """Draw a light direction for the viewer wo.

    Parameters
    ----------
    name : one of `lobes.LOBES`
    wo : unit vector above the horizon
    u1, u2, u_choice : independent random numbers in [0, 1], both ends included
    p1, p2 : the lobe's parameters
    cosine_share : least share of draws that follow the cosine, for "ggx" and Phong's

    Returns
    -------
    wi, unit length, and its pdf per solid angle as `lobe_pdf` gives it. wi may point below the horizon, or be the
    zero vector at a corner of the random numbers: such a draw carries nothing, whatever its pdf, which may be 0.
    """
    angle = u1 * (2 * math.pi)
    turn = xp.cos(angle), xp.sin(angle)
    if name == "ggx":
        wi = _draw_ggx(xp, wo, turn, u2, u_choice < cosine_share, p1)
    elif name in PHONG:
        by_cosine = u_choice < _share(xp, name, p2, cosine_share)
        wi = _draw_phong(xp, wo, turn, u2, by_cosine, p1, PHONG[name])
    else:
        wi = _around(xp, turn, 1 - u2 if name == "sheen" else xp.sqrt(1 - u2))
    return wi, lobe_pdf(xp, name, wi, wo, p1, p2, cosine_share)


def lobe_pdf(xp: Any, name: str, wi: Any, wo: Any, p1: Any, p2: Any, cosine_share: float = COSINE_SHARE) -> Any:
    """Density per solid angle, >= 0, with which `sample_lobe` draws wi (above the horizon) when seen from wo."""
    cosine = xp.maximum(xp.components(wi)[2], 0.0) * (1 / math.pi)
    if name == "sheen":
        return 1 / (2 * math.pi)
    if name != "ggx" and name not in PHONG:
        return cosine
    share = _share(xp, name, p2, cosine_share)
    if name == "ggx":
        # G1(wo) D / (4 cos_o), the cosines of G1 and of the Jacobian cancelled
        visible = 2 * (xp.components(wo)[2] + ggx_stretched(xp, wo, p1))
        lobe = ggx_ndf(xp, wi, wo, p1) / visible
    else:
        lobe = lobe_density(xp, PHONG[name], mirror_distance(xp, wi, wo), p1)
    return share * cosine + (1 - share) * lobe


def sample(lobe: Lobe, wo: Array, random: Array, cosine_share: float = COSINE_SHARE) -> tuple[Array, Array]:
    """`sample_lobe` in numpy: wo (..., 3), random (..., 3) as u1, u2, u_choice; wi (..., 3) and pdf (...)."""
    u1, u2, u_choice = (random[..., k] for k in range(3))
    wi, pdf = sample_lobe(xp_numpy, lobe.name, wo, u1, u2, u_choice, lobe.p1, lobe.p2, cosine_share)
    return wi, np.broadcast_to(pdf, wi.shape[:-1])


def _share(xp: Any, name: str, p2: Any, cosine_share: float) -> Any:
    """Of the draws that follow the cosine; Phong's diffuse part asks for its own."""
    return xp.maximum(p2, cosine_share) if name in PHONG else cosine_share


def _around(xp: Any, turn: tuple[Any, Any], cosine: Any) -> Any:
    """Direction at this cosine from z and this (cos, sin) of azimuth."""
    sine = xp.sqrt((1 - cosine) * (1 + cosine))
    return xp.vec(sine * turn[0], sine * turn[1], cosine)


def _draw_ggx(xp: Any, wo: Any, turn: tuple[Any, Any], u: Any, by_cosine: Any, alpha: Any) -> Any:
    """A visible normal is a point of the cap around the stretched viewer, halved with it and stretched back."""
    stretch = xp.vec(alpha, alpha, 1.0)
    viewer = xp.normalize(wo * stretch)
    cap = (1 - u) * (1 + xp.components(viewer)[2]) - xp.components(viewer)[2]
    point = _around(xp, turn, xp.where(by_cosine, xp.sqrt(1 - u), cap))
    half = xp.normalize((point + viewer) * stretch)
    mirrored = xp.scale(half, 2 * xp.dot(wo, half)) - wo
    return xp.where_vector(by_cosine, point, mirrored)


def _draw_phong(xp: Any, wo: Any, turn: tuple[Any, Any], u: Any, by_cosine: Any, exponent: Any, curve: str) -> Any:
    """About z, then turned half a circle about the direction midway between z and the axis, which moves z there."""
    away = xp.where(by_cosine, 1 - xp.sqrt(1 - u), draw_lobe(xp, curve, u, exponent))
    sine = xp.sqrt(away * (2 - away))
    local = xp.vec(sine * turn[0], sine * turn[1], 1 - away)
    normal = xp.vec(0.0, 0.0, 1.0)
    axis = wo * xp.vec(-1.0, -1.0, 1.0)
    midway = xp.normalize(xp.where_vector(by_cosine, normal, axis) + normal)
    return xp.scale(midway, 2 * xp.dot(midway, local)) - local
