"""Node group: draw a light direction for a viewer direction from a material's alias tables."""

from __future__ import annotations

from typing import Any

import bpy

from ..bake.alias_sampler import SamplerLayout, choose_texel, find_texel, reflect_from_cell
from . import expr
from .group import node_group


def alias_sampler_group(name: str, image: bpy.types.Image, layout: SamplerLayout) -> bpy.types.ShaderNodeTree:
    """(wo, four random numbers) to (wi, pdf); local frame, wo in the x-z plane.

    Parameters
    ----------
    image : the alias tables, one row per theta_o bin from the top, one column per cell; RGBA as in `AliasSampler`
    """

    def sample(wo: Any, u_cell: Any, u_alias: Any, u_h: Any, u_phi: Any) -> tuple[Any, Any]:
        bin_index, cell = choose_texel(expr, layout, wo, u_cell)
        u = (cell + 0.5) * (1 / layout.cells)
        v = 1 - (bin_index + 0.5) * (1 / layout.n_o)
        texel, alias_pdf = expr.image_tap(image, u, v, "Closest")
        return reflect_from_cell(expr, layout, wo, cell, texel, alias_pdf, u_alias, u_h, u_phi)

    numbers = dict.fromkeys(("Random Cell", "Random Alias", "Random Theta", "Random Phi"), "float")
    return node_group(name, {"wo": "vector", **numbers}, {"wi": "vector", "pdf": "float"}, sample)


def alias_pdf_group(name: str, image: bpy.types.Image, layout: SamplerLayout) -> bpy.types.ShaderNodeTree:
    """(wi, wo) to the density with which `alias_sampler_group` draws wi; 0 where it never does."""

    def density(wi: Any, wo: Any) -> Any:
        bin_index, cell, wo_half = find_texel(expr, layout, wi, wo)
        u, v = (cell + 0.5) * (1 / layout.cells), 1 - (bin_index + 0.5) * (1 / layout.n_o)
        pdf_h = expr.components(expr.image_tap(image, u, v, "Closest")[0])[2]
        return expr.divide(pdf_h, 4 * expr.maximum(wo_half, 1e-6))

    return node_group(name, {"wi": "vector", "wo": "vector"}, {"pdf": "float"}, density)
