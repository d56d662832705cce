"""Photographs under lights of any directions, interpolated to a light in between: a weight for each photograph.

Thin plates (Duchon 1977, "Splines minimizing rotation-invariant semi-norms in Sobolev spaces") over the projected
direction (l_x, l_y), where the zenith is the middle, azimuth has no seam, and steps are even for what cosines light.
Beside the plate stands the polynomial 1, l_x, l_y, l_z, which holds a Lambertian texel of any normal exactly.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Singular values of the polynomial below this part of the largest say nothing: lights all of one elevation.
_DEPENDENT = 1e-3


class LightWeights:
    """Weights of photographs, linear in their values.

    Parameters
    ----------
    directions : (n, 3) unit vectors to the lights, z along the normal
    smoothing : what is added to the plate's diagonal; 0 passes through every photograph
    """

    def __init__(self, directions: Array, smoothing: float) -> None:
        self._places = directions[:, :2]
        self._hull = convex_hull(self._places)
        tail = _polynomial(directions)
        _, values, axes = np.linalg.svd(tail, full_matrices=False)
        self._axes = axes[values > _DEPENDENT * values[0]].T
        tail = tail @ self._axes
        count, terms = tail.shape
        system = np.zeros((count + terms, count + terms))
        system[:count, :count] = _plate(self._places, self._places) + smoothing * np.eye(count)
        system[:count, count:], system[count:, :count] = tail, tail.T
        self._inverse = np.linalg.pinv(system, rcond=1e-13, hermitian=True)[:, :count]

    def within(self, places: Array) -> Array:
        """Projected directions (m, 2), those outside of the lights' convex hull moved to its nearest point."""
        return nearest_within(self._hull, places)

    def __call__(self, places: Array) -> Array:
        """Weights (m, n) of the photographs for lights of projected directions (m, 2), which lie `within`."""
        height = np.sqrt(np.maximum(1 - np.square(places).sum(-1, keepdims=True), 0))
        tail = _polynomial(np.concatenate([places, height], -1)) @ self._axes
        weights: Array = np.concatenate([_plate(places, self._places), tail], -1) @ self._inverse
        return weights


def _polynomial(directions: Array) -> Array:
    return np.concatenate([np.ones((len(directions), 1)), directions], -1)


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
