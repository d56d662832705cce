"""Cases of f_r, the reflectances that light a shading map, at their narrowest and widest."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mpmath as mp
import numpy as np
from measured_materials.bake.lobes.lobes import PHONG, Lobe, lobe_value
from measured_materials.nodes.group import call
from measured_materials.nodes.lobe_group import lobe_group

from . import truth
from .case import Array, Case
from .points import DIRECTIONS, pairs_above

NARROW = (Lobe("ggx", 1e-3), Lobe("sheen", 0.05), Lobe("phong", 1e4, 0.0), Lobe("phong_cubic", 1e4, 0.0))
WIDE = (Lobe("ggx", 1.0), Lobe("sheen", 1.0), Lobe("phong", 1.0, 0.5), Lobe("phong_schlick", 1.0, 0.0))


def cases() -> list[Case]:
    """Of this module."""
    return [_case("narrow", NARROW, 2e-4, 2e-4), _case("wide", WIDE, 5e-7, 2e-6)]


def _value(lobe: Lobe, wi: Any, wo: Any) -> Any:
    """As the authors print it, by the angles."""
    wi, wo = ([x / mp.norm(w) for x in w] for w in (wi, wo))
    if lobe.name in PHONG:
        u = sum((a - b) ** 2 for a, b in zip((-wi[0], -wi[1], wi[2]), wo)) / 2
        curve, n = PHONG[lobe.name], mp.mpf(lobe.p1)
        highlight = truth.cosine_lobe(curve, u, n) * truth.lobe_norm(curve, n)
        return lobe.p2 / mp.pi + (1 - lobe.p2) * highlight
    theta_d, theta_h, _ = truth.half_angles(wi, wo)
    cosine, width = mp.cos(theta_h), mp.mpf(lobe.p1)
    if lobe.name == "ggx":
        ndf = width**2 / (mp.pi * (1 + (width**2 - 1) * cosine**2) ** 2)
        tangents = [(w[0] ** 2 + w[1] ** 2) / w[2] ** 2 for w in (wi, wo)]
        masked = 1 / (1 + sum((mp.sqrt(1 + width**2 * t) - 1) / 2 for t in tangents))
    else:
        sine = mp.sin(theta_h)
        ndf = mp.exp(-((cosine / sine / width) ** 2)) / (mp.pi * width**2 * sine**4) if sine else mp.mpf(0)
        masked = min(1, 2 * cosine * min(wi[2], wo[2]) / mp.cos(theta_d))
    return ndf * masked / (4 * wi[2] * wo[2])


def _case(name: str, lobes: tuple[Lobe, ...], exact: float, bound: float) -> Case:
    def formula(xp: Any, wi: Any, wo: Any) -> tuple[Any, ...]:
        return tuple(lobe_value(xp, lobe.name, wi, wo, lobe.p1, lobe.p2) for lobe in lobes)

    def nodes(folder: Path, wi: Any, wo: Any) -> tuple[Any, ...]:
        return tuple(call(lobe_group(lobe.name), wi, wo, lobe.p1, lobe.p2) for lobe in lobes)

    def error(found: Array, true: Array, wi: Array, wo: Array) -> Array:
        peaks = np.stack([lobe.peak(wo) for lobe in lobes], -1)
        # A narrow sheen seen from the normal peaks at 1e-172, where float32 has ended.
        return np.abs(found - true) * wi[:, 2:] / np.maximum(peaks, 1e-30)

    return Case(
        "reflectances",
        f"{name}: {', '.join(f'{lobe.name} {lobe.p1:g}' for lobe in lobes)}",
        DIRECTIONS,
        "f cos(theta_i), of its peak",
        "a rounding of the directions over the width of the lobe; float64 too starts from float32 vectors",
        {"float64": exact, "float32": bound, "nodes": bound},
        pairs_above,
        truth.each(lambda wi, wo: tuple(_value(lobe, wi, wo) for lobe in lobes)),
        formula,
        nodes=nodes,
        error=error,
        low=0,
    )
