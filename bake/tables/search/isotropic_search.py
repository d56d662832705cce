"""Candidates for an isotropic table of given bytes: basis, parameterisation, sizes and shapes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...source import BrdfSource
from ..atlas import AtlasLayout
from ..grids.grid import Grid
from ..grids.half_vector_grid import COSINE_POWERS, HalfVectorGrid
from ..grids.normal_vector_grid import NormalVectorGrid
from ..grids.parameterization import LogWarp
from .alpha_search import AlphaSearch, search_alpha, with_alpha
from .grid_fit import GridErrors, Measure, descend, fit_warps

_PAIRS = 8192
_ALPHAS, _FIRST_ALPHAS = (0.0, 0.125, 0.25, 0.5, 0.75, 1.0), (0.5, 0.0, 0.5)
# Of "auto". No material is served best by identity, nor by Bezier in the normal-vector basis (`./run bench bases`).
AUTO = {"normal": ("uniform", "fitted"), "half": ("uniform", "squared", "fitted", "bezier")}
# A Bezier warp is fitted by "auto" where it starts with at most this multiple of the least error: its steepest end
# falls short of a glossy peak by factors, while on matte materials it is now and then the best by a few per cent.
_HOPEFUL = 3.0
# Sizes of (theta_h, phi_d) as multiples of N; theta_d has what is left. Where phi_d ends at pi it needs more.
_SPLITS = {True: ((2.0, 0.5), (4.0, 0.5), (4.0, 0.25)), False: ((2.0, 0.5), (2.0, 1.0), (4.0, 0.25), (4.0, 0.5))}
# Antisymmetric part below this share of the signal is rounding.
_RECIPROCAL = 1e-6


Splits = Sequence[tuple[float, float]]


class IsotropicCandidates:
    """Grids fitted to an isotropic source; what `grid_search` ranks.

    Attributes
    ----------
    found : the grids
    search : the Bezier trials, if there were any
    asymmetry : RMS of half the difference between f(wi, wo) and f(wo, wi)
    """

    kinds = AUTO

    @staticmethod
    def named(basis: str, parameterization: str) -> tuple[str, ...]:
        """The spacings of a basis under one name: every basis has all."""
        return (parameterization,)

    def __init__(self, source: BrdfSource, n: int, alpha: str | tuple[float, float]) -> None:
        self.source, self.n, self.alpha = source, n, alpha
        self.errors = GridErrors.at(source, _PAIRS, 0.25)
        pairs, truth = self.errors.pairs, self.errors.truth
        self.asymmetry = pairs.rms(truth - source.evaluate(pairs.wo, pairs.wi)) / 2
        # A third of the directions leads the descent, which takes a hundred steps.
        self.quick = GridErrors(source, pairs.first(len(truth) // 3), truth[: len(truth) // 3])
        self.found: list[Grid] = []
        self.search: AlphaSearch | None = None

    def asymmetries(self) -> dict[str, float]:
        """As a share of the signal, JSON-ready."""
        return {"reciprocity_error": self.asymmetry / max(self.errors.pairs.rms(self.errors.truth), 1e-30)}

    def add(self, basis: str, kind: Any, if_hopeful: bool) -> None:
        """Find the best grid of a basis and parameterisation, or leave it out where `if_hopeful` and there is none."""
        if basis == "half":
            self._add_half(kind, if_hopeful)
            return
        grid = NormalVectorGrid(self.n, kind)
        if kind == "bezier" and isinstance(self.alpha, str):
            self.search = search_alpha(self.source, self.n, self.errors.pairs, self.errors.truth)
            best = self.search.by_error if self.alpha == "error" else self.search.by_intensity
            grid = with_alpha(grid, best)
        elif kind == "bezier":
            grid = replace(grid, alpha_theta=float(self.alpha[0]), alpha_phi=float(self.alpha[1]))
        elif kind == "fitted":
            grid = fit_warps(grid, self.quick)
        self.found.append(grid)

    def _add_half(self, kind: Any, if_hopeful: bool) -> None:
        """With phi_d to pi / 2, to pi, or both where neither is sure to be worse."""
        exact = self.asymmetry <= _RECIPROCAL * self.errors.pairs.rms(self.errors.truth)
        if not exact:
            self._add_sizes(kind, False, if_hopeful)
        # A reciprocal table misses at least the antisymmetric part of the source.
        if exact or self.asymmetry < self._least():
            self._add_sizes(kind, True, if_hopeful)

    def _least(self) -> float:
        """The least RMS of what was found."""
        return min(map(self.quick, self.found), default=np.inf)

    def _add_sizes(self, kind: Any, reciprocal: bool, if_hopeful: bool) -> None:
        grids = [
            HalfVectorGrid(sizes, kind, warps=(LogWarp(), LogWarp(0.003), LogWarp()), reciprocal=reciprocal)
            for sizes in half_sizes(self.n, reciprocal)
        ]
        if kind == "bezier":
            grids = [replace(grid, alphas=_FIRST_ALPHAS) for grid in grids]
            if if_hopeful and self.quick(grids[0]) > _HOPEFUL * self._least():
                return
        fit = _FITS.get(kind)
        if fit:
            first = fit(grids[0], self.quick)
            grids = [replace(first, sizes=grid.sizes) for grid in grids]
        best = min(grids, key=self.quick)
        self.found.append(fit(best, self.quick) if fit else best)


def refit_grid(source: BrdfSource, grid: Grid, n: int) -> Grid:
    """The grid fitted anew to a source without reciprocity that is left of the grid's own."""
    errors = GridErrors.at(source, _PAIRS // 3, 0.25)
    if isinstance(grid, HalfVectorGrid):
        splits = [replace(grid, sizes=sizes, reciprocal=False) for sizes in half_sizes(n, False)]
        grid = min(splits, key=errors)
    fitted = isinstance(grid, HalfVectorGrid) or grid.parameterization == "fitted"
    fit = _FITS.get(grid.parameterization) if fitted else None
    return fit(grid, errors) if fit else grid


def with_cosine_powers(grid: Any) -> list[Any]:
    """An isotropic grid, of half vectors with each power of the cosine that values are stored times.

    At grazing a BRDF grows as 1 / (cos theta_i + cos theta_o) or faster. Stored times that sum it has there neither a
    peak that codes have to reach nor a bend between samples.
    """
    if not isinstance(grid, HalfVectorGrid):
        return [grid]
    return [replace(grid, cosine_power=power) for power in COSINE_POWERS]


def half_sizes(n: int, reciprocal: bool, further: Splits = ()) -> list[tuple[int, int, int]]:
    """Sizes (theta_d, theta_h, phi_d) whose atlas has no more texels than that of an N x N x 2N table.

    `further` are splits to try beside the usual ones: sizes of theta_h and phi_d as multiples of N.
    """
    room = int(np.prod(AtlasLayout((n, n, 2 * n)).size))
    sizes = []
    for rows, columns in (*_SPLITS[reciprocal], *further):
        n_h, n_phi = (max(round(n * share), 4) for share in (rows, columns))
        n_d = 2 * n * n * n // (n_h * n_phi)
        while n_d > 4 and np.prod(AtlasLayout((n_d, n_h, n_phi)).size) > room:
            n_d -= 1
        sizes.append((max(n_d, 4), n_h, n_phi))
    return sizes


def _fit_alphas(grid: HalfVectorGrid, measure: Measure) -> HalfVectorGrid:
    def with_alphas(alphas: Any) -> HalfVectorGrid:
        return replace(grid, alphas=alphas)

    return with_alphas(descend(lambda a: measure(with_alphas(a)), grid.alphas, _ALPHAS, 1))


_FITS: dict[str, Callable[[Any, Measure], Any]] = {"fitted": fit_warps, "bezier": _fit_alphas}
