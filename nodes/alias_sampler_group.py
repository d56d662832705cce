"""Node groups: a light direction for a viewer direction, drawn from a material's alias tables, and its density."""

from __future__ import annotations

from typing import Any

import bpy

from ..bake import alias_sampler
from ..bake.alias_sampler import SamplerLayout
from ..bake.anisotropic import sampler as slope_sampler
from ..bake.brdf.baked_table import Layout
from . import expr
from .group import node_group


def alias_sampler_group(name: str, image: bpy.types.Image, layout: Layout) -> bpy.types.ShaderNodeTree:
    """(wo, four random numbers) to (wi, pdf); local frame, of an isotropic material with wo in the x-z plane.

    Parameters
    ----------
    image : the alias tables, one row per bin of viewers from the top, one column per cell; RGBA as in `AliasSampler`
        and `SlopeSampler`
    """

    def sample(wo: Any, u_cell: Any, u_alias: Any, u: Any, v: Any) -> tuple[Any, Any]:
        cell = expr.minimum(expr.floor(u_cell * layout.cells), layout.cells - 1.0)
        if isinstance(layout, SamplerLayout):
            row, _ = alias_sampler.choose_texel(expr, layout, wo, u_cell)
            texel, alias_pdf = _texel(image, layout.cells, layout.n_o, row, cell)
            return alias_sampler.reflect_from_cell(expr, layout, wo, cell, texel, alias_pdf, u_alias, u, v)
        row = slope_sampler.viewer_bin(expr, layout, wo)
        texel, alias_weight = _texel(image, layout.cells, layout.bins, row, cell)
        return slope_sampler.reflect_from_cell(expr, layout, wo, cell, texel, alias_weight, u_alias, u, v)

    numbers = dict.fromkeys(("Random Cell", "Random Alias", "Random U", "Random V"), "float")
    return node_group(name, {"wo": "vector", **numbers}, {"wi": "vector", "pdf": "float"}, sample)


def alias_pdf_group(name: str, image: bpy.types.Image, layout: Layout) -> bpy.types.ShaderNodeTree:
    """(wi, wo) to the density with which `alias_sampler_group` draws wi; 0 where it never does."""

    def density(wi: Any, wo: Any) -> Any:
        if isinstance(layout, SamplerLayout):
            row, cell, wo_half = alias_sampler.find_texel(expr, layout, wi, wo)
            pdf_h = _own(_texel(image, layout.cells, layout.n_o, row, cell))
            return expr.divide(pdf_h, 4 * expr.maximum(wo_half, 1e-6))
        row, cell, factor = slope_sampler.find_texel(expr, layout, wi, wo)
        return _own(_texel(image, layout.cells, layout.bins, row, cell)) * factor

    return node_group(name, {"wi": "vector", "wo": "vector"}, {"pdf": "float"}, density)


def _texel(image: bpy.types.Image, cells: int, bins: int, row: Any, cell: Any) -> tuple[Any, Any]:
    """(acceptance, alias, own value) and the alias cell's value."""
    return expr.image_tap(image, (cell + 0.5) * (1 / cells), 1 - (row + 0.5) * (1 / bins), "Closest")


def _own(texel: tuple[Any, Any]) -> Any:
    return expr.components(texel[0])[2]
