"""Few curves shared by a whole shading map, mixed at each texel: S(s, t, x) ~ sum_j c_j(s, t) B_j(x).

An alternative to the power law of Kautz et al. 2004 that is fitted to the swatch: with two curves it stores as many
numbers per texel, needs no logarithm in the shader, and the curves are those that leave the least
squared error over the map (singular value decomposition), or the least with nothing negative.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import BakeError
from .power_law import check_slices, rms_error

MAX_RANK = 4

_BLOCK = 1 << 16
_SAMPLES = 1 << 14  # texels that the non-negative curves are fitted to
_ALTERNATIONS = 100

_F32 = NDArray[np.float32]
_F64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SliceBasis:
    """S(x) ~ sum over j of coefficients[..., j] curves_j(x), never below 0.

    Attributes
    ----------
    coefficients : (H, W, C, rank) float32, relative to a_max
    curves : (rank, N) float32 at x = i / (N - 1), straight lines between; 0 at x = 0, largest magnitude 1
    """

    coefficients: _F32
    curves: _F32

    def evaluate(self, x: ArrayLike) -> _F32:
        """S(x) relative to a_max; x = r / a_max broadcasts against (H, W, C). Stays at its last value above 1."""
        x = np.asarray(x, np.float64)
        nodes = np.linspace(0, 1, self.curves.shape[1])
        value = np.zeros((), np.float32)
        for number, curve in enumerate(self.curves):
            value = value + self.coefficients[..., number] * np.interp(x, nodes, curve).astype(np.float32)
        return np.asarray(np.maximum(value, 0), np.float32)

    def rms(self, slices: NDArray[Any]) -> float:
        """`rms_error` against the slices."""
        return rms_error(slices, self.evaluate)


def fit_basis(slices: NDArray[Any], rank: int, *, nonnegative: bool = False) -> SliceBasis:
    """Curves and coefficients of least squared error over all texels, channels and slices.

    Parameters
    ----------
    slices : (N, H, W, C), slice i at x = i / (N - 1), slice 0 black, relative to a_max
    rank : number of curves, 1 to 4 and below N
    nonnegative : keep curves and coefficients at 0 or above, as 8-bit storage needs it, at a slightly larger error

    Without the constraint the curves are the leading singular vectors of the (N - 1) x (H W C) matrix of the
    slices, found from its small Gram matrix; nothing of this rank comes closer. With it they are found by alternating
    exact non-negative least squares on 16384 texels, the same at every call. Raises BakeError.
    """
    slices = check_slices(slices)
    if isinstance(rank, bool) or not isinstance(rank, int | np.integer) or not 1 <= rank <= MAX_RANK:
        raise BakeError("basis rank", f"is {rank!r}", f"give a whole number from 1 to {MAX_RANK}")
    if rank >= len(slices):
        raise BakeError("basis rank", f"is {rank} for {len(slices)} slices", "give a lower rank or more slices")
    flat = slices.reshape(len(slices), -1)
    curves = _nonnegative_curves(flat[1:], rank) if nonnegative else _singular_curves(flat[1:], rank)
    gram = curves @ curves.T
    solve = _least_nonnegative if nonnegative else _least
    coefficients = np.empty((flat.shape[1], rank), np.float32)
    for start in range(0, len(coefficients), _BLOCK):
        here = slice(start, start + _BLOCK)
        coefficients[here] = solve(gram, curves @ flat[1:, here].astype(np.float64)).T
    padded = np.pad(curves, ((0, 0), (1, 0))).astype(np.float32)
    return SliceBasis(coefficients.reshape(*slices.shape[1:], rank), padded)


def _singular_curves(lit: NDArray[Any], rank: int) -> _F64:
    """(rank, N - 1) leading left singular vectors of (N - 1, texels), pointing up."""
    gram = np.zeros((len(lit), len(lit)))
    for start in range(0, lit.shape[1], _BLOCK):
        block = lit[:, start : start + _BLOCK].astype(np.float64)
        gram += block @ block.T
    # Ascending, and as many as asked for even where the slices span less.
    vectors = np.linalg.eigh(gram)[1][:, ::-1][:, :rank].T
    return _unit_peak(vectors * np.where(vectors.sum(axis=1, keepdims=True) < 0, -1, 1))


def _nonnegative_curves(lit: NDArray[Any], rank: int) -> _F64:
    if lit.shape[1] > _SAMPLES:  # any regular step could fall in with the channels or a weave
        lit = lit[:, np.random.default_rng(0).integers(0, lit.shape[1], _SAMPLES)]
    samples: _F64 = np.maximum(lit.astype(np.float64), 0)
    x = np.arange(1, len(lit) + 1) / len(lit)
    # From early to late rising curves; a rank of 1 starts with x itself, the average of the map.
    exponents = np.geomspace(0.4, 2.5, rank) if rank > 1 else np.ones(1)
    curves: _F64 = x ** exponents[:, None]
    for _ in range(_ALTERNATIONS if samples.any() else 0):
        coefficients = _least_nonnegative(curves @ curves.T, curves @ samples)
        found = _least_nonnegative(coefficients @ coefficients.T, coefficients @ samples.T)
        lost = found.max(axis=1) <= 0  # a curve that no texel uses stays, and may be used again
        found[lost] = curves[lost]
        curves = _unit_peak(found)
    return curves


def _unit_peak(curves: _F64) -> _F64:
    peak = np.abs(curves).max(axis=1, keepdims=True)
    return np.asarray(curves / np.where(peak > 0, peak, 1))


def _least(gram: _F64, projected: _F64) -> _F64:
    """c of least |S - B^T c|^2 for gram = B B^T and projected = B S, (rank, texels)."""
    return np.asarray(np.linalg.pinv(gram, hermitian=True) @ projected)


def _least_nonnegative(gram: _F64, projected: _F64) -> _F64:
    """The same under c >= 0, exactly: the best of all choices of the coefficients that are not 0."""
    rank = len(gram)
    best = np.zeros_like(projected)
    gain = np.zeros(projected.shape[1])
    for count in range(1, rank + 1):
        for chosen in itertools.combinations(range(rank), count):
            kept = list(chosen)
            part = _least(gram[np.ix_(kept, kept)], projected[kept])
            # |S|^2 - |S - B^T c|^2 at the unconstrained optimum of the chosen ones
            part_gain = np.where((part >= 0).all(axis=0), np.einsum("rt,rt->t", part, projected[kept]), -1)
            better = part_gain > gain
            gain[better] = part_gain[better]
            for row in range(rank):
                best[row, better] = part[kept.index(row), better] if row in kept else 0
    return best
