"""The part of a map over azimuth that lies under the native closure, and the residual's share of the rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...images.storage import Storage, round_down, scale_for
from .azimuth_basis import BLOCK, AzimuthBasis, levels_of

# What a shader's float32 sum of 23 products may be off by, in parts of the sum of their magnitudes.
_ROUNDING = np.float32(2e-6)


@dataclass(frozen=True, eq=False)
class AzimuthEnvelope:
    """The part of a map that lies under the native closure.

    Attributes
    ----------
    envelope : m (H, W, 3), the largest with m x <= S at every level and azimuth
    share : (H, W) of the residual S - m x in the light of a texel, all levels and azimuths being equally frequent
    scale : that m is rounded down at, and stored with
    energy : part of the light of the whole swatch that m x carries
    """

    envelope: NDArray[np.float32]
    share: NDArray[np.float32]
    scale: float
    energy: float


def azimuth_envelope(basis: AzimuthBasis, storage: Storage = Storage.FLOAT32) -> AzimuthEnvelope:
    """m, rounded down to what `storage` holds.

    Between the nodes S / x is linear in the position of x at constant phi, and in phi at constant x: its minimum lies
    on a node. Below 0 S is held at 0, and m with it.
    """
    nodes, azimuths = basis.nodes(), basis.curves.shape[1]
    light = np.tile(_light_of_nodes(basis.curves.shape[2]) / azimuths, azimuths).astype(np.float32)
    flat = basis.coefficients.reshape(-1, basis.rank)
    least, mean = np.empty(len(flat), np.float32), np.empty(len(flat), np.float32)
    bound = np.abs(nodes).max(axis=1)
    for start in range(0, len(flat), BLOCK):
        here = slice(start, start + BLOCK)
        slope = flat[here] @ nodes
        least[here] = slope.min(axis=1)
        mean[here] = np.maximum(slope, 0, out=slope) @ light
    least -= _ROUNDING * (np.abs(flat) @ bound)
    shape = basis.coefficients.shape[:3]
    least = np.maximum(least, 0).reshape(shape)
    scale = scale_for(least, storage)
    envelope = round_down(least, storage, scale)
    whole = mean.reshape(shape).sum(-1)
    carried = np.float32(0.5) * envelope.sum(-1)
    share = np.divide(np.maximum(whole - carried, 0), whole, out=np.zeros_like(whole), where=whole > 0)
    total = float(whole.sum(dtype=np.float64))
    return AzimuthEnvelope(envelope, share, scale, float(carried.sum(dtype=np.float64)) / total if total > 0 else 0.0)


def _light_of_nodes(count: int) -> NDArray[np.float64]:
    """Weights of S / x at all nodes but the first, (count - 1,), whose sum is the mean of S over x from 0 to 1.

    Trapezoids in x of S / x, times x: light near black, where the first node lies, is next to none.
    """
    x = levels_of(count)
    middle, step = 0.5 * (x[1:] + x[:-1]), np.diff(x)
    each = np.zeros(count)
    each[1:] += 0.5 * middle * step
    each[:-1] += 0.5 * middle * step
    each[1] += each[0]
    return each[1:]
