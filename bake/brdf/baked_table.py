"""A table in a bundle with the alias tables that draw its directions: what lookups and samplers are built of."""

from __future__ import annotations

from dataclasses import dataclass

from ..bundle.bundle import Bundle
from ..errors import BakeError
from ..sampling.cell_sampler import CellSampler
from ..sampling.half_vector_cells import SamplerLayout
from ..sampling.slope_cells import SlopeLayout
from ..tables.atlas import unpack
from ..tables.table import Filter, Table
from .parts import StoredTableRecord

Layout = SamplerLayout | SlopeLayout
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
    layout : sizes of its alias tables
    filter : that it was baked for
    """

    bundle: Bundle
    part: str
    stored: StoredTableRecord
    layout: Layout
    filter: Filter

    @property
    def sampler(self) -> str:
        """Name of the image of its alias tables."""
        return SAMPLERS[self.part]

    def load(self) -> Table:
        """The stored values. Raises BakeError."""
        grid = self.stored.grid
        values = self.stored.decoded(unpack(grid, self.bundle.load(self.part)))
        return Table(grid, values, self.stored.log, self.filter)

    def load_sampler(self) -> CellSampler:
        """The stored alias tables. Raises BakeError where a number would lead out of them."""
        texels = self.bundle.load(self.sampler)
        if texels.shape[2] != 4 or (texels < 0).any() or (texels[..., 1] >= self.layout.cells).any():
            raise BakeError(self.bundle.image_path(self.sampler), "is no alias table", "bake it again")
        return CellSampler(self.layout, texels)
