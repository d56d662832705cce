"""Node group: a tabulated BRDF as native closures under it and a mirror for the rest (DESIGN.md section 5)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy

from ..bake.envelope import mirror_probability, texture_coordinate
from ..bake.shading.lobes import Lobe
from . import expr
from .group import call, node_group
from .native_closure import add_closures, choose_closure, native_closure
from .table_groups import TableGroups


@dataclass(frozen=True)
class EnvelopeImage:
    """Weights of native closures over theta_o, `bake.envelope.pack_weights` as a texture."""

    closures: tuple[Lobe, ...]
    image: bpy.types.Image
    nodes: int


def exact_group(
    name: str,
    envelope: EnvelopeImage,
    table: TableGroups,
    lamps: bpy.types.Image | None = None,
) -> bpy.types.ShaderNodeTree:
    """(Normal, Tint) to a shader: the envelope's closures or, as often as its share of light, the residual's mirror.

    Parameters
    ----------
    table : of the residual; its density is needed with `lamps`
    lamps : table of lamps to aim at
    """

    def build(normal: Any, tint: Any) -> Any:
        drawn = table.draw(normal, lamps)
        u = texture_coordinate(expr, drawn.wo, envelope.nodes)
        rows = len(envelope.closures)
        taps = [expr.image_tap(envelope.image, u, 1 - (k + 0.5) / rows, "Linear") for k in range(rows)]
        chance = mirror_probability(expr, taps[0][1])
        gain = expr.divide(drawn.cosine, drawn.pdf * chance)
        residual = expr.scale(call(table.lookup, drawn.wi, drawn.wo, drawn.random[0]), gain) * tint
        mirror = drawn.mirror(residual)
        closures = [
            native_closure(lobe, expr.scale(weight * tint, expr.divide(1.0, 1 - chance)), normal)
            for lobe, (weight, _) in zip(envelope.closures, taps)
        ]
        return choose_closure(drawn.random[1] < chance, add_closures(closures), mirror)

    return node_group(name, {"Normal": "vector", "Tint": "vector"}, {"BSDF": "shader"}, build)
