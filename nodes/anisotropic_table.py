"""A four-dimensional table in a material: directions drawn in the frame of a tangent."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy

from ..bake.anisotropic.facts import filter_of, grid_of, sampler_of
from ..bake.bundle import Bundle
from ..bake.table_facts import log_of, offset_of, scale_of
from ..bake.tables.anisotropic_grids import AnisotropicNormalGrid
from .anisotropic_groups import anisotropic_lookup_group, slope_pdf_group, slope_sampler_group
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
    bundle: Bundle, name: str, filter: str | None, stochastic: bool, pack: bool, *, aimed: bool, part: str = "table"
) -> AnisotropicGroups:
    """Groups of a bundle's BRDF, or of its "residual", their textures loaded; without a tangent yet. Raises BakeError.

    Blended, sixteen taps of a spline, or four beside the normal basis' longer formulas, would not leave a material room
    on SVM's stack: there one slice is chosen in any case.

    Whoever shares a bundle may have changed its pixels: they are read and checked once before Blender loads them.
    """
    bundle.load(part)
    stored = "sampler" if part == "table" else "residual_sampler"
    grid, layout = grid_of(bundle, part), sampler_of(bundle, stored).layout
    atlas = bundle_image(bundle, part, f"{name} {part}", pack=pack)
    cells = bundle_image(bundle, stored, f"{name} {stored.replace('_', ' ')}", pack=pack)
    filter = filter or filter_of(bundle)
    stochastic = stochastic or filter == "bspline" or isinstance(grid, AnisotropicNormalGrid)
    scale, offset, log = 1 / scale_of(bundle, part), offset_of(bundle, part), log_of(bundle, part)
    lookup = anisotropic_lookup_group(f"MM Lookup {name}", atlas, grid, filter, scale, stochastic, offset, log)
    sampler = slope_sampler_group(f"MM Sampler {name}", cells, layout)
    density = slope_pdf_group(f"MM Sampler Density {name}", cells, layout) if aimed else None
    return AnisotropicGroups(lookup, sampler, density)
