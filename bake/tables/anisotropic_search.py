"""Which grid serves an anisotropic source: its symmetries, its basis, and the basis' shape, all by measurement."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..errors import BakeError
from ..source import Array, BrdfSource
from .accuracy import DirectionPairs, direction_pairs, linear_estimate
from .anisotropic_grids import NORMAL_KINDS, AnisotropicHalfGrid, AnisotropicNormalGrid
from .grid import Grid
from .grid_search import fit_warps

# Relative L1 difference up to which a symmetry is taken as exact, and half of the samples are saved.
SYMMETRIC = 1e-3
BASES = ("auto", "half", "normal")
_WIDTHS = (0.03, 0.1, 0.3, 1.0)
_RATIOS = (2.0, 1.4)
_NARROWEST, _WIDEST = 2e-3, 8.0
_ALPHAS_THETA, _ALPHAS_PHI = (0.0, 0.25, 0.5, 0.75), (0.05, 0.15, 0.3, 0.5)
_RANKING = 4096
# Of "auto" in the normal basis.
AUTO = ("bezier", "fitted")
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
    """Of values `truth` (P, 3) at the pairs."""
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


def choose_grid(
    source: BrdfSource,
    n: int,
    symmetry: Symmetry,
    basis: str = "auto",
    progress: Callable[[float], None] | None = None,
    *,
    parameterization: str = "auto",
    alpha: str | tuple[float, float] = "error",
) -> tuple[Grid, dict[str, Any]]:
    """The grid of least cosine-weighted RMS at directions of no table, and a JSON-ready account of all kinds.

    Parameters
    ----------
    n : resolution, see `half_shape`; the normal basis gets about as many texels
    basis : "half", "normal", or "auto" for the one whose best grid has the smaller error
    parameterization : of the normal basis, "auto" for the best; the half basis has slope widths of its own, which are
        fitted, and is left out where another parameterisation is named
    alpha : for "bezier", as of `bake.tables.grid_search.choose_grid`

    Raises
    ------
    BakeError : an unknown basis, or a parameterisation that the basis does not have
    """
    if basis not in BASES:
        raise BakeError("basis", f"cannot be {basis!r}", f"choose from {', '.join(BASES)}")
    kinds = _kinds(basis, parameterization)
    say = progress or (lambda share: None)
    rms, tried = _measure(source, offset=0.25)

    best: dict[str, Grid] = {}
    for done, (which, kind) in enumerate(kinds):
        say(done / len(kinds))
        if which == "half":
            best["half"] = _best_half(
                AnisotropicHalfGrid(half_shape(n, symmetry.reciprocal), folded=symmetry.reciprocal), rms
            )
            continue
        start = AnisotropicNormalGrid(
            normal_shape(n, symmetry.half_turn), folded=symmetry.half_turn, parameterization=kind
        )
        best[f"normal {kind}"] = _best_normal(source, start, alpha, rms)
    say(1.0)
    # The directions that fitted a grid flatter it, the more of its numbers were fitted the more.
    ranked, _ = _measure(source, offset=0.75)
    chosen = min(best.values(), key=ranked)
    account = {name: {**grid.facts(), "rms": ranked(grid)} for name, grid in best.items()}
    return chosen, {"trials": len(tried), "chosen": chosen.basis, "best": account}


def _measure(source: BrdfSource, offset: float) -> tuple[Callable[[Grid], float], dict[Grid, float]]:
    """Cosine-weighted RMS of grids at one set of directions, and what it has found so far."""
    pairs = direction_pairs(_RANKING, offset, turned=True)
    truth = source.evaluate(pairs.wi, pairs.wo)
    found: dict[Grid, float] = {}

    def rms(grid: Grid) -> float:
        if grid not in found:
            found[grid] = pairs.rms(linear_estimate(source, grid, pairs) - truth)
        return found[grid]

    return rms, found


def _kinds(basis: str, parameterization: str) -> list[tuple[str, str]]:
    """Basis and parameterisation of what is to be tried."""
    if parameterization not in ("auto", *NORMAL_KINDS):
        choices = ", ".join(("auto", *NORMAL_KINDS))
        raise BakeError(
            "parameterization", f"cannot be {parameterization!r} of an anisotropic table", f"choose {choices}"
        )
    own = parameterization in ("auto", "fitted")
    if basis == "half" and not own:
        cause = f"cannot be {parameterization!r} in the half basis of an anisotropic table, whose slopes are fitted"
        raise BakeError("parameterization", cause, "choose auto, or the normal basis")
    normal = AUTO if parameterization == "auto" else (parameterization,)
    wanted = [("half", "slopes")] if basis != "normal" and own else []
    return wanted + ([("normal", kind) for kind in normal] if basis != "half" else [])


def _best_normal(
    source: BrdfSource, start: AnisotropicNormalGrid, alpha: str | tuple[float, float], rms: Callable[[Grid], float]
) -> Grid:
    if start.parameterization == "fitted":
        return fit_warps(start, rms)
    if start.parameterization != "bezier":
        return start
    if not isinstance(alpha, str):
        return replace(start, alpha_theta=float(alpha[0]), alpha_phi=float(alpha[1]))
    trials = [replace(start, alpha_theta=t, alpha_phi=p) for t, p in itertools.product(_ALPHAS_THETA, _ALPHAS_PHI)]
    if alpha == "intensity":
        return max(trials, key=lambda grid: total_intensity(source, grid))
    return min(trials, key=rms)


def total_intensity(source: BrdfSource, grid: AnisotropicNormalGrid, most: int = _INTENSITY_N) -> float:
    """Sum of all samples of the table (MY16 section 4.2), or of one of at most `most` elevations of its proportions."""
    n_a, n_b, n_r, n_c = grid.shape
    share = min(1.0, most / n_b)
    azimuth, columns = (max(4, 2 * round(n * share / 2)) for n in (n_a, n_c))
    small = replace(grid, shape=(azimuth, max(4, round(n_b * share)), max(4, round(n_r * share)), columns))
    values = source.evaluate(*small.directions(*np.meshgrid(*map(np.arange, small.shape), indexing="ij")))
    return float(values.sum(dtype=np.float64))


def _best_half(start: AnisotropicHalfGrid, rms: Callable[[Grid], float]) -> AnisotropicHalfGrid:
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
