"""The numpy half of the namespace `xp` that formulas shared with shader nodes are written against.

`nodes.expr` offers the same names on sockets. A scalar is an array of any shape, a vector has a last axis of
three; `scale` multiplies the one by the other, since numpy would broadcast along the wrong axis.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .source import Array

pi = np.pi


def sqrt(x: Any) -> Any:
    """Square root, 0 for negative arguments as Cycles' Math node has it."""
    return np.sqrt(np.maximum(x, 0))


sin, cos, tanh, exp, log, floor = np.sin, np.cos, np.tanh, np.exp, np.log, np.floor
minimum, maximum, where = np.minimum, np.maximum, np.where
cross = np.cross


def arcsin(x: Any) -> Any:
    """Arcsine with the argument clamped to [-1, 1] as Cycles' Math node has it."""
    return np.arcsin(np.clip(x, -1, 1))


def arctan2(y: Any, x: Any) -> Any:
    """Angle of the point (x, y), 0 at the origin."""
    return np.arctan2(y, x)


def divide(a: Any, b: Any) -> Any:
    """Quotient, 0 where the divisor is 0, as Cycles' Math node has it."""
    a, b = np.broadcast_arrays(a, b)
    return np.divide(a, b, out=np.zeros(a.shape, np.promote_types(a.dtype, b.dtype)), where=b != 0)


def power(x: Any, exponent: Any) -> Any:
    """x ** exponent for x >= 0."""
    return np.power(x, exponent)


def vec(x: Any, y: Any, z: Any) -> Array:
    """Vector from three scalars."""
    return np.stack(np.broadcast_arrays(x, y, z), -1)


def where_vector(condition: Any, a: Array, b: Array) -> Array:
    """Vector `a` where the scalar condition holds, `b` elsewhere."""
    return np.where(np.asarray(condition)[..., None], a, b)


def components(v: Array) -> tuple[Array, Array, Array]:
    """The three scalars of a vector."""
    return v[..., 0], v[..., 1], v[..., 2]


def scale(v: Array, factor: Any) -> Array:
    """Vector times scalar."""
    return v * np.asarray(factor)[..., None]


def _total(v: Array) -> Array:
    """Sum over a vector's components, to the bit as `np.sum`, which takes five times as long over an axis of three.

    Adding 0 makes -0 of three such numbers 0.
    """
    x, y, z = components(v)
    total: Array = x + y + z + 0.0
    return total


def dot(a: Array, b: Array) -> Array:
    """Dot product of vectors."""
    return _total(a * b)


def length(v: Array) -> Array:
    """Euclidean length of vectors."""
    return np.sqrt(_total(v * v))


def normalize(v: Array) -> Array:
    """Unit vectors; the zero vector stays zero, as Cycles' Vector Math node has it."""
    n = length(v)[..., None]
    return v / np.where(n > 0, n, 1)
