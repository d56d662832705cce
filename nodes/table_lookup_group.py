"""Node group: the BRDF of a tabulated material for a pair of local directions (Mallett & Yuksel 2016)."""

from __future__ import annotations

from typing import Any

import bpy

from ..bake.atlas import AtlasLayout, atlas_uv
from ..bake.parameterization import normal_basis_coordinates
from ..bake.table import TableGrid, bspline_weights
from . import expr
from .group import call, node_group

# Blender's "Cubic" is the uniform B-spline, in two dimensions; the third axis is ours.
_INTERPOLATION = {"nearest": "Closest", "trilinear": "Linear", "bspline": "Cubic"}


def coordinates_group(parameterization: str) -> bpy.types.ShaderNodeTree:
    """(wi, wo, alphas) to table coordinates (u_o, u_i, u_phi); shared by all materials."""
    return node_group(
        f"MM Coordinates {parameterization.title()}",
        {"wi": "vector", "wo": "vector", "Alpha Theta": "float", "Alpha Phi": "float"},
        {"u_o": "float", "u_i": "float", "u_phi": "float"},
        lambda wi, wo, alpha_theta, alpha_phi: normal_basis_coordinates(
            expr, wi, wo, parameterization, alpha_theta, alpha_phi
        ),
        {"Alpha Theta": 0.5, "Alpha Phi": 0.5},
    )


def table_lookup_group(
    name: str,
    image: bpy.types.Image,
    grid: TableGrid,
    filter: str,
    scale: float = 1.0,
    stochastic: bool = False,
) -> bpy.types.ShaderNodeTree:
    """(wi, wo, random) to the BRDF in 1/sr without the cosine.

    Parameters
    ----------
    image : the atlas of `bake.atlas.pack`
    filter : "nearest", "trilinear" or "bspline"
    scale : what stored values are multiplied by
    stochastic : choose one slice with the filter's weights by the random number instead of blending all. Unbiased
        where the value enters the picture linearly, as in Reference mode, and one tap instead of two or four.
    """
    layout = AtlasLayout(grid.n)

    def lookup(wi: Any, wo: Any, random: Any) -> Any:
        u_o, u_i, u_phi = call(coordinates_group(grid.parameterization), wi, wo, grid.alpha_theta, grid.alpha_phi)

        def tap(index: Any) -> Any:
            uv = atlas_uv(expr, layout, index, u_i, u_phi)
            return expr.image_tap(image, *uv, _INTERPOLATION[filter])[0]

        position = u_o * (grid.n - 1)
        value = _across_slices(tap, position, layout.slices - 1, filter, random if stochastic else None)
        return value if scale == 1.0 else expr.scale(value, scale)

    return node_group(
        name, {"wi": "vector", "wo": "vector", "Random": "float"}, {"BRDF": "vector"}, lookup, {"Random": 0.5}
    )


def _across_slices(tap: Any, position: Any, last: int, filter: str, random: Any) -> Any:
    """Reconstruct along theta_o: blend the filter's slices, or choose one of them by `random`."""
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
