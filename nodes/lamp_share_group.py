"""Node group: the mirror's probability, by the share of the strongest lamp's light that is left to it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy

from ..bake.envelope import ShareLayout, SlopeShareLayout, part_of_light, share_coordinates
from ..bake.sampling.gloss import stretched
from ..bake.sampling.lamps import TEXELS
from . import expr
from .adjustments import GLOSS
from .drawn_direction import frame_of
from .group import node_group
from .light_images import texel


@dataclass(frozen=True)
class LampShares:
    """The image of `bake.envelope.lamp_shares`, and where it has what.

    Parameters
    ----------
    through : of a sheet, whether it is of light from the far side; None of what is no sheet
    """

    image: bpy.types.Image
    layout: ShareLayout | SlopeShareLayout
    through: bool | None = None


def lamp_share_group(shares: LampShares, lamps: bpy.types.Image) -> bpy.types.ShaderNodeTree:
    """(wo, Normal, Usual, Gloss), and Tangent of an anisotropic material, to a probability.

    It is the usual one as far as other light than the lamp's arrives.

    Parameters
    ----------
    lamps : the table of `bake.sampling.lamps.lamp_table`
    """

    def build(wo: Any, normal: Any, usual: Any, gloss: Any, tangent: Any = None) -> Any:
        geometry = expr.node("ShaderNodeNewGeometry", {}, {})
        position, incoming = (expr.Vector(geometry.outputs[name]) for name in ("Position", "Incoming"))
        return lamp_probability(shares, lamps, position, incoming, normal, wo, usual, tangent, gloss)

    inputs = {"wo": "vector", "Normal": "vector", "Usual": "float", GLOSS: "float"}
    if isinstance(shares.layout, SlopeShareLayout):
        inputs["Tangent"] = "vector"
    return node_group("MM Mirror Probability", inputs, {"Probability": "float"}, build, switched="extension")


def lamp_probability(
    shares: LampShares,
    lamps: bpy.types.Image,
    position: Any,
    incoming: Any,
    normal: Any,
    wo: Any,
    usual: Any,
    tangent: Any = None,
    gloss: Any = None,
) -> Any:
    """The group's content, for a position and viewer."""
    centre, (sky, count, strength) = _strongest(lamps)
    to_centre = centre - position
    if shares.through:  # as the table has it, mirrored in the sheet
        to_centre = to_centre - expr.scale(normal, expr.dot(to_centre, normal) * 2.0)
    to_lamp = expr.normalize(to_centre)
    if gloss is not None:
        to_lamp, _ = stretched(expr, to_lamp, incoming, gloss, normal)
    u, v = _place(shares.layout, to_lamp, incoming, normal, wo, tangent)
    seen, reflected, _ = expr.components(expr.image_tap(shares.image, u, v, "Linear")[0])
    part = part_of_light(expr, to_centre, reflected, strength, count, sky)
    if shares.through is not None:
        part = part * (expr.dot(to_lamp, normal) > 0.0)
    return expr.where(part, seen, usual)


def lamp_side_group(lamps: bpy.types.Image, least: float) -> bpy.types.ShaderNodeTree:
    """(Normal, Usual) to the part of a sheet's light that its reflection brings: all of a lamp's before it.

    It is the usual part as far as other light than the lamp's arrives, and lies between `least` and 1 - `least`.
    """

    def build(normal: Any, usual: Any) -> Any:
        position = expr.Vector(expr.node("ShaderNodeNewGeometry", {}, {}).outputs["Position"])
        return lamp_side(lamps, position, normal, usual, least)

    inputs = {"Normal": "vector", "Usual": "float"}
    return node_group("MM Lamp's Side", inputs, {"Reflected": "float"}, build, switched="extension")


def lamp_side(lamps: bpy.types.Image, position: Any, normal: Any, usual: Any, least: float) -> Any:
    """The group's content, for a position."""
    centre, (sky, count, strength) = _strongest(lamps)
    to_centre = centre - position
    part = part_of_light(expr, to_centre, 1.0, strength, count, sky)
    found = expr.where(part, expr.dot(to_centre, normal) > 0.0, usual)
    return expr.minimum(expr.maximum(found, least), 1 - least)


def _place(
    layout: ShareLayout | SlopeShareLayout, to_lamp: Any, incoming: Any, normal: Any, wo: Any, tangent: Any
) -> tuple[Any, Any]:
    """Texture coordinates of the shares for a lamp in this direction."""
    if isinstance(layout, ShareLayout):
        return share_coordinates(expr, to_lamp, incoming, normal, wo, layout)
    # The nodes of this frame are those that wo came from, and Cycles computes them once.
    _, along, across = frame_of(normal, incoming, tangent)
    wi = expr.vec(*(expr.dot(to_lamp, axis) for axis in (along, across, normal)))
    return layout.coordinates(expr, wi, wo)


def _strongest(lamps: bpy.types.Image) -> tuple[Any, tuple[Any, Any, Any]]:
    """Middle of the strongest lamp; irradiance of all else, number of lamps, and the lamp's own strength."""
    (centre, _), (scene, strength) = (texel(lamps, 0.0, k) for k in (0, TEXELS - 1))
    sky, _, count = expr.components(scene)
    return centre, (sky, count, strength)
