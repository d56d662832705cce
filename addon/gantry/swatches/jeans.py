"""Jeans: a 3/1 twill of uneven indigo warp over white weft."""

from __future__ import annotations

import bpy
import numpy as np

from .stock import coloured
from .surfaces import add_object, backing, join, visible_height
from .swatch import Swatch
from .weave import YarnStyle, weave

_WARP = YarnStyle(
    width=0.53, thickness=0.44, strands=8, twist=16, slub=0.10, wander=0.06, colour=(0.05, 0.085, 0.17), uneven=0.22
)
_WEFT = YarnStyle(
    width=0.46, thickness=0.34, strands=8, twist=14, slub=0.12, wander=0.06, colour=(0.58, 0.58, 0.55), uneven=0.05
)
# Each weft goes over one warp in four, one further with every row: the diagonal of the twill.
_TWILL = ~np.eye(4, dtype=bool)


def jeans(seed: int = 0) -> Swatch:
    """Denim, three over one."""

    def build(scene: bpy.types.Scene) -> list[bpy.types.Object]:
        rng = np.random.default_rng(seed)
        woven = weave(rng, _TWILL, (4, 5), _WARP, _WEFT, crimp=0.45, fuzz=5000)
        surface = join(woven, backing(woven.points[:, 2].min() - 0.005, (0.02, 0.03, 0.06)))
        return [add_object(scene, "Swatch jeans", surface, coloured("Swatch jeans"), visible_height(surface))]

    return Swatch("jeans", build, 0.11, "blue denim, twill 3/1", "oren_nayar", {"roughness": 0.4})
