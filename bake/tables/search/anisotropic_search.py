"""Which grid serves an anisotropic source: its symmetries, its basis, and the basis' shape, all by measurement."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...source import Array, BrdfSource
from ..accuracy import DirectionPairs
from ..atlas import AtlasLayout
from ..grids.anisotropic_grids import NORMAL_KINDS, AnisotropicHalfGrid, AnisotropicNormalGrid
from ..grids.grid import HORIZON_SHARES, Grid
from ..grids.patch_grid import PatchGrid
from .alpha_search import AlphaSearch, AlphaTrial
from .grid_fit import GridErrors, Measure, fit_warps
from .horizon_light import HorizonLight

# Relative L1 difference up to which a symmetry is taken as exact, and half of the samples are saved.
SYMMETRIC = 1e-3
_WIDTHS = (0.03, 0.1, 0.3, 1.0)
_RATIOS = (2.0, 1.4)
_NARROWEST, _WIDEST = 2e-3, 8.0
_ALPHAS_THETA, _ALPHAS_PHI = (0.0, 0.25, 0.5, 0.75), (0.05, 0.15, 0.3, 0.5)
_RANKING = 4096
# Samples of phi_d and theta_d, as multiples of those of `half_shape`, in the table and in that of a residual; the
# slopes have what is left of the bytes.
_TABLE_SPLITS = ((1.0, 1.0), (1.0, 2**0.5), (2**0.5, 2**0.5), (2.0, 1.0))
_RESIDUAL_SPLITS = ((1.0, 1.0), (1.0, 2**0.5), (1.0, 2.0), (2**0.5, 2**0.5), (2.0, 1.0), (2.0, 2.0))
# The RMS, as a multiple of the least, up to which the light at grazing decides.
_ALIKE, _RESIDUAL_ALIKE = 1.05, 1.15
# Of "auto".
AUTO = {"half": ("slopes",), "normal": ("bezier", "fitted")}
_INTENSITY_N = 12


@dataclass(frozen=True)
class Symmetry:
    """Relative L1 differences of f(wi, wo) to f(wo, wi), and to f after half a turn about the normal."""

    reciprocity_error: float
    half_turn_error: float

    @property
    def reciprocal(self) -> bool:
        """Whether light and viewer may be exchanged."""
        return self.reciprocity_error <= SYMMETRIC

    @property
    def half_turn(self) -> bool:
        """Whether half a turn of the surface changes nothing, as of all brushed metals and most weaves."""
        return self.half_turn_error <= SYMMETRIC

    def facts(self) -> dict[str, float]:
        """JSON-ready."""
        return {"reciprocity_error": self.reciprocity_error, "half_turn_error": self.half_turn_error}


def measured_symmetry(source: BrdfSource, pairs: DirectionPairs, truth: Array) -> Symmetry:
    """Symmetry of a source with values `truth` (P, 3) at the pairs."""
    turn = np.array([-1.0, -1.0, 1.0])

    def error(value: Array) -> float:
        return pairs.relative_error(value - truth, truth)

    return Symmetry(
        error(source.evaluate(pairs.wo, pairs.wi)), error(source.evaluate(pairs.wi * turn, pairs.wo * turn))
    )


def half_shape(n: int, folded: bool) -> tuple[int, int, int, int]:
    """Samples of the half basis at resolution n: n along each slope, n / 4 in theta_d, and as many in half of phi_d."""
    quarter = max(4, round(n / 4))
    return (1 if folded else 2) * quarter, quarter, n, n


def normal_shape(n: int, folded: bool) -> tuple[int, int, int, int]:
    """Samples [2 N, N, N, 4 N] of the normal basis, phi_o halved where folded, of as many texels as `half_shape`'s.

    phi_delta takes 4 N: 2 N on either side of the viewer, what the isotropic table has for the one side it needs.
    """
    texels = np.prod([float(x) for x in half_shape(n, True)])
    size = max(4, round((texels / (4 if folded else 8)) ** 0.25))
    return (1 if folded else 2) * size, size, size, 4 * size


class AnisotropicCandidates:
    """Grids fitted to an anisotropic source; as `isotropic_search.IsotropicCandidates`."""

    kinds = AUTO

    @staticmethod
    def named(basis: str, parameterization: str) -> tuple[str, ...]:
        """The spacings of a basis under one name: slopes are fitted, and "squared" is a spacing of theta_h."""
        if basis == "half":
            return AUTO["half"] if parameterization == "fitted" else ()
        return (parameterization,) if parameterization in NORMAL_KINDS else ()

    def __init__(self, source: BrdfSource, n: int, alpha: str | tuple[float, float]) -> None:
        self.source, self.n, self.alpha = source, n, alpha
        self.errors = GridErrors.at(source, _RANKING, 0.25)
        self.symmetry = measured_symmetry(source, self.errors.pairs, self.errors.truth)
        self.found: list[Grid] = []
        self.search: AlphaSearch | None = None

    def asymmetries(self) -> dict[str, float]:
        """JSON-ready."""
        return self.symmetry.facts()

    def add(self, basis: str, kind: str, if_hopeful: bool) -> None:
        """Find the best grid of a basis and parameterisation."""
        if basis == "half":
            reciprocal = self.symmetry.reciprocal
            start = AnisotropicHalfGrid(half_shape(self.n, reciprocal), folded=reciprocal)
            self.found.append(_best_half(start, self.errors))
            return
        folded = self.symmetry.half_turn
        grid = AnisotropicNormalGrid(normal_shape(self.n, folded), folded=folded, parameterization=kind)
        if kind == "fitted":
            grid = fit_warps(grid, self.errors)
        elif kind == "bezier":
            grid = self._best_bezier(grid, account=not if_hopeful)
        self.found.append(grid)

    def _best_bezier(self, grid: AnisotropicNormalGrid, account: bool) -> AnisotropicNormalGrid:
        """Of a coarse square of shapes; total intensities cost seconds, and are summed if they choose or are asked."""
        if not isinstance(self.alpha, str):
            return replace(grid, alpha_theta=float(self.alpha[0]), alpha_phi=float(self.alpha[1]))
        shapes = itertools.product(_ALPHAS_THETA, _ALPHAS_PHI)
        trials = [replace(grid, alpha_theta=theta, alpha_phi=phi) for theta, phi in shapes]
        if not account:
            return min(trials, key=self.errors)
        self.search = AlphaSearch(
            tuple(
                AlphaTrial(g.alpha_theta, g.alpha_phi, total_intensity(self.source, g), self.errors(g)) for g in trials
            )
        )
        best = self.search.by_error if self.alpha == "error" else self.search.by_intensity
        return replace(grid, alpha_theta=best.alpha_theta, alpha_phi=best.alpha_phi)


def total_intensity(source: BrdfSource, grid: AnisotropicNormalGrid, most: int = _INTENSITY_N) -> float:
    """Sum of the table's samples (Mallett & Yuksel 2016, section 4.2), or of a smaller one of like proportions."""
    n_a, n_b, n_r, n_c = grid.shape
    share = min(1.0, most / n_b)
    azimuth, columns = (max(4, 2 * round(n * share / 2)) for n in (n_a, n_c))
    small = replace(grid, shape=(azimuth, max(4, round(n_b * share)), max(4, round(n_r * share)), columns))
    values = source.evaluate(*small.directions(*np.meshgrid(*map(np.arange, small.shape), indexing="ij")))
    return float(values.sum(dtype=np.float64))


