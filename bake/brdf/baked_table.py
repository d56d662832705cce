"""A table in a bundle with the sampler that draws its directions: what lookups and samplers are built of."""

from __future__ import annotations

from dataclasses import dataclass

from ..bundle.bundle import Bundle
from ..tables.atlas import unpack
from ..tables.grids.patch_grid import PatchGrid
from ..tables.table import Filter, Table
from .parts import StoredTableRecord
from .samplers import Layout, Sampler, checked_sampler

SAMPLERS = {"table": "sampler", "residual": "residual_sampler"}


def images_of_table(part: str) -> tuple[str, str]:
    """Names of the images of the "table" or of the "residual": its values, and its alias tables."""
    return part, SAMPLERS[part]


@dataclass(frozen=True)
class BakedTable:
    """The whole BRDF's table or the residual's.

    Attributes
    ----------
    bundle : that holds its images
    part : "table" or "residual", the name of its image
    stored : its grid, and how values come back
    layout : kind and sizes of its sampler
    filter : that it was baked for
    """

    bundle: Bundle
    part: str
    stored: StoredTableRecord
    layout: Layout
    filter: Filter

    @property
    def sampler(self) -> str:
        """Name of the image of its sampler."""
        return SAMPLERS[self.part]

    def read_by(self, filter: Filter | None) -> Filter:
        """The filter that shaders read it by, where this one is asked for, or None for its own.

        Between the patches of a matrix there is nothing to blend.
        """
        if isinstance(self.stored.grid, PatchGrid):
            return "nearest"
        return filter or self.filter

    def load(self) -> Table:
        """The stored values. Raises BakeError."""
        grid = self.stored.grid
        values = self.stored.decoded(unpack(grid, self.bundle.load(self.part)))
        return Table(grid, values, self.stored.log, self.filter)

    def load_sampler(self) -> Sampler:
        """The stored sampler. Raises BakeError where a number would lead out of its tables."""
        return checked_sampler(self.layout, self.bundle.load(self.sampler), self.bundle.image_path(self.sampler))
