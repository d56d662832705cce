"""Where the swatch lies in the frame: crop or four corners, and the reduction to the size requested."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import BakeError
from .settings import SMALLEST_SIDE, Corners, Rectangle, StackSettings

Rows = Callable[[int, int], NDArray[np.float32]]
"""Linear values (rows, width of the region, 3) of rows `start` to `stop` of the region."""

_STRIP_VALUES = 1 << 21
_MAX_SUPERSAMPLING = 32
# Codes of Exif: which flips bring the stored rows upright, after transposing for 5 to 8.
_FLIPS = {1: (0, 0), 2: (0, 1), 3: (1, 1), 4: (1, 0), 5: (0, 0), 6: (0, 1), 7: (1, 1), 8: (1, 0)}


@dataclass(frozen=True)
class Placement:
    """Region (x, y, width, height) of the frame that is read, corners inside it or None, size of the result."""

    region: Rectangle
    corners: NDArray[np.float64] | None
    width: int
    height: int

    @property
    def scale(self) -> float:
        """Pixels of the photograph per texel of the result."""
        return self._full_width / self.width

    @property
    def _full_width(self) -> float:
        return float(_side_lengths(self.corners)[0]) if self.corners is not None else float(self.region[2])

    @property
    def turn(self) -> float:
        """Angle (rad) from the photograph's x axis to the result's, anticlockwise with y up; 0 for a crop."""
        if self.corners is None:
            return 0.0
        c = self.corners
        x, y = (c[1] - c[0]) / np.linalg.norm(c[1] - c[0]) + (c[2] - c[3]) / np.linalg.norm(c[2] - c[3])
        return float(np.arctan2(-y, x))


def upright(pixels: NDArray[Any], orientation: int) -> NDArray[Any]:
    """Pixels as a viewer shows them, by the Exif orientation; a view, not a copy."""
    if orientation >= 5:
        pixels = pixels.swapaxes(0, 1)
    vertical, horizontal = _FLIPS[orientation]
    return pixels[:: -1 if vertical else 1, :: -1 if horizontal else 1]


def place(file: Path, width: int, height: int, settings: StackSettings) -> Placement:
    """Placement in frames of this size. Raises BakeError where crop or corners lie outside or little is left."""
    if settings.corners is not None:
        return _place_corners(file, width, height, settings.corners, settings.size)
    region = settings.crop or (0, 0, width, height)
    check_inside(file, "crop", region, width, height)
    return Placement(region, None, *_reduced(file, region[2], region[3], settings.size))


def check_inside(file: Path, what: str, region: Rectangle, width: int, height: int) -> None:
    """Raises BakeError where a rectangle leaves the frame."""
    x, y, w, h = region
    if x + w > width or y + h > height:
        cause = f"is {width} x {height}, and the {what} reaches to x {x + w}, y {y + h}"
        raise BakeError(file, cause, f"give the {what} as x, y, width, height inside the photograph")


def _place_corners(file: Path, width: int, height: int, corners: Corners, size: int | None) -> Placement:
    points = np.array(corners, float)
    if points.min() < -0.5 or (points > np.array([width, height]) + 0.5).any():
        raise BakeError(file, f"is {width} x {height}, and a corner lies outside", "give corners inside the photograph")
    # One pixel more around, for the bilinear taps at the border.
    low = np.clip(np.floor(points.min(axis=0)) - 1, 0, None).astype(int)
    high = np.minimum(np.ceil(points.max(axis=0)) + 1, [width, height]).astype(int)
    region = (int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1]))
    inside = points - low
    full = np.maximum(np.round(_side_lengths(inside)), 1).astype(int)
    return Placement(region, inside, *_reduced(file, int(full[0]), int(full[1]), size))


def _side_lengths(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean length of top and bottom, and of left and right."""
    sides = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    return np.array([(sides[0] + sides[2]) / 2, (sides[1] + sides[3]) / 2])


def _reduced(file: Path, width: int, height: int, size: int | None) -> tuple[int, int]:
    longer = max(width, height)
    if size is not None and size < longer:
        width, height = (max(1, round(side * size / longer)) for side in (width, height))
    if min(width, height) < SMALLEST_SIDE:
        raise BakeError(file, f"leaves a swatch of {width} x {height} texels", "choose a larger crop or size")
    return width, height


def resample(rows: Rows, placement: Placement) -> NDArray[np.float32]:
    """The swatch (height, width, 3): area average of the region, or of the quadrilateral made square-on."""
    _, _, width, height = placement.region
    if placement.corners is None:
        return _reduce(rows, placement.region, placement.width, placement.height)
    # What is reduced much is averaged before it is warped, down to two pixels per texel: few taps then suffice.
    matrix = homography(placement.corners, placement.width, placement.height)
    factor = max(1.0, _stretch(matrix, placement.width, placement.height)[0] / 2)
    reduced = max(1, round(width / factor)), max(1, round(height / factor))
    corners = placement.corners * [reduced[0] / width, reduced[1] / height]
    return _square_on(_reduce(rows, placement.region, *reduced), corners, placement.width, placement.height)


