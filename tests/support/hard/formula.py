"""A formula of the papers that loses its digits in float32, and what both forms are measured by."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import mpmath as mp
import numpy as np
from measured_materials.bake import xp_numpy
from measured_materials.bake.directions import spherical

from . import truth

Array = np.ndarray
F32 = np.float32
_EPS = float(np.finfo(F32).eps)


def _vec32(x: Any, y: Any, z: Any) -> Array:
    return xp_numpy.vec(x, y, z).astype(F32)


def _divide32(a: Any, b: Any) -> Array:
    return xp_numpy.divide(np.asarray(a, F32), np.asarray(b, F32))


# numpy's namespace, in which no plain number raises anything to float64.
xp_float32: Any = SimpleNamespace(**{**vars(xp_numpy), "vec": _vec32, "divide": _divide32})


@dataclass(frozen=True)
class Formula:
    """One row: `errors` gives the worst error of the printed and of the stable form; `bound` is the latter's.

    As printed formulas live in the tests only. Both forms see the same float32 numbers; the truth is that of 40 digits.
    """

    paper: str
    what: str
    printed: str
    stable: str
    domain: str
    unit: str
    bound: float
    errors: Callable[[], tuple[float, float]]

    def __str__(self) -> str:
        return f"{self.paper}: {self.what}"


def digits_saved(printed: float, stable: float) -> float:
    """log10 of the ratio; an error that is not finite, or beyond 1, counts as 1, and none as an ulp."""
    worst = min(printed, 1.0) if math.isfinite(printed) else 1.0
    return math.log10(worst / max(stable, _EPS / 2))


def worst(found: Any, true: Any) -> float:
    """Largest absolute difference, infinite where one is not finite."""
    with np.errstate(all="ignore"):
        off = np.abs(np.asarray(found, np.float64) - true)
    return float(off.max()) if np.isfinite(off).all() else math.inf


def near_pairs() -> tuple[Array, Array, Array]:
    """Float32 unit vectors 1e-5 to 1 rad apart about a tilted axis, and their angle in 40 digits."""
    theta = np.geomspace(1e-5, 1, 300)
    a = np.broadcast_to(spherical(0.9, 0.4), (300, 3))
    across = np.cross(a, [0.3, -0.5, 0.8])
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    b = np.cos(theta)[:, None] * a + np.sin(theta)[:, None] * across
    a, b = a.astype(F32), b.astype(F32)
    exact = truth.each(lambda x, y: mp.acos(_dot(x, y) / mp.norm(x) / mp.norm(y)))
    return a, b, exact(a.astype(float), b.astype(float))[:, 0]


def _dot(x: Any, y: Any) -> Any:
    return sum(p * q for p, q in zip(x, y))


def dot32(a: Array, b: Array) -> Array:
    """Dot product in float32, at most 1."""
    return np.minimum(np.sum(a * b, -1, dtype=F32), F32(1))
