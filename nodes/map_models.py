"""Node groups of compressed shading maps, sockets as of `slices_group`: a power law (Kautz et al. 2004) or a basis."""

from __future__ import annotations

from typing import Any

import bpy

from . import expr
from .group import node_group
from .slices_group import SliceImages, SliceOptions, inside, interface, split, tapper, texel_tap

_ONE = (1.0, 1.0, 1.0)


def power_group(name: str, images: SliceImages, options: SliceOptions) -> bpy.types.ShaderNodeTree:
    """S(x) = k x^K of each texel; `images.residual` holds k above K.

    The envelope is k where K <= 1, since x^K >= x there; where K > 1 no line from black lies under it.
    """

    def lookup(uv: Any, x: Any, peak: Any, _random: Any) -> tuple[Any, ...]:
        u, v = inside(uv, images.layout, options.tiling)
        tap = tapper(images, u, v, options.interpolation)
        k, exponent = tap(0.0), tap(1.0)
        one = expr.vec(*_ONE)
        held = expr.vector_node("MINIMUM", x, one) if options.coloured else expr.minimum(x, 1.0)
        levels = expr.components(held) if options.coloured else (held,) * 3
        reflected = k * expr.vec(*(expr.power(level, e) for level, e in zip(levels, expr.components(exponent))))
        if options.above == "scale":
            beyond = expr.vector_node("MAXIMUM", x, one) if options.coloured else expr.maximum(x, 1.0)
            reflected = reflected * beyond if options.coloured else expr.scale(reflected, beyond)
        concave = expr.vec(*(1 - (e > 1.0) for e in expr.components(exponent)))
        m = k * concave
        if options.above == "clamp" and options.peak:
            m = expr.scale(m, 1 / expr.maximum(peak, 1.0))
        residual = reflected - (m * x if options.coloured else expr.scale(m, x))
        # Over x in [0, 1] the line carries (K + 1) / 2 of the light that k x^K reflects.
        carried = expr.dot(m, exponent + one) * 0.5
        share = 1 - expr.divide(carried, expr.dot(k, one))
        return reflected, residual, m, share

    return node_group(name, *interface(options), lookup, {"Peak": 1.0, "Random": 0.5})


def basis_group(
    name: str, images: SliceImages, curves: tuple[tuple[float, ...], ...], options: SliceOptions
) -> bpy.types.ShaderNodeTree:
    """S(x) = sum of coefficient images times curves, piecewise linear between their (rank, N) knots."""

    def lookup(uv: Any, x: Any, peak: Any, _random: Any) -> tuple[Any, ...]:
        u, v = inside(uv, images.layout, options.tiling)
        tap = tapper(images, u, v, options.interpolation)
        m, share = texel_tap(images, u, v, options)
        coefficients = [tap(float(k)) for k in range(len(curves))]

        def at(level: Any) -> list[Any]:
            weights = piecewise_linear(curves, level)
            return [expr.scale(c, w) for c, w in zip(coefficients, weights)]

        if options.coloured:
            channels = []
            for channel, level in enumerate(expr.components(x)):
                channels.append(expr.components(_sum(at(expr.minimum(level, 1.0))))[channel])
            value = expr.vec(*channels)
        else:
            value = _sum(at(expr.minimum(x, 1.0)))
        held = expr.vector_node("MINIMUM", x, expr.vec(*_ONE)) if options.coloured else expr.minimum(x, 1.0)
        rest = value - (m * held if options.coloured else expr.scale(m, held))
        last = None
        if options.above == "clamp" and options.peak:
            last = _sum([expr.scale(c, curve[-1]) for c, curve in zip(coefficients, curves)]) - m
        return *split(x, m, rest, last, peak, options), share

    return node_group(name, *interface(options), lookup, {"Peak": 1.0, "Random": 0.5})


def _sum(parts: list[Any]) -> Any:
    total = parts[0]
    for part in parts[1:]:
        total = total + part
    return total


def piecewise_linear(curves: tuple[tuple[float, ...], ...], x: Any) -> list[Any]:
    """Values at x in [0, 1] of up to three curves with even knots from 0 to 1, the first value being that at 0.

    Every knot adds its change of slope times max(x - knot, 0); the curves share that ramp as one vector.
    """
    n = len(curves[0])
    step = 1 / (n - 1)
    slopes = [[(c[i + 1] - c[i]) / step for i in range(n - 1)] for c in curves]
    padded = [[*s] for s in slopes] + [[0.0] * (n - 1)] * (3 - len(curves))
    start = [c[0] for c in curves] + [0.0] * (3 - len(curves))
    total = expr.vec(*start)
    for i in range(n - 1):
        change = [s[i] - (s[i - 1] if i else 0.0) for s in padded]
        if any(change):
            ramp = expr.maximum(x - i * step, 0.0) if i else x
            total = total + expr.scale(expr.vec(*change), ramp)
    return list(expr.components(total))[: len(curves)]
