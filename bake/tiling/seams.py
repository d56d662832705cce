"""What both ways of tiling share: the features seams are judged by, and the cheapest cut between two pictures."""

from __future__ import annotations

import numpy as np

from ..source import Array

_COMPONENTS = 5  # principal components of a stack; more change no cut that was tried
_SAMPLES = 20_000  # texels that the components are computed from
_SMOOTH_WEIGHT = 3.0  # of the smoothed components: noise offers cuts through pictures of unlike brightness


def stack_features(slices: Array) -> tuple[Array, float]:
    """A few channels in which squared differences stand for those of all slices together.

    Every slice counts in the square root of value over mean: dark slices as much as bright ones, and highlights
    no more than they strike the eye. The principal components of these are followed by their local means.

    Parameters
    ----------
    slices : (N, H, W, C)

    Returns
    -------
    features (H, W, K) float32, and the share of the stack's variance that the components hold
    """
    height, width = slices.shape[1:3]
    scale = 1 / np.maximum(slices.mean(axis=(1, 2, 3), dtype=np.float64), 1e-20)
    stride = max(1, height * width // _SAMPLES)
    flat = slices.reshape(len(slices), height * width, -1)
    some = np.sqrt(np.maximum(flat[:, ::stride], 0) * scale[:, None, None])
    some = some.transpose(1, 0, 2).reshape(some.shape[1], -1)
    centred = some - some.mean(axis=0)
    power, directions = np.linalg.eigh(centred.T @ centred)
    directions = directions[:, ::-1][:, :_COMPONENTS]
    # An eigenvector's sign is the library's whim.
    directions = directions * np.sign(directions[np.abs(directions).argmax(axis=0), np.arange(directions.shape[1])])
    components = np.zeros((height * width, directions.shape[1]), np.float32)
    for values, gain, part in zip(flat, scale, np.split(directions, len(slices))):
        components += np.sqrt(np.maximum(values, 0) * np.float32(gain)) @ part.astype(np.float32)
    components -= components.mean(axis=0)
    components = components.reshape(height, width, -1)
    smooth = box_mean(components, max(1, min(height, width) // 48)) * np.float32(_SMOOTH_WEIGHT)
    held = power[::-1][:_COMPONENTS].sum() / power.sum() if power.sum() > 0 else 1.0
    return np.concatenate([components, smooth], axis=2), float(held)


def box_mean(image: Array, radius: int, wrap: bool = False) -> Array:
    """Mean over a square of 2 radius + 1 texels, (H, W, ...) -> same; beyond the border the border or the far side."""
    for axis in (0, 1):
        pad = [(0, 0)] * image.ndim
        pad[axis] = (radius + 1, radius)
        total = np.cumsum(np.pad(image, pad, mode="wrap" if wrap else "edge"), axis=axis, dtype=np.float64)
        size, side = image.shape[axis], 2 * radius + 1
        upper, lower = np.take(total, range(side, size + side), axis), np.take(total, range(size), axis)
        image = ((upper - lower) / side).astype(image.dtype)
    return image


def reduction(shape: tuple[int, ...], side: int) -> int:
    """Power of two that brings the longer side of (H, W, ...) down to `side`, but leaves the shorter one 16 texels."""
    factor = 1
    while max(shape[:2]) > side * factor and min(shape[:2]) >= 32 * factor:
        factor *= 2
    return factor


def shrink(image: Array, factor: int) -> Array:
    """Mean of factor x factor blocks, (H, W, C) -> (H // factor, W // factor, C); a rest is dropped."""
    if factor == 1:
        return image
    height, width = image.shape[0] // factor, image.shape[1] // factor
    blocks = image[: height * factor, : width * factor].reshape(height, factor, width, factor, -1)
    return np.asarray(blocks.mean(axis=(1, 3), dtype=np.float32))


def gradient_energy(image: Array) -> Array:
    """Squared differences to the right and lower neighbours, (H, W, K) -> (H, W); 0 beyond the border."""
    energy = np.zeros(image.shape[:2], np.float32)
    energy[:, :-1] += np.square(np.diff(image, axis=1)).sum(axis=2)
    energy[:-1] += np.square(np.diff(image, axis=0)).sum(axis=2)
    return energy


def mismatch(a: Array, b: Array, gradient_a: Array, gradient_b: Array, floor: float) -> Array:
    """Cost of a cut at each texel: squared difference over the gradient energy there.

    After Kwatra et al. 2003, equation 2, with energies in place of norms: where both pictures are busy a jump hides.
    `floor` is the mean gradient energy of the whole picture.
    """
    difference = np.square(a - b).sum(axis=2)
    return np.asarray(difference / (0.5 * (gradient_a + gradient_b) + floor))


def cheapest_cut(cost: Array, margin: int, closed: bool = False) -> tuple[Array, float]:
    """Path from the top to the bottom between two overlapping pictures, by dynamic programming.

    The path crosses each row once and may run along a row for any length; both kinds of step pay the mismatch of
    the two texels that they part.

    Parameters
    ----------
    cost : (R, O) mismatch in the overlap
    margin : texels kept clear on both sides
    closed : the last row adjoins the first

    Returns
    -------
    cuts (R,): texels left of cuts[y] belong to the left picture; mean cost of one row, in units of `cost`
    """
    rows, width = cost.shape
    low = min(max(1, margin), width // 2)
    high = max(width - max(1, margin), low)
    cost = cost.astype(np.float64)
    across = cost[:, low - 1 : high] + cost[:, low : high + 1]
    along = np.zeros_like(across)  # from one row to the next, summed from the left
    along[:, 1:] = np.cumsum(cost[:, low:high] + np.roll(cost, -1, axis=0)[:, low:high], axis=1)
    if not closed:
        totals = _totals(across, along[:-1])
        path = _trace(totals, along, int(totals[-1].argmin()))
        return path + low, float(totals[-1].min() / (2 * rows))
    # Once round twice, the middle no longer feels the ends: there the closed path starts.
    twice = _totals(np.tile(across, (2, 1)), np.tile(along, (2, 1))[:-1])
    start = int(_trace(twice, np.tile(along, (2, 1)), int(twice[-1].argmin()))[rows])
    across = np.concatenate([across, np.zeros((1, across.shape[1]))])
    opening = np.full(across.shape[1], np.inf)
    opening[start] = across[0, start]
    across[0] = opening
    totals = _totals(across, along)
    return _trace(totals, along, start)[:-1] + low, float(totals[-1, start] / (2 * rows))


def _totals(across: Array, along: Array) -> Array:
    """Cost of the cheapest path that ends at each place; rows of `along` lie between rows of `across`."""
    totals = np.empty_like(across)
    totals[0] = across[0]
    for y, step in enumerate(along, 1):
        before = totals[y - 1]
        from_left = np.minimum.accumulate(before - step) + step
        from_right = np.minimum.accumulate((before + step)[::-1])[::-1] - step
        totals[y] = across[y] + np.minimum(from_left, from_right)
    return totals


def _trace(totals: Array, along: Array, end: int) -> Array:
    path = np.empty(len(totals), np.intp)
    path[-1] = end
    for y in range(len(totals) - 2, -1, -1):
        path[y] = (totals[y] + np.abs(along[y] - along[y, path[y + 1]])).argmin()
    return path


def feathered(mask: Array, radius: int, wrap: bool = False) -> Array:
    """Weights (H, W) float32 that fall from 1 to 0 over about 2 radius texels around the border of a mask.

    They are exactly 0 and 1 from 2 radius texels on.
    """
    weights = mask.astype(np.float32)
    for _ in range(2 if radius else 0):
        weights = box_mean(weights, radius, wrap)
    # The running sums leave rounding where there is nothing to blend.
    return np.asarray(np.where(weights < 1e-5, 0, np.where(weights > 1 - 1e-5, 1, weights)), np.float32)
