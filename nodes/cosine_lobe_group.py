"""Node groups of a cosine lobe, for artists: its value between two directions, and a highlight of its shape.

One group for each lobe, all with the same sockets, so that one takes another's place in a node's menu of groups.
Blender has had a menu switch in materials only since 5.0, and Cycles would evaluate every branch of it.
"""

from __future__ import annotations

from typing import Any

import bpy

from ..bake.lobes.cosine_lobes import cosine_lobe, half_chord_square, lobe_norm
from ..bake.lobes.lobes import PHONG
from . import expr
from .drawn_direction import drawn_direction
from .group import call, node_group
from .lobe_group import lobe_group, lobe_pdf_group, sample_lobe_group

LEAST_EXPONENT = 0.01
# Far beyond it float32 overflows on the way to values and factors.
FINITE_EXPONENT = 1e8
# Directions of float32 cannot distinguish angles in a highlight narrower than this one's.
MOST_EXPONENT = 1e4
USUAL_EXPONENT = 50.0


def cosine_lobe_group(name: str) -> bpy.types.ShaderNodeTree:
    """(Normal, Direction, Exponent) to the lobe of the angle between the two, and to the same times its factor in 1/sr.

    Normal is the surface's where nothing is linked. Direction, of any length, is usually a half vector (Blinn), a
    mirrored direction (Phong) or a direction of the artist's own; unlinked it is the viewer's.

    Parameters
    ----------
    name : one of `bake.lobes.cosine_lobes.COSINE_LOBES`
    """

    def value(normal: Any, direction: Any, exponent: Any) -> tuple[Any, Any]:
        n = expr.minimum(expr.maximum(exponent, LEAST_EXPONENT), FINITE_EXPONENT)
        toward = _or_geometry(direction, "Incoming")
        lobe = cosine_lobe(expr, name, half_chord_square(expr, _or_geometry(normal, "Normal"), toward), n)
        return lobe, lobe * lobe_norm(expr, name, n)

    return node_group(
        f"Cosine Lobe {name.title()}",
        {"Normal": "vector", "Direction": "vector", "Exponent": "float"},
        {"Lobe": "float", "Normalized": "float"},
        value,
        {"Exponent": USUAL_EXPONENT},
    )


def highlight_group(name: str, lamps: bpy.types.Image | None = None) -> bpy.types.ShaderNodeTree:
    """(Color, Exponent, Normal) to a closure: Phong's highlight with this lobe about the mirror direction.

    It reflects its colour at normal incidence and less elsewhere. Cycles has no such closure: a stochastic mirror draws
    directions by the lobe, in closed form, and aims at lamps. The second output is a GGX highlight of the same width,
    for EEVEE.

    Parameters
    ----------
    name : one of `bake.lobes.cosine_lobes.COSINE_LOBES`
    lamps : table of lamps to aim at, see `bake.sampling.lamps`
    """
    phong = next(lobe for lobe, curve in PHONG.items() if curve == name)

    def closure(colour: Any, exponent: Any, given: Any) -> tuple[Any, Any]:
        n = expr.minimum(expr.maximum(exponent, LEAST_EXPONENT), MOST_EXPONENT)
        normal = _or_geometry(given, "Normal")
        drawn = drawn_direction(
            normal,
            lambda wo, *u: call(sample_lobe_group(phong), wo, *u[:3], n, 0.0)[:2],
            lambda wi, wo: call(lobe_pdf_group(phong), wi, wo, n, 0.0),
            lamps,
        )
        f_cos = call(lobe_group(phong), drawn.wi, drawn.wo, n, 0.0) * drawn.cosine
        mirror = drawn.mirror(expr.scale(colour, expr.divide(f_cos, drawn.pdf)))
        # The GGX lobe of the same curvature at its peak as cos^n about the mirror direction.
        roughness = expr.power(8 / (n + 2), 0.25)
        inputs = {"Color": colour, "Roughness": expr.minimum(roughness, 1.0), "Normal": normal}
        glossy = expr.node("ShaderNodeBsdfAnisotropic", {"distribution": "GGX"}, inputs)
        return mirror, expr.Scalar(glossy.outputs[0])

    return node_group(
        f"Highlight {name.title()}",
        {"Color": "color", "Exponent": "float", "Normal": "vector"},
        {"BSDF": "shader", "EEVEE": "shader"},
        closure,
        {"Exponent": USUAL_EXPONENT, "Color": (0.5, 0.5, 0.5, 1.0)},
    )


def _or_geometry(given: Any, output: str) -> Any:
    """The vector given, of unit length, or, where it is 0, the Geometry node's."""
    own = expr.Vector(expr.node("ShaderNodeNewGeometry", {}, {}).outputs[output])
    return expr.where(expr.dot(given, given) > 0, expr.normalize(given), own)
