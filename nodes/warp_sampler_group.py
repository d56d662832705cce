"""Node groups: a light direction for a viewer direction, drawn by a warp of the unit square, and its density."""

from __future__ import annotations

from typing import Any

import bpy

from ..bake.sampling.warp_sampler import Read, WarpLayout, density, draw
from . import expr
from .group import node_group


def warp_sampler_group(name: str, image: bpy.types.Image, layout: WarpLayout) -> bpy.types.ShaderNodeTree:
    """(wo, four random numbers) to (wi, pdf); local frame, of an isotropic material with wo in the x-z plane.

    Two of the numbers are used: the others are there so that it takes the place of `alias_sampler_group`.

    Parameters
    ----------
    image : the warp's tables, one row per bin of viewers from the top; RGBA as in `WarpSampler`
    """

    def sample(wo: Any, u: Any, v: Any, *_: Any) -> tuple[Any, Any]:
        read = _reader(image, layout, wo)
        wi = draw(expr, layout, read, wo, u, v)
        return wi, density(expr, layout, read, wi, wo)

    numbers = dict.fromkeys(("Random U", "Random V", "Unused 1", "Unused 2"), "float")
    return node_group(name, {"wo": "vector", **numbers}, {"wi": "vector", "pdf": "float"}, sample)


def warp_pdf_group(name: str, image: bpy.types.Image, layout: WarpLayout) -> bpy.types.ShaderNodeTree:
    """(wi, wo) to the density with which `warp_sampler_group` draws wi."""

    def ask(wi: Any, wo: Any) -> Any:
        return density(expr, layout, _reader(image, layout, wo), wi, wo)

    return node_group(name, {"wi": "vector", "wo": "vector"}, {"pdf": "float"}, ask)


def _reader(image: bpy.types.Image, layout: WarpLayout, wo: Any) -> Read:
    v = layout.bin_of(expr, wo) * (-1 / layout.bins) + (1 - 0.5 / layout.bins)

    def read(column: Any) -> tuple[Any, Any]:
        return expr.image_tap(image, column * (1 / layout.width), v, "Closest")

    return read
