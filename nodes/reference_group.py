"""Node group: a tabulated BRDF by mirror alone, every sample exact (DESIGN.md section 5)."""

from __future__ import annotations

from typing import Any

import bpy

from . import expr
from .drawn_direction import drawn_direction
from .group import call, node_group


def reference_group(
    name: str,
    lookup: bpy.types.ShaderNodeTree,
    sampler: bpy.types.ShaderNodeTree,
    density: bpy.types.ShaderNodeTree | None = None,
    lamps: bpy.types.Image | None = None,
) -> bpy.types.ShaderNodeTree:
    """(Normal, Tint) to a shader: the tabulated BRDF, mirror only.

    Parameters
    ----------
    lookup : (wi, wo, random) to the BRDF
    sampler : (wo, four random numbers) to (wi, pdf)
    density : (wi, wo) to the sampler's pdf; needed with `lamps`
    lamps : table of lamps to aim at
    """

    def build(normal: Any, tint: Any) -> Any:
        drawn = drawn_direction(
            normal, lambda wo, *u: call(sampler, wo, *u), lambda wi, wo: call(density, wi, wo), lamps
        )
        gain = expr.divide(drawn.cosine, drawn.pdf)
        weight = expr.scale(call(lookup, drawn.wi, drawn.wo, drawn.random[0]), gain) * tint
        return drawn.mirror(weight)

    return node_group(name, {"Normal": "vector", "Tint": "vector"}, {"BSDF": "shader"}, build)
