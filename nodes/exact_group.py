"""Node group: a tabulated BRDF as native closures under it and a mirror for the rest (DESIGN.md section 5)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy

from ..bake.envelope import mirror_probability, texture_coordinate
from ..bake.shading.lobes import Lobe
from . import expr
from .drawn_direction import drawn_direction
from .group import call, node_group
from .native_closure import native_closure


@dataclass(frozen=True)
class EnvelopeImage:
    """Weights of native closures over theta_o, `bake.envelope.pack_weights` as a texture."""

    closures: tuple[Lobe, ...]
    image: bpy.types.Image
    nodes: int


def exact_group(
    name: str,
    envelope: EnvelopeImage,
    lookup: bpy.types.ShaderNodeTree,
    sampler: bpy.types.ShaderNodeTree,
    density: bpy.types.ShaderNodeTree | None = None,
    lamps: bpy.types.Image | None = None,
) -> bpy.types.ShaderNodeTree:
    """(Normal, Tint) to a shader: the envelope's closures or, as often as its share of light, the residual's mirror.

    Parameters
    ----------
    lookup, sampler, density : of the residual; see `reference_group`
    lamps : table of lamps to aim at
    """

    def build(normal: Any, tint: Any) -> Any:
        drawn = drawn_direction(
            normal, lambda wo, *u: call(sampler, wo, *u), lambda wi, wo: call(density, wi, wo), lamps
        )
        u = texture_coordinate(expr, drawn.wo, envelope.nodes)
        rows = len(envelope.closures)
        taps = [expr.image_tap(envelope.image, u, 1 - (k + 0.5) / rows, "Linear") for k in range(rows)]
        chance = mirror_probability(expr, taps[0][1])
        gain = expr.divide(drawn.cosine, drawn.pdf * chance)
        residual = expr.scale(call(lookup, drawn.wi, drawn.wo, drawn.random[0]), gain) * tint
        mirror = drawn.mirror(residual)
        closures = [
            native_closure(lobe, expr.scale(weight * tint, expr.divide(1.0, 1 - chance)), normal)
            for lobe, (weight, _) in zip(envelope.closures, taps)
        ]
        total = closures[0]
        for closure in closures[1:]:
            total = _shader("ShaderNodeAddShader", {0: total, 1: closure})
        # Cycles skips the nodes of the branch that a factor of 0 or 1 leaves out.
        return _shader("ShaderNodeMixShader", {0: drawn.random[1] < chance, 1: total, 2: mirror})

    return node_group(name, {"Normal": "vector", "Tint": "vector"}, {"BSDF": "shader"}, build)


def _shader(kind: str, inputs: dict[int | str, Any]) -> Any:
    return expr.Scalar(expr.node(kind, {}, inputs).outputs[0])
