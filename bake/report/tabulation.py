"""What a report varies about a table: basis, parameterisation and resolution, of three axes or four."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Protocol, cast

import numpy as np

from ..source import Array, BrdfSource
from ..storage import Storage
from ..tables import anisotropic_search as four_axes
from ..tables.accuracy import DirectionPairs, direction_pairs
from ..tables.anisotropic_grids import AnisotropicHalfGrid, AnisotropicNormalGrid
from ..tables.atlas import MOST_TEXELS, AtlasLayout
from ..tables.bspline_fit import fit_coefficients
from ..tables.grid import Grid
from ..tables.grid_search import AUTO, choose_grid
from ..tables.half_vector_grid import HalfVectorGrid
from ..tables.normal_grid import NormalVectorGrid
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


class Tabulation(Protocol):
    """A source and the tables that can be made of it; grids are of its own kind.

    kinds : (basis, parameterisation), those that "auto" chooses from in `auto`
    pairs, truth : directions that no table holds, and the source's values there
    """

    kinds: tuple[Kind, ...]
    auto: tuple[Kind, ...]
    pairs: DirectionPairs
    truth: Array

    def chosen(self, kind: Kind) -> tuple[Any, float]:
        """The grid whose shapes suit the source best, and its cosine-weighted RMS."""
        ...

    def resized(self, grid: Any, n: int) -> Any:
        """The same shapes at another resolution."""
        ...

    def texels(self, grid: Any) -> int:
        """Of the texture, gutters included; 0 where it would be too large."""
        ...

    def values(self, grid: Any) -> Array:
        """The samples."""
        ...

    def coefficients(self, grid: Any, values: Array, filter: Filter) -> Array:
        """What is stored of the samples for a filter."""
        ...

    def stored(self, grid: Any, values: Array, filter: Filter, storage: Storage) -> Lookup:
        """The table of what comes back from a storage."""
        ...


class _Tabulated:
    """A treated source and its tables; "bspline" with fitted coefficients."""

    def __init__(self, source: BrdfSource, pairs: DirectionPairs) -> None:
        self._source, self.pairs = TreatedSource(source), pairs
        self.truth = self._source.evaluate(pairs.wi, pairs.wo)

    def texels(self, grid: Grid) -> int:
        count = int(np.prod(AtlasLayout(grid.shape).size))
        return count if count <= MOST_TEXELS else 0

    def values(self, grid: Grid) -> Array:
        return tabulate(self._source, grid).values

    def coefficients(self, grid: Grid, values: Array, filter: Filter) -> Array:
        return fit_coefficients(grid, values) if filter == "bspline" else values

    def stored(self, grid: Grid, values: Array, filter: Filter, storage: Storage) -> Lookup:
        return store_table(Table(grid, values, filter=filter), storage, self.pairs, self.truth).table.evaluate


class Isotropic(_Tabulated):
    """Tables of three axes."""

    kinds = KINDS
    auto = tuple(kind for kind in KINDS if kind[1] in AUTO[kind[0]])

    def __init__(self, source: BrdfSource) -> None:
        super().__init__(source, direction_pairs(_PAIRS))

    def chosen(self, kind: Kind) -> tuple[Grid, float]:
        found = choose_grid(self._source, CHOSEN_AT, (kind[0],), cast(Any, kind[1]))
        best = min(found.candidates, key=lambda c: c.rms)
        return best.grid, best.rms

    def resized(self, grid: Grid, n: int) -> Grid:
        return resized(grid, n)


class Anisotropic(_Tabulated):
    """Tables of four axes; "bspline" takes the samples as they are, as a bake does."""

    kinds = ANISOTROPIC_KINDS
    auto = (*(("normal", spacing) for spacing in four_axes.AUTO), ("half", "slopes"))

    def __init__(self, source: BrdfSource) -> None:
        super().__init__(source, direction_pairs(_TURNED_PAIRS, turned=True))
        self._symmetry = four_axes.measured_symmetry(self._source, self.pairs, self.truth)

    def chosen(self, kind: Kind) -> tuple[Grid, float]:
        basis, spacing = kind
        named = "auto" if basis == "half" else spacing
        grid, account = four_axes.choose_grid(self._source, CHOSEN_AT, self._symmetry, basis, parameterization=named)
        (best,) = account["best"].values()
        return grid, float(best["rms"])

    def resized(self, grid: Grid, n: int) -> Grid:
        return anisotropic_resized(grid, n)

    def coefficients(self, grid: Grid, values: Array, filter: Filter) -> Array:
        return values


def tabulation(source: BrdfSource) -> Tabulation:
    """Of an isotropic or an anisotropic source."""
    return Isotropic(source) if source.isotropic else Anisotropic(source)


def resized(grid: Grid, n: int) -> Grid:
    """A grid of `CHOSEN_AT` at another resolution."""
    if isinstance(grid, HalfVectorGrid):
        n_d, n_h, n_phi = (max(4, round(size * n / CHOSEN_AT)) for size in grid.sizes)
        return replace(grid, sizes=(n_d, n_h, n_phi))
    assert isinstance(grid, NormalVectorGrid)
    return replace(grid, n=n)


def anisotropic_resized(grid: Grid, n: int) -> Grid:
    """The same of four axes."""
    if isinstance(grid, AnisotropicHalfGrid):
        return replace(grid, shape=four_axes.half_shape(n, grid.folded))
    assert isinstance(grid, AnisotropicNormalGrid)
    return replace(grid, shape=four_axes.normal_shape(n, grid.folded))
