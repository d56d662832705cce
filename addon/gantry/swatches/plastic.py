"""Moulded plastic: the pebbled grain of a dashboard under a gloss of chosen width."""

from __future__ import annotations

import bpy
import numpy as np

from .periodic import domes, fractal_noise, grid, smooth_noise
from .stock import coloured
from .surfaces import add_object, height_field
from .swatch import Swatch

_SIDE = 384
_PEBBLES = 13  # along an edge
_RISE = 0.022  # of a pebble, in tiles per squared pebble
_GLOSS = 0.3


def plastic(seed: int = 0, exponent: float = 20.0) -> Swatch:
    """Bumpy plastic whose gloss is as wide as a Phong lobe of `exponent`."""

    def build(scene: bpy.types.Scene) -> list[bpy.types.Object]:
        rng = np.random.default_rng(seed)
        u, v = grid(_SIDE)
        # Bend the grid, or the eye finds the rows of the jittered points.
        bend = [0.007 * smooth_noise(rng, _SIDE, 0.2) for _ in range(2)]
        height = _RISE * domes(rng, _PEBBLES, u + bend[0], v + bend[1], 9.0)
        height += 0.0015 * smooth_noise(rng, _SIDE, 0.12) + 0.00004 * fractal_noise(rng, _SIDE, 0.03, 1.2)
        field = height_field(height - height.mean(), np.array((0.035, 0.05, 0.075)))
        material = coloured("Swatch plastic", _GLOSS, exponent)
        return [add_object(scene, "Swatch plastic", field, material)]

    description = f"moulded plastic with a pebbled grain, gloss of Phong exponent {exponent:g}"
    return Swatch(f"plastic_{exponent:g}", build, 0.03, description, "phong", {"exponent": exponent, "diffuse": 0.1})
