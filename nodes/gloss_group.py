"""Node group: a direction carried along by a change of gloss (addon/docs/method.md, section 9)."""

from __future__ import annotations

from typing import Any

import bpy

from ..bake.sampling.gloss import changes, held, stretched
from . import expr
from .adjustments import GLOSS
from .group import call, node_group


def gloss_group() -> bpy.types.ShaderNodeTree:
    """(wi, wo, Gloss), local, to the direction of the table that is seen along wi, and the factor of its density."""
    inputs = {"wi": "vector", "wo": "vector", GLOSS: "float"}
    return node_group("MM Gloss", inputs, {"wi": "vector", "Spread": "float"}, lambda *a: stretched(expr, *a))


def seen_in_table(wi: Any, wo: Any, gloss: Any) -> tuple[Any, Any]:
    """Direction of the table that is seen along local wi, and the factor of a density there to one along wi."""
    found: tuple[Any, Any] = call(gloss_group(), wi, wo, gloss)
    return found


def seen_from_table(wi: Any, wo: Any, gloss: Any) -> tuple[Any, Any]:
    """Where a local direction of the table is seen, and the factor of its density to one there."""
    seen, back = call(gloss_group(), wi, wo, expr.divide(1.0, gloss))
    return seen, expr.divide(1.0, back)


def lit_in_table(wi: Any, wo: Any, gloss: Any) -> tuple[Any, Any, Any]:
    """Of local light: its direction in the table, what takes the cosine's place there, and the factor of densities.

    Without a gloss, which is None, that is the direction itself, its cosine and 1.
    """
    cosine = expr.maximum(expr.components(wi)[2], 0.0)
    if gloss is None:
        return wi, cosine, 1.0
    stored, spread = seen_in_table(wi, wo, gloss)
    changed = expr.maximum(expr.components(stored)[2], 0.0) * spread * (cosine > 0)
    return stored, expr.where(changes(gloss), changed, cosine), spread


def seen_above(seen: Any, gloss: Any) -> Any:
    """1 where a direction of `seen_from_table` lies above the horizon, and where no gloss can have taken it below."""
    return expr.where(changes(gloss), expr.components(seen)[2] > 0, 1.0)


def held_gloss(gloss: Any) -> Any:
    """An artist's gloss, which a texture may give, held within what is possible."""
    return held(expr, gloss)


def glossy_roughness(roughness: float, gloss: Any) -> Any:
    """Roughness of a native GGX closure, whose width is its square, under a gloss."""
    return expr.minimum(expr.divide(roughness, expr.sqrt(gloss)), 1.0)
