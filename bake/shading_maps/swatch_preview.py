"""The bundle's picture: the swatch under rising light, from grazing at the left to full at the right."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..brdf.preview_sphere import to_srgb
from .shading_map import ShadingMap, at_level

_SIZE = 256
_LEVELS = (0.15, 0.4, 0.7, 1.0)


def preview_swatch(shading_map: ShadingMap) -> NDArray[np.uint8]:
    """(256, 256, 3) display values: four strips of the swatch, each at its own level."""
    height, width = shading_map.slices.shape[1:3]
    side = min(height, width)
    rows = (np.arange(_SIZE) * side // _SIZE) % height
    columns = (np.arange(_SIZE) * side // _SIZE) % width
    strips = np.array_split(columns, len(_LEVELS))
    parts = [at_level(shading_map, x)[rows][:, strip] for x, strip in zip(_LEVELS, strips)]
    picture = np.concatenate(parts, axis=1)
    # Half of the brightest slice's mean is shown as middle grey.
    return np.rint(to_srgb(picture * 0.36) * 255).astype(np.uint8)
