"""Directions of lights by mirror spheres that lie in the picture, whose highlights show where each light stood.

The camera looks straight down from far away (orthographic, as for all photographs here): v = (0, 0, 1), the sphere's
normal at a pixel follows from its place in the circle, and a mirror shows there the light of l = 2 (n . v) n - v, as a
light probe (Debevec 1998, "Rendering synthetic objects into real scenes", section 4). The map from the circle's area to
directions keeps areas, dw = 4 dA / r^2, so that the mean of l over the highlight's pixels is the light's own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import BakeError

Sphere = tuple[float, float, float]
"""Centre x, y and radius in pixels from the upper left corner of the picture."""

LEAST_RADIUS = 4.0
# Lights on the horizon show at 1 / sqrt(2) of the radius; further out the sphere shows what lies beside it.
_HORIZON = math.sqrt(0.5)
# A highlight is brighter than the rest of what the sphere shows by this factor ...
_STANDS_OUT = 2.5
# ... and takes up less than this share of it: a sphere so bright all over is none, or the circle is not on it.
_MOST_AREA = 0.25
# ... and than this share of full scale or, of floats, of the picture's brightest pixels: below that is noise ...
_LEAST = 0.02
# Of the way from the rest to the brightest pixel, from which on a pixel belongs to the highlight.
_LEVEL = 0.5
# Degrees by which spheres may differ.
DOUBTFUL_DEG = 6.0


def light_on_sphere(path: Path, pixels: NDArray[Any], sphere: Sphere) -> NDArray[np.float64]:
    """Unit direction (3,) to the light, x right, y up, z to the camera, by one sphere.

    Parameters
    ----------
    pixels : (H, W, 1 or 3) as a viewer shows them, in any unit that rises with light; the most that integers hold is
        full scale

    Raises
    ------
    BakeError : the sphere is not within the picture, or shows no highlight
    """
    x, y, radius = sphere
    height, width = pixels.shape[:2]
    where = f"the sphere {x:g},{y:g},{radius:g}"
    if x - radius < -1 or y - radius < -1 or x + radius > width + 1 or y + radius > height + 1:
        cause = f"is {width} x {height}, and {where} reaches outside"
        raise BakeError(path, cause, "give x and y of its centre, and its radius, in pixels")
    reach = radius * _HORIZON
    left, top = max(math.floor(x - reach), 0), max(math.floor(y - reach), 0)
    part = pixels[top : math.ceil(y + reach) + 1, left : math.ceil(x + reach) + 1].astype(np.float64).mean(-1)
    part = _without_hot_pixels(part)
    rows, columns = np.indices(part.shape)
    normal = np.stack([(columns + left + 0.5 - x) / radius, (y - rows - top - 0.5) / radius], -1)
    inside = (normal**2).sum(-1) <= _HORIZON**2
    lit = _highlight(part, inside, _LEAST * _scale(pixels))
    if lit is None:
        cause = f"shows no highlight on {where}"
        raise BakeError(path, cause, "check the circle, and that the sphere is a mirror that the lamp shines on")
    nx, ny = normal[lit].T
    nz = np.sqrt(1 - nx**2 - ny**2)
    directions = np.stack([2 * nz * nx, 2 * nz * ny, 2 * nz**2 - 1], -1)
    mean: NDArray[np.float64] = part[lit] @ directions
    return mean / np.linalg.norm(mean)


def lights_on_spheres(path: Path, pixels: NDArray[Any], spheres: Sequence[Sphere]) -> tuple[NDArray[np.float64], float]:
    """Mean direction by several spheres, and the most degrees that one of them is off it. Raises BakeError."""
    found = np.stack([light_on_sphere(path, pixels, sphere) for sphere in spheres])
    mean = found.sum(0)
    mean /= np.linalg.norm(mean)
    return mean, float(np.degrees(np.arccos(np.clip(found @ mean, -1, 1))).max())


def _scale(pixels: NDArray[Any]) -> float:
    """Full scale, else what one pixel in a thousand reaches."""
    if np.issubdtype(pixels.dtype, np.integer):
        return float(np.iinfo(pixels.dtype).max)
    some = pixels[::4, ::4]
    some = some[np.isfinite(some)]
    return float(np.percentile(some, 99.9)) if some.size else 0.0


def _without_hot_pixels(part: NDArray[np.float64]) -> NDArray[np.float64]:
    """No pixel brighter than the brightest of its neighbours: a lamp seen by a lens lights several, a defect one."""
    padded = np.pad(part, 1, constant_values=-np.inf)
    height, width = part.shape
    around = [padded[i : i + height, j : j + width] for i in range(3) for j in range(3) if (i, j) != (1, 1)]
    return np.minimum(part, np.max(around, 0))


def _highlight(part: NDArray[np.float64], inside: NDArray[np.bool_], least: float) -> NDArray[np.bool_] | None:
    """Pixels of the brightest spot, at least so bright; None where none stands out."""
    values = part[inside]
    if not np.isfinite(values).all():
        return None
    rest, brightest = float(np.median(values)), float(values.max())
    if brightest <= max(rest * _STANDS_OUT, least, 0.0):
        return None
    bright = inside & (part >= rest + _LEVEL * (brightest - rest))
    spot = _connected(bright, _brightest_spot(part, bright))
    return spot if spot.sum() < _MOST_AREA * inside.sum() else None


def _brightest_spot(part: NDArray[np.float64], bright: NDArray[np.bool_]) -> tuple[int, int]:
    """Middle of the 3 x 3 pixels that are the brightest together."""
    padded = np.pad(np.where(bright, part, 0.0), 1)
    height, width = part.shape
    total = sum(padded[i : i + height, j : j + width] for i in range(3) for j in range(3))
    row, column = np.unravel_index(int(np.argmax(np.where(bright, total, -1.0))), part.shape)
    return int(row), int(column)


def _connected(bright: NDArray[np.bool_], start: tuple[int, int]) -> NDArray[np.bool_]:
    """Pixels that hang together with the first one, corners counting."""
    spot = np.zeros_like(bright)
    spot[start] = True
    while True:
        padded = np.pad(spot, 1)
        height, width = spot.shape
        grown = np.zeros_like(spot)
        for i in range(3):
            for j in range(3):
                grown |= padded[i : i + height, j : j + width]
        grown &= bright
        if (grown == spot).all():
            return spot
        spot = grown
