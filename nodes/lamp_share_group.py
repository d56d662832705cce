"""Node group: the mirror's probability, by the share of the strongest lamp's light that is left to it."""

from __future__ import annotations

from typing import Any

import bpy

from ..bake.envelope import part_of_light, share_coordinates
from ..bake.sampling.lamps import TEXELS
from . import expr
from .group import node_group


def lamp_share_group(shares: bpy.types.Image, lamps: bpy.types.Image) -> bpy.types.ShaderNodeTree:
    """(wo, Normal, Usual) to a probability, the usual one as far as other light than the lamp's arrives.

    Parameters
    ----------
    shares : of `bake.envelope.lamp_shares`
    lamps : the table of `bake.sampling.lamps.lamp_table`
    """

    def build(wo: Any, normal: Any, usual: Any) -> Any:
        geometry = expr.node("ShaderNodeNewGeometry", {}, {})
        position, incoming = (expr.Vector(geometry.outputs[name]) for name in ("Position", "Incoming"))
        return lamp_probability(shares, lamps, position, incoming, normal, wo, usual)

    inputs = {"wo": "vector", "Normal": "vector", "Usual": "float"}
    return node_group("MM Mirror Probability", inputs, {"Probability": "float"}, build, switched="extension")


def lamp_probability(
    shares: bpy.types.Image, lamps: bpy.types.Image, position: Any, incoming: Any, normal: Any, wo: Any, usual: Any
) -> Any:
    """The group's content, for a position and viewer."""
    first_row = 1 - 0.5 / lamps.size[1]
    (centre, _), (scene, strength) = (
        expr.image_tap(lamps, (k + 0.5) / TEXELS, first_row, "Closest") for k in (0, TEXELS - 1)
    )
    sky, _, count = expr.components(scene)
    to_centre = centre - position
    to_lamp = expr.normalize(to_centre)
    u, v = share_coordinates(expr, to_lamp, incoming, normal, wo)
    seen, reflected, _ = expr.components(expr.image_tap(shares, u, v, "Linear")[0])
    part = part_of_light(expr, to_centre, reflected, strength, count, sky)
    return expr.where(part, seen, usual)
