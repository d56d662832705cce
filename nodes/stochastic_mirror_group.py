"""Node groups: an arbitrary BRDF as a perfect mirror whose facet the shader itself draws (method.md, section 7)."""

from __future__ import annotations

from typing import Any

import bpy

from . import expr
from .group import node_group
from .native_closure import choose_closure


def ray_hash(salt: Any = None) -> tuple[Any, tuple[Any, Any, Any]]:
    """Position, and three hashes of all else that separates rays at a position; others for another salt.

    Of a camera far from the origin many rays meet the surface at one float32 position and differ in direction alone;
    those of an orthographic one all have one direction, and differ within the triangle more finely than in position.
    A projection of the direction in place of its hash would drop the bits that a narrow view lives on.
    """
    geometry = expr.node("ShaderNodeNewGeometry", {}, {})
    position, incoming, parametric = (expr.Vector(geometry.outputs[k]) for k in ("Position", "Incoming", "Parametric"))
    # One number of two coordinates: the golden ratio keeps it from being constant along any edge or regular grid.
    within = expr.dot(parametric, expr.vec(1.0, 1.618034, 0.0))
    return position, expr.white_noise(incoming, within if salt is None else within + salt)


def random_numbers() -> tuple[Any, ...]:
    """Six independent numbers in [0, 1], fresh for every ray: sub-pixel jitter moves every bit of the hash.

    The first sample of a pixel always passes its middle: with one sample a pixel, another seed draws the same numbers.
    """
    position, (first, second, _) = ray_hash()
    return expr.white_noise(position, first) + expr.white_noise(position, second)


def random_numbers_group() -> bpy.types.ShaderNodeTree:
    """Six random numbers per shading point."""
    names = {f"Random {k}": "float" for k in range(1, 7)}
    return node_group("MM Random Numbers", {}, names, random_numbers)


def more_random_numbers_group() -> bpy.types.ShaderNodeTree:
    """Three more, for materials that aim at lamps; Cycles merges what both groups compute alike."""

    def numbers() -> tuple[Any, ...]:
        position, (_, _, third) = ray_hash()
        return expr.white_noise(position, third)

    return node_group("MM More Random Numbers", {}, {f"Random {k}": "float" for k in range(7, 10)}, numbers)


# Cycles drops closures whose mean weight is below 1e-5. One that aims at the sun has a weight of that order: it stands
# for a small solid angle, but for all of the sun's light. Below FAINT_WEIGHT a metal carries it where it can, whose own
# weight is 1: of most such mirrors a Mix Shader behind may then leave little, and nothing is lost.
FAINT_WEIGHT = 1e-3
# What no metal carries is raised to this by Russian roulette: hardly more, since each raise costs variance.
LEAST_WEIGHT = 1.05e-5
# Of the F82 reflectance: (1 - c)^5 at the cosine c = 1/7, and what the tint there takes away at most.
_F5 = (6 / 7) ** 5
_MOST_TAKEN = 7 * _F5 / (6 / 7) ** 6
# Below this cosine, of directions 163 degrees apart, a metal is too bright for what is asked of it; and where less than
# this part of its edge reflectance is asked for, float32 rounds the difference: +4 % of a weight of 1e-6 at 0.26.
_LEAST_COSINE = 0.15
_LEAST_OF_EDGE = 1e-4


def mirror_closure(wi_world: Any, incoming: Any, weight: Any, random: Any = None, wanted: Any = 1.0) -> Any:
    """Glossy closure of roughness 0 that sends the path along wi with this weight (f cos / pdf).

    With a random number, and where that is `wanted`, weights that Cycles might drop are carried by `_faint_mirror` or,
    where it cannot, live on by Russian roulette: raised to `LEAST_WEIGHT`, as often as keeps their mean.
    """
    half = expr.normalize(wi_world + incoming)
    if random is None:
        return _mirror(half, weight)
    mean = expr.dot(weight, expr.vec(*[1 / 3] * 3))
    glossy = _mirror(half, expr.scale(weight, kept_where_wanted(weight, random, wanted)))
    faint, carries = _faint_mirror(half, incoming, weight)
    return choose_closure(carries * (mean < FAINT_WEIGHT) * wanted, glossy, faint)


def kept_alive(weight: Any, random: Any) -> Any:
    """Factor by which a weight that Cycles might drop is raised to `LEAST_WEIGHT`, as often as keeps its mean; else
    1."""
    keep = expr.minimum(expr.dot(weight, expr.vec(*[1 / 3] * 3)) * (1 / LEAST_WEIGHT), 1.0)
    return expr.divide(random < keep, keep)


def kept_where_wanted(weight: Any, random: Any, wanted: Any) -> Any:
    """`kept_alive` where that is wanted, else 1."""
    raised = kept_alive(weight, random)
    # A constant that is 0 takes all that hangs on it out of Cycles' graph.
    return raised if isinstance(wanted, float) else expr.where(wanted, raised, 1.0)


def _mirror(half: Any, weight: Any) -> Any:
    made = expr.node(
        "ShaderNodeBsdfAnisotropic", {"distribution": "GGX"}, {"Color": weight, "Roughness": 0.0, "Normal": half}
    )
    return expr.Scalar(made.outputs[0])


def _faint_mirror(half: Any, incoming: Any, weight: Any) -> tuple[Any, Any]:
    """Perfect mirror of a weight however small, and whether it can have this one.

    A metal of Principled BSDF has the weight 1; its reflectance is applied when it is sampled, and nothing is dropped.
    That is, at cosine c to the facet (Kutz, Hasan & Edmondson 2021, "Novel aspects of the Adobe standard material"),

        F = f0 + (1 - f0) x - (f0 + (1 - f0) f5) 7 / (6/7)^6 (1 - tint) c (1 - c)^6,   x = (1 - c)^5, f5 = (6/7)^5,

    solved here for f0 and tint at the one c that the path takes.
    """
    cosine = expr.dot(half, incoming)
    rest = 1 - cosine
    square = rest * rest
    edge = square * square * rest
    taken = edge * rest * cosine * _MOST_TAKEN
    white, black = expr.vec(1.0, 1.0, 1.0), expr.vec(0.0, 0.0, 0.0)
    above = weight - expr.scale(white, edge)
    tint = expr.vector_node("MINIMUM", white + expr.scale(above, expr.divide(1.0, taken)), white)
    f0 = expr.scale(expr.vector_node("MAXIMUM", above, black), expr.divide(1.0, 1 - edge))
    made = expr.node(
        "ShaderNodeBsdfPrincipled",
        {"distribution": "GGX"},
        {
            "Base Color": f0,
            "Metallic": 1.0,
            "Roughness": 0.0,
            "Specular Tint": expr.vector_node("MAXIMUM", tint, black),
            "Normal": half,
        },
    )
    red, green, blue = expr.components(weight)
    darkest = expr.minimum(expr.minimum(red, green), blue)
    reached = expr.maximum(edge - taken, edge * _LEAST_OF_EDGE)
    return expr.Scalar(made.outputs[0]), (darkest > reached) * (cosine > _LEAST_COSINE)
