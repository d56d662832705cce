"""What a report varies about a table: basis, parameterisation and resolution, of three axes or four."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Protocol, cast

import numpy as np

from ..accuracy import DirectionPairs, direction_pairs
from ..anisotropic import choice as four_axes
from ..anisotropic import table as anisotropic_table
from ..anisotropic.accuracy import turned_pairs
from ..anisotropic.atlas import MOST_TEXELS
from ..anisotropic.atlas import SliceLayout as AnisotropicLayout
from ..anisotropic.grid import Grid as AnisotropicGrid
from ..anisotropic.grid import HalfGrid as AnisotropicHalfGrid
from ..atlas import AtlasLayout
from ..bspline_fit import fit_coefficients
from ..grid_search import AUTO, choose_grid
from ..half_grid import HalfGrid
from ..source import Array, BrdfSource
from ..storage import Storage
from ..table import BrdfTable, Filter, Grid, TreatedSource, pad_slices, tabulate
from ..table_storage import store_table

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

    def coefficients(self, values: Array, filter: Filter) -> Array:
        """What is stored of the samples for a filter."""
        ...

    def stored(self, grid: Any, values: Array, filter: Filter, storage: Storage) -> Lookup:
        """The table of what comes back from a storage."""
        ...


class Isotropic:
    """Tables of three axes; "bspline" with fitted coefficients."""

    kinds = KINDS
    auto = tuple(kind for kind in KINDS if kind[1] in AUTO[kind[0]])

    def __init__(self, source: BrdfSource) -> None:
        self._source = TreatedSource(source)
        self.pairs = direction_pairs(_PAIRS)
        self.truth = self._source.evaluate(self.pairs.wi, self.pairs.wo)

    def chosen(self, kind: Kind) -> tuple[Grid, float]:
        found = choose_grid(self._source, CHOSEN_AT, (kind[0],), cast(Any, kind[1]))
        best = min(found.candidates, key=lambda c: c.rms)
        return best.grid, best.rms

    def resized(self, grid: Grid, n: int) -> Grid:
        return resized(grid, n)

    def texels(self, grid: Grid) -> int:
        return int(np.prod(AtlasLayout(grid.shape).size))

    def values(self, grid: Grid) -> Array:
        return tabulate(self._source, grid).values

    def coefficients(self, values: Array, filter: Filter) -> Array:
        return fit_coefficients(values) if filter == "bspline" else values

    def stored(self, grid: Grid, values: Array, filter: Filter, storage: Storage) -> Lookup:
        made = BrdfTable(grid, values)
        table = store_table(made, pad_slices(values), storage, filter, self.pairs, self.truth).table
        return lambda wi, wo: table.evaluate(wi, wo, filter)


class Anisotropic:
    """Tables of four axes; "bspline" takes the samples as they are, as a bake does."""

    kinds = ANISOTROPIC_KINDS
    auto = (*(("normal", spacing) for spacing in four_axes.AUTO), ("half", "slopes"))

    def __init__(self, source: BrdfSource) -> None:
        self._source = anisotropic_table.TreatedAnisotropic(source)
        self.pairs = turned_pairs(_TURNED_PAIRS)
        self.truth = self._source.evaluate(self.pairs.wi, self.pairs.wo)
        self._symmetry = four_axes.measured_symmetry(self._source, self.pairs, self.truth)

    def chosen(self, kind: Kind) -> tuple[AnisotropicGrid, float]:
        basis, spacing = kind
        named = "auto" if basis == "half" else spacing
        grid, account = four_axes.choose_grid(self._source, CHOSEN_AT, self._symmetry, basis, parameterization=named)
        (best,) = account["best"].values()
        return grid, float(best["rms"])

    def resized(self, grid: AnisotropicGrid, n: int) -> AnisotropicGrid:
        return anisotropic_resized(grid, n)

    def texels(self, grid: AnisotropicGrid) -> int:
        count = int(np.prod(AnisotropicLayout(grid.shape).size))
        return count if count <= MOST_TEXELS else 0

    def values(self, grid: AnisotropicGrid) -> Array:
        return anisotropic_table.tabulate(self._source, grid).values

    def coefficients(self, values: Array, filter: Filter) -> Array:
        return values

    def stored(self, grid: AnisotropicGrid, values: Array, filter: Filter, storage: Storage) -> Lookup:
        made = anisotropic_table.AnisotropicTable(grid, values, filter)
        padded = anisotropic_table.pad_slices(grid, values)
        return store_table(made, padded, storage, filter, self.pairs, self.truth).table.evaluate


def tabulation(source: BrdfSource) -> Tabulation:
    """Of an isotropic or an anisotropic source."""
    return Isotropic(source) if source.isotropic else Anisotropic(source)


def resized(grid: Grid, n: int) -> Grid:
    """A grid of `CHOSEN_AT` at another resolution."""
    if isinstance(grid, HalfGrid):
        n_d, n_h, n_phi = (max(4, round(size * n / CHOSEN_AT)) for size in grid.sizes)
        return replace(grid, sizes=(n_d, n_h, n_phi))
    return replace(grid, n=n)


def anisotropic_resized(grid: AnisotropicGrid, n: int) -> AnisotropicGrid:
    """The same of four axes."""
    if isinstance(grid, AnisotropicHalfGrid):
        return replace(grid, shape=four_axes.half_shape(n, grid.folded))
    return replace(grid, shape=four_axes.normal_shape(n, grid.folded))
