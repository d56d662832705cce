"""Repetition hidden at random: every point shows the swatch at the offset of one of the three hexagons around it.

The triangular grid and the weights are those of Heitz & Neyret 2018, "High-Performance By-Example Noise using a
Histogram-Preserving Blending Operator"; sharpened as by Mikkelsen 2022, "Practical Real-Time Hex-Tiling". One of the
three is drawn by a random number rather than that all are blended: what a shading map reflects enters linearly, so that
the mean is the blend, at the cost of one lookup. The swatch is moved and never turned, since its photographs were lit
from one side.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

# Of the weights: at 1 the swatches are blurred into each other everywhere, here near the borders alone.
SHARPNESS = 7
_SLOPE = 1 / math.sqrt(3)


def hexagon_tiling(
    xp: Any, offsets: Callable[[Any, Any], tuple[Any, Any]], u: Any, v: Any, size: Any, random: Any
) -> tuple[Any, Any]:
    """(u, v) moved by the offset of one of the hexagons that they lie in or near.

    Parameters
    ----------
    xp : namespace, numpy or `nodes.expr`
    offsets : (column, row) of a hexagon to its offset (u, v)
    u, v : in swatches
    size : of a hexagon, edge of the grid's triangles in swatches
    random : in [0, 1], chooses
    """
    across, up = xp.divide(u - v * _SLOPE, size), xp.divide(v * (2 * _SLOPE), size)
    column, row = xp.floor(across), xp.floor(up)
    x, y = across - column, up - row
    far = (x + y > 1) * 1.0  # the second triangle of the rhombus
    near = 1 - far
    # Of the corner at the origin or opposite, of that beside it, of that above: they sum to 1.
    first = _sharp((1 - x - y) * (near - far))
    second, third = _sharp(x * near + (1 - y) * far), _sharp(y * near + (1 - x) * far)
    place = random * (first + second + third)
    of_first = (place < first) * 1.0
    of_second = (place < first + second) * (1 - of_first)
    of_third = 1 - of_first - of_second
    moved_u, moved_v = offsets(column + far * of_first + of_second, row + far * of_first + of_third)
    return u + moved_u, v + moved_v


def _sharp(weight: Any) -> Any:
    """To the power of `SHARPNESS`."""
    square = weight * weight
    return square * square * square * weight
