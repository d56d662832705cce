"""Node group: the demo's metallic paint evaluated analytically, the truth its tables are compared with."""

from __future__ import annotations

from typing import Any

import bpy

from ..bake.lobes.metallic_paint import metallic_paint
from ..bake.sources.analytic import MetallicPaint
from . import expr
from .group import node_group


def metallic_paint_group(paint: MetallicPaint) -> bpy.types.ShaderNodeTree:
    """(wi, wo, random) to the BRDF, in the place of a table lookup; the random number is not used."""

    def evaluate(wi: Any, wo: Any, random: Any) -> Any:
        return metallic_paint(
            expr,
            wi,
            wo,
            expr.Vector(constant=paint.diffuse),
            expr.Vector(constant=paint.flake),
            paint.flake_alpha,
            paint.coat_alpha,
            paint.coat_eta,
        )

    inputs = {"wi": "vector", "wo": "vector", "Random": "float"}
    return node_group("MM Metallic Paint", inputs, {"BRDF": "vector"}, evaluate)
