"""Node group of a four-dimensional table's lookup."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy

from ..bake.tables.atlas import AtlasLayout, atlas_uv
from ..bake.tables.grid import Grid
from ..bake.tables.log_codes import LogCodes
from ..bake.tables.table import bspline_weights
from . import expr
from .group import node_group

_INTERPOLATION = {"nearest": "Closest", "trilinear": "Linear", "bspline": "Cubic"}


def anisotropic_lookup_group(
    name: str,
    image: bpy.types.Image,
    grid: Grid,
    filter: str,
    scale: float = 1.0,
    stochastic: bool = False,
    offset: float = 0.0,
    log: LogCodes | None = None,
) -> bpy.types.ShaderNodeTree:
    """(wi, wo, random) to the BRDF in 1/sr without the cosine, of local directions.

    Parameters
    ----------
    image : the atlas of `bake.tables.atlas.pack`
    filter : "nearest", "trilinear" (here of four axes) or "bspline"
    scale, offset : what stored values are multiplied by, after the offset was subtracted
    log : what stored values are the codes of; scale and offset are then 1 and 0
    stochastic : choose one slice with the filter's weights by the random number instead of blending 4 or 16. Unbiased
        where the value enters the picture linearly
    """
    layout = AtlasLayout.of(grid)
    count_a, last_b = grid.shape[0], layout.run - 1

    def lookup(wi: Any, wo: Any, random: Any) -> Any:
        a, b, r, c = grid.coordinates(expr, wi, wo)

        def tap(i_a: Any, i_b: Any) -> Any:
            i_b = expr.minimum(expr.maximum(i_b, 0.0), float(last_b))
            index = _around(i_a, count_a) * layout.run + i_b
            texel = expr.image_tap(image, *atlas_uv(expr, layout, index, r, c), _INTERPOLATION[filter])[0]
            return log.decode(expr, texel) if log else texel

        value = _across_slices(tap, a, b, filter, random if stochastic else None)
        value = value - expr.vec(offset, offset, offset) if offset else value
        return expr.scale(value, expr.divide(scale, grid.factor(expr, wi, wo)))

    return node_group(
        name, {"wi": "vector", "wo": "vector", "Random": "float"}, {"BRDF": "vector"}, lookup, {"Random": 0.5}
    )


def _around(index: Any, count: int) -> Any:
    """A whole index of a periodic axis, brought into it from at most two beyond either end."""
    index = expr.where(index > count - 0.5, index - count, index)
    return expr.where(index < -0.5, index + count, index)


def _across_slices(tap: Callable[[Any, Any], Any], a: Any, b: Any, filter: str, random: Any) -> Any:
    """Reconstruct along the two axes that choose slices: blend the filter's taps, or choose one by `random`."""
    if filter == "nearest":
        return tap(expr.floor(a + 0.5), expr.floor(b + 0.5))
    base_a, base_b = expr.floor(a), expr.floor(b)
    weights_a, weights_b = _weights(a - base_a, filter), _weights(b - base_b, filter)
    first = 0 if filter == "trilinear" else -1
    if random is not None:
        step_b, random = _chosen(weights_b, random)
        step_a, _ = _chosen(weights_a, random)
        return tap(base_a + (step_a + first), base_b + (step_b + first))
    total = None
    for i, weight_a in enumerate(weights_a, first):
        for j, weight_b in enumerate(weights_b, first):
            part = expr.scale(tap(base_a + i, base_b + j), weight_a * weight_b)
            total = part if total is None else total + part
    return total


def _weights(t: Any, filter: str) -> tuple[Any, ...]:
    return (1 - t, t) if filter == "trilinear" else bspline_weights(expr, t)


def _chosen(weights: tuple[Any, ...], random: Any) -> tuple[Any, Any]:
    """Place of a weight chosen in proportion, and where in its share the number lies: again even in [0, 1]."""
    below, place, start, share = weights[0], 0.0, 0.0, weights[0]
    for weight in weights[1:]:
        passed = random > below
        place = passed + place
        start, share = expr.where(passed, below, start), expr.where(passed, weight, share)
        below = below + weight
    # Rounding may lead past the last one, or to one of no weight.
    rest = expr.minimum(expr.maximum(expr.divide(random - start, share), 0.0), 1.0)
    return place, rest
