"""Tiling by offset and cut: the swatch overlaps itself at the best period and is cut once in either direction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..source import Array
from .seams import cheapest_cut, feathered, gradient_energy, mismatch, reduction, shrink

_SEARCH_SIDE = 256  # texels of the reduced picture that periods are searched in


@dataclass(frozen=True)
class Wrap:
    """One overlap, along x: texel (y, x < W - period) is weights * S[y, x + period] + (1 - weights) * S[y, x]."""

    period: int
    weights: Array

    def apply(self, image: Array) -> Array:
        """(..., H, W, C) -> (..., H, period, C)."""
        overlap = image.shape[-2] - self.period
        result = image[..., : self.period, :].copy()
        weights = self.weights[..., None].astype(image.dtype)
        left = result[..., :overlap, :]
        # In this form weights 0 and 1 give the texels bit by bit.
        left[:] = (1 - weights) * left + weights * image[..., self.period :, :]
        return result

    def choose(self, image: Array) -> Array:
        """Apply as `apply` does, but each texel takes the one with the larger weight."""
        result = image[..., : self.period, :].copy()
        taken = self.weights > 0.5
        result[..., : image.shape[-2] - self.period, :][..., taken, :] = image[..., self.period :, :][..., taken, :]
        return result


@dataclass(frozen=True)
class OffsetPlan:
    """First the overlap in x, then in y."""

    across: Wrap
    down: Wrap

    @property
    def shape(self) -> tuple[int, int]:
        """(H', W')."""
        return self.down.period, self.across.period

    def apply(self, slices: Array) -> Array:
        """(N, H, W, C) -> (N, H', W', C)."""
        flipped = self.down.apply(self.across.apply(slices).swapaxes(-3, -2))
        return np.ascontiguousarray(flipped.swapaxes(-3, -2))

    def source(self, places: Array) -> Array:
        """Texel of the swatch that each texel mostly shows; (H, W, 2) -> (H', W', 2)."""
        return self.down.choose(self.across.choose(places).swapaxes(0, 1)).swapaxes(0, 1)


def plan_offset(features: Array, keep: float, feather: int) -> OffsetPlan:
    """The periods whose cuts show least, and those cuts.

    Between x = period - 1 and x = 0 the swatch simply goes on: the border of a tile lies where nothing is cut.
    The cut in y closes around the tile; the one in x need not, since the cut in y then treats it as part of
    the picture.

    Parameters
    ----------
    features : (H, W, K), see `stack_features`
    keep : smallest share of either side that may be left
    feather : radius of the blend
    """
    across = _plan_wrap(features, keep, feather, closed=False)
    turned = np.ascontiguousarray(across.apply(features).swapaxes(0, 1))
    return OffsetPlan(across, _plan_wrap(turned, keep, feather, closed=True))


def _plan_wrap(features: Array, keep: float, feather: int, closed: bool) -> Wrap:
    period = _best_period(features, keep, feather)
    cuts, _ = cheapest_cut(_overlap_cost(features, gradient_energy(features), period), 2 * feather + 1, closed)
    left = np.arange(features.shape[1] - period) < cuts[:, None]
    # Beyond the overlap only one picture exists, so the blend must end inside it.
    mask = np.concatenate([np.ones_like(left), left, np.zeros_like(left)], axis=1)
    rim = 2 * feather if closed else 0
    weights = feathered(np.pad(mask, ((rim, rim), (0, 0)), mode="wrap"), feather)[rim : rim + len(mask)]
    return Wrap(period, np.ascontiguousarray(weights[:, left.shape[1] : 2 * left.shape[1]]))


def _best_period(features: Array, keep: float, feather: int) -> int:
    """Search in a reduced picture, then close to what was found in ever larger ones."""
    factor = reduction(features.shape, _SEARCH_SIDE)
    period = 0
    while factor:
        allowed = _periods(features.shape[1] // factor, keep, -(-feather // factor))
        near = range(max(2 * period - 2, allowed.start), min(2 * period + 3, allowed.stop)) if period else allowed
        period = _search(shrink(features, factor), near or allowed[-1:], -(-feather // factor))
        factor //= 2
    return period


def _periods(width: int, keep: float, feather: int) -> range:
    least_overlap = min(max(width // 12, 4 * feather + 2), width // 2)
    longest = width - least_overlap
    return range(max(min(int(np.ceil(keep * width)), longest), (width + 1) // 2), longest + 1)


def _search(features: Array, periods: range, feather: int) -> int:
    """The period of least cost for its length: a larger tile is worth a slightly worse cut."""
    gradient = gradient_energy(features)

    def cost(period: int) -> float:
        return (cheapest_cut(_overlap_cost(features, gradient, period), 2 * feather + 1)[1] + 1e-9) / period

    return min(periods, key=cost)


def _overlap_cost(features: Array, gradient: Array, period: int) -> Array:
    rest = features.shape[1] - period
    floor = float(gradient.mean()) + 1e-12
    return mismatch(features[:, period:], features[:, :rest], gradient[:, period:], gradient[:, :rest], floor)
