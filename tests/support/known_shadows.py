"""Normals from photographs whose shadows are known: what a fit that has to find them is held against."""

from __future__ import annotations

import numpy as np
from measured_materials.bake.maps.normals import _solved
from measured_materials.bake.source import luminance

# Of a light that is hidden from more of a texel than this nothing is believed, unless too few are left.
_SEEN, _FEWEST = 0.5, 4


def normals_of(images: np.ndarray, visibility: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Unit normals (H, W, 3) by least squares of what each texel would show of a light unhidden (Woodham 1980).

    Parameters
    ----------
    images : (n, H, W, 3)
    visibility : (n, H, W), the part of a texel's light that no other place keeps from it
    directions : (n, 3) to the lights
    """
    count, height, width = visibility.shape
    seen, seen_of = luminance(images).reshape(count, -1).astype(np.float64), visibility.reshape(count, -1)
    weight = np.where(seen_of > _SEEN, seen_of**2, 0.0)
    few = (weight > 0).sum(0) < _FEWEST
    weight[:, few] = seen_of[:, few] ** 2 + 1e-6
    found = _solved(seen / np.maximum(seen_of, 1e-3), directions, weight)
    found /= np.maximum(np.linalg.norm(found, axis=-1, keepdims=True), 1e-12)
    return found.reshape(height, width, 3)
