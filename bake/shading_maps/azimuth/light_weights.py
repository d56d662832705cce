"""Photographs under lights of any directions, interpolated to a light in between: a weight for each photograph.

Thin plates (Duchon 1977, "Splines minimizing rotation-invariant semi-norms in Sobolev spaces") over the projected
direction (l_x, l_y), where the zenith is the middle, azimuth has no seam, and steps are even for what cosines light.
Beside the plate stands the polynomial 1, l_x, l_y, l_z, which holds a Lambertian texel of any normal exactly.

Under a highlight photographs differ by a hundred times in brightness, and a plate that bends for the bright ones would
ripple among the dark: "scaled" multiplies it by the level of the light at both its ends, so that it bends photographs
in parts of their level. "shadows" does so over other places, by azimuth and ln(1 + tan theta): a shadow is as long as
tan theta, and low lights, which are close together in projection, lie as far apart as what they show.
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from .level_curve import LevelCurve

Array = NDArray[np.float64]

Plate = Literal["plain", "scaled", "shadows"]
PLATES: tuple[Plate, ...] = get_args(Plate)
# Level below which lights count as equally dark, and angle from the normal beyond which as equally low.
_DARKEST, _LOWEST = 1e-3, 1.55
# Singular values of the polynomial below this part of the largest say nothing: lights all of one elevation. A highlight
# a thousand times as bright as all else makes terms as small, which few lights hardly tell: nothing is worse for it.
_DEPENDENT = 1e-3


class LightWeights:
    """Weights of photographs, linear in their values.

    Parameters
    ----------
    directions : (n, 3) unit vectors to the lights, z along the normal
    smoothing : what is added to the plate's diagonal; 0 passes through every photograph
    curve : levels of lights, by which `plate` multiplies
    plate : over which places, and of what
    """

    def __init__(self, directions: Array, smoothing: float, curve: LevelCurve, plate: Plate = "plain") -> None:
        self._curve, self._kind = curve, plate
        self._hull = convex_hull(directions[:, :2])
        self._places, self._levels = self._place(directions), self._level(directions)
        tail = self._polynomial(directions)
        _, values, axes = np.linalg.svd(tail, full_matrices=False)
        self._axes = axes[values > _DEPENDENT * values[0]].T
        tail = tail @ self._axes
        count, terms = tail.shape
        system = np.zeros((count + terms, count + terms))
        bent = _plate(self._places, self._places) + smoothing * np.eye(count)
        system[:count, :count] = self._levels[:, None] * bent * self._levels
        system[:count, count:], system[count:, :count] = tail, tail.T
        self._inverse = np.linalg.pinv(system, rcond=1e-13, hermitian=True)[:, :count]

    def within(self, places: Array) -> Array:
        """Projected directions (m, 2), those outside of the lights' convex hull moved to its nearest point."""
        return nearest_within(self._hull, places)

    def __call__(self, places: Array) -> Array:
        """Weights (m, n) of the photographs for lights of projected directions (m, 2), which lie `within`."""
        height = np.sqrt(np.maximum(1 - np.square(places).sum(-1, keepdims=True), 0))
        directions = np.concatenate([places, height], -1)
        plate = self._level(directions)[:, None] * _plate(self._place(directions), self._places) * self._levels
        weights: Array = np.concatenate([plate, self._polynomial(directions) @ self._axes], -1) @ self._inverse
        return weights

    def _level(self, directions: Array) -> Array:
        cosine = directions[:, 2]
        return np.ones_like(cosine) if self._kind == "plain" else np.maximum(self._curve.level(cosine), _DARKEST)

    def _place(self, directions: Array) -> Array:
        """Where on the plate lights of these directions (n, 3) stand, (n, 2)."""
        if self._kind != "shadows":
            return directions[:, :2]
        aside = np.linalg.norm(directions[:, :2], axis=-1)
        radius = np.log1p(np.tan(np.minimum(np.arctan2(aside, directions[:, 2]), _LOWEST))) / 2
        return directions[:, :2] * (radius / np.maximum(aside, 1e-12))[:, None]

    def _polynomial(self, directions: Array) -> Array:
        """What beside the plate is held exactly, (n, terms): of a plate that is multiplied, linear functions of its
        places times the level, without which no plate need bend least."""
        one = np.ones((len(directions), 1))
        if self._kind == "plain":
            return np.concatenate([one, directions], -1)
        linear = self._level(directions)[:, None] * np.concatenate([one, self._place(directions)], -1)
        return linear if self._kind == "shadows" else np.concatenate([linear, directions], -1)


def _plate(a: Array, b: Array) -> Array:
    """r^2 log r of all pairs."""
    squared = np.square(a[:, None] - b[None]).sum(-1)
    return np.where(squared > 0, 0.5 * squared * np.log(np.maximum(squared, 1e-300)), 0.0)


def convex_hull(points: Array) -> Array:
    """Corners of the convex hull of (n, 2), counterclockwise (Andrew 1979, monotone chain)."""
    ordered = np.unique(points, axis=0)
    if len(ordered) < 3:
        return ordered

    def chain(places: Array) -> list[Array]:
        found: list[Array] = []
        for place in places:
            while len(found) > 1 and _cross(found[-1] - found[-2], place - found[-2]) <= 0:
                found.pop()
            found.append(place)
        return found[:-1]

    return np.array(chain(ordered) + chain(ordered[::-1]))


def _cross(a: Array, b: Array) -> float:
    return float(a[0] * b[1] - a[1] * b[0])


def nearest_within(hull: Array, places: Array) -> Array:
    """Places (m, 2), those outside of a convex polygon moved to the nearest point of its rim."""
    start, edge = hull, np.roll(hull, -1, axis=0) - hull
    from_start = places[:, None] - start[None]
    outside = (edge[None, :, 0] * from_start[..., 1] - edge[None, :, 1] * from_start[..., 0] < 0).any(1)
    length = np.maximum(np.square(edge).sum(-1), 1e-300)
    along = np.clip((from_start * edge).sum(-1) / length, 0, 1)
    rim = start + along[..., None] * edge
    chosen = np.argmin(np.square(places[:, None] - rim).sum(-1), axis=1)
    return np.where(outside[:, None], rim[np.arange(len(places)), chosen], places)


def widest_gap(directions: Array) -> float:
    """The largest angle in radians between azimuths of neighbouring lights, those near the zenith left out; 2 pi where
    fewer than two are left."""
    aside = np.linalg.norm(directions[:, :2], axis=-1) > np.sin(np.radians(10))
    azimuths = np.sort(np.arctan2(directions[aside, 1], directions[aside, 0]))
    if len(azimuths) < 2:
        return 2 * np.pi
    return float(np.diff(azimuths, append=azimuths[0] + 2 * np.pi).max())


def spacing(directions: Array) -> float:
    """Median angle in radians from a light to its nearest neighbour."""
    cosines = np.clip(directions @ directions.T, -1, 1)
    np.fill_diagonal(cosines, -1)
    return float(np.median(np.arccos(cosines.max(1))))
