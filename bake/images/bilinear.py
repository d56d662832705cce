"""The four texels that a linear filter reads, and their weights."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def texels_around(size: tuple[int, ...], uv: NDArray[np.float64]) -> list[tuple[tuple[Any, Any], Any]]:
    """Of an image of (height, width) that repeats: index and weight of each texel around uv (..., 2), v upwards."""
    height, width = size
    column, row = uv[..., 0] * width - 0.5, (1 - uv[..., 1]) * height - 0.5
    left, top = np.floor(column).astype(np.intp), np.floor(row).astype(np.intp)
    a, b = column - left, row - top
    return [
        (((top + i) % height, (left + j) % width), (b if i else 1 - b) * (a if j else 1 - a))
        for i in (0, 1)
        for j in (0, 1)
    ]