def best_half_shape(source: BrdfSource, grid: AnisotropicHalfGrid, errors: Measure) -> AnisotropicHalfGrid:
    """The grid, or one of no more bytes and of another shape, and how it goes on beyond the horizon.

    The RMS, weighted by cosines, hardly sees what is lost at grazing, and the shape of least RMS is not that of least
    loss: Ashikhmin & Shirley (2000) with exponents 10 and 100 lost 3.0 % at 88 degrees across the wide direction in
    the usual shape, 1.7 % with 1.4 times the azimuths and theta_d at 0.76 times the RMS; GGX of alpha 0.1 and 0.4 loses
    least in the usual one. So the light seen at grazing decides (`HorizonLight`), among shapes whose RMS is within
    5 % of the usual one's.
    """
    light = HorizonLight(source)
    horizons = [replace(grid, horizon_share=share) for share in HORIZON_SHARES]
    usual = min((replace(g, falling=falls) for g in horizons for falls in (True, False)), key=light)
    most = _ALIKE * errors(usual)
    return min((shape for shape in _half_shapes(usual, _TABLE_SPLITS) if errors(shape) <= most), key=light)


def refit_grid(
    source: BrdfSource, grid: Grid, whole: BrdfSource, progress: Callable[[float], None] | None = None
) -> Grid:
    """The grid for what an envelope leaves of a source, of the table's grid's bytes: shape, symmetry and horizon anew.

    The envelope's weights follow the viewer alone, so what it leaves has no reciprocity, and a table that takes light
    and viewer for exchangeable is off by half of the difference: on four formulas at 32 samples that was a third of the
    error, and 15 % of all light seen at grazing. More samples in theta_d and fewer of the slopes pay too (RMS 0.8 to
    0.2 of that of the table's own grid), other widths do not: a fit of five seconds gained 0.4 %. Among those that are
    nearly as good the light at grazing decides, as a share of all that the `whole` source reflects there.
    """
    if isinstance(grid, PatchGrid):
        return grid
    errors = GridErrors.at(source, _RANKING, 0.25)
    trials = _residual_shapes(grid) if isinstance(grid, AnisotropicHalfGrid) else [grid]
    rms: dict[Grid, float] = {}
    for trial in trials:
        rms[trial] = errors(trial)
        if progress:
            progress(len(rms) / (len(trials) + 1))
    best = min(rms, key=rms.__getitem__)
    horizons = [replace(best, horizon_share=share) for share in HORIZON_SHARES]
    if not isinstance(best, AnisotropicHalfGrid):
        return min((*horizons, grid), key=errors)
    horizons = [replace(horizon, falling=falling) for horizon in horizons for falling in (True, False)]
    rms.update((trial, errors(trial)) for trial in (*horizons, grid))
    most = _RESIDUAL_ALIKE * min(rms.values())
    return min((trial for trial, error in rms.items() if error <= most), key=HorizonLight(source, whole))


