"""How visible the seams of a tile are, measured against the picture itself."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..source import Array
from .seams import reduction, shrink

SCALES = (1, 4, 16)  # texels over which steps are looked for: hard edges, broken strands, unlike brightness
_WINDOW = 5
_SIDE = 256  # texels of the reduced picture whose windows are compared
_DIMENSIONS = 24
_SAMPLES = 384  # windows on seams, and as many elsewhere
_UNSEEN = 0.02  # distance of windows that differ by a fraction of a percent: no eye distinguishes them
_FEWEST = 6  # pairs of blocks on a seam that still make a statistic


def seam_facts(slices: Array, source: Array, features: Array, swatch: Array, seed: int) -> dict[str, Any]:
    """Steps and novelty of a tile's seams, JSON-ready.

    Parameters
    ----------
    slices, source : see `seam_steps`
    features, swatch, seed : see `seam_novelty`

    Returns
    -------
    "steps", "novelty", and "visibility": the larger of novelty and worst over expected step; up to 1 nothing is seen
    """
    steps = seam_steps(slices, source)
    novelty = seam_novelty(features, source, swatch, seed)
    visibility = max(novelty, steps["worst"] / max(steps["expected"], 1.0))
    return {"visibility": round(visibility, 3), "novelty": round(novelty, 3), "steps": steps}


def seam_steps(slices: Array, source: Array) -> dict[str, Any]:
    """Steps across seams against those between all other neighbours, as ratio of root mean squares.

    Two neighbouring texels of the endlessly repeated tile have a seam between them unless they are neighbours
    in the swatch too. Compared are the square roots of the values, in single texels and in means of 4 x 4 and
    16 x 16, separately in either direction.

    Parameters
    ----------
    slices : (N, H, W, C) tile
    source : (H, W, 2) texel (y, x) of the swatch that each texel shows

    Returns
    -------
    per slice the largest ratio of all scales and directions ("per_slice"), its maximum ("worst"), and "expected":
    the largest ratio that a line of the seams' shape has in 19 of 20 places of the tile. Up to that, a seam
    cannot be distinguished from the picture; without any seam all are 0
    """
    ratios, expected = np.zeros(len(slices)), np.zeros(len(slices))
    for scale in SCALES:
        height, width = slices.shape[1] // scale, slices.shape[2] // scale
        middle = source[scale // 2 :: scale, scale // 2 :: scale][:height, :width]
        for axis in (0, 1):
            if min(height, width) < 4:
                continue
            seam = _breaks(middle, scale, axis)
            if min(seam.sum(), (~seam).sum()) < _FEWEST:
                continue
            shape = np.fft.rfft2(seam / seam.sum())
            for n, values in enumerate(slices):
                energy = _step_energy(np.sqrt(np.maximum(shrink(values, scale), 0)), axis)
                usual = energy[~seam].mean() + 1e-9 * values.mean(dtype=np.float64) + 1e-30
                ratios[n] = max(ratios[n], np.sqrt(energy[seam].mean() / usual))
                energy[seam] = usual  # or a strong seam would vouch for itself
                elsewhere = np.fft.irfft2(np.fft.rfft2(energy) * shape.conj(), s=energy.shape)
                expected[n] = max(expected[n], np.sqrt(max(np.quantile(elsewhere, 0.95), 0) / usual))
    worst = int(ratios.argmax())
    return {
        "per_slice": [round(float(r), 3) for r in ratios],
        "worst": round(float(ratios[worst]), 3),
        "expected": round(float(expected[worst]), 3),
    }


def _breaks(source: Array, scale: int, axis: int) -> Array:
    """Whether a texel and the next along the axis, around the tile, are not `scale` apart in the swatch."""
    step = np.roll(source, -1, axis=axis) - source
    step[..., axis] -= scale
    # Blocks of a repeated whole may be cut off by a rest, hence the tolerance.
    return np.asarray(np.abs(step).max(axis=2) > scale // 2)


def _step_energy(image: Array, axis: int) -> Array:
    return np.square(np.roll(image, -1, axis=axis) - image).sum(axis=2, dtype=np.float64)


def seam_novelty(tile: Array, source: Array, swatch: Array, seed: int) -> float:
    """Novelty of seams: how much less their surroundings look like the swatch than it looks like itself.

    Windows around seams are looked up in the swatch, and as many windows of the swatch in its remainder. The
    result is the ratio of the mean distances to the nearest: near 1 nothing on the seams is foreign to
    the swatch, larger means strands that break or tones that do not meet. Steps miss a broken thread, this does not.

    Parameters
    ----------
    tile, swatch : (H', W', K), (H, W, K) features of both
    source : (H', W', 2) texel of the swatch that each texel shows
    """
    factor = reduction(swatch.shape, _SIDE)
    small, small_tile = shrink(swatch, factor), shrink(tile, factor)
    if min(*small.shape[:2], *small_tile.shape[:2]) < 2 * _WINDOW:
        return 1.0
    middle = source[factor // 2 :: factor, factor // 2 :: factor][: small_tile.shape[0], : small_tile.shape[1]]
    seam = _breaks(middle, factor, 0) | _breaks(middle, factor, 1)
    if not seam.any():
        return 1.0
    random = np.random.default_rng(seed)
    basis = _window_basis(small, random)
    known = _windows(small, basis)
    height, width = known.shape[:2]
    half = _WINDOW // 2
    wrapped = np.pad(small_tile, ((half, half), (half, half), (0, 0)), mode="wrap")
    at_seams = _pick(_windows(wrapped, basis)[seam], random)
    places = np.stack(np.divmod(_pick(np.arange(height * width), random), width), axis=1)
    usual = _to_nearest(known[tuple(places.T)], known, places)
    return float((_to_nearest(at_seams, known, None) + _UNSEEN) / (usual + _UNSEEN))


def _window_basis(image: Array, random: np.random.Generator) -> Array:
    """Principal directions (window, window, K, D) of the windows of an image."""
    half = _WINDOW // 2
    y = random.integers(half, image.shape[0] - half, 4000)[:, None, None] + np.arange(-half, half + 1)[:, None]
    x = random.integers(half, image.shape[1] - half, 4000)[:, None, None] + np.arange(-half, half + 1)
    some = image[y, x].reshape(len(y), -1)
    some = some - some.mean(axis=0)
    directions = np.linalg.eigh(some.T @ some)[1][:, : -_DIMENSIONS - 1 : -1]
    return directions.reshape(_WINDOW, _WINDOW, image.shape[2], -1)


def _windows(image: Array, basis: Array) -> Array:
    """Coordinates (H - window + 1, W - window + 1, D) of all windows."""
    height, width = image.shape[0] - _WINDOW + 1, image.shape[1] - _WINDOW + 1
    result = np.zeros((height * width, basis.shape[3]), np.float32)
    for dy in range(_WINDOW):
        for dx in range(_WINDOW):
            result += image[dy : dy + height, dx : dx + width].reshape(height * width, -1) @ basis[dy, dx]
    return result.reshape(height, width, -1)


def _pick(items: Array, random: np.random.Generator) -> Array:
    return items if len(items) <= _SAMPLES else items[random.choice(len(items), _SAMPLES, replace=False)]


def _to_nearest(queries: Array, known: Array, places: Array | None) -> float:
    """Mean distance to the nearest known window, leaving out those near the query's own place."""
    flat = known.reshape(-1, known.shape[2])
    norms = np.square(flat).sum(axis=1)
    y, x = np.divmod(np.arange(len(flat)), known.shape[1])
    total = 0.0
    for k, query in enumerate(queries):
        distance = norms - 2 * (flat @ query)
        if places is not None:
            distance[np.maximum(np.abs(y - places[k, 0]), np.abs(x - places[k, 1])) < _WINDOW // 2] = np.inf
        total += np.sqrt(max(float(distance.min()) + float(np.square(query).sum()), 0.0))
    return total / len(queries)
