"""A tabulated BRDF as native closures under it and a mirror for the rest (addon/docs/method.md, section 9)."""

from __future__ import annotations

from typing import Any

import bpy

from . import expr
from .adjustments import Adjustments
from .group import call
from .lamp_share_group import LampShares, lamp_share_group
from .native_closure import choose_closure
from .table_groups import TableGroups
from .weighted_closures import WeightedClosures


def exact_closure(
    envelope: WeightedClosures,
    table: TableGroups,
    normal: Any,
    adjustments: Adjustments,
    lamps: bpy.types.Image | None,
    shares: LampShares | None = None,
) -> Any:
    """The envelope's closures or, as often as its share of light, the residual's mirror.

    With `mirror_probability` at an eagerness of 1 that share is the probability itself.

    Parameters
    ----------
    table : of the residual; its density is needed with `lamps`
    lamps : table of lamps to aim at
    shares : of the light of one lamp; used with `lamps` only
    """
    drawn = table.draw(normal, lamps)
    weights = envelope.weights(drawn.wo)
    chance = weights[0][1]
    if lamps is not None and shares is not None:
        tangent = () if table.tangent is None else (table.tangent,)
        chance = call(lamp_share_group(shares, lamps), drawn.wo, normal, chance, table.gloss, *tangent)
    gain = expr.divide(drawn.cosine, drawn.pdf * chance)
    residual = expr.scale(call(table.lookup, drawn.wi, drawn.wo, drawn.random[0]), gain)
    native = envelope.closure(weights, normal, adjustments, expr.divide(1.0, 1 - chance))
    return choose_closure(drawn.random[1] < chance, native, drawn.mirror(adjustments.apply(residual)))


def reference_closure(table: TableGroups, normal: Any, adjustments: Adjustments, lamps: bpy.types.Image | None) -> Any:
    """The mirror alone, every sample exact; `table` is of the whole BRDF."""
    drawn = table.draw(normal, lamps)
    gain = expr.divide(drawn.cosine, drawn.pdf)
    weight = expr.scale(call(table.lookup, drawn.wi, drawn.wo, drawn.random[0]), gain)
    return drawn.mirror(adjustments.apply(weight))
