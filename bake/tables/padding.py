"""Tables continued beyond their ends, as a texture filter needs them."""

from __future__ import annotations

import numpy as np

from ..source import Array
from .grids.grid import Grid

# Texels beside a slice that belong to its continuation: a cubic filter reaches one beyond the neighbour.
GUTTER = 2
PAD_MODES = {"around": "wrap", "mirrored": "reflect", "held": "edge"}


def pad_slices(grid: Grid, values: Array) -> Array:
    """Continue a table (*shape, 3) by one slice beyond the pole of its last slice axis, and all slices by `GUTTER`.

    Returns
    -------
    (..., S + 1, R + 2 G, C + 2 G, 3) with G = GUTTER; an azimuth among the slice axes goes around by its indices
    """
    rows = len(grid.shape) - 2
    values = continued(grid, values, rows - 1, 0, 1)
    for axis in (rows, rows + 1):
        values = continued(grid, values, axis, GUTTER, GUTTER)
    return values


def continued(grid: Grid, values: Array, axis: int, before: int, after: int) -> Array:
    """A table with so many samples more before and after those of an axis, by its boundary."""
    boundary = grid.boundaries[axis]
    if boundary != "pole":
        ends = [(before, after) if k == axis else (0, 0) for k in range(values.ndim)]
        return np.pad(values, ends, mode=PAD_MODES[boundary])  # type: ignore[call-overload]
    first, last = (np.take(values, [place], axis) for place in (0, -2))
    beyond = np.repeat(grid.beyond_pole(last, axis), after, axis)
    return np.concatenate([np.repeat(first, before, axis), values, beyond], axis)
