"""Lobes and pairs of directions that the tests of shading maps' f_r share."""

from __future__ import annotations

import numpy as np
from measured_materials.bake.directions import spherical
from measured_materials.bake.lobes.lobes import Lobe

NARROW = [
    Lobe("ggx", 1e-3),
    Lobe("ggx", 0.01),
    Lobe("phong", 1e4, 0.0),
    Lobe("sheen", 0.05),
    Lobe("phong_cubic", 1e4, 0.0),
]
WIDE = [
    Lobe("lambert"),
    Lobe("oren_nayar", 0.1),
    Lobe("oren_nayar", 1.0),
    Lobe("ggx", 0.1),
    Lobe("ggx", 0.5),
    Lobe("ggx", 1.0),
    Lobe("sheen", 0.2),
    Lobe("sheen", 1.0),
    Lobe("phong", 1.0, 0.2),
    Lobe("phong", 60.0, 0.3),
    Lobe("phong", 60.0, 0.0),
    Lobe("phong_schlick", 60.0, 0.0),
    Lobe("phong_schlick", 1.0, 0.3),
    Lobe("phong_lyon", 60.0, 0.0),
    Lobe("phong_cosine", 60.0, 0.3),
    Lobe("phong_cubic", 60.0, 0.0),
    Lobe("phong_cubic", 1.0, 0.2),
]


def pairs(count: int = 20_000, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of directions, half of them within 0.06 to 6 degrees of the horizon, and some near the mirror direction."""
    rng = np.random.default_rng(seed)
    z = np.concatenate([rng.random(count // 2), 10 ** rng.uniform(-3, -1, count - count // 2)])
    wo = spherical(np.arccos(z), rng.uniform(-np.pi, np.pi, count))
    wi = spherical(np.arccos(rng.permutation(z)), rng.uniform(-np.pi, np.pi, count))
    wi[::4] = wo[::4] * [-1, -1, 1]
    return wi, wo


def identity(lobe: Lobe) -> str:
    return "-".join(str(value) for value in lobe.facts().values())
