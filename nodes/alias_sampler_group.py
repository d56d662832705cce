"""Node groups: a light direction for a viewer direction, drawn from a material's alias tables, and its density."""

from __future__ import annotations

from typing import Any

import bpy

from ..bake.sampling.cell_sampler import CellLayout, draw_cell, find_texel, reflect_from_cell
from . import expr
from .group import node_group


def alias_sampler_group(name: str, image: bpy.types.Image, layout: CellLayout) -> bpy.types.ShaderNodeTree:
    """(wo, four random numbers) to (wi, pdf); local frame, of an isotropic material with wo in the x-z plane.

    Parameters
    ----------
    image : the alias tables, one row per bin of viewers from the top, one column per cell; RGBA as in `CellSampler`
    """

    def sample(wo: Any, u_cell: Any, u_alias: Any, u: Any, v: Any) -> tuple[Any, Any]:
        cell = draw_cell(expr, layout, u_cell)
        texel, alias_value = _texel(image, layout, layout.bin_of(expr, wo), cell)
        return reflect_from_cell(expr, layout, wo, cell, texel, alias_value, u_alias, u, v)

    numbers = dict.fromkeys(("Random Cell", "Random Alias", "Random U", "Random V"), "float")
    return node_group(name, {"wo": "vector", **numbers}, {"wi": "vector", "pdf": "float"}, sample)


def alias_pdf_group(name: str, image: bpy.types.Image, layout: CellLayout) -> bpy.types.ShaderNodeTree:
    """(wi, wo) to the density with which `alias_sampler_group` draws wi; 0 where it never does."""

    def density(wi: Any, wo: Any) -> Any:
        row, cell, pdf = find_texel(expr, layout, wi, wo)
        return pdf(expr.components(_texel(image, layout, row, cell)[0])[2])

    return node_group(name, {"wi": "vector", "wo": "vector"}, {"pdf": "float"}, density)


def _texel(image: bpy.types.Image, layout: CellLayout, row: Any, cell: Any) -> tuple[Any, Any]:
    """Acceptance, alias and own value, and the alias cell's value."""
    u, v = (cell + 0.5) * (1 / layout.cells), 1 - (row + 0.5) * (1 / layout.bins)
    return expr.image_tap(image, u, v, "Closest")
