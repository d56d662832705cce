"""A shading map as m r plus a residual: the part that a native closure of f_r carries, and the rest.

m(s, t) = min over slices of S_i / x_i is the steepest line from black that stays under S everywhere, between the
slices and below the first too, since S is piecewise linear. What is stored are m and the residual slices
S_i - m x_i >= 0; together they are S again, so nothing is stored twice.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..images.storage import Storage, round_down
from .shading_map import ShadingMap


@dataclass(frozen=True, eq=False)
class EnvelopeSplit:
    """`envelope` m (H, W, 3), `residual` (N, H, W, 3) >= 0 with slice 0 black, `share` (H, W) of it in [0, 1]."""

    envelope: NDArray[np.float32]
    residual: NDArray[np.float32]

    @property
    def share(self) -> NDArray[np.float32]:
        """The residual's part of a texel's reflected light, all levels x in [0, 1] being equally frequent.

        That is how a Lambertian swatch is lit by a uniform sky. Channels are summed.
        """
        rest = _mean_over_levels(self.residual).sum(-1)
        return np.divide(rest, rest + 0.5 * self.envelope.sum(-1), out=np.zeros_like(rest), where=rest > 0)

    @property
    def envelope_energy(self) -> float:
        """Part of all reflected light that the envelope carries, by the same measure."""
        carried = 0.5 * float(self.envelope.mean(dtype=np.float64))
        return carried / (carried + float(_mean_over_levels(self.residual).mean(dtype=np.float64)))

    def map(self) -> ShadingMap:
        """The shading map it came from."""
        levels = np.linspace(0, 1, len(self.residual), dtype=np.float32)[:, None, None, None]
        return ShadingMap(self.residual + levels * self.envelope)


def split(shading_map: ShadingMap, storage: Storage = Storage.FLOAT32, scale: float = 1.0) -> EnvelopeSplit:
    """Split off the envelope; m is rounded down to what `storage` holds at `scale`, so that the residual stays >= 0."""
    slices, levels = shading_map.slices, shading_map.levels.astype(np.float32)
    envelope = slices[1] / levels[1]
    for k in range(2, len(slices)):
        np.minimum(envelope, slices[k] / levels[k], out=envelope)
    envelope = round_down(envelope, storage, scale)
    residual = slices - levels[:, None, None, None] * envelope
    return EnvelopeSplit(envelope, np.maximum(residual, 0, out=residual))


def reach(x_peak: float, above: str) -> bool:
    """Whether f_r leaves the levels where m alone is a bound: then m must also stay under S_last / x_peak."""
    return above == "clamp" and x_peak > 1


def bounded_envelope(split_map: EnvelopeSplit, x_peak: float, above: str) -> NDArray[np.float32]:
    """m such that m x <= S(x) for every x up to x_peak."""
    if not reach(x_peak, above):
        return split_map.envelope
    last = split_map.residual[-1] + split_map.envelope
    return np.minimum(split_map.envelope, last / np.float32(x_peak))


def _mean_over_levels(slices: NDArray[Any]) -> NDArray[Any]:
    """Trapezoid rule over x in [0, 1]."""
    return (slices[1:-1].sum(0) + 0.5 * (slices[0] + slices[-1])) / np.float32(len(slices) - 1)
