"""What a report varies about a table: basis, parameterisation and resolution, of three axes or four."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ..images.storage import Storage
from ..source import Array, BrdfSource
from ..tables.accuracy import direction_pairs
from ..tables.atlas import MOST_TEXELS, AtlasLayout
from ..tables.bspline_fit import fit_coefficients
from ..tables.grids.anisotropic_grids import AnisotropicHalfGrid, AnisotropicNormalGrid
from ..tables.grids.grid import Grid
from ..tables.grids.half_vector_grid import HalfVectorGrid
from ..tables.grids.normal_vector_grid import NormalVectorGrid
from ..tables.search import anisotropic_search, isotropic_search
from ..tables.search.grid_search import choose_grid
from ..tables.stored_table import store_table
from ..tables.table import Filter, Table, tabulate
from ..tables.treated_source import TreatedSource

Kind = tuple[str, str]
# (wi, wo) to the BRDF, each (P, 3).
Lookup = Callable[[Array, Array], Array]

KINDS: tuple[Kind, ...] = (
    ("normal", "identity"),
    ("normal", "uniform"),
    ("normal", "bezier"),
    ("normal", "fitted"),
    ("half", "identity"),
    ("half", "uniform"),
    ("half", "squared"),
    ("half", "bezier"),
    ("half", "fitted"),
)
ANISOTROPIC_KINDS: tuple[Kind, ...] = (
    ("normal", "identity"),
    ("normal", "uniform"),
    ("normal", "bezier"),
    ("normal", "fitted"),
    ("half", "slopes"),
)
# The shapes of a grid are chosen at one resolution: they hardly change with it, and a choice takes seconds.
CHOSEN_AT = 48
_PAIRS, _TURNED_PAIRS = 16384, 8192


class Tabulation:
    """A treated source and the tables that can be made of it; "bspline" with fitted coefficients.

    kinds : (basis, parameterisation), those that "auto" chooses from in `auto`
    pairs, truth : directions that no table holds, and the source's values there
    """

    def __init__(self, source: BrdfSource) -> None:
        self._source = TreatedSource(source)
        self.kinds = KINDS if source.isotropic else ANISOTROPIC_KINDS
        chosen_from = isotropic_search.AUTO if source.isotropic else anisotropic_search.AUTO
        self.auto = tuple(kind for kind in self.kinds if kind[1] in chosen_from[kind[0]])
        count = _PAIRS if source.isotropic else _TURNED_PAIRS
        self.pairs = direction_pairs(count, turned=not source.isotropic)
        self.truth = self._source.evaluate(self.pairs.wi, self.pairs.wo)

    def chosen(self, kind: Kind) -> tuple[Grid, float]:
        """The grid whose shapes suit the source best, and its cosine-weighted RMS."""
        basis, spacing = kind
        named: Any = "auto" if spacing == "slopes" else spacing
        best = min(choose_grid(self._source, CHOSEN_AT, (basis,), named).candidates, key=lambda c: c.rms)
        return best.grid, best.rms

    def texels(self, grid: Grid) -> int:
        """Number of texels of the texture, gutters included; 0 where it would be too large."""
        count = int(np.prod(AtlasLayout(grid.shape).size))
        return count if count <= MOST_TEXELS else 0

    def values(self, grid: Grid) -> Array:
        """Samples of the source on the grid, (*grid.shape, 3)."""
        return tabulate(self._source, grid).values

    def coefficients(self, grid: Grid, values: Array, filter: Filter) -> Array:
        """Coefficients that a table stores for a filter."""
        return fit_coefficients(grid, values) if filter == "bspline" else values

    def stored(self, grid: Grid, values: Array, filter: Filter, storage: Storage) -> Lookup:
        """The table of what comes back from a storage."""
        return store_table(Table(grid, values, filter=filter), storage, self.pairs, self.truth).table.evaluate


def resized(grid: Grid, n: int) -> Grid:
    """The same shapes as a grid's of `CHOSEN_AT`, at another resolution."""
    if isinstance(grid, HalfVectorGrid):
        n_d, n_h, n_phi = (max(4, round(size * n / CHOSEN_AT)) for size in grid.sizes)
        return replace(grid, sizes=(n_d, n_h, n_phi))
    if isinstance(grid, AnisotropicHalfGrid):
        return replace(grid, shape=anisotropic_search.half_shape(n, grid.folded))
    if isinstance(grid, AnisotropicNormalGrid):
        return replace(grid, shape=anisotropic_search.normal_shape(n, grid.folded))
    assert isinstance(grid, NormalVectorGrid)
    return replace(grid, n=n)
