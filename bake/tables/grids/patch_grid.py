"""Where the samples of a table lie that holds a matrix over patches of the hemisphere as it is: one in each pair.

A matrix is constant within its patches, and what goes straight on through a woven shade fills one patch of each column.
Grids that interpolate meet such steps slowly: a woven shade's error falls with the root of their samples, from 0.74 of
the signal at 24 samples to 0.40 at 160 (`./run bench behind`). The matrix itself is smaller than either.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ...patches import KLEMS, PatchBasis
from ...source import Array, Facts
from .grid import Boundary


@dataclass(frozen=True)
class PatchGrid:
    """Axes [one, the viewer's patch, row, column]: rows and columns are the light's patches, in reading order.

    Parameters
    ----------
    parameterization : name of the patches in `bake.patches.KLEMS`, of the light and the viewer
    """

    parameterization: str
    basis: ClassVar[str] = "patches"
    boundaries: ClassVar[tuple[Boundary, ...]] = ("around", "pole", "held", "held")
    axis_shapes: ClassVar[tuple[Any, ...]] = ()
    horizon_share: ClassVar[float] = 1.0

    @property
    def patches(self) -> PatchBasis:
        """Of the light and of the viewer."""
        return KLEMS[self.parameterization]

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Nearly square slices, of which the last places are not used."""
        count = self.patches.count
        columns = math.ceil(math.sqrt(count))
        return 1, count, math.ceil(count / columns), columns

    def coordinates(self, xp: Any, wi: Any, wo: Any) -> tuple[Any, Any, Any, Any]:
        """Indices along each axis, whole ones: whatever the filter, it finds one sample."""
        columns = self.shape[3]
        light, viewer = self.patches.index(xp, wi), self.patches.index(xp, wo)
        row = xp.floor((light + 0.5) * (1 / columns))
        return viewer * 0.0, viewer, row, light - row * columns

    def directions(self, *index: Array) -> tuple[Array, Array]:
        """(wi, wo), each (..., 3), at whole indices that broadcast: the middle of their patches."""
        _, viewer, row, column = np.broadcast_arrays(*index)
        centres = self.patches.centres()
        light = np.minimum(row * self.shape[3] + column, len(centres) - 1)
        return centres[light], centres[viewer]

    def factor(self, xp: Any, wi: Any, wo: Any) -> float:
        """The BRDF itself is stored."""
        return 1.0

    def sample_factor(self, wi: Array, wo: Array, *index: Array) -> float:
        """No sample stands for a pair below the horizon."""
        return 1.0

    def settle_poles(self, values: Array) -> None:
        """The patch about the normal is one."""

    def beyond_pole(self, before: Array, axis: int) -> Array:
        """Nothing is read beyond a patch."""
        return before

    def facts(self) -> Facts:
        """JSON-ready description."""
        return {"basis": self.basis, "parameterization": self.parameterization, "shape": list(self.shape)}

    def shader_constants(self) -> Mapping[str, Any]:
        """The name tells the shader where the bounds of the patches are."""
        sizes = dict(zip(("Azimuths", "Slices", "SliceRows", "SliceColumns"), self.shape, strict=True))
        return {"Basis": self.basis, "Parameterization": self.parameterization, "Reciprocal": 0, "Folded": 0, **sizes}
