"""Cases of the cosine lobes: values, factors and draws."""

from __future__ import annotations

from typing import Any

import mpmath as mp
import numpy as np
from measured_materials.bake.lobes.cosine_lobes import COSINE_LOBES, HEAVY, cosine_lobe, draw_lobe, lobe_norm

from . import truth
from .case import Array, Case, Osl
from .points import ulps_around

EXPONENTS = (0.01, 0.3, 0.999, *map(float, ulps_around(1)), 1.001, 2, 30, 256, 1e4, 1e6, 1e8)


def cases() -> list[Case]:
    """Of this module."""
    return [
        *(_value(name) for name in COSINE_LOBES),
        *(_norm(name) for name in COSINE_LOBES),
        *(_draw(name) for name in ("power", "cubic")),
    ]


def points() -> tuple[Array, Array]:
    """u and n: the peak, tiny u, the join and 90 degrees with an ulp beside both, the tail, and beyond."""
    u, n = [], []
    for exponent in EXPONENTS:
        p = -np.expm1(-np.log(2) / max(exponent, 1))
        at = np.array([0, 1e-38, 1e-20, *ulps_around(p, 1), 1.5, 2, *np.geomspace(1e-3 * p, 1, 12)], np.float32)
        u.append(at)
        n.append(np.full(len(at), exponent, np.float32))
    return np.concatenate(u), np.concatenate(n)


def exponents() -> tuple[Array]:
    """n alone."""
    return (np.array(EXPONENTS, np.float32),)


def draws() -> tuple[Array, Array]:
    """Random numbers, 0 and 1 and an ulp off them among them, and exponents up to what the nodes take."""
    random = np.array([0, 1e-38, 1e-7, 1e-3, 0.3, 0.5, 0.9, 0.999, *ulps_around(1)[:2]], np.float32)
    n = np.array([x for x in EXPONENTS if x <= 1e4], np.float32)
    return np.tile(random, len(n)), np.repeat(n, len(random))


def _value(name: str) -> Case:
    return Case(
        "cosine lobes",
        f"value of {name}",
        "n from 0.01 to 1e8, 1 and an ulp beside it; u at 0, at the join and 1 and an ulp beside, beyond",
        "of a peak of 1",
        "a dozen roundings whatever n is; OSL's exponential and power are fast and wrong by 1e-5 in parts",
        {"float64": 1e-14, "float32": 1e-6, "nodes": 1e-6, "osl": 1e-5},
        points,
        truth.each(lambda u, n: truth.cosine_lobe(name, u, n)),
        lambda xp, u, n: cosine_lobe(xp, name, u, n),
        osl=lambda folder: Osl(f'y[0] = mm_cosine_lobe("{name}", x, n);', 1, ("x", "n"), "measured_lobes.h"),
        low=0,
        high=1,
    )


def _norm(name: str) -> Case:
    return Case(
        "cosine lobes",
        f"factor of {name}",
        "n from 0.01 to 1e8, 1 and an ulp beside it",
        "relative",
        "8 nodes of quadrature (cosine: 3e-8); Schlick's closed form cancels ten times; OSL's sines are fast",
        {"float64": 3e-8 if name == "cosine" else 1e-13, "float32": 5e-6, "nodes": 1e-5, "osl": 2e-4},
        exponents,
        truth.each(lambda n: truth.lobe_norm(name, n)),
        lambda xp, n: lobe_norm(xp, name, n),
        osl=lambda folder: Osl(f'y[0] = mm_lobe_norm("{name}", n);', 1, ("n",), "measured_lobes.h"),
        error=lambda found, true, n: np.abs(found / true - 1),
        low=0,
    )


def _drawn(name: str) -> Any:
    def row(random: Any, n: Any) -> Any:
        if name not in HEAVY:
            return 1 - max(random, mp.mpf(2) ** -126) ** (1 / (n + 1))
        return min(((1 + n) ** random - 1) / n, mp.mpf(1))

    return row


def _draw(name: str) -> Case:
    heavy = name in HEAVY
    return Case(
        "cosine lobes",
        f"u drawn by {name}",
        "random numbers 0, 1, an ulp below 1; n from 0.01 to 1e4",
        "of 90 degrees" if heavy else "relative, of u above 1e-7 / (n + 1)",
        "at n = 0.01 the quotient of two differences" if heavy else "a handful of roundings; tanh to a few ulp",
        {"float64": 1e-13, "float32": 2e-5 if heavy else 1e-6, "nodes": 2e-5 if heavy else 1e-6},
        draws,
        truth.each(_drawn(name)),
        lambda xp, random, n: draw_lobe(xp, name, random, n),
        error=lambda found, true, random, n: (
            np.abs(found - true) / (1 if heavy else np.maximum(true, 1e-7 / (n[:, None] + 1)))
        ),
        low=0,
        high=1,
    )
