"""Stone: broken granite, facets of crystals in three minerals."""

from __future__ import annotations

import bpy
import numpy as np

from .periodic import fractal_noise, grid, smooth_noise, voronoi
from .stock import coloured
from .surfaces import add_object, height_field
from .swatch import Swatch

_SIDE = 448
_GRAINS = 34  # along an edge
_MINERALS = np.array([(0.55, 0.42, 0.36), (0.42, 0.41, 0.40), (0.62, 0.60, 0.56), (0.035, 0.033, 0.035)])
_SHARES = (0.34, 0.28, 0.22, 0.16)  # feldspar, quartz, white feldspar, mica


def stone(seed: int = 0) -> Swatch:
    """Granite as the hammer leaves it."""

    def build(scene: bpy.types.Scene) -> list[bpy.types.Object]:
        rng = np.random.default_rng(seed)
        u, v = grid(_SIDE)
        bend = [0.008 * fractal_noise(rng, _SIDE, 0.08, 1.6) for _ in range(2)]
        grains = voronoi(rng, _GRAINS, (u + bend[0]) % 1, (v + bend[1]) % 1)
        tilt = 0.24 * rng.standard_normal((_GRAINS**2, 2))[grains.index]
        lift = 0.0025 * rng.standard_normal(_GRAINS**2)[grains.index]
        facets = (tilt * grains.offset).sum(-1) + lift
        broken = 0.011 * fractal_noise(rng, _SIDE, 0.35, 1.9)
        height = broken + facets + 0.0006 * fractal_noise(rng, _SIDE, 0.02, 1.0)
        kind = rng.choice(len(_SHARES), _GRAINS**2, p=_SHARES)[grains.index]
        shade = 1 + 0.12 * rng.standard_normal(_GRAINS**2)[grains.index] + 0.08 * smooth_noise(rng, _SIDE, 0.01)
        colour = np.clip(_MINERALS[kind] * shade[..., None], 0.01, 0.9)
        field = height_field(height - height.mean(), colour)
        material = coloured("Swatch stone", gloss=0.05, exponent=12)
        return [add_object(scene, "Swatch stone", field, material)]

    return Swatch("stone", build, 0.12, "broken granite", "oren_nayar", {"roughness": 0.6})
