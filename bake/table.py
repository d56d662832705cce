"""Tabulated isotropic BRDFs (Mallett & Yuksel 2016), and their evaluation in numpy.

In the normal-vector basis, `TableGrid`, axes are [theta_o, theta_i, phi_delta, rgb] of sizes N, N, 2N. Sample 0 of an
elevation lies at the horizon and the last at the normal; sample 0 of the azimuth lies at pi and the last at 0. The
half-vector basis is `half_grid.HalfGrid`; a table of either is sampled, continued, packed and filtered alike.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np

from . import xp_numpy
from .errors import BakeError
from .half_grid import HalfGrid
from .log_storage import LogCodes
from .parameterization import LogWarp, Parameterization, Shape, normal_basis_coordinates, phi_nodes, theta_nodes
from .source import Array, BrdfSource

Filter = Literal["nearest", "trilinear", "bspline"]
FILTERS: tuple[str, ...] = get_args(Filter)

# Texels beside a slice that belong to its continuation: a cubic filter reaches one beyond the neighbour.
GUTTER = 2
# At the horizon a BRDF may grow without bound (as 1 / (cos cos) in the mirror direction) and measurements have ended.
# The last sample is taken short of it, at this share of its neighbour's cosine: taken at 1e-3 instead, the one cell
# beside the horizon dominates the whole error (tried: 4 to 8 times the RMS on glossy paints). A BRDF that stays bounded
# is better served close to the horizon: baking measures both.
HORIZON_SHARES = (1 / 3, 1 / 50)
# At the pole itself no azimuth is left: the mean over the azimuth is taken at this chord beside it.
_POLE_CHORD = 1e-5
_CHUNK = 1 << 17
# Beyond this a number is damage; sums of a hundred of them are still float32 numbers.
LARGEST = 1e36


@dataclass(frozen=True)
class TableGrid:
    """Where the samples of a table lie, normal-vector basis.

    Parameters
    ----------
    n : samples per elevation; the azimuth has 2 n
    parameterization : of every axis
    alpha_theta, alpha_phi : Bezier shape of the elevations and the azimuth, in [0, 1]; unused by the others
    horizon_share : the sample at the horizon is taken at this share of its neighbour's cosine
    warps : fitted warps of the elevations and the azimuth; unused by the others
    """

    n: int
    parameterization: Parameterization
    alpha_theta: float = 0.5
    alpha_phi: float = 0.5
    horizon_share: float = HORIZON_SHARES[0]
    warps: tuple[LogWarp, LogWarp] = (LogWarp(), LogWarp())

    @property
    def shapes(self) -> tuple[Shape, Shape]:
        """Of the elevations and the azimuth."""
        return self.warps if self.parameterization == "fitted" else (self.alpha_theta, self.alpha_phi)

    @property
    def shape(self) -> tuple[int, int, int]:
        """(theta_o, theta_i, phi_delta) sizes."""
        return self.n, self.n, 2 * self.n

    def unit_coordinates(self, xp: Any, wi: Any, wo: Any) -> tuple[Any, Any, Any]:
        """Coordinates (u_o, u_i, u_phi) in [0, 1], in numpy or nodes."""
        return normal_basis_coordinates(xp, wi, wo, self.parameterization, *self.shapes)

    def coordinates(self, wi: Array, wo: Array) -> tuple[Array, Array, Array]:
        """Fractional sample indices (theta_o, theta_i, phi_delta) of direction pairs."""
        u_o, u_i, u_phi = self.unit_coordinates(xp_numpy, wi, wo)
        n = self.n
        return u_o * (n - 1), u_i * (n - 1), u_phi * (2 * n - 1)

    def directions(self, i_o: Array, i_i: Array, i_phi: Array) -> tuple[Array, Array]:
        """(wi, wo), each (..., 3), at integer sample indices that broadcast; wo lies in the x-z plane."""
        i_o, i_i, i_phi = np.broadcast_arrays(i_o, i_i, i_phi)
        v = theta_nodes(self.parameterization, self.n, self.shapes[0])
        v = np.clip(v, _POLE_CHORD, np.sqrt(1 - self.horizon_share * (1 - v[1] ** 2)))
        cosine, sine = (1 - v) * (1 + v), v * np.sqrt(2 - v * v)
        cos_phi, sin_phi = phi_nodes(self.parameterization, 2 * self.n, self.shapes[1])
        wi = np.stack([sine[i_i] * cos_phi[i_phi], sine[i_i] * sin_phi[i_phi], cosine[i_i]], -1)
        wo = np.stack([sine[i_o], np.zeros_like(sine[i_o]), cosine[i_o]], -1)
        return wi, wo

    def facts(self) -> dict[str, Any]:
        """JSON-ready description."""
        return {
            "basis": "normal",
            "n": self.n,
            "parameterization": self.parameterization,
            "alpha_theta": self.alpha_theta,
            "alpha_phi": self.alpha_phi,
            "horizon_share": self.horizon_share,
            **({"warps": [[w.near, w.far] for w in self.warps]} if self.parameterization == "fitted" else {}),
        }

    def phi_weights(self) -> Array:
        """Weights (2N,) of the mean over the azimuth by the trapezoid rule, for nodes that crowd where it matters."""
        cosine, sine = phi_nodes(self.parameterization, 2 * self.n, self.shapes[1])
        phi = np.arctan2(sine, cosine)
        step = -np.diff(phi) / np.pi
        return 0.5 * (np.append(step, 0) + np.insert(step, 0, 0))


Grid = TableGrid | HalfGrid


class TreatedSource:
    """A source as tables can hold it: averaged with its mirror image, negative values set to 0.

    What is treated is counted at every evaluation; baking states the counts of one fixed set of directions.
    """

    def __init__(self, source: BrdfSource) -> None:
        self.source, self.name = source, source.name
        self._values = self._negative = self._asymmetry = self._total = 0.0

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """BRDF (..., 3) >= 0, symmetric in phi_delta. Raises BakeError as `check_values`."""
        value = self.source.evaluate(wi, wo)
        if not self.source.bilateral:
            # Mirroring both directions in the x-z plane turns phi_delta to -phi_delta for any wo.
            mirror = np.array([1.0, -1.0, 1.0])
            other = self.source.evaluate(wi * mirror, wo * mirror)
            self._asymmetry += float(np.abs(value - other).sum()) / 2
            self._total += float(np.abs(value + other).sum()) / 2
            value = 0.5 * (value + other)
        check_values(value, self.name)
        self._values += value.size
        self._negative += int((value < 0).sum())
        return np.maximum(value, 0)

    def facts(self) -> dict[str, float]:
        """Share of evaluated values that were negative, and relative L1 difference to the mirror image."""
        return {
            "negative_share": self._negative / max(self._values, 1.0),
            "asymmetry": self._asymmetry / self._total if self._total else 0.0,
        }


def check_values(values: Array, name: str) -> None:
    """Raise BakeError where a source's values are not finite, or no table could hold them."""
    if not values.size or -LARGEST <= values.min() <= values.max() <= LARGEST:
        return
    cause = (
        f"values above {LARGEST:g}, which are too large" if np.isfinite(values).all() else "values that are not finite"
    )
    raise BakeError(name, f"holds {cause}", "check the file")


