"""Node group: the BRDF of a tabulated material for a pair of local directions (Mallett & Yuksel 2016)."""

from __future__ import annotations

from typing import Any

import bpy

from ..bake.tables.atlas import AtlasLayout, atlas_uv
from ..bake.tables.half_vector_grid import HalfVectorGrid
from ..bake.tables.log_codes import LogCodes
from ..bake.tables.normal_grid import NormalVectorGrid
from ..bake.tables.table import bspline_weights
from . import expr
from .group import call, node_group

# Blender's "Cubic" is the uniform B-spline, in two dimensions; the third axis is ours.
_INTERPOLATION = {"nearest": "Closest", "trilinear": "Linear", "bspline": "Cubic"}

IsotropicGrid = NormalVectorGrid | HalfVectorGrid


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
    grid: IsotropicGrid,
    filter: str,
    scale: float = 1.0,
    stochastic: bool = False,
    offset: float = 0.0,
    log: LogCodes | None = None,
) -> bpy.types.ShaderNodeTree:
    """(wi, wo, random) to the BRDF in 1/sr without the cosine.

    Parameters
    ----------
    image : the atlas of `bake.tables.atlas.pack`
    filter : "nearest", "trilinear" or "bspline"
    scale, offset : what stored values are multiplied by, after the offset was subtracted
    log : what stored values are the codes of; scale and offset are then 1 and 0
    stochastic : choose one slice with the filter's weights by the random number instead of blending all. Unbiased
        where the value enters the picture linearly, as in Reference mode, and one tap instead of two or four.
    """
    layout = AtlasLayout(grid.shape)
    count, rows, columns = grid.shape

    def lookup(wi: Any, wo: Any, random: Any) -> Any:
        u_slice, u_row, u_phi = call(coordinates_group(grid), wi, wo)

        def tap(index: Any) -> Any:
            uv = atlas_uv(expr, layout, index, u_row * (rows - 1), u_phi * (columns - 1))
            texel = expr.image_tap(image, *uv, _INTERPOLATION[filter])[0]
            return log.decode(expr, texel) if log else texel

        position = u_slice * (count - 1)
        value = _across_slices(tap, position, layout.slices - 1, filter, random if stochastic else None)
        value = value - expr.vec(offset, offset, offset) if offset else value
        return value if scale == 1.0 else expr.scale(value, scale)

    return node_group(
        name, {"wi": "vector", "wo": "vector", "Random": "float"}, {"BRDF": "vector"}, lookup, {"Random": 0.5}
    )


def _across_slices(tap: Any, position: Any, last: int, filter: str, random: Any) -> Any:
    """Reconstruct across the slices: blend the filter's slices, or choose one of them by `random`."""
    if filter == "nearest":
        return tap(expr.floor(position + 0.5))
    base = expr.floor(position)
    t = position - base
    if filter == "trilinear":
        if random is not None:
            return tap(base + (random < t))
        return expr.scale(tap(base), 1 - t) + expr.scale(tap(base + 1), t)
    weights = bspline_weights(expr, t)
    indices = [expr.maximum(base - 1, 0.0), base, base + 1, expr.minimum(base + 2, float(last))]
    if random is not None:
        # How many of the running sums the number has passed is the tap's place among the four.
        below, passed = weights[0], 0.0
        for weight in weights[1:]:
            passed = (random > below) + passed
            below = below + weight
        return tap(expr.minimum(expr.maximum(base - 1 + passed, 0.0), float(last)))
    value = expr.scale(tap(indices[0]), weights[0])
    for index, weight in zip(indices[1:], weights[1:], strict=True):
        value = value + expr.scale(tap(index), weight)
    return value
