"""Node groups: the world's picture as Cycles shows it, for shaders that sample it (method.md, section 10)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy

from . import expr
from .group import call, node_group
from .light_images import WORLD_LIGHT_TEXELS

# Name of the groups that hold a world's picture.
PICTURE = "MM World Picture"
LIT = {"Lit": "float", "Row1": "vector", "Row2": "vector", "Row3": "vector", "Rays": "float"}


@dataclass(frozen=True)
class Surroundings:
    """A world's picture, how it is interpolated, and the table of its strength and rotation.

    Texel k of the table is row k of the matrix that turns directions of the world to those of the picture; in alpha of
    the first, the picture's strength, or 0 where its light is not known exactly; in that of the second which rays show
    it, as `bake.sampling.lamp_light` has it of lamps.
    """

    image: bpy.types.Image
    interpolation: str
    table: bpy.types.Image


def lit_group(table: bpy.types.Image) -> bpy.types.ShaderNodeTree:
    """No input to how bright the world's picture is shown, and how directions are turned to it."""

    def build() -> tuple[Any, ...]:
        taps = [
            expr.image_tap(table, (k + 0.5) / WORLD_LIGHT_TEXELS, 0.5, "Closest") for k in range(WORLD_LIGHT_TEXELS)
        ]
        return taps[0][1], *(row for row, _ in taps), taps[1][1]

    return node_group("MM World Strength", {}, LIT, build, switched="extension")


def picture_group(around: Surroundings) -> bpy.types.ShaderNodeTree:
    """(direction of the picture) to its colour there, as Cycles has it behind the scene."""

    def build(direction: Any) -> Any:
        setting = {"image": around.image, "interpolation": around.interpolation}
        return expr.Vector(expr.node("ShaderNodeTexEnvironment", setting, {0: direction}).outputs["Color"])

    return node_group(PICTURE, {"Direction": "vector"}, {"Color": "vector"}, build)


def radiance_group(around: Surroundings) -> bpy.types.ShaderNodeTree:
    """(direction of the world) to its radiance, 0 where it is not known exactly; what is below 0 is left out.

    That, and what is not a number, is left to a mirror, which shows it as it is.
    """
    lit, picture = lit_group(around.table), picture_group(around)

    def build(wi: Any) -> Any:
        strength, *rows, _ = call(lit)
        colour = call(picture, expr.vec(*(expr.dot(row, wi) for row in rows)))
        return expr.vector_node("MAXIMUM", expr.scale(colour, strength), expr.vec(0.0, 0.0, 0.0))

    return node_group("MM World Radiance", {"wi": "vector"}, {"Radiance": "vector"}, build)