@dataclass(frozen=True)
class BrdfTable:
    """Sampled values (or B-spline coefficients), float32, of shape grid.shape + (3,).

    With `log` they are stored as its codes, and codes are what is interpolated within a slice.
    """

    grid: Grid
    values: Array
    log: LogCodes | None = None

    @cached_property
    def _padded(self) -> Array:
        padded = pad_slices(self.values)
        return self.log.encode(padded) if self.log else padded

    def evaluate(self, wi: Array, wo: Array, filter: Filter = "trilinear") -> Array:
        """BRDF (..., 3) reconstructed at direction pairs; the truth the shader nodes are compared with."""
        wi, wo = np.broadcast_arrays(wi, wo)
        shape = wi.shape
        wi, wo = wi.reshape(-1, 3), wo.reshape(-1, 3)
        out = np.empty((len(wi), 3))
        for start in range(0, len(wi), _CHUNK):
            part = slice(start, start + _CHUNK)
            out[part] = _reconstruct(self._padded, self.grid.coordinates(wi[part], wo[part]), filter, self.log)
        # Positions below the horizon have no value; the lookup itself would return the horizon's.
        out[(wi[:, 2] <= 0) | (wo[:, 2] <= 0)] = 0
        return out.reshape(shape)

    @property
    def total_intensity(self) -> float:
        """Sum over all entries, the metric by which MY16 section 4.2 chooses alpha."""
        return float(self.values.sum(dtype=np.float64))