def _residual_shapes(grid: AnisotropicHalfGrid) -> list[AnisotropicHalfGrid]:
    """Of the grid's room with more of theta_d, and also all of phi_d where it was folded."""
    start = replace(grid, horizon_share=HORIZON_SHARES[0], falling=False)
    shapes = _half_shapes(start, _RESIDUAL_SPLITS)
    return shapes + [replace(shape, folded=False) for shape in shapes if grid.folded]


def _half_shapes(grid: AnisotropicHalfGrid, splits: tuple[tuple[float, float], ...]) -> list[AnisotropicHalfGrid]:
    """The grid and others of no more texels, with multiples of its azimuths and of its theta_d."""
    n_a, n_b, _, n_c = grid.shape
    room = np.prod(AtlasLayout.of(grid).size)
    shapes = []
    for azimuths, rows in splits:
        a, b, n = round(n_a * azimuths), round(n_b * rows), n_c
        while n > 4 and np.prod(AtlasLayout((a, b, n, n)).size) > room:
            n -= 1
        shapes.append(replace(grid, shape=(a, b, n, n)))
    return shapes


def _best_half(start: AnisotropicHalfGrid, rms: Measure) -> AnisotropicHalfGrid:
    """Widths by a coarse square of trials, then steps in either width for as long as one pays."""
    coarse = (replace(start, width_x=x, width_y=y) for x, y in itertools.product(_WIDTHS, _WIDTHS))
    best = min(coarse, key=rms)
    for ratio in _RATIOS:
        while True:
            steps = ((ratio, 1.0), (1 / ratio, 1.0), (1.0, ratio), (1.0, 1 / ratio), (ratio, ratio), (1 / ratio,) * 2)
            moved = [
                replace(
                    best,
                    width_x=float(np.clip(best.width_x * x, _NARROWEST, _WIDEST)),
                    width_y=float(np.clip(best.width_y * y, _NARROWEST, _WIDEST)),
                )
                for x, y in steps
            ]
            found = min(moved, key=rms)
            if rms(found) >= rms(best) * 0.995:
                break
            best = found
    return best
