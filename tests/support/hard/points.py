"""Inputs that float32 finds hard, shared by the cases."""

from __future__ import annotations

from itertools import product

import numpy as np
from measured_materials.bake.directions import spherical

EPS = float(np.finfo(np.float32).eps)
Array = np.ndarray
DIRECTIONS = "poles, 1e-7 rad to 89.99 degrees, wi = wo, mirror(wo), -wo, phi_delta 0 and pi"


def ulps_around(*values: float) -> list[np.float32]:
    """Each number as float32, with its two neighbours."""
    out = []
    for value in values:
        x = np.float32(value)
        out += [np.nextafter(x, np.float32(-np.inf)), x, np.nextafter(x, np.float32(np.inf))]
    return out


def unit_interval() -> tuple[Array]:
    """[0, 1]: the ends, an ulp off them, the middle, tiny numbers down to denormals, and everything between."""
    hard = [0, 1e-45, 1e-38, 1e-20, 1e-10, 1e-7, 1e-4, *ulps_around(0.5), np.nextafter(np.float32(1), np.float32(0)), 1]
    spread = np.concatenate([np.geomspace(1e-6, 1, 60), 1 - np.geomspace(1e-7, 0.5, 60), np.linspace(0, 1, 101)])
    return (np.concatenate([np.array(hard, np.float32), spread.astype(np.float32)]),)


def pairs() -> tuple[Array, Array]:
    """(wi, wo) in the upper hemisphere and on its edge, and exact opposites, of which one is below."""
    theta = np.array([0, 1e-7, 1e-4, 0.01, 0.8, np.radians(89), np.radians(89.99), np.pi / 2])
    phi = np.array([0, 1e-4, 1.0, np.pi / 2, np.pi - 1e-4, np.pi])
    ti, to, p = np.array(list(product(theta, theta, phi))).T
    wi, wo = spherical(ti, p).astype(np.float32), spherical(to, 0.0).astype(np.float32)
    rng = np.random.default_rng(4)
    some = spherical(np.arccos(rng.random(100)), rng.uniform(-np.pi, np.pi, 100)).astype(np.float32)
    mirror = some * np.float32([-1, -1, 1])
    near = (mirror + 1e-4 * rng.normal(size=mirror.shape)).astype(np.float32)
    near /= np.linalg.norm(near, axis=-1, keepdims=True)
    others = spherical(np.arccos(rng.random(100)), rng.uniform(-np.pi, np.pi, 100)).astype(np.float32)
    a, b = np.concatenate([wi, some, mirror, near, others, -some]), np.concatenate([wo, *[some] * 5])
    # cos(pi / 2) in float64 is not 0, but that of a direction on the horizon is.
    for w in (a, b):
        w[np.abs(w[:, 2]) < 1e-7, 2] = 0
    return a, b


def pairs_above() -> tuple[Array, Array]:
    """Those of `pairs` of which both lie above the horizon, 89.99 degrees included."""
    wi, wo = pairs()
    above = (wi[:, 2] > 1e-4) & (wo[:, 2] > 1e-4)
    return wi[above], wo[above]
