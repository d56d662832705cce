"""Setting a slightly turned swatch straight, so that its threads meet across the border of an upright tile."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..source import Array
from .seams import reduction, shrink

STEEPEST = 0.04  # slope, about 2 degrees; beyond it the photographs should be turned
_SEARCH_SIDE = 256
_STEEPNESS_COST = 0.5  # keeps the search from taking a neighbouring thread for the same one


@dataclass(frozen=True)
class Shear:
    """Texel (y, x) of the straight picture shows (y + rise * (x - cx), x + lean * (y - cy)) of the swatch."""

    rise: float
    lean: float

    def is_felt(self, height: int, width: int) -> bool:
        """Whether anything moves by half a texel."""
        return abs(self.rise) * width >= 0.5 or abs(self.lean) * height >= 0.5

    def rim(self, height: int, width: int) -> tuple[int, int]:
        """Texels lost at top and bottom each, and at left and right each."""
        return int(np.ceil(abs(self.rise) * (width - 1) / 2)), int(np.ceil(abs(self.lean) * (height - 1) / 2))

    def apply(self, slices: Array) -> Array:
        """(N, H, W, C) -> (N, H'', W'', C), bilinear, cut to what the swatch covers."""
        y, x, fraction_y, fraction_x = self._grid(*slices.shape[1:3])
        result = np.empty((len(slices), *y.shape, slices.shape[3]), slices.dtype)
        wy, wx = fraction_y[..., None].astype(slices.dtype), fraction_x[..., None].astype(slices.dtype)
        for out, values in zip(result, slices):
            upper = values[y, x] * (1 - wx) + values[y, x + 1] * wx
            out[:] = upper * (1 - wy) + (values[y + 1, x] * (1 - wx) + values[y + 1, x + 1] * wx) * wy
        return result

    def nearest(self, height: int, width: int) -> Array:
        """Texel (y, x) of the swatch nearest to each, (H'', W'', 2) int32."""
        y, x, fraction_y, fraction_x = self._grid(height, width)
        return np.stack([y + (fraction_y >= 0.5), x + (fraction_x >= 0.5)], axis=2).astype(np.int32)

    def _grid(self, height: int, width: int) -> tuple[Array, Array, Array, Array]:
        rim_y, rim_x = self.rim(height, width)
        y, x = np.mgrid[rim_y : height - rim_y, rim_x : width - rim_x].astype(np.float64)
        y, x = y + self.rise * (x - (width - 1) / 2), x + self.lean * (y - (height - 1) / 2)
        # One texel short of the last, which is still a whole interpolation of two.
        whole_y = np.clip(np.floor(y), 0, height - 2).astype(np.intp)
        whole_x = np.clip(np.floor(x), 0, width - 2).astype(np.intp)
        return whole_y, whole_x, np.clip(y - whole_y, 0, 1), np.clip(x - whole_x, 0, 1)


def find_shear(features: Array, keep: float) -> Shear:
    """The slopes of the shifts under which the swatch is most like itself, one mostly across and one mostly down.

    Parameters
    ----------
    features : (H, W, K), see `stack_features`
    keep : shortest shift, as a share of the side
    """
    small = shrink(features, reduction(features.shape, _SEARCH_SIDE))
    difference = _self_difference(small)
    height, width = small.shape[:2]
    return Shear(_slope(difference, width, keep), _slope(difference.T, height, keep))


def _self_difference(image: Array) -> Array:
    """Mean squared difference (2 H, 2 W) between an image and itself shifted by (y, x), negative shifts at the end."""
    height, width = image.shape[:2]
    size = (2 * height, 2 * width)
    ones = np.fft.rfft2(np.ones((height, width)), s=size)
    energy = np.fft.rfft2(np.square(image).sum(axis=2), s=size)
    values = np.fft.rfft2(image, s=size, axes=(0, 1))
    count = np.fft.irfft2(np.abs(ones) ** 2, s=size)
    cross = ones.conj() * energy + energy.conj() * ones
    total = np.fft.irfft2(cross - 2 * (np.abs(values) ** 2).sum(axis=2), s=size)
    return np.asarray(np.maximum(total, 0) / np.maximum(count, 1))


def _slope(difference: Array, width: int, keep: float) -> float:
    """Rise over run of the best shift along x, to a fraction of a texel."""
    shifts = np.arange(int(np.ceil(keep * width)), max(int(0.9 * width), int(np.ceil(keep * width)) + 1))
    limit = min(int(STEEPEST * width), difference.shape[0] // 2 - 2)
    if limit < 1:
        return 0.0
    rises = np.arange(-limit, limit + 1)
    cost = difference[rises[:, None], shifts] * (1 + _STEEPNESS_COST * np.abs(rises[:, None]) / limit)
    k, j = np.unravel_index(int(cost.argmin()), cost.shape)
    below, here, above = difference[[rises[k] - 1, rises[k], rises[k] + 1], shifts[j]]
    bend = below - 2 * here + above
    fraction = float(np.clip(0.5 * (below - above) / bend, -0.5, 0.5)) if bend > 0 else 0.0
    return float((rises[k] + fraction) / shifts[j])
