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


def sampled(image: NDArray[Any], uv: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values (..., C) at uv (..., 2) of an image (H, W, C) that repeats, by a linear filter."""
    value = np.zeros((*np.shape(uv)[:-1], image.shape[-1]))
    for index, weight in texels_around(image.shape[:2], np.asarray(uv, np.float64)):
        value += weight[..., None] * image[index]
    return value
