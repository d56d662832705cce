"""Tabulated BRDFs (Mallett & Yuksel 2016) on any `grid.Grid`, and their evaluation in numpy.

Values have the axes of their grid and rgb. A table of either basis, of an isotropic or an anisotropic material, is
sampled, continued, packed and filtered alike.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Literal, get_args

import numpy as np

from .. import xp_numpy
from ..source import Array, BrdfSource, Facts
from .grids.grid import Grid
from .log_codes import LogCodes
from .padding import GUTTER, pad_slices

Filter = Literal["nearest", "trilinear", "bspline"]
FILTERS: tuple[Filter, ...] = get_args(Filter)

_CHUNK = 1 << 17


@dataclass(frozen=True)
class Table:
    """Sampled values (or B-spline coefficients) times the grid's factor, float32; a `BrdfSource`.

    Parameters
    ----------
    values : of shape grid.shape + (3,)
    log : values are stored as its codes, and codes are what is interpolated within a slice
    filter : reconstructs it where no other is named
    """

    grid: Grid
    values: Array
    log: LogCodes | None = None
    filter: Filter = "trilinear"
    name: ClassVar[str] = "table"

    @property
    def isotropic(self) -> bool:
        """Whether the table has one slice axis."""
        return len(self.grid.shape) == 3

    @property
    def bilateral(self) -> bool:
        """An isotropic table holds one side of the viewer for both."""
        return self.isotropic

    @property
    def facts(self) -> Facts:
        """Nothing: what is known of a table stands in its bundle."""
        return {}

    @cached_property
    def _padded(self) -> Array:
        padded = pad_slices(self.grid, self.values)
        return self.log.encode(padded) if self.log else padded

    def evaluate(self, wi: Array, wo: Array, filter: Filter | None = None) -> Array:
        """BRDF (..., 3) reconstructed at direction pairs; the truth the shader nodes are compared with.

        On and below the horizon 0; the shader's lookup itself would return the horizon's value.
        """
        wi, wo = np.broadcast_arrays(np.asarray(wi, np.float64), np.asarray(wo, np.float64))
        shape = wi.shape
        wi, wo = wi.reshape(-1, 3), wo.reshape(-1, 3)
        out = np.zeros((len(wi), 3))
        above = np.flatnonzero((wi[:, 2] > 0) & (wo[:, 2] > 0))
        for start in range(0, len(above), _CHUNK):
            part = above[start : start + _CHUNK]
            pair = wi.take(part, 0), wo.take(part, 0)
            value = self._reconstruct(self.grid.coordinates(xp_numpy, *pair), filter or self.filter)
            out[part] = value / np.reshape(self.grid.factor(xp_numpy, *pair), (-1, 1))
        return out.reshape(shape)

    def _reconstruct(self, coordinates: tuple[Array, ...], filter: Filter) -> Array:
        """Tensor-product filter over the padded table; coordinates are fractional indices of the unpadded one."""
        padded = self._padded
        n_rows, n_columns = padded.shape[-3:-1]
        flat = padded.reshape(-1, 3)
        out = np.zeros((len(coordinates[0]), 3))
        *slice_taps, row_taps, column_taps = (filter_taps(c, filter) for c in coordinates)
        for taps in itertools.product(*slice_taps):
            index, weight = self._slice(taps)
            within = np.zeros_like(out)
            for r, w_r in row_taps:
                row = (index * n_rows + (r + GUTTER)) * n_columns + GUTTER
                for c, w_c in column_taps:
                    # Fancy indexing takes eight times as long as `take`.
                    within += flat.take(row + c, 0) * (w_r * w_c)[:, None]
            out += (self.log.decode(xp_numpy, within) if self.log else within) * weight[:, None]
        return out

    def _slice(self, taps: tuple[tuple[Array, Array], ...]) -> tuple[Array, Array]:
        """Index of a slice of the padded table, and its weight, from one tap of each slice axis."""
        index, weight = np.zeros(len(taps[0][0]), np.intp), np.ones(len(taps[0][0]))
        for (place, part), n, boundary in zip(taps, self._padded.shape, self.grid.boundaries):
            index = index * n + (place % n if boundary == "around" else np.clip(place, 0, n - 1))
            weight = weight * part
        return index, weight

    @property
    def total_intensity(self) -> float:
        """Sum over all entries, the metric by which Mallett & Yuksel (2016, section 4.2) choose alpha."""
        return float(self.values.sum(dtype=np.float64))


def tabulate(source: BrdfSource, grid: Grid, progress: Callable[[float], None] | None = None) -> Table:
    """Sample a source on a grid; `progress` is called with the share done."""
    *slice_axes, n_rows, n_columns = grid.shape
    values = np.empty((*grid.shape, 3), np.float32)
    slices = values.reshape(-1, n_rows, n_columns, 3)
    rows, columns = np.meshgrid(np.arange(n_rows), np.arange(n_columns), indexing="ij")
    step = max(1, _CHUNK // rows.size)
    for start in range(0, len(slices), step):
        chosen = np.arange(start, min(start + step, len(slices)))
        places = np.unravel_index(chosen[:, None, None], slice_axes)
        wi, wo = grid.directions(*places, rows, columns)
        slices[chosen] = (
            source.evaluate(wi, wo) * np.asarray(grid.sample_factor(wi, wo, *places, rows, columns))[..., None]
        )
        if progress:
            progress((start + len(chosen)) / len(slices))
    grid.settle_poles(values)
    return Table(grid, values)


def bspline_weights(xp: Any, t: Any) -> tuple[Any, Any, Any, Any]:
    """Weights of the uniform cubic B-spline for the samples -1, 0, 1, 2 around a position t in [0, 1]."""
    r = 1 - t
    return (
        r * r * r * (1 / 6),
        (t * t) * (0.5 * t - 1) + 2 / 3,
        (r * r) * (0.5 * r - 1) + 2 / 3,
        t * t * t * (1 / 6),
    )


def filter_taps(position: Array, filter: Filter) -> list[tuple[Array, Array]]:
    """(index, weight) pairs of a one-dimensional filter."""
    if filter == "nearest":
        return [(np.floor(position + 0.5).astype(np.intp), np.ones_like(position))]
    base = np.floor(position)
    t = position - base
    index = base.astype(np.intp)
    if filter == "trilinear":
        return [(index, 1 - t), (index + 1, t)]
    return [(index + k - 1, w) for k, w in enumerate(bspline_weights(xp_numpy, t))]
