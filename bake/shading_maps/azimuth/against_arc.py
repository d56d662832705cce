"""Whether photographs ask for a map over azimuth at all, or one arc of them foretells the others as well."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...errors import BakeError
from ...photographs.lights import arc_of
from .azimuth_fit import Prepared
from .level_curve import LevelCurve
from .light_stack import LightStack, relative_error
from .light_weights import convex_hull, widest_gap

# Lights that leave no more of the circle open than this surround the swatch: four of them do, and so do three.
_OPEN = np.radians(150)
_LEAST_LIGHTS = 5
_LINE = 0.05


def surround(directions: NDArray[np.float64] | None) -> bool:
    """Whether lights of these directions (n, 3) stand on all sides of the swatch."""
    return directions is not None and len(directions) >= _LEAST_LIGHTS and widest_gap(directions) <= _OPEN


def check_lights(directions: NDArray[np.float64] | None) -> None:
    """Raise BakeError where no map over azimuth can be made of photographs under these lights (n, 3)."""
    if directions is None:
        raise BakeError("azimuths all", "needs directions of the lights", "give a lights file, or angles in the names")
    places = convex_hull(directions[:, :2])
    spread = np.linalg.svd(places - places.mean(0), compute_uv=False)
    if len(places) < 3 or spread[1] < _LINE * spread[0]:
        cause = "needs lights of several azimuths, but these lie in one plane"
        raise BakeError("azimuths all", cause, "photograph from more sides, or choose azimuths arc")


def foretells(prepared: Prepared, spread: float) -> bool:
    """Whether a map over azimuth foretells photographs that are left out better than one arc of the others does."""
    return relative_error(prepared.products, prepared.errors) < arc_error(prepared.products, spread)


def arc_error(stack: LightStack, spread: float) -> float:
    """Mean over photographs left out of the RMS by which one arc of the others misses them, in parts of their own.

    The arc is the one that is taken where nothing is said, its photographs sorted by their averages (Kautz et al.
    2004), and each light at the level of its elevation. Photographs are left out as for `azimuth_fit.left_out`.
    """
    found = np.zeros(len(stack))
    for kept, left in stack.folds():
        near = kept[arc_of(stack.directions[kept], None, spread)[1]]
        if len(near) < 2:
            return float("inf")
        averages = stack.averages[near]
        curve = LevelCurve.of(stack.directions[near, 2], averages)
        wanted = curve.level(stack.directions[left, 2]) * curve.a_max
        order = np.argsort(averages, kind="stable")
        knots = np.insert(averages[order], 0, 0.0)
        hats = np.eye(len(knots))[1:]
        weights = np.zeros((len(left), len(near)))
        weights[:, order] = np.stack([np.interp(wanted, knots, hat) for hat in hats], -1)
        found[left] = stack.errors(weights, left, near)
    return relative_error(stack, found)
