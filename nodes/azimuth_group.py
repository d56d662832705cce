"""Node groups of a shading map over azimuth: what it reflects at a level of light from one side, or from all around."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..bake.shading_maps.azimuth.curve_layout import PER_TEXEL, CurveLayout, curve_uv
from . import expr
from .group import node_group
from .map_models import piecewise_linear
from .slices_group import SliceImages, SliceOptions, image_tap, inside, interface, split, tapper, texel_tap

LIGHT = "Light"
_PER_VECTOR = 3


@dataclass(frozen=True)
class AzimuthImages(SliceImages):
    """Textures of a shading map over azimuth, loaded; `residual` are its coefficients, one tile for each curve.

    Parameters
    ----------
    curves : as `bake.shading_maps.azimuth.curve_layout.pack_curves` lays them out
    curve_layout : of `curves`
    """

    curves: bpy.types.Image = field(kw_only=True)
    curve_layout: CurveLayout = field(kw_only=True)


def azimuth_group(name: str, images: AzimuthImages, options: SliceOptions) -> bpy.types.ShaderNodeTree:
    """S(x, phi) = max(sum of coefficients times curves, m x), m the envelope; sockets as of `slices_group`, and Light.

    Light is any vector whose x and y are its parts along the swatch's u and v. At a texel the sum is below m x only
    where it is below 0; between texels it may be, for the larger of two does not interpolate.
    """
    layout = images.curve_layout

    def lookup(uv: Any, x: Any, peak: Any, _random: Any, light: Any) -> tuple[Any, ...]:
        u, v = inside(uv, images.layout, options.tiling)
        tap = tapper(images, u, v, options.interpolation)
        m, share = texel_tap(images, u, v, options)
        along, across, _ = expr.components(light)
        turns = expr.arctan2(across, along) * (1 / (2 * math.pi))
        turns = turns - expr.floor(turns)
        levels = expr.components(x) if options.coloured else (x,)
        total: Any = None
        for group in range(layout.groups):
            # Curves of every level, (levels, 4).
            at = [_curves(images, group, level, turns, options.interpolation) for level in levels]
            for k in range(min(PER_TEXEL, layout.rank - group * PER_TEXEL)):
                texel = tap(float(group * PER_TEXEL + k))
                weights = [four[k] for four in at]
                part = texel * expr.vec(*weights) if options.coloured else expr.scale(texel, weights[0])
                total = part if total is None else total + part
        one = expr.vec(1.0, 1.0, 1.0)
        held = m * expr.vector_node("MINIMUM", x, one) if options.coloured else expr.scale(m, expr.minimum(x, 1.0))
        rest = expr.vector_node("MAXIMUM", total - held, expr.vec(0.0, 0.0, 0.0))
        if options.above == "clamp" and options.peak:
            # What the closure carries must not depend on the light's azimuth, as the brightest level may.
            bounded = expr.scale(m, 1 / expr.maximum(peak, 1.0))
            reflected = rest + held
            return reflected, reflected - (bounded * x if options.coloured else expr.scale(bounded, x)), bounded, share
        return *split(x, m, rest, None, peak, options), share

    inputs, outputs = interface(options)
    return node_group(name, {**inputs, LIGHT: "vector"}, outputs, lookup, {"Peak": 1.0, "Random": 0.5})


def _curves(images: AzimuthImages, group: int, x: Any, turns: Any, interpolation: str) -> tuple[Any, ...]:
    layout = images.curve_layout
    at = curve_uv(expr, layout, group, x, turns)
    colour, alpha = image_tap(images.curves, (layout.width, layout.rows), *at, interpolation, "EXTEND")
    return *expr.components(colour), alpha


def mean_group(
    name: str, images: SliceImages, means: NDArray[np.float64], options: SliceOptions
) -> bpy.types.ShaderNodeTree:
    """The map lit from all around, sockets as of `slices_group`; where x is a colour, its red is the level of all.

    Parameters
    ----------
    means : (rank, N) of the curves over azimuth
    """

    def lookup(uv: Any, x: Any, peak: Any, _random: Any) -> tuple[Any, ...]:
        u, v = inside(uv, images.layout, options.tiling)
        tap = tapper(images, u, v, options.interpolation)
        m, share = texel_tap(images, u, v, options)
        level = expr.components(x)[0] if options.coloured else x
        held = expr.minimum(level, 1.0)
        total: Any = expr.vec(0.0, 0.0, 0.0)
        for start in range(0, len(means), _PER_VECTOR):
            curves = tuple(tuple(map(float, curve)) for curve in means[start : start + _PER_VECTOR])
            for k, weight in enumerate(piecewise_linear(curves, held)):
                total = total + expr.scale(tap(float(start + k)), weight)
        rest = expr.vector_node("MAXIMUM", total - expr.scale(m, held), expr.vec(0.0, 0.0, 0.0))
        return *split(x, m, rest, None, peak, options), share

    return node_group(name, *interface(options), lookup, {"Peak": 1.0, "Random": 0.5})
