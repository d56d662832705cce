"""Node groups of a shading map over azimuth: what it reflects at a level of light from one side, or from all around."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
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
# Times what has been summed so far, it changes no coordinate that it is added to. But it is a reason for Cycles to read
# the next texel after that: else all coordinates of all texels are on its stack before it reads the first.
_NOTHING = 1e-30
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
    """S(x, phi) = x max(sum of coefficients times curves, m), m the envelope; sockets as of `slices_group`, and Light.

    Light is any vector whose x and y are its parts along the swatch's u and v. At a texel the sum is below m only
    where it is below 0; between texels it may be, for the larger of two does not interpolate.
    """
    layout = images.curve_layout

    def lookup(uv: Any, x: Any, peak: Any, _random: Any, light: Any) -> tuple[Any, ...]:
        u, v = inside(uv, images.layout, options.tiling)
        along, across, _ = expr.components(light)
        turns = expr.arctan2(across, along) * (1 / (2 * math.pi))
        turns = turns - expr.floor(turns)
        levels = expr.components(x) if options.coloured else (x,)
        total: Any = expr.vec(0.0, 0.0, 0.0)
        at: list[tuple[Any, ...]] = []
        for k in range(layout.rank):
            later = _red(total) * _NOTHING if k else 0.0
            if k % PER_TEXEL == 0:
                at = [_curves(images, k // PER_TEXEL, level + later, turns, options.interpolation) for level in levels]
            tap = tapper(replace(images, residual_scale=1.0), u + later, v, options.interpolation)
            weights = [four[k % PER_TEXEL] for four in at]
            if options.coloured:
                total = total + tap(float(k)) * expr.vec(*weights)
            else:
                total = _plus(total, tap(float(k)), *weights)
        m, share = texel_tap(images, u + _red(total) * _NOTHING, v, options)
        total = expr.scale(total, images.residual_scale)
        slope = expr.vector_node("MAXIMUM", total - m, expr.vec(0.0, 0.0, 0.0))
        if options.coloured:
            level: Any = expr.vector_node("MINIMUM", x, expr.vec(1.0, 1.0, 1.0))
            rest, held = slope * level, m * level
        else:
            level = expr.minimum(x, 1.0)
            rest, held = expr.scale(slope, level), expr.scale(m, level)
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
    return *_channels(colour), alpha


def _channels(colour: Any) -> tuple[Any, Any, Any]:
    outputs = expr.node("ShaderNodeSeparateColor", {"mode": "RGB"}, {0: colour}).outputs
    return expr.Scalar(outputs[0]), expr.Scalar(outputs[1]), expr.Scalar(outputs[2])


def _red(colour: Any) -> Any:
    return _channels(colour)[0]


def _plus(total: Any, colour: Any, weight: Any) -> Any:
    """total + weight colour, by one node."""
    settings = {"data_type": "RGBA", "blend_type": "ADD", "clamp_factor": False}
    return expr.Vector(expr.node("ShaderNodeMix", settings, {0: weight, 6: total, 7: colour}).outputs[2])


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
