"""Node groups: an arbitrary BRDF as a perfect mirror whose facet the shader itself draws (DESIGN.md section 5)."""

from __future__ import annotations

from typing import Any

import bpy

from . import expr
from .group import node_group


def _place() -> tuple[Any, tuple[Any, Any, Any]]:
    """Position, and three hashes of all else that tells one ray from another at a position.

    Of a camera far from the origin many rays meet the surface at one float32 position and differ in direction alone;
    those of an orthographic one all have one direction, and differ within the triangle more finely than in position.
    A projection of the direction in place of its hash would drop the bits that a narrow view lives on.
    """
    geometry = expr.node("ShaderNodeNewGeometry", {}, {})
    position, incoming, parametric = (expr.Vector(geometry.outputs[k]) for k in ("Position", "Incoming", "Parametric"))
    # One number of two coordinates: the golden ratio keeps it from being constant along any edge or regular grid.
    within = expr.dot(parametric, expr.vec(1.0, 1.618034, 0.0))
    return position, expr.white_noise(incoming, within)


def random_numbers() -> tuple[Any, ...]:
    """Six independent numbers in [0, 1], fresh for every ray: sub-pixel jitter moves every bit of the hash.

    The first sample of a pixel always passes its middle: with one sample a pixel, another seed draws the same numbers.
    """
    position, (first, second, _) = _place()
    return expr.white_noise(position, first) + expr.white_noise(position, second)


def random_numbers_group() -> bpy.types.ShaderNodeTree:
    """Six random numbers per shading point."""
    names = {f"Random {k}": "float" for k in range(1, 7)}
    return node_group("MM Random Numbers", {}, names, random_numbers)


def more_random_numbers_group() -> bpy.types.ShaderNodeTree:
    """Three more, for materials that aim at lamps; Cycles merges what both groups compute alike."""

    def numbers() -> tuple[Any, ...]:
        position, (_, _, third) = _place()
        return expr.white_noise(position, third)

    return node_group("MM More Random Numbers", {}, {f"Random {k}": "float" for k in range(7, 10)}, numbers)


# Cycles drops closures of a weight below 1e-5. One that aims at the sun has a weight of that order: it stands for a
# small solid angle, but for all of the sun's light.
LEAST_WEIGHT = 2e-5


def mirror_closure(wi_world: Any, incoming: Any, weight: Any, random: Any = None) -> Any:
    """Glossy closure of roughness 0 that sends the path along wi with this weight (f cos / pdf).

    With a random number, weights that Cycles would drop live on by Russian roulette: raised to `LEAST_WEIGHT`, as often
    as keeps their mean.
    """
    if random is not None:
        keep = expr.minimum(expr.dot(weight, expr.vec(*[1 / (3 * LEAST_WEIGHT)] * 3)), 1.0)
        weight = expr.scale(weight, expr.divide(random < keep, keep))
    half = expr.normalize(wi_world + incoming)
    made = expr.node(
        "ShaderNodeBsdfAnisotropic",
        {"distribution": "GGX"},
        {"Color": weight, "Roughness": 0.0, "Normal": half},
    )
    return expr.Scalar(made.outputs[0])
