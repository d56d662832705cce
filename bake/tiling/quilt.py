"""Tiling by image quilting (Efros & Freeman 2001) on a torus: patches of the swatch, joined along cheapest cuts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..source import Array
from .seams import cheapest_cut, feathered, gradient_energy, mismatch, reduction, shrink

_SEARCH_SIDE = 256  # texels of the reduced picture that patches are searched in
_TOLERANCE = 0.1  # patches this much worse than the best may be drawn, as in the paper
_REUSE = 0.5  # how much a patch suffers that was wholly used before, in units of what the best tenth errs
_BEST = 0.1  # small enough to hold only patches in step where the swatch is regular, hence small errors


@dataclass(frozen=True)
class Patch:
    """Patch of a tile: where it goes and comes from, both (y, x), and its weights (h, w) over what is there."""

    target: tuple[int, int]
    source: tuple[int, int]
    weights: Array


@dataclass(frozen=True)
class QuiltPlan:
    """Patches in the order they are laid."""

    shape: tuple[int, int]
    patches: tuple[Patch, ...]

    def apply(self, slices: Array) -> Array:
        """(N, H, W, C) -> (N, H', W', C)."""
        result = np.zeros((len(slices), *self.shape, slices.shape[3]), slices.dtype)
        for patch in self.patches:
            rows, columns = _torus(patch, self.shape)
            weights = patch.weights[..., None].astype(slices.dtype)
            below = result[:, rows[:, None], columns]
            result[:, rows[:, None], columns] = (1 - weights) * below + weights * _cut_out(slices, patch)
        return result

    def source(self, places: Array) -> Array:
        """Texel of the swatch that each texel mostly shows; (H, W, 2) -> (H', W', 2)."""
        result = np.zeros((*self.shape, 2), places.dtype)
        for patch in self.patches:
            rows, columns = _torus(patch, self.shape)
            here = result[rows[:, None], columns]
            taken = (patch.weights > 0.5)[..., None]
            result[rows[:, None], columns] = np.where(taken, _cut_out(places[None], patch)[0], here)
        return result


def plan_quilt(
    features: Array,
    shape: tuple[int, int],
    patch: int,
    feather: int,
    seed: int,
    progress: Callable[[float], None] | None = None,
) -> QuiltPlan:
    """Lay patches row by row around the torus; the last of a row and of a column meet the first.

    Parameters
    ----------
    features : (H, W, K), see `stack_features`
    shape : (H', W') of the tile; should hold whole periods of a regular swatch
    patch : texels of a patch's side, a third of which overlaps
    progress : called with the share done
    """
    quilt = _Quilt(features, shape, _side(shape, patch), feather, np.random.default_rng(seed))
    spots = [(y, x) for y in _starts(shape[0], quilt.side) for x in _starts(shape[1], quilt.side)]
    patches = []
    for k, spot in enumerate(spots):
        patches.append(quilt.lay(spot))
        if progress:
            progress((k + 1) / len(spots))
    return QuiltPlan(shape, tuple(patches))


def patch_count(shape: tuple[int, int], patch: int) -> int:
    """Number of patches of a tile."""
    side = _side(shape, patch)
    return len(_starts(shape[0], side)) * len(_starts(shape[1], side))


def _side(shape: tuple[int, int], patch: int) -> int:
    # At most two thirds of the tile, so that a patch meets its neighbours and never itself.
    return max(min(patch, 2 * min(shape) // 3), 4)


def _overlap(side: int) -> int:
    return max(side // 3, 1)


def _starts(length: int, side: int) -> list[int]:
    """Evenly spread patch corners, no further apart than side minus overlap."""
    count = -(-length // (side - _overlap(side)))
    return [k * length // count for k in range(count)]


class _Quilt:
    """The tile as it grows, in features."""

    def __init__(
        self, features: Array, shape: tuple[int, int], side: int, feather: int, random: np.random.Generator
    ) -> None:
        self.features, self.shape, self.side, self.feather, self.random = features, shape, side, feather, random
        self.overlap = _overlap(side)
        self.gradient = gradient_energy(features)
        self.floor = float(self.gradient.mean()) + 1e-12
        self.tile = np.zeros((*shape, features.shape[2]), np.float32)
        self.tile_gradient = np.zeros(shape, np.float32)
        self.filled = np.zeros(shape, bool)
        self.search = _PatchSearch(features, side)

    def lay(self, spot: tuple[int, int]) -> Patch:
        rows = (spot[0] + np.arange(self.side)) % self.shape[0]
        columns = (spot[1] + np.arange(self.side)) % self.shape[1]
        there = np.ix_(rows, columns)
        below, known = self.tile[there], self.filled[there]
        source = self.search.find(below, known, self.random)
        piece = (slice(source[0], source[0] + self.side), slice(source[1], source[1] + self.side))
        new = self.features[piece]
        cost = mismatch(below, new, self.tile_gradient[there], self.gradient[piece], self.floor)
        weights = self._weights(np.where(known, cost, 0), known)
        self.tile[there] = below + weights[..., None] * (new - below)
        self.tile_gradient[there] += weights * (self.gradient[piece] - self.tile_gradient[there])
        self.filled[there] = True
        return Patch(spot, source, weights)

    def _weights(self, cost: Array, known: Array) -> Array:
        """1 where the patch shows, 0 where the tile stays: inside the cuts of those sides that meet something."""
        if not known.any():
            return np.ones(known.shape, np.float32)
        mask = np.ones(known.shape, bool)
        for turn in range(4):
            turned_cost, turned_known = np.rot90(cost, turn), np.rot90(known, turn)
            # A side meets something if the middle of its outermost column does: corners belong to two sides.
            if turned_known[self.side // 4 : -self.side // 4 or None, 0].mean() > 0.5:
                cuts, _ = cheapest_cut(turned_cost[:, : self.overlap], 2 * self.feather + 1)
                mask &= np.rot90(np.arange(self.side) >= cuts[:, None], -turn)
        return np.where(known, feathered(mask, self.feather), np.float32(1))


class _PatchSearch:
    """Finds the patch of the swatch that fits what is laid already, by correlation in a reduced picture."""

    def __init__(self, features: Array, side: int) -> None:
        self.features, self.side = features, side
        # A patch keeps at least 8 texels, or its overlap would vanish.
        self.factor = min(reduction(features.shape, _SEARCH_SIDE), 1 << max((side // 8).bit_length() - 1, 0))
        small = shrink(features, self.factor)
        self.size = small.shape[:2]
        self.small_side = side // self.factor
        self.spectrum = np.fft.rfft2(small, axes=(0, 1))
        self.energy = np.fft.rfft2(np.square(small).sum(axis=2))
        self.used = np.zeros(self.size)

    def find(self, below: Array, known: Array, random: np.random.Generator) -> tuple[int, int]:
        """Corner (y, x) in the swatch of a patch that continues `below` (side, side, K) where it is `known`."""
        error = self._errors(shrink(below * known[..., None], self.factor), shrink(known[..., None] * 1.0, self.factor))
        window = np.zeros(self.size)
        window[: self.small_side, : self.small_side] = 1 / self.small_side**2
        reuse = self._valid(np.fft.irfft2(np.fft.rfft2(self.used) * np.fft.rfft2(window).conj(), s=self.size))
        error = np.maximum(error, 0) + _REUSE * np.quantile(error, _BEST) * np.maximum(reuse, 0)
        good = np.argwhere(error <= error.min() * (1 + _TOLERANCE) + 1e-9)
        y, x = good[random.integers(len(good))]
        self.used[y : y + self.small_side, x : x + self.small_side] += 1
        return self._refine(int(y) * self.factor, int(x) * self.factor, below, known)

    def _valid(self, correlation: Array) -> Array:
        reach = [
            min((full - self.side) // self.factor, size - self.small_side) + 1
            for full, size in zip(self.features.shape[:2], self.size)
        ]
        return correlation[: reach[0], : reach[1]]

    def _errors(self, below: Array, known: Array) -> Array:
        """Sum of squared differences for every corner."""
        template = np.zeros((*self.size, below.shape[2]))
        template[: below.shape[0], : below.shape[1]] = below
        mask = np.zeros(self.size)
        mask[: known.shape[0], : known.shape[1]] = known[..., 0]
        product = (self.spectrum * np.fft.rfft2(template, axes=(0, 1)).conj()).sum(axis=2)
        both = np.fft.irfft2(self.energy * np.fft.rfft2(mask).conj() - 2 * product, s=self.size)
        return self._valid(both) + float((np.square(template).sum(axis=2) / np.maximum(mask, 1e-6)).sum())

    def _refine(self, y: int, x: int, below: Array, known: Array) -> tuple[int, int]:
        """The best corner in full size around one found in the reduced picture."""
        if self.factor == 1 or not known.any():
            return y, x
        last_y, last_x = (length - self.side for length in self.features.shape[:2])
        target = below[known]

        def error(corner: tuple[int, int]) -> float:
            piece = self.features[corner[0] : corner[0] + self.side, corner[1] : corner[1] + self.side]
            return float(np.square(piece[known] - target).sum())

        step = self.factor
        while step := step // 2:
            around = [
                (min(max(y + dy, 0), last_y), min(max(x + dx, 0), last_x))
                for dy in (0, -step, step)
                for dx in (0, -step, step)
            ]
            y, x = min(around, key=error)
        return y, x


def _torus(patch: Patch, shape: tuple[int, int]) -> tuple[Array, Array]:
    high, wide = patch.weights.shape
    return (patch.target[0] + np.arange(high)) % shape[0], (patch.target[1] + np.arange(wide)) % shape[1]


def _cut_out(slices: Array, patch: Patch) -> Array:
    high, wide = patch.weights.shape
    y, x = patch.source
    return slices[:, y : y + high, x : x + wide]
