"""Single fibres: arcs of a nap and curls of fuzz."""

from __future__ import annotations

import numpy as np

from .surfaces import Array, Surface, tubes


def nap(
    roots: Array, start: Array, end: Array, length: Array, radius: float, colour: Array, points: int = 4
) -> Surface:
    """Fibres (N) that leave their roots (N, 3) along `start` and bend over to run along `end` (unit, (N, 3)).

    colour is (N, 3); roots are darker, as they are in a dyed hide.
    """
    t = np.linspace(0, 1, points)[None, :, None]
    # The integral of (1 - t) start + t end: an arc of a parabola.
    centres = roots[:, None] + length[:, None, None] * ((t - t * t / 2) * start[:, None] + t * t / 2 * end[:, None])
    taper = np.linspace(1, 0.35, points) * radius
    shade = np.linspace(0.55, 1.0, points)[None, :, None]
    return tubes(centres, taper, colour[:, None] * shade, sides=3)


def curls(
    rng: np.random.Generator, roots: Array, start: Array, length: Array, radius: float, colour: Array, points: int = 7
) -> Surface:
    """Fibres (N) that wander off from their roots along `start`, each in a curl of its own."""
    count = len(roots)
    t = np.linspace(0, 1, points)[None, :, None]
    axis = _unit(start + 0.6 * rng.standard_normal((count, 3)))
    across = _unit(np.cross(axis, rng.standard_normal((count, 3))))
    second = np.cross(axis, across)
    turns, width = rng.uniform(1.5, 6.0, (count, 1, 1)), rng.uniform(0.15, 0.45, (count, 1, 1))
    swing = np.sin(turns * t) * across[:, None] + (1 - np.cos(turns * t)) * second[:, None]
    centres = roots[:, None] + length[:, None, None] * (t * axis[:, None] * (1 - width) + width * swing)
    return tubes(centres, np.linspace(1, 0.5, points) * radius, colour[:, None], sides=3)


def _unit(vectors: Array) -> Array:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