def _reduce(rows: Rows, region: Rectangle, width: int, height: int) -> NDArray[np.float32]:
    """Area average of a region, read in strips so that only the narrowed rows are held."""
    step = max(1, _STRIP_VALUES // (3 * region[2]))
    narrow = np.empty((region[3], width, 3), np.float32)
    for start in range(0, region[3], step):
        stop = min(start + step, region[3])
        narrow[start:stop] = area_average(rows(start, stop), width, axis=1)
    return area_average(narrow, height, axis=0)


def area_average(values: NDArray[np.float32], count: int, axis: int) -> NDArray[np.float32]:
    """Reduce an axis of n samples to `count` <= n, each the mean over its share of the axis, fractions included."""
    n = values.shape[axis]
    if count == n:
        return values
    edges = np.arange(count + 1) * (n / count)
    whole = np.minimum(edges.astype(int), n - 1)
    sums = np.add.reduceat(values, whole[:-1], axis=axis, dtype=np.float64)
    # The last sum runs to the end, sample n - 1 included, which the share of the last edge adds once more.
    sums[(slice(None),) * axis + (-1,)] -= values.take(n - 1, axis)
    share = np.expand_dims(edges - whole, tuple(k for k in range(values.ndim) if k != axis))
    cut = share * values.take(whole, axis)
    sums += np.diff(cut, axis=axis)
    return (sums * (count / n)).astype(np.float32)


def homography(corners: NDArray[np.float64], width: int, height: int) -> NDArray[np.float64]:
    """(3, 3) matrix from (x, y, 1) in a width x height rectangle to the quadrilateral TL, TR, BR, BL, up to scale."""
    rows: list[list[float]] = []
    target: list[float] = []
    for (x, y), (u, v) in zip([(0, 0), (width, 0), (width, height), (0, height)], corners):
        rows += [[x, y, 1, 0, 0, 0, -u * x, -u * y], [0, 0, 0, x, y, 1, -v * x, -v * y]]
        target += [u, v]
    return np.append(np.linalg.solve(np.array(rows, float), np.array(target)), 1.0).reshape(3, 3)


def _square_on(
    image: NDArray[np.float32], corners: NDArray[np.float64], width: int, height: int
) -> NDArray[np.float32]:
    """Inverse mapping, each texel the mean of as many bilinear taps as image pixels it covers each way."""
    matrix = homography(corners, width, height)
    taps = int(np.clip(np.ceil(_stretch(matrix, width, height)[1] - 0.05), 1, _MAX_SUPERSAMPLING))
    result = np.empty((height, width, 3), np.float32)
    step = max(1, _STRIP_VALUES // (3 * width * taps * taps))
    x = (np.arange(width * taps) + 0.5) / taps
    for start in range(0, height, step):
        stop = min(start + step, height)
        y = (np.arange(start * taps, stop * taps) + 0.5)[:, None] / taps
        w = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2]
        u = (matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2]) / w
        v = (matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2]) / w
        fine = _bilinear(image, u - 0.5, v - 0.5)
        result[start:stop] = fine.reshape(stop - start, taps, width, taps, 3).mean(axis=(1, 3))
    return result


def _stretch(matrix: NDArray[np.float64], width: int, height: int) -> tuple[float, float]:
    """Least and largest number of image pixels per texel along an axis; a homography has both at corners."""
    lengths = []
    for x, y in ((0, 0), (width, 0), (width, height), (0, height)):
        u, v, w = matrix @ [x, y, 1.0]
        jacobian = (matrix[:2, :2] - np.outer([u / w, v / w], matrix[2, :2])) / w
        lengths += np.linalg.norm(jacobian, axis=0).tolist()
    return min(lengths), max(lengths)


def _bilinear(image: NDArray[np.float32], u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float32]:
    """Values at pixel positions (0 = centre of the first pixel), the border continued."""
    height, width = image.shape[:2]
    u, v = np.clip(u, 0, width - 1), np.clip(v, 0, height - 1)
    x, y = np.minimum(u.astype(int), max(width - 2, 0)), np.minimum(v.astype(int), max(height - 2, 0))
    s, t = (u - x)[..., None].astype(np.float32), (v - y)[..., None].astype(np.float32)
    right, below = np.minimum(x + 1, width - 1), np.minimum(y + 1, height - 1)
    top = image[y, x] * (1 - s) + image[y, right] * s
    bottom = image[below, x] * (1 - s) + image[below, right] * s
    mixed: NDArray[np.float32] = top * (1 - t) + bottom * t
    return mixed
