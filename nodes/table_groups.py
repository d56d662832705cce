"""The node groups of a tabulated BRDF, and a direction drawn by them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import bpy

from ..bake.brdf.baked_table import BakedTable
from ..bake.brdf.grids import is_anisotropic
from ..bake.brdf.samplers import Layout, kind_of_layout
from ..bake.tables.grids.anisotropic_grids import AnisotropicNormalGrid
from ..bake.tables.table import Filter
from .aimed_light_group import MAX_SLOTS
from .alias_sampler_group import alias_pdf_group, alias_sampler_group
from .checked_pixels import check_table, concentration_of
from .data_image import Images
from .drawn_direction import DrawnDirection, drawn_direction
from .group import call
from .table_lookup_group import table_lookup_group
from .warp_sampler_group import warp_pdf_group, warp_sampler_group

MakeGroup = Callable[[str, bpy.types.Image, Any], bpy.types.ShaderNodeTree]


@dataclass(frozen=True)
class TableGroups:
    """Node groups of a tabulated BRDF: (wi, wo, random) to it, (wo, random numbers) to (wi, pdf), and (wi, wo) to that
    pdf.

    Parameters
    ----------
    density : None where nothing is aimed
    tangent : of the surface, in world space, in whose frame an anisotropic table lies; None of an isotropic one
    gloss : by which it is seen sharper or softer, see `bake.sampling.gloss`; None as it is
    through : of a sheet's transmission, mirrored
    concentration : of the sampler, `bake.sampling.concentration`
    most_lamps : that there is room to aim at
    """

    lookup: bpy.types.ShaderNodeTree
    sampler: bpy.types.ShaderNodeTree
    density: bpy.types.ShaderNodeTree | None = None
    tangent: Any = None
    gloss: Any = None
    through: bool = False
    concentration: float = 0.0
    most_lamps: int = MAX_SLOTS

    def draw(self, normal: Any, lamps: bpy.types.Image | None) -> DrawnDirection:
        """A direction from the sampler or, with `density`, towards the lamps of a table."""
        return drawn_direction(
            normal,
            lambda wo, *u: call(self.sampler, wo, *u),
            lambda wi, wo: call(self.density, wi, wo),
            lamps,
            self.tangent,
            self.gloss,
            self.through,
            self.concentration,
            self.most_lamps,
        )


def table_groups(
    table: BakedTable, name: str, images: Images, filter: Filter | None, stochastic: bool, *, aimed: bool
) -> TableGroups:
    """Groups of a table, of its textures; of an anisotropic one without a tangent yet. Raises BakeError.

    Blended, sixteen taps of an anisotropic spline, or four beside the normal basis' longer formulas, would not leave a
    material room on SVM's stack: there one slice is chosen in any case.
    """
    stored, grid = table.stored, table.stored.grid
    check_table(table)
    atlas, cells = images(table.part), images(table.sampler)
    filter = table.read_by(filter)
    if is_anisotropic(grid):
        stochastic = stochastic or filter == "bspline" or isinstance(grid, AnisotropicNormalGrid)
    lookup = table_lookup_group(
        f"MM Lookup {name}", atlas, grid, filter, 1 / stored.scale, stochastic, stored.offset, stored.log
    )
    draw, ask = sampler_groups(table.layout)
    sampler = draw(f"MM Sampler {name}", cells, table.layout)
    density = ask(f"MM Sampler Density {name}", cells, table.layout) if aimed else None
    return TableGroups(lookup, sampler, density, concentration=concentration_of(table) if aimed else 0.0)


def sampler_groups(layout: Layout) -> tuple[MakeGroup, MakeGroup]:
    """What makes the groups of such a sampler and of its density, of a name, its image and the layout."""
    if kind_of_layout(layout) == "warp":
        return warp_sampler_group, warp_pdf_group
    return alias_sampler_group, alias_pdf_group
