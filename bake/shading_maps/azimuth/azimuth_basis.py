"""A shading map over azimuth: curves of level and azimuth that the whole swatch shares, mixed at each texel.

Kautz et al. 2004 look a swatch up by the light that it reflects, r, alone, so that light from another side keeps the
shadows where they were. Here S(s, t, x, phi) ~ x max(sum_j c_j(s, t) B_j(x, phi), 0), x = r / a_max as ever, phi the
azimuth of the light in the swatch's own tangent frame: from +u towards +v. The curves are S in parts of its level,
which changes slowly where light is low, and their nodes crowd towards black, where a glossy swatch has most of its
lights.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ... import xp_numpy
from ...errors import BakeError
from ...images.bilinear import texels_around

# At most thrice the numbers of a texel of a usual map of one arc: 7 slices and m are 25, 23 curves with m and share 73.
MIN_RANK, MAX_RANK = 1, 23
MIN_AZIMUTHS, MAX_AZIMUTHS = 4, 128
# Texel channels that are looked at together: a few MB of float32 at all nodes.
BLOCK = 1 << 13
_SAMPLES = 1 << 16
# Nodes lie at x = (i / (N - 1))^CROWDING.
CROWDING = 1.5

_F32 = NDArray[np.float32]
_F64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class AzimuthBasis:
    """S(x, phi) ~ x max(sum over j of coefficients[..., j] curves_j(x, phi), 0), relative to a_max.

    Its mean over texels and azimuths is x, as far as the rank allows: the map is linearised as one of an arc.

    Attributes
    ----------
    coefficients : (H, W, 3, rank) float32, of either sign; row 0 on top
    curves : (rank, P, N) float32 at phi = 2 pi p / P, periodic, and `levels_of(N)`; straight lines between in phi and
        in `position(x)`. At x = 1, light from the zenith, the same at every azimuth; stored ones are at x = 0 as at the
        level after it
    """

    coefficients: _F32
    curves: _F32

    def __post_init__(self) -> None:
        rank, azimuths, levels = self.curves.shape
        if self.coefficients.ndim != 4 or self.coefficients.shape[2:] != (3, rank):
            raise ValueError(f"coefficients {self.coefficients.shape} of {rank} curves")
        for name, value, low, high in (
            ("azimuth rank", rank, MIN_RANK, MAX_RANK),
            ("azimuths", azimuths, MIN_AZIMUTHS, MAX_AZIMUTHS),
            ("levels", levels, 2, 64),
        ):
            if not low <= value <= high:
                raise BakeError(name, f"cannot be {value}", f"choose {low} to {high}")

    @property
    def rank(self) -> int:
        """Number of curves."""
        return len(self.curves)

    def weights(self, x: ArrayLike, phi: ArrayLike) -> _F64:
        """`curve_weights` of the curves: S is their sum with the coefficients, where that is above 0."""
        return curve_weights(self.curves, x, phi)

    def evaluate(self, x: float, phi: float) -> _F32:
        """The whole swatch (H, W, 3) lit from azimuth phi (rad), at level x; stays at its last value above x = 1."""
        value = self.coefficients @ self.weights(x, phi).astype(np.float32)
        return np.maximum(value, 0, out=value)

    def at(self, uv: NDArray[Any], x: NDArray[Any], phi: NDArray[Any], above: str = "clamp") -> _F64:
        """Reflected light (..., 3) relative to a_max, linear between texels, periodic in uv.

        Parameters
        ----------
        uv : (..., 2), v upwards; the swatch covers [0, 1]
        x : (...) or (..., 3) for channels that reach different levels; r / a_max, >= 0
        phi : (...), radians
        above : "clamp": beyond x = 1 stay with the last level; "scale" it in proportion to x
        """
        x = np.asarray(x, np.float64)
        x = x if x.ndim == np.ndim(uv) else np.repeat(x[..., None], 3, -1)
        weights = self.weights(x, np.asarray(phi, np.float64)[..., None])
        value = np.zeros(x.shape)
        for index, weight in texels_around(self.coefficients.shape[:2], np.asarray(uv, np.float64)):
            value += weight[..., None] * np.einsum("...cr,...cr->...c", self.coefficients[index], weights)
        value = np.maximum(value, 0)
        return value * np.maximum(x, 1.0) if above == "scale" else value

    def nodes(self) -> _F32:
        """Curves at all (x, phi) but x = 0, where S is 0: (rank, P (N - 1)), levels of an azimuth together."""
        return self.curves[:, :, 1:].reshape(self.rank, -1)

    def lit_nodes(self) -> _F32:
        """The same times x: the curves of S."""
        _, azimuths, levels = self.curves.shape
        return self.nodes() * np.tile(levels_of(levels)[1:], azimuths).astype(np.float32)


def levels_of(count: int) -> _F64:
    """x of `count` nodes, from 0 to 1."""
    return np.linspace(0, 1, count) ** CROWDING


def position(xp: Any, x: Any) -> Any:
    """Where between the first node, 0, and the last, 1, a level x >= 0 lies; beyond 1 it stays there."""
    return xp.power(xp.minimum(x, 1.0), 1 / CROWDING)


def curve_weights(curves: NDArray[Any], x: ArrayLike, phi: ArrayLike) -> _F64:
    """x times curves (rank, P, N) at level x, held at 1 above it, and azimuth phi (rad); they broadcast (..., rank)."""
    _, azimuths, levels = curves.shape
    x, phi = np.broadcast_arrays(np.asarray(x, np.float64), np.asarray(phi, np.float64))
    x = np.clip(x, 0, 1)
    place = position(xp_numpy, x) * (levels - 1)
    column = np.minimum(place.astype(np.intp), levels - 2)
    turned = np.mod(phi / (2 * np.pi), 1.0) * azimuths
    row = np.minimum(turned.astype(np.intp), azimuths - 1)
    s, t = place - column, turned - row
    above = (row + 1) % azimuths
    curves = np.asarray(curves, np.float64)  # or numbers, which are no arrays, would be rounded to float32
    near = (1 - s) * curves[:, row, column] + s * curves[:, row, column + 1]
    far = (1 - s) * curves[:, above, column] + s * curves[:, above, column + 1]
    return np.moveaxis(((1 - t) * near + t * far) * x, 0, -1)


def mean_curves(curves: NDArray[Any]) -> _F64:
    """Mean over azimuths of x times curves (rank, P, N), at even levels from 0 to 1: (rank, N)."""
    even = np.linspace(0, 1, curves.shape[2])
    return curve_weights(curves.mean(axis=1, keepdims=True, dtype=np.float64), even, 0.0).T


def mean_over_azimuth(basis: AzimuthBasis) -> _F32:
    """Slices (N, H, W, 3) for what knows no azimuth: at each of N even levels the mean over all nodes of azimuth."""
    _, azimuths, levels = basis.curves.shape
    even, turns = np.linspace(0, 1, levels)[1:], np.arange(azimuths) / azimuths
    flat = basis.coefficients.reshape(-1, basis.rank)
    nodes = basis.weights(even, 2 * np.pi * turns[:, None]).reshape(-1, basis.rank).T.astype(np.float32)
    slices = np.zeros((levels, len(flat)), np.float32)
    for start in range(0, len(flat), BLOCK):
        value = flat[start : start + BLOCK] @ nodes
        np.maximum(value, 0, out=value)
        slices[1:, start : start + BLOCK] = value.reshape(-1, azimuths, levels - 1).mean(1).T
    return slices.reshape(levels, *basis.coefficients.shape[:3])


def node_means(basis: AzimuthBasis) -> _F64:
    """Mean of S / x over texels and channels at all (x, phi) but x = 0: (P, N - 1). What is held at 0 is sampled."""
    flat, nodes = basis.coefficients.reshape(-1, basis.rank), basis.nodes()
    means = flat.mean(0, dtype=np.float64) @ nodes
    chosen = flat
    if len(flat) > _SAMPLES:  # any regular step could fall in with the channels or a weave
        chosen = flat[np.random.default_rng(0).integers(0, len(flat), _SAMPLES)]
    held = np.zeros(nodes.shape[1])
    for start in range(0, len(chosen), BLOCK):
        held += np.maximum(-(chosen[start : start + BLOCK] @ nodes), 0).sum(0, dtype=np.float64)
    return (means + held / len(chosen)).reshape(basis.curves.shape[1], -1)
