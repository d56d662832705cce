"""Node group: the BRDF of a table for a pair of local directions, of one slice axis or of two.

A table of an isotropic material (Mallett & Yuksel 2016) is read between the slices of one axis, an anisotropic one
between those of two. Within a slice the image's own filter serves.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import Any

import bpy

from ..bake.tables.atlas import AtlasLayout, atlas_uv
from ..bake.tables.grids.grid import Grid, IsotropicGrid
from ..bake.tables.log_codes import LogCodes
from ..bake.tables.table import Filter, bspline_weights
from . import expr
from .group import call, node_group

# Blender's "Cubic" is the uniform B-spline, in two dimensions; the slice axes are ours.
_INTERPOLATION: dict[Filter, str] = {"nearest": "Closest", "trilinear": "Linear", "bspline": "Cubic"}


def coordinates_group(grid: IsotropicGrid) -> bpy.types.ShaderNodeTree:
    """(wi, wo) to coordinates in [0, 1] of the slices, rows and columns of a table on this grid."""
    return node_group(
        f"MM Coordinates {grid.basis.title()} {grid.parameterization.title()}",
        {"wi": "vector", "wo": "vector"},
        {"u_slice": "float", "u_row": "float", "u_phi": "float"},
        lambda wi, wo: grid.unit_coordinates(expr, wi, wo),
    )


def table_lookup_group(
    name: str,
    image: bpy.types.Image,
    grid: Grid,
    filter: Filter,
    scale: float = 1.0,
    stochastic: bool = False,
    offset: float = 0.0,
    log: LogCodes | None = None,
) -> bpy.types.ShaderNodeTree:
    """(wi, wo, random) to the BRDF in 1/sr without the cosine, of local directions.

    Parameters
    ----------
    image : the atlas of `bake.tables.atlas.pack`
    filter : "nearest", "trilinear" (linear along every axis) or "bspline"
    scale, offset : what stored values are multiplied by, after the offset was subtracted
    log : what stored values are the codes of; scale and offset are then 1 and 0
    stochastic : choose one slice with the filter's weights by the random number instead of blending all. Unbiased
        where the value enters the picture linearly, as in Reference mode, and one tap instead of 2 or 4, of an
        anisotropic table instead of 4 or 16
    """

    def lookup(wi: Any, wo: Any, random: Any) -> Any:
        position, texture_place = _place(grid, wi, wo)

        def tap(*slices: Any) -> Any:
            uv = texture_place(_slice_index(grid, slices))
            texel = expr.image_tap(image, *uv, _INTERPOLATION[filter])[0]
            return log.decode(expr, texel) if log else texel

        value = _across_slices(tap, position, grid.shape[-3], filter, random if stochastic else None)
        value = value - expr.vec(offset, offset, offset) if offset else value
        factor = grid.factor(expr, wi, wo)
        gain = scale if isinstance(factor, float) else expr.divide(scale, factor)
        return value if isinstance(gain, float | int) and gain == 1 else expr.scale(value, gain)

    return node_group(
        name, {"wi": "vector", "wo": "vector", "Random": "float"}, {"BRDF": "vector"}, lookup, {"Random": 0.5}
    )


def _place(grid: Grid, wi: Any, wo: Any) -> tuple[tuple[Any, ...], Callable[[Any], tuple[Any, Any]]]:
    """Fractional indices along the slice axes, and texture coordinates within the slice of a whole index."""
    layout = AtlasLayout.of(grid)
    if isinstance(grid, IsotropicGrid):
        u_slice, u_row, u_phi = call(coordinates_group(grid), wi, wo)
        count, rows, columns = grid.shape
        # At every tap anew: a product fewer would be a live value more.
        return (u_slice * (count - 1),), lambda index: atlas_uv(
            expr, layout, index, u_row * (rows - 1), u_phi * (columns - 1)
        )
    *position, row, column = grid.coordinates(expr, wi, wo)
    return tuple(position), lambda index: atlas_uv(expr, layout, index, row, column)


def _slice_index(grid: Grid, slices: Sequence[Any]) -> Any:
    """Place in the atlas of whole indices along the slice axes; the azimuth's, at most two beyond an end, is periodic.

    Along the last of them one slice more lies beyond the pole.
    """
    if len(slices) == 1:
        return slices[0]
    azimuth, polar = slices
    count = grid.shape[0]
    if count == 1:
        return polar
    azimuth = expr.where(azimuth > count - 0.5, azimuth - count, azimuth)
    azimuth = expr.where(azimuth < -0.5, azimuth + count, azimuth)
    return azimuth * (grid.shape[1] + 1) + polar


def _across_slices(tap: Callable[..., Any], position: tuple[Any, ...], last: int, filter: Filter, random: Any) -> Any:
    """Reconstruct along the axes that choose slices: blend the filter's taps, or choose one by `random`.

    `last` is the last whole index of the last of these axes; an azimuth before it goes round.
    """
    if filter == "nearest":
        return tap(*(expr.floor(p + 0.5) for p in position))
    bases = [expr.floor(p) for p in position]
    if random is not None and filter == "trilinear" and len(position) == 1:
        return tap(bases[0] + (random < position[0] - bases[0]))
    weights = [_weights(p - base, filter) for p, base in zip(position, bases, strict=True)]
    first = 0 if filter == "trilinear" else -1
    if random is not None:
        chosen = [base + first + step for base, step in zip(bases, _chosen(weights, random), strict=True)]
        if first:
            chosen[-1] = expr.minimum(expr.maximum(chosen[-1], 0.0), float(last))
        return tap(*chosen)
    total = None
    for places in itertools.product(range(len(weights[0])), repeat=len(bases)):
        slices = [base + (place + first) for base, place in zip(bases, places, strict=True)]
        slices[-1] = _held(slices[-1], places[-1] + first, last)
        weight = weights[0][places[0]]
        for axis, place in zip(weights[1:], places[1:], strict=True):
            weight = weight * axis[place]
        part = expr.scale(tap(*slices), weight)
        total = part if total is None else total + part
    return total


def _held(index: Any, step: int, last: int) -> Any:
    """An index this many steps from the one below the position: only the outer ones can leave [0, last]."""
    if step < 0:
        return expr.maximum(index, 0.0)
    return expr.minimum(index, float(last)) if step > 1 else index


def _weights(t: Any, filter: Filter) -> tuple[Any, ...]:
    return (1 - t, t) if filter == "trilinear" else bspline_weights(expr, t)


def _chosen(weights: Sequence[tuple[Any, ...]], random: Any) -> list[Any]:
    """For each axis the place of a weight chosen in proportion: one number serves both, the last axis first."""
    *azimuth, polar = weights
    places = [_passed(polar, random)]
    if azimuth:
        places.insert(0, _passed(azimuth[0], _rest(polar, random)))
    return places


def _passed(weights: tuple[Any, ...], random: Any) -> Any:
    """How many of the running sums of the weights a number has passed."""
    place: Any = 0.0
    for below in itertools.accumulate(weights[:-1]):
        place = (random > below) + place
    return place


def _rest(weights: tuple[Any, ...], random: Any) -> Any:
    """Where in the share of the weight that it has chosen the number lies: again even in [0, 1]."""
    start, share = 0.0, weights[0]
    for below, weight in zip(itertools.accumulate(weights[:-1]), weights[1:], strict=True):
        passed = random > below
        start, share = expr.where(passed, below, start), expr.where(passed, weight, share)
    # Rounding may lead past the last one, or to one of no weight.
    return expr.minimum(expr.maximum(expr.divide(random - start, share), 0.0), 1.0)
