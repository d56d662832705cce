"""Choosing Bezier shape parameters by total intensity (Mallett & Yuksel 2016, section 4.2) or measured error."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...source import Array, BrdfSource, Facts
from ..accuracy import DirectionPairs, direction_pairs, linear_estimate
from ..grids.normal_vector_grid import NormalVectorGrid

_COARSE = (0.0, 0.25, 0.5, 0.75, 1.0)
_FINE = (-0.125, 0.0, 0.125)
# Summing every sample of the table for every trial takes minutes with slow sources and ranks the trials alike.
_INTENSITY_N = 32


@dataclass(frozen=True)
class AlphaTrial:
    """One pair of shape parameters and what was measured for it."""

    alpha_theta: float
    alpha_phi: float
    intensity: float
    rms: float


@dataclass(frozen=True)
class AlphaSearch:
    """All trials, and the winner by each metric."""

    trials: tuple[AlphaTrial, ...]

    @property
    def by_error(self) -> AlphaTrial:
        """The trial of least cosine-weighted RMS."""
        return min(self.trials, key=lambda trial: trial.rms)

    @property
    def by_intensity(self) -> AlphaTrial:
        """The trial of largest total intensity (Mallett & Yuksel 2016, section 4.2)."""
        return max(self.trials, key=lambda trial: trial.intensity)

    def facts(self) -> Facts:
        """JSON-ready account: both winners, and whether the paper's metric found the least error."""
        by_error, by_intensity = self.by_error, self.by_intensity
        return {
            "trials": len(self.trials),
            "by_error": vars(by_error),
            "by_intensity": vars(by_intensity),
            "intensity_finds_least_error": by_error == by_intensity,
            "error_of_intensity_choice": by_intensity.rms / max(by_error.rms, 1e-30),
        }


def search_alpha(
    source: BrdfSource,
    n: int,
    pairs: DirectionPairs | None = None,
    truth: Array | None = None,
    progress: Callable[[float], None] | None = None,
    intensity_n: int = _INTENSITY_N,
) -> AlphaSearch:
    """Try 25 pairs of a regular grid, then the eight neighbours of the best by error and of the best by intensity.

    Parameters
    ----------
    n : table resolution the choice is made for
    pairs, truth : directions at which the error is measured, and the source there; by default 8192
    progress : called with the share done
    intensity_n : largest resolution at which the total intensity is estimated
    """
    pairs = direction_pairs(8192) if pairs is None else pairs
    truth = source.evaluate(pairs.wi, pairs.wo) if truth is None else truth
    tried: dict[tuple[float, float], AlphaTrial] = {}

    def attempt(alpha_theta: float, alpha_phi: float) -> None:
        key = (min(max(alpha_theta, 0.0), 1.0), min(max(alpha_phi, 0.0), 1.0))
        if key not in tried:
            rms = pairs.rms(linear_estimate(source, NormalVectorGrid(n, "bezier", *key), pairs) - truth)
            intensity = estimate_intensity(source, NormalVectorGrid(min(n, intensity_n), "bezier", *key))
            tried[key] = AlphaTrial(*key, intensity, rms)
        if progress:
            progress(min(len(tried) / 41, 1.0))

    for alpha_theta in _COARSE:
        for alpha_phi in _COARSE:
            attempt(alpha_theta, alpha_phi)
    coarse = AlphaSearch(tuple(tried.values()))
    for best in (coarse.by_error, coarse.by_intensity):
        for step_theta in _FINE:
            for step_phi in _FINE:
                attempt(best.alpha_theta + step_theta, best.alpha_phi + step_phi)
    return AlphaSearch(tuple(tried.values()))


def estimate_intensity(source: BrdfSource, grid: NormalVectorGrid, stride: int = 8) -> float:
    """Total intensity of the table on this grid from about a third of its samples.

    The sum lives in the mirror direction and, for some materials, in the retro-reflection: azimuths near pi and near
    0 are summed in full. Between them every `stride`-th sample of a skewed lattice, which meets every row and column,
    stands for its neighbours.
    """
    n_o, n_i, n_phi = grid.shape
    i_o, i_i, i_phi = np.meshgrid(np.arange(n_o), np.arange(n_i), np.arange(n_phi), indexing="ij", sparse=True)
    in_full = (i_phi < n_phi // 8) | (i_phi >= n_phi - n_phi // 16)
    chosen = np.nonzero(in_full | ((i_o + 2 * i_i + 3 * i_phi) % stride == 0))
    values = source.evaluate(*grid.directions(*chosen)).sum(-1)
    weight = np.where(in_full[0, 0, chosen[2]], 1, stride)
    return float((values * weight).sum(dtype=np.float64))


def with_alpha(grid: NormalVectorGrid, trial: AlphaTrial) -> NormalVectorGrid:
    """The grid with a trial's shape parameters."""
    return replace(grid, alpha_theta=trial.alpha_theta, alpha_phi=trial.alpha_phi)
