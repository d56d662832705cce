"""Node groups: an arbitrary BRDF as a perfect mirror whose facet the shader itself draws (DESIGN.md section 5)."""

from __future__ import annotations

from typing import Any

import bpy

from . import expr
from .group import node_group


def random_numbers() -> tuple[Any, ...]:
    """Six independent numbers in [0, 1], fresh for every sample.

    Sub-pixel jitter moves position and incoming direction, and with them every bit of the hash; the two nodes
    differ in the direction that the incoming vector is projected on.
    """
    geometry = expr.node("ShaderNodeNewGeometry", {}, {})
    position = expr.Vector(geometry.outputs["Position"])
    incoming = expr.Vector(geometry.outputs["Incoming"])
    first = expr.white_noise(position, expr.dot(incoming, expr.vec(3.17, 7.31, 1.93)))
    second = expr.white_noise(position, expr.dot(incoming, expr.vec(1.17, 9.31, 2.93)) + 17.0)
    return first + second


def random_numbers_group() -> bpy.types.ShaderNodeTree:
    """Six random numbers per shading point."""
    names = {f"Random {k}": "float" for k in range(1, 7)}
    return node_group("MM Random Numbers", {}, names, random_numbers)


def more_random_numbers_group() -> bpy.types.ShaderNodeTree:
    """Three more, for materials that aim at lamps."""

    def numbers() -> tuple[Any, ...]:
        geometry = expr.node("ShaderNodeNewGeometry", {}, {})
        incoming = expr.Vector(geometry.outputs["Incoming"])
        return expr.white_noise(
            expr.Vector(geometry.outputs["Position"]), expr.dot(incoming, expr.vec(5.17, 1.31, 8.93)) + 31.0
        )

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
