"""How far a table is from its source, measured at directions that were not used to build it."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from .. import xp_numpy
from ..directions import normalize, spherical
from ..source import Array, BrdfSource
from .grids.grid import Grid
from .table import Filter

_WARP = 4.0
_GOLDEN = 0.6180339887498949


@dataclass(frozen=True)
class DirectionPairs:
    """Weighted direction pairs: `weight` turns a mean over them into a mean over both hemispheres.

    wi, wo : (P, 3); weight : (P,)
    """

    wi: Array
    wo: Array
    weight: Array

    @property
    def cosines(self) -> Array:
        """cos theta_i cos theta_o, (P, 1): with it an error counts as much seen as lit, as reciprocity has it.

        Weighted by cos theta_i alone, a BRDF that grows as 1 / (cos cos) leaves the whole sum to viewers within three
        degrees of the horizon, and to the luck of which pairs fell there.
        """
        return self.wi[:, 2:] * self.wo[:, 2:]

    def first(self, count: int) -> DirectionPairs:
        """So many of them, from the first."""
        return DirectionPairs(self.wi[:count], self.wo[:count], self.weight[:count])

    def rms(self, difference: Array) -> float:
        """Cosine-weighted root mean square over uniform wi and wo, of a BRDF difference (P, 3) in 1/sr."""
        square = ((difference * self.cosines) ** 2).mean(-1)
        return float(np.sqrt((self.weight * square).mean()))

    def rms_uncertainty(self, difference: Array) -> float:
        """Standard error of `rms` as a share of it, from sixteen interleaved parts of the pairs."""
        square = self.weight * ((difference * self.cosines) ** 2).mean(-1)
        parts = np.array([square[k::16].mean() for k in range(16)])
        return float(0.5 * parts.std(ddof=1) / 4 / max(float(parts.mean()), 1e-300))

    def relative_error(self, difference: Array, truth: Array) -> float:
        """Cosine-weighted L1 error as a share of the reflected energy."""
        weight = self.weight[:, None] * self.cosines
        return float((weight * np.abs(difference)).sum() / max(float((weight * truth).sum()), 1e-30))


class Reconstructed(Protocol):
    """A table of any number of dimensions."""

    def evaluate(self, wi: Array, wo: Array, filter: Filter) -> Array:
        """BRDF (..., 3) in 1/sr at direction pairs."""
        ...


def table_errors(table: Reconstructed, filter: Filter, pairs: DirectionPairs, truth: Array) -> Mapping[str, float]:
    """Cosine-weighted RMS in 1/sr and energy-relative error at directions the table was not built from."""
    difference = table.evaluate(pairs.wi, pairs.wo, filter) - truth
    return {
        "rms": pairs.rms(difference),
        "rms_uncertainty": pairs.rms_uncertainty(difference),
        "relative": pairs.relative_error(difference, truth),
        "rms_of_signal": pairs.rms(truth),
        "directions": len(truth),
    }


def direction_pairs(
    count: int, offset: float = 0.5, turned: bool = False, elevations: Array | None = None
) -> DirectionPairs:
    """A low-discrepancy set of direction pairs, half of it crowding round the mirror direction.

    Uniform directions alone would meet a chrome peak in one of a hundred thousand draws. Half the pairs are drawn
    through the half vector instead, and the balance heuristic (Veach 1997, section 9.2) weights both.

    Parameters
    ----------
    count : number of pairs; about 5 % fall below the horizon and are dropped
    offset : start of the sequence in [0, 1): another value gives other points, shifted from the first
    turned : each pair turned about the normal by an angle of its own, for an anisotropic source; otherwise wo lies in
        the x-z plane
    elevations : (n,) polar angles in radians, of wo only these: each stands for the solid angle that is next to it
    """
    u = _additive_recurrence(count, 4, offset)
    theta_o = np.arccos(u[:, 0])
    if elevations is not None:
        theta_o = elevations[np.abs(theta_o[:, None] - elevations).argmin(1)]
    wo = spherical(theta_o, 0.0)
    uniform = spherical(np.arccos(u[:, 1]), 2 * np.pi * u[:, 2])
    m = u[:, 1] ** _WARP
    half = spherical(2 * np.arcsin(np.sqrt(m / 2)), 2 * np.pi * u[:, 2])
    mirrored = 2 * xp_numpy.dot(wo, half)[:, None] * half - wo
    wi = np.where(u[:, 3:] < 0.5, uniform, mirrored)
    half = normalize(wi + wo)
    wo_half = xp_numpy.dot(wo, half)
    m = np.maximum(np.sum((half - [0, 0, 1]) ** 2, -1) / 2, 1e-30)
    pdf_half = 1 / (2 * np.pi * _WARP * m ** (1 - 1 / _WARP)) / (4 * np.maximum(wo_half, 1e-12))
    weight = 1 / (0.5 + 0.5 * (2 * np.pi) * pdf_half)
    keep = (wi[:, 2] > 1e-3) & (wo[:, 2] > 1e-3)
    # Dropped pairs lie outside the domain; the mean must still be over all draws.
    pairs = DirectionPairs(wi[keep], wo[keep], weight[keep] * (keep.sum() / count))
    return _turned(pairs, offset) if turned else pairs


def _turned(pairs: DirectionPairs, offset: float) -> DirectionPairs:
    phi = 2 * np.pi * ((offset + np.arange(len(pairs.wi)) * _GOLDEN) % 1)
    cosine, sine = np.cos(phi), np.sin(phi)

    def turn(w: Array) -> Array:
        return np.stack([cosine * w[:, 0] - sine * w[:, 1], sine * w[:, 0] + cosine * w[:, 1], w[:, 2]], -1)

    return DirectionPairs(turn(pairs.wi), turn(pairs.wo), pairs.weight)


def _additive_recurrence(count: int, dimensions: int, offset: float) -> Array:
    """Points of the generalised golden-ratio sequence (Roberts 2018), (count, dimensions) in [0, 1)."""
    ratio = 2.0
    for _ in range(40):
        ratio = (1 + ratio) ** (1 / (dimensions + 1))
    steps = ratio ** -np.arange(1.0, dimensions + 1)
    return (offset + np.arange(1, count + 1)[:, None] * steps) % 1.0


def linear_estimate(source: BrdfSource, grid: Grid, pairs: DirectionPairs) -> Array:
    """What a table on this grid, linear along each axis, would return at the pairs, (P, 3), without building the table.

    Only the 8 or 16 samples round each pair are evaluated, so that a search over many grids costs little.
    """
    samples, weights, factor = corner_samples(source, grid, pairs)
    # To the bit as `np.sum`, which takes three times as long over few samples in the middle.
    values = sum(np.moveaxis(samples * (weights * factor)[..., None], 1, 0))
    return values / np.reshape(grid.factor(xp_numpy, pairs.wi, pairs.wo), (-1, 1))


def corner_samples(source: BrdfSource, grid: Grid, pairs: DirectionPairs) -> tuple[Array, Array, Any]:
    """The source at the samples round each pair, (P, 2^axes, 3), their weights (P, 2^axes), last axis fastest, and the
    grid's factor there, (P, 2^axes) or 1."""
    position = grid.coordinates(xp_numpy, pairs.wi, pairs.wo)
    corners = np.array(list(itertools.product((0, 1), repeat=len(position))))
    index, weights = [], []
    for axis, (place, n, boundary) in enumerate(zip(position, grid.shape, grid.boundaries, strict=True)):
        around = boundary == "around"
        base = np.floor(place) if around else np.minimum(np.floor(place), n - 2)
        t = (place - base)[:, None]
        whole = base.astype(np.intp)[:, None] + corners[:, axis]
        index.append(whole % n if around else whole)
        weights.append(np.where(corners[:, axis], t, 1 - t))
    wi, wo = grid.directions(*index)
    return source.evaluate(wi, wo), np.prod(weights, 0), grid.sample_factor(wi, wo, *index)


def estimator_variance(
    integrand: Callable[[Array], Array], sample: Callable[[Array], tuple[Array, Array]], random: Array
) -> tuple[float, float]:
    """Mean and variance of the one-sample estimator integrand(wi) / pdf(wi), channels averaged.

    Parameters
    ----------
    integrand : wi (P, 3) -> f cos (P, 3)
    sample : random numbers (P, 4) -> wi (P, 3), pdf (P,)
    """
    wi, pdf = sample(random)
    value = integrand(wi).mean(-1) / np.maximum(pdf, 1e-30)
    return float(value.mean()), float(value.var())
