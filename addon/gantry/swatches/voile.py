"""Voile: a thin plain weave that lets light through, as one sheet with the relief of its yarns."""

from __future__ import annotations

import bpy
import numpy as np

from .periodic import sample, smooth_noise
from .stock import coloured
from .surfaces import add_object, height_field
from .swatch import Swatch

_SIDE, _YARNS = 192, 6
# Of the light that the yarns do not take up; half of the height from yarn to yarn, in tiles.
_THROUGH, _RELIEF = 0.6, 0.035
_YARN, _GAP = (0.80, 0.66, 0.44), (0.97, 0.93, 0.84)


def voile(seed: int = 0) -> Swatch:
    """Undyed cotton, every yarn over one and under one, thinner where yarns leave gaps."""

    def build(scene: bpy.types.Scene) -> list[bpy.types.Object]:
        rng = np.random.default_rng(seed)
        v, u = np.meshgrid(*[np.arange(_SIDE) / _SIDE] * 2, indexing="ij")
        wander = [0.12 * sample(smooth_noise(rng, 128, 0.2), u, v) for _ in range(2)]
        across, along = (np.pi * (_YARNS * place + bend) for place, bend in ((u, wander[0]), (v, wander[1])))
        # Of two yarns that cross the upper one shows: warp where the product of their waves is positive.
        wave = np.cos(across) * np.cos(along)
        ridges = np.sin(across) ** 2 * np.cos(along) ** 2 + np.cos(across) ** 2 * np.sin(along) ** 2
        height = _RELIEF * (wave + 0.4 * ridges)
        gap = (np.sin(across) * np.sin(along)) ** 4
        uneven = 1 + 0.04 * sample(smooth_noise(rng, 128, 0.05), u, v)
        colour = np.array(_YARN) + gap[..., None] * (np.array(_GAP) - np.array(_YARN))
        surface = height_field(height - height.mean(), np.clip(colour * uneven[..., None], 0, 1))
        return [add_object(scene, "Swatch voile", surface, coloured("Swatch voile", through=_THROUGH))]

    return Swatch("voile", build, 0.1, "undyed cotton voile, against the light", "oren_nayar", {"roughness": 0.3})
