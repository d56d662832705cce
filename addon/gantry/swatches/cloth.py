"""Cloth: a plain weave of soft yarns."""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np

from .stock import coloured
from .surfaces import add_object, backing, join, visible_height
from .swatch import Swatch
from .weave import YarnStyle, weave

_WARP = YarnStyle(
    width=0.5, thickness=0.36, strands=14, twist=11, slub=0.06, wander=0.05, colour=(0.36, 0.045, 0.06), uneven=0.05
)
_WEFT = replace(_WARP, colour=(0.42, 0.07, 0.07))


def cloth(seed: int = 0) -> Swatch:
    """Red cotton, every yarn over one and under one."""

    def build(scene: bpy.types.Scene) -> list[bpy.types.Object]:
        rng = np.random.default_rng(seed)
        woven = weave(rng, np.eye(2, dtype=bool), (7, 7), _WARP, _WEFT, crimp=0.5, fuzz=3000)
        surface = join(woven, backing(woven.points[:, 2].min() - 0.005, (0.05, 0.01, 0.01)))
        return [add_object(scene, "Swatch cloth", surface, coloured("Swatch cloth"), visible_height(surface))]

    return Swatch("cloth", build, 0.13, "red cotton in plain weave", "oren_nayar", {"roughness": 0.3})