def tabulate(
    source: BrdfSource | TreatedSource, grid: Grid, progress: Callable[[float], None] | None = None
) -> BrdfTable:
    """Sample a source on a grid; `progress` is called with the share done."""
    n_slices, n_rows, n_phi = grid.shape
    values = np.empty((*grid.shape, 3), np.float32)
    i_i, i_phi = np.meshgrid(np.arange(n_rows), np.arange(n_phi), indexing="ij")
    step = max(1, _CHUNK // i_i.size)
    for start in range(0, n_slices, step):
        i_o = np.arange(start, min(start + step, n_slices))
        wi, wo = grid.directions(i_o[:, None, None], i_i, i_phi)
        values[i_o] = source.evaluate(wi, wo)
        if progress:
            progress((start + len(i_o)) / n_slices)
    # Real measurements disagree with themselves at the pole (twofold in some RGL files); a table must not.
    weights = grid.phi_weights()
    values[:, -1] = np.einsum("opc,p->oc", values[:, -1], weights)[:, None]
    values[-1] = np.einsum("ipc,p->ic", values[-1], weights)[:, None]
    return BrdfTable(grid, values)


def pad_slices(values: Array) -> Array:
    """Continue a table beyond its ends: (S, R, C, 3) -> (S + 1, R + 2 G, C + 2 G, 3) with G = GUTTER.

    The azimuth is mirrored at both ends, so that the derivative vanishes there and no crease runs through the
    highlight. Beyond angle 0, a pole, comes `beyond_pole`. Beyond the horizon there is nothing: the last sample is
    held. The slices get the one that a cubic filter needs.
    """
    values = np.concatenate([values, beyond_pole(values[-2:-1])], 0)
    ends = np.repeat(values[:, :1], GUTTER, 1), np.repeat(beyond_pole(values[:, -2:-1]), GUTTER, 1)
    values = np.concatenate([ends[0], values, ends[1]], 1)
    return np.pad(values, ((0, 0), (0, 0), (GUTTER, GUTTER), (0, 0)), mode="reflect")


def beyond_pole(row: Array) -> Array:
    """The samples (..., C, 3) that a cubic filter finds beyond the normal, from the last ones before it.

    Going on down the other side, at pi - phi_delta, would be smoothest along each line, but leaves the normal itself
    a different value from every azimuth: a star in the picture. With 2 mean - row all azimuths meet in one value,
    unless the row varies so much that 0 stands in for a negative sample; where the row is a constant plus a cosine of
    phi_delta both are the same.
    """
    return np.maximum(2 * row.mean(-2, keepdims=True) - row, 0)


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


def _reconstruct(padded: Array, coordinates: tuple[Array, Array, Array], filter: Filter, log: LogCodes | None) -> Array:
    """Tensor-product filter over a padded table; coordinates are fractional indices of the unpadded one."""
    n_slices, n_rows, n_columns = padded.shape[:3]
    flat = padded.reshape(-1, 3)
    out = np.zeros((len(coordinates[0]), 3))
    o_taps, i_taps, phi_taps = (filter_taps(c, filter) for c in coordinates)
    for o, w_o in o_taps:
        o = np.clip(o, 0, n_slices - 1)
        within = np.zeros_like(out)
        for i, w_i in i_taps:
            row = (o * n_rows + (i + GUTTER)) * n_columns + GUTTER
            for p, w_p in phi_taps:
                within += flat[row + p] * (w_i * w_p)[:, None]
        out += (log.decode(xp_numpy, within) if log else within) * w_o[:, None]
    return out
