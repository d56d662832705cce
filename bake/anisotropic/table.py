"""Tabulated anisotropic BRDFs (Mallett & Yuksel 2016), and their evaluation in numpy.

Values have the axes of their grid and rgb. Poles: at theta_i = 0 (normal basis) and at theta_d = 0 (half basis) the
azimuth means nothing and the samples are one value. At theta_o = 0 of the normal basis they are not, for the light's
own azimuth phi_o + phi_delta still counts: the samples agree along it as far as both azimuths' steps let them.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .. import xp_numpy
from ..log_storage import LogCodes
from ..source import Array, BrdfSource
from ..table import GUTTER, Filter, beyond_pole, check_values, filter_taps
from .grid import Grid, NormalGrid

_CHUNK = 1 << 17


class TreatedAnisotropic:
    """A source as tables can hold it, negative values set to 0; a `BrdfSource`. What is treated is counted."""

    isotropic = bilateral = False

    def __init__(self, source: BrdfSource) -> None:
        self.source, self.name, self.facts = source, source.name, source.facts
        self._values = self._negative = 0

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """BRDF (..., 3) >= 0. Raises BakeError as `table.check_values`."""
        value = self.source.evaluate(wi, wo)
        check_values(value, self.name)
        self._values += value.size
        self._negative += int((value < 0).sum())
        return np.maximum(value, 0)

    def treatment(self) -> dict[str, float]:
        """Share of evaluated values that were negative."""
        return {"negative_share": self._negative / max(self._values, 1)}


@dataclass(frozen=True)
class AnisotropicTable:
    """Sampled values (or B-spline coefficients), float32, of shape grid.shape + (3,), times the grid's factor.

    `filter` is what it is reconstructed with; with `log` codes are what is interpolated within a slice.
    """

    grid: Grid
    values: Array
    filter: Filter = "trilinear"
    log: LogCodes | None = None
    isotropic = bilateral = False

    @cached_property
    def _padded(self) -> Array:
        padded = pad_slices(self.grid, self.values)
        return self.log.encode(padded) if self.log else padded

    def evaluate(self, wi: Array, wo: Array, filter: Filter | None = None) -> Array:
        """BRDF (..., 3) reconstructed at direction pairs; the truth the shader nodes are compared with."""
        wi, wo = np.broadcast_arrays(np.asarray(wi, np.float64), np.asarray(wo, np.float64))
        shape = wi.shape
        wi, wo = wi.reshape(-1, 3), wo.reshape(-1, 3)
        out = np.zeros((len(wi), 3))
        above = np.flatnonzero((wi[:, 2] > 0) & (wo[:, 2] > 0))
        for start in range(0, len(above), _CHUNK):
            part = above[start : start + _CHUNK]
            pair = wi[part], wo[part]
            value = _reconstruct(self._padded, self.grid.coordinates(xp_numpy, *pair), filter or self.filter, self.log)
            out[part] = value / np.reshape(self.grid.factor(xp_numpy, *pair), (-1, 1))
        return out.reshape(shape)


def tabulate(source: BrdfSource, grid: Grid, progress: Callable[[float], None] | None = None) -> AnisotropicTable:
    """Sample a source on a grid; `progress` is called with the share done."""
    n_a, n_b, n_r, n_c = grid.shape
    values = np.empty((*grid.shape, 3), np.float32)
    flat = values.reshape(n_a * n_b, n_r, n_c, 3)
    r, c = np.meshgrid(np.arange(n_r), np.arange(n_c), indexing="ij")
    step = max(1, _CHUNK // r.size)
    for start in range(0, n_a * n_b, step):
        index = np.arange(start, min(start + step, n_a * n_b))
        a, b = index[:, None, None] // n_b, index[:, None, None] % n_b
        wi, wo = grid.directions(a, b, r, c)
        factor = np.broadcast_to(grid.factor(xp_numpy, wi, wo), wi.shape[:-1])
        flat[index] = source.evaluate(wi, wo) * factor[..., None]
        if progress:
            progress((start + len(index)) / (n_a * n_b))
    if isinstance(grid, NormalGrid):
        values[:, :, -1] = np.einsum("abcx,c->abx", values[:, :, -1], _column_weights(grid))[:, :, None]
    else:
        values[:, -1] = values[:, -1].mean(0)
    return AnisotropicTable(grid, values)


def _column_weights(grid: NormalGrid) -> Array:
    """Weights (C,) of the mean over phi_delta, whose samples crowd where it matters."""
    cosine, sine = grid.phi_delta()
    steps = np.abs(np.diff(np.arctan2(sine, cosine)))[::-1] / np.pi
    around = np.concatenate([steps, steps[::-1]])
    weights: Array = 0.25 * (around + np.roll(around, 1))
    return weights


def pad_slices(grid: Grid, values: Array) -> Array:
    """Continue a table beyond its ends: (A, B, R, C, 3) -> (A, B + 1, R + 2 G, C + 2 G, 3) with G = GUTTER.

    Beyond the pole of b comes the one slice that a cubic filter needs. A periodic azimuth goes on around; beyond a
    horizon there is nothing and the last sample is held.
    """
    if isinstance(grid, NormalGrid):
        # On the other side both azimuths are half a turn further.
        beyond = np.roll(values[:, -2], grid.shape[3] // 2, axis=2)
        beyond = beyond if grid.folded else np.roll(beyond, grid.shape[0] // 2, axis=0)
    else:
        beyond = np.maximum(2 * values[:, -2].mean(0) - values[:, -2], 0)
    values = np.concatenate([values, beyond[:, None]], 1)
    if isinstance(grid, NormalGrid):
        values = np.concatenate([values, np.repeat(beyond_pole(values[:, :, -2:-1]), GUTTER, 2)], 2)
        values = np.pad(values, ((0, 0), (0, 0), (GUTTER, 0), (0, 0), (0, 0)), mode="edge")
        return np.pad(values, ((0, 0), (0, 0), (0, 0), (GUTTER, GUTTER), (0, 0)), mode="wrap")
    return np.pad(values, ((0, 0), (0, 0), (GUTTER, GUTTER), (GUTTER, GUTTER), (0, 0)), mode="edge")


def _reconstruct(
    padded: Array, coordinates: tuple[Array, Array, Array, Array], filter: Filter, log: LogCodes | None
) -> Array:
    """Tensor-product filter over a padded table; coordinates are fractional indices of the unpadded one."""
    n_a, n_b, n_r, n_c = padded.shape[:4]
    flat = padded.reshape(-1, 3)
    out = np.zeros((len(coordinates[0]), 3))
    a_taps, b_taps, r_taps, c_taps = (filter_taps(p, filter) for p in coordinates)
    for (a, w_a), (b, w_b) in itertools.product(a_taps, b_taps):
        slices = (a % n_a) * n_b + np.clip(b, 0, n_b - 1)
        within = np.zeros_like(out)
        for r, w_r in r_taps:
            row = (slices * n_r + r + GUTTER) * n_c + GUTTER
            for c, w_c in c_taps:
                within += flat[row + c] * (w_r * w_c)[:, None]
        out += (log.decode(xp_numpy, within) if log else within) * (w_a * w_b)[:, None]
    return out
