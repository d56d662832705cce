"""A four-dimensional table in a material: directions drawn in the frame of a tangent."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy

from ..bake.brdf.baked_table import BakedTable
from ..bake.tables.anisotropic_grids import AnisotropicNormalGrid
from .alias_sampler_group import alias_pdf_group, alias_sampler_group
from .anisotropic_groups import anisotropic_lookup_group
from .data_image import bundle_image
from .drawn_direction import DrawnDirection, drawn_direction
from .group import call
from .table_groups import TableGroups
from .tangent_frame_group import tangent_frame_group


@dataclass(frozen=True)
class AnisotropicGroups(TableGroups):
    """Groups of an anisotropic table, as those of an isotropic one, with the surface's tangent in world space."""

    tangent: Any = None

    def draw(self, normal: Any, lamps: bpy.types.Image | None) -> DrawnDirection:
        """A direction from the sampler or, with `density`, towards the lamps of a table."""
        return drawn_direction(
            normal,
            lambda wo, *u: call(self.sampler, wo, *u),
            lambda wi, wo: call(self.density, wi, wo),
            lamps,
            lambda n, incoming: call(tangent_frame_group(), n, incoming, self.tangent),
        )


def anisotropic_table_groups(
    table: BakedTable, name: str, filter: str | None, stochastic: bool, pack: bool, *, aimed: bool
) -> AnisotropicGroups:
    """Groups of an anisotropic table, its textures loaded; without a tangent yet. Raises BakeError.

    Blended, sixteen taps of a spline, or four beside the normal basis' longer formulas, would not leave a material room
    on SVM's stack: there one slice is chosen in any case.

    Whoever shares a bundle may have changed its pixels: they are read and checked once before Blender loads them.
    """
    bundle, stored, grid, layout = table.bundle, table.stored, table.stored.grid, table.layout
    bundle.load(table.part)
    table.load_sampler()
    atlas = bundle_image(bundle, table.part, f"{name} {table.part}", pack=pack)
    cells = bundle_image(bundle, table.sampler, f"{name} {table.sampler.replace('_', ' ')}", pack=pack)
    filter = filter or table.filter
    stochastic = stochastic or filter == "bspline" or isinstance(grid, AnisotropicNormalGrid)
    lookup = anisotropic_lookup_group(
        f"MM Lookup {name}", atlas, grid, filter, 1 / stored.scale, stochastic, stored.offset, stored.log
    )
    sampler = alias_sampler_group(f"MM Sampler {name}", cells, layout)
    density = alias_pdf_group(f"MM Sampler Density {name}", cells, layout) if aimed else None
    return AnisotropicGroups(lookup, sampler, density)
