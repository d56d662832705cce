"""The virtual gantry takes a whole bidirectional texture function, as a goniometer does, and makes it upright."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from measured_materials.addon.gantry.techniques import SeesFrames, frame_uv, pixels
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from .btf import Btf, whole
from .rings import Array, Rings

# Points along a texel's edge that an oblique frame is read at.
_OVER = 2


def photograph_btf(
    gantry: SeesFrames, views: Rings, lights: Rings, progress: Callable[[float], None] = lambda share: None
) -> Btf:
    """One rectified picture for each pair of directions, with as many texels as the frame has pixels."""
    rows = []
    for k, view in enumerate(views.angles):
        theta, phi = map(math.radians, view)
        gantry.set_view(theta, phi)
        row = []
        for j, light in enumerate(lights.angles):
            gantry.set_light(*map(math.radians, light))
            row.append(rectified(gantry.render(), (theta, phi)))
            progress((k + (j + 1) / len(lights.angles)) / len(views.angles))
        rows.append(row)
    return whole(np.array(rows, np.float32), views, lights)


def rectified(frame: NDArray[np.float32], view: tuple[float, float]) -> Array:
    """The tile (S, S, 3) as it lies, of a gantry's frame (S, S, 3) from (theta, phi) in radians.

    From above a pixel is a texel. Obliquely the frame shows a parallelogram of the plane, two sides of it along v, as
    wide as the tile or wider in both directions, so that every texel is in it: itself, or one that repeats it.
    """
    size = len(frame)
    if view[0] == 0:
        return frame.astype(np.float64)
    quarters = frame_uv(2, view)
    across, up = 2 * (quarters[0, 1] - quarters[0, 0]), 2 * (quarters[0, 0] - quarters[1, 0])
    uv = frame_uv(size, over=_OVER) - 0.5
    a = uv[..., 0] / across[0]
    along = uv[..., 1] - across[1] * a
    b = (along - np.round(along)) / up[1]
    place = np.stack([(0.5 - b) * size - 0.5, (a + 0.5) * size - 0.5])
    channels = [map_coordinates(frame[..., k].astype(np.float64), place, order=1, mode="nearest") for k in range(3)]
    return pixels(np.stack(channels, -1), _OVER)
