"""Choosing a table's basis, parameterisation and shape by the error measured at directions that no table holds.

Candidates have equal bytes. Only the samples round the test directions are evaluated, so that a choice costs seconds
whatever the resolution.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np

from ..parameterization import NARROWEST_END, WIDEST_END, LogWarp, Parameterization
from ..source import Array, BrdfSource
from .accuracy import DirectionPairs, direction_pairs, linear_estimate
from .alpha_search import AlphaSearch, search_alpha, with_alpha
from .atlas import AtlasLayout
from .grid import HORIZON_SHARES, Grid
from .grid_race import Candidate, race
from .half_vector_grid import HalfVectorGrid
from .normal_grid import NormalVectorGrid
from .treated_source import TreatedSource

Basis = Literal["normal", "half"]
BASES: tuple[str, ...] = get_args(Basis)
Measure = Callable[[Grid], float]

_PAIRS = 8192
_ENDS = (WIDEST_END, 0.4, 0.1, 0.03, 0.01, 0.003, 0.001, NARROWEST_END)
_ALPHAS, _FIRST_ALPHAS = (0.0, 0.125, 0.25, 0.5, 0.75, 1.0), (0.5, 0.0, 0.5)
# What has to be gained for a step of the descent: less is chance.
_GAIN = 0.995
# Of "auto". No material is served best by identity, nor by Bezier in the normal-vector basis (`./run bench bases`).
AUTO = {"normal": ("uniform", "fitted"), "half": ("uniform", "squared", "fitted", "bezier")}
# A Bezier warp is fitted by "auto" where it starts with at most this multiple of the least error: its steepest end
# falls short of a glossy peak by factors, while on matte materials it is now and then the best by a few per cent.
_HOPEFUL = 3.0
# Sizes of (theta_h, phi_d) as multiples of N; theta_d has what is left. Where phi_d ends at pi it needs more.
_SPLITS = {True: ((2.0, 0.5), (4.0, 0.5), (4.0, 0.25)), False: ((2.0, 0.5), (2.0, 1.0), (4.0, 0.25), (4.0, 0.5))}
# Antisymmetric part below this share of the signal is rounding.
_RECIPROCAL = 1e-6


@dataclass(frozen=True)
class GridChoice:
    """Every candidate, the Bezier trials where there were any, and how far the source is from reciprocity.

    reciprocity_error : RMS of half the difference between f(wi, wo) and f(wo, wi), as a share of the signal's
    """

    candidates: tuple[Candidate, ...]
    search: AlphaSearch | None
    reciprocity_error: float

    @property
    def grid(self) -> Grid:
        """The candidate of least error."""
        return min(self.candidates, key=lambda c: c.rms).grid

    def facts(self) -> dict[str, Any]:
        """JSON-ready account of all candidates, best first."""
        ranked = sorted(self.candidates, key=lambda c: c.rms)
        return {
            "reciprocity_error": self.reciprocity_error,
            "candidates": [
                {"shape": list(c.grid.shape), "rms": c.rms, **c.grid.facts(), "entries": int(np.prod(c.grid.shape))}
                for c in ranked
            ],
        }


def choose_grid(
    source: BrdfSource | TreatedSource,
    n: int,
    bases: Sequence[str] = BASES,
    parameterization: Parameterization | Literal["auto"] = "auto",
    alpha: Literal["error", "intensity"] | tuple[float, float] = "error",
    progress: Callable[[float], None] | None = None,
) -> GridChoice:
    """Measure the candidates for a table as large as N x N x 2N.

    Parameters
    ----------
    bases : to choose from
    parameterization : of the table; "auto" to choose by error
    alpha : for "bezier" in the normal-vector basis: the metric that chooses it, or (alpha_theta, alpha_phi)
    progress : called with the share done
    """
    pairs = direction_pairs(_PAIRS, offset=0.25)
    truth, swapped = source.evaluate(pairs.wi, pairs.wo), source.evaluate(pairs.wo, pairs.wi)
    asymmetry = pairs.rms(truth - swapped) / 2
    chooser = _Chooser(source, n, pairs, truth, asymmetry)
    wanted = [(b, k) for b in bases for k in (AUTO[b] if parameterization == "auto" else (parameterization,))]
    for done, (basis, kind) in enumerate(wanted):
        if progress:
            progress(done / len(wanted))
        chooser.add_normal(kind, alpha) if basis == "normal" else chooser.add_half(kind, parameterization == "auto")
    found = race(source, chooser.found)
    return GridChoice(found, chooser.search, asymmetry / max(pairs.rms(truth), 1e-30))


def refit_grid(source: BrdfSource | TreatedSource, grid: Grid, n: int) -> Grid:
    """The grid fitted anew to a source without reciprocity that is left of the grid's own."""
    pairs = direction_pairs(_PAIRS // 3, offset=0.25)
    truth = source.evaluate(pairs.wi, pairs.wo)

    def measure(grid: Grid) -> float:
        return pairs.rms(linear_estimate(source, grid, pairs) - truth)

    if isinstance(grid, HalfVectorGrid):
        splits = [replace(grid, sizes=sizes, reciprocal=False) for sizes in half_sizes(n, False)]
        grid = min(splits, key=measure)
    fitted = isinstance(grid, HalfVectorGrid) or grid.parameterization == "fitted"
    fit = _FITS.get(grid.parameterization) if fitted else None
    return fit(grid, measure) if fit else grid


class _Chooser:
    """The candidates measured so far."""

    def __init__(
        self, source: BrdfSource | TreatedSource, n: int, pairs: DirectionPairs, truth: Array, asymmetry: float
    ) -> None:
        self.source, self.n, self.asymmetry = source, n, asymmetry
        self.pairs, self.truth = pairs, truth
        # A third of the directions leads the descent, which takes a hundred steps.
        few = slice(len(truth) // 3)
        self.leading = DirectionPairs(pairs.wi[few], pairs.wo[few], pairs.weight[few]), truth[few]
        self.found: list[Grid] = []
        self.least: dict[Grid, float] = {}
        self.search: AlphaSearch | None = None

    def quick(self, grid: Grid) -> float:
        pairs, truth = self.leading
        return pairs.rms(linear_estimate(self.source, grid, pairs) - truth)

    def found_least(self) -> float:
        """The least RMS of what was found."""
        self.least |= {grid: self.quick(grid) for grid in self.found if grid not in self.least}
        return min(self.least.values(), default=np.inf)

    def add_normal(self, kind: Any, alpha: Any) -> None:
        grid: Any = NormalVectorGrid(self.n, kind)
        if kind == "bezier" and isinstance(alpha, str):
            self.search = search_alpha(self.source, self.n, self.pairs, self.truth)
            grid = with_alpha(grid, self.search.by_error if alpha == "error" else self.search.by_intensity)
        elif kind == "bezier":
            grid = replace(grid, alpha_theta=float(alpha[0]), alpha_phi=float(alpha[1]))
        elif kind == "fitted":
            grid = fit_warps(grid, self.quick)
        self.found.append(grid)

    def add_half(self, kind: Any, if_hopeful: bool) -> None:
        """With phi_d to pi / 2, to pi, or both where neither is sure to be worse."""
        exact = self.asymmetry <= _RECIPROCAL * self.pairs.rms(self.truth)
        if not exact:
            self._add_half(kind, False, if_hopeful)
        # A reciprocal table misses at least the antisymmetric part of the source.
        if exact or self.asymmetry < self.found_least():
            self._add_half(kind, True, if_hopeful)

    def _add_half(self, kind: Any, reciprocal: bool, if_hopeful: bool) -> None:
        grids = [
            HalfVectorGrid(sizes, kind, warps=(LogWarp(), LogWarp(0.003), LogWarp()), reciprocal=reciprocal)
            for sizes in half_sizes(self.n, reciprocal)
        ]
        if kind == "bezier":
            grids = [replace(grid, alphas=_FIRST_ALPHAS) for grid in grids]
            if if_hopeful and self.quick(grids[0]) > _HOPEFUL * self.found_least():
                return
        fit = _FITS.get(kind)
        if fit:
            first = fit(grids[0], self.quick)
            assert isinstance(first, HalfVectorGrid)
            grids = [replace(first, sizes=grid.sizes) for grid in grids]
        best = min(grids, key=self.quick)
        self.found.append(fit(best, self.quick) if fit else best)


def half_sizes(n: int, reciprocal: bool) -> list[tuple[int, int, int]]:
    """Sizes (theta_d, theta_h, phi_d) whose atlas has no more texels than that of an N x N x 2N table."""
    room = int(np.prod(AtlasLayout((n, n, 2 * n)).size))
    sizes = []
    for rows, columns in _SPLITS[reciprocal]:
        n_h, n_phi = (max(round(n * share), 4) for share in (rows, columns))
        n_d = 2 * n * n * n // (n_h * n_phi)
        while n_d > 4 and np.prod(AtlasLayout((n_d, n_h, n_phi)).size) > room:
            n_d -= 1
        sizes.append((max(n_d, 4), n_h, n_phi))
    return sizes


def fit_warps(grid: Any, measure: Measure, rounds: int = 1) -> Any:
    """The grid with the fitted warps of least error, one end of one axis after the other."""

    def with_ends(ends: tuple[float, ...]) -> Grid:
        warps: Any = tuple(LogWarp(*ends[k : k + 2]) for k in range(0, len(ends), 2))
        return replace(grid, warps=warps)

    start = tuple(end for warp in grid.warps for end in (warp.near, warp.far))
    return with_ends(_descend(lambda ends: measure(with_ends(ends)), start, _ENDS, rounds))


def _fit_alphas(grid: Grid, measure: Measure) -> Grid:
    assert isinstance(grid, HalfVectorGrid)

    def with_alphas(alphas: Any) -> Grid:
        return replace(grid, alphas=alphas)

    return with_alphas(_descend(lambda a: measure(with_alphas(a)), grid.alphas, _ALPHAS, 1))


_FITS: dict[str, Callable[[Grid, Measure], Grid]] = {"fitted": fit_warps, "bezier": _fit_alphas}


def _descend(
    measure: Callable[[tuple[float, ...]], float], start: tuple[float, ...], choices: Sequence[float], rounds: int
) -> tuple[float, ...]:
    """Coordinate descent over a few choices for every number."""
    best = (measure(start), start)
    for _ in range(rounds):
        before = best
        for place in range(len(start)):
            base = best[1]
            for choice in choices:
                if choice != base[place]:
                    trial = (*base[:place], choice, *base[place + 1 :])
                    rms = measure(trial)
                    best = (rms, trial) if rms < _GAIN * best[0] else best
        if best == before:
            break
    return best[1]


def best_horizon(source: BrdfSource | TreatedSource, grid: Grid, pairs: DirectionPairs, truth: Array) -> Grid:
    """The grid whose sample at the horizon is taken where it serves this material better."""
    grids = [replace(grid, horizon_share=share) for share in HORIZON_SHARES]
    return min(grids, key=lambda g: pairs.rms(linear_estimate(source, g, pairs) - truth))
