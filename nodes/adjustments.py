"""What an artist asks of a measured group by its sockets, without a bake: tint, brightness and saturation.

They act on the reflectance, a colour for every pair of directions, and linearly, so that the parts which a material is
built of, closures, mirror and sampled light, still add up to the measurement so adjusted. Cycles folds what is neutral
away: such a material costs what it would without these sockets.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import bpy

from ..bake.sampling.gloss import LEAST, MOST
from ..bake.source import LUMINANCE
from . import expr
from .group import call, node_group

SOCKETS = {"Tint": "color", "Brightness": "float", "Saturation": "float"}
# Of measured BRDFs: it acts on directions, not on the reflectance, see `nodes.gloss_group`.
GLOSS = "Gloss"
NEUTRAL: dict[str, Any] = {"Tint": (1.0, 1.0, 1.0, 1.0), "Brightness": 1.0, "Saturation": 1.0, GLOSS: 1.0}
# What a slider offers; a link may bring anything, and what is negative then counts as 0.
LIMITS = {"Brightness": (0.0, 10.0), "Saturation": (0.0, 2.0), GLOSS: (LEAST, MOST)}
# Shown where the mouse rests on a socket or its row in the panel.
WORDS = {
    "Normal": "Shading normal; link a Bump or a Normal Map",
    "Tint": "Colour that all reflected light is multiplied by",
    "Brightness": "Factor of all reflected light; the Adjust panel says up to where the material stays physical",
    "Saturation": "0 is grey of the same luminance, 1 as measured; above 1 colours are exaggerated",
    "Gloss": "Highlights sharper above 1, softer below; 1 is as measured",
    "Tangent": "Direction that an anisotropic measurement's x-axis lies along",
    "UV": "Where on the swatch; 0 to 1 is one swatch",
    "Light Level": "EEVEE only: irradiance of the brightest light, which shows the brightest photograph",
}


@dataclass(frozen=True)
class Adjustments:
    """Sockets of a measured group, as expressions.

    Parameters
    ----------
    tint, brightness : a colour and a scalar, factors of all that is reflected
    saturation : 0 makes every reflectance grey of its own luminance, 1 leaves it
    """

    tint: Any
    brightness: Any
    saturation: Any

    @classmethod
    def among(cls, named: Mapping[str, Any]) -> Adjustments:
        """Of a group's inputs by their names."""
        return cls(*(named[name] for name in SOCKETS))

    @property
    def gain(self) -> Any:
        """Factor of all that is reflected, a colour."""
        gain = expr.scale(self.tint, self.brightness)
        # An animation may overshoot, and negative light be emitted.
        return expr.vector_node("MAXIMUM", gain, expr.vec(0.0, 0.0, 0.0))

    def saturated(self, reflectance: Any) -> Any:
        """v * saturation + luminance(v) * (1 - saturation) of a reflectance v, times any scalar; not below 0."""
        return call(saturation_group(), reflectance, self.saturation)

    def apply(self, reflectance: Any, factor: Any = 1.0) -> Any:
        """A reflectance adjusted, times a scalar; the light that it meets is to be a factor of the result."""
        gain = self.gain if isinstance(factor, float) and factor == 1.0 else expr.scale(self.gain, factor)
        return self.saturated(reflectance) * gain


def describe_sockets(group: bpy.types.ShaderNodeTree) -> None:
    """Give a measured group's inputs their words; they are no part of what it is known by."""
    for item in group.interface.items_tree:
        words = WORDS.get(item.name, "") if item.item_type == "SOCKET" and item.in_out == "INPUT" else ""
        if words and item.description != words:
            item.description = words


def saturation_group() -> bpy.types.ShaderNodeTree:
    """(Color, Saturation) to the colour of that saturation about its own luminance: exactly itself at 1."""

    def saturate(colour: Any, saturation: Any) -> Any:
        luminance = expr.dot(colour, expr.vec(*LUMINANCE))
        grey = expr.Vector(luminance.socket)  # a number where a vector is asked for stands in all its components
        mixed = expr.where(expr.maximum(saturation, 0.0), colour, grey)
        # Between grey and the colour itself nothing is negative; chosen so that Cycles folds it away there.
        held = expr.vector_node("MAXIMUM", mixed, expr.vec(0.0, 0.0, 0.0))
        return expr.where(saturation > 1.0, held, mixed)

    return node_group(
        "MM Saturation",
        {"Color": "vector", "Saturation": "float"},
        {"Color": "vector"},
        saturate,
        {"Saturation": 1.0},
    )
