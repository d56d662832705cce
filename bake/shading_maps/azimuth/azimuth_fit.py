"""From photographs lit from many sides to a map over azimuth: interpolated, tried on photographs left out, reduced.

At the nodes of level and azimuth the map is a weighted sum of photographs (`LightWeights`), so that all nodes are a
small matrix of weights times the photographs. Of that product the leading singular vectors are found from the
photographs' products with each other, and each texel's coefficients are once more weighted sums of photographs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .azimuth_basis import BLOCK, MAX_RANK, AzimuthBasis, curve_weights, node_means
from .level_curve import LevelCurve
from .light_stack import LightStack, relative_error
from .light_weights import LightWeights

Array = NDArray[np.float64]

AZIMUTHS, LEVELS, MOST_LEVELS = 32, 32, 64
# Median of photographs' averages, in parts of the brightest, below which levels crowd near black.
_DIM = 0.1
SMOOTHINGS = (1e-4, 1e-3, 1e-2, 1e-1)
# Radiance in parts of a_max that counts as none.
_DARK = 1e-4
_CURVE_STEPS = 64
# The rank is spent on errors in parts of the level: dim light counts as the eye counts it.
POWER = 1.0
# Smoothing that lowers the error of photographs left out by less than this part of it is not worth its blur.
_AS_GOOD = 0.02
# A higher rank must lower the error of photographs left out by this part of it.
_WORTH = 0.002


@dataclass(frozen=True)
class AzimuthChoice:
    """How photographs are interpolated.

    Parameters
    ----------
    smoothing : of `LightWeights`
    even : whether the mean over the texels is the level at every azimuth, as where only lamps differ; else its mean
        over all azimuths is, as where the swatch itself reflects more to some sides
    """

    smoothing: float
    even: bool


@dataclass(frozen=True, eq=False)
class AzimuthFit:
    """A map with what it came from.

    Attributes
    ----------
    curve : levels of lights by their angle
    error : `relative_error` of photographs left out, predicted from the others at the level of their elevation
    held_out : the same of each photograph: index, level, "rms" in parts of a_max, and "relative" to its own RMS
    lost : RMS over the nodes that the rank loses, and of the nodes themselves, in parts of a_max
    """

    basis: AzimuthBasis
    curve: LevelCurve
    choice: AzimuthChoice
    error: float
    held_out: list[dict[str, float]]
    lost: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Nodes:
    """A map over azimuth of no pixels: at each node weights of photographs.

    Attributes
    ----------
    curve : levels of lights by their angle
    weights : (P (N - 1), n) at azimuth p and level i, levels of an azimuth together, in parts of a_max
    """

    curve: LevelCurve
    weights: Array
    azimuths: int = AZIMUTHS
    levels: int = LEVELS

    @classmethod
    def of(cls, stack: LightStack, choice: AzimuthChoice, azimuths: int = AZIMUTHS, levels: int = LEVELS) -> Nodes:
        """Interpolate photographs.

        Beyond the outermost lights the swatch looks as it does under the nearest of them, and darkens with the level,
        as Kautz et al. 2004 go from the lowest photograph to black.
        """
        curve = LevelCurve.of(stack.directions[:, 2], stack.averages)
        phi = 2 * np.pi * np.arange(azimuths) / azimuths
        interpolate = LightWeights(stack.directions, choice.smoothing)
        if not choice.even:
            curve = _mean_curve(stack, interpolate, curve, phi)
        x = np.arange(1, levels) / (levels - 1)
        weights, fading = _around(interpolate, curve, curve.cosine(x), phi)
        seen = weights @ stack.averages
        wanted = np.tile(x * curve.a_max, azimuths)
        if not choice.even:
            faded = (seen * fading).reshape(azimuths, -1)
            wanted *= np.ravel(faded / np.maximum(faded.mean(0), _DARK * curve.a_max))
        # Where extrapolation leaves next to nothing there is nothing to scale up.
        weights *= (wanted / np.maximum(seen, _DARK * curve.a_max) / curve.a_max)[:, None]
        return cls(curve, weights, azimuths, levels)

    def reduced(self, stack: LightStack, rank: int) -> tuple[Array, Array, float]:
        """Curves (rank, P, N), photographs' weights (rank, n) of their coefficients, and the RMS that is lost.

        The leading left singular vectors of weights times photographs, all in parts of the level; nothing of this rank
        loses less by that measure.
        """
        values, vectors = np.linalg.eigh(stack.products)
        root = vectors * np.sqrt(np.maximum(values, 0))
        share = 1 / np.tile(np.arange(1, self.levels) / (self.levels - 1), self.azimuths)[:, None] ** POWER
        seen = share * self.weights @ root
        left = seen @ np.linalg.eigh(seen.T @ seen)[1][:, ::-1][:, :rank]
        left, _ = np.linalg.qr(left)
        mixed = left.T @ (share * self.weights)
        left = left / share
        peak = np.abs(left).max(0)
        peak = np.where(peak > 0, peak, 1) * np.where(left.sum(0) < 0, -1, 1)
        left, mixed = left / peak, mixed * peak[:, None]
        curves = np.zeros((left.shape[1], self.azimuths, self.levels))
        curves[:, :, 1:] = left.T.reshape(-1, self.azimuths, self.levels - 1)
        off = (left @ mixed - self.weights) @ root
        return curves, mixed, float(np.sqrt(np.square(off).sum(1).mean()))

    def predicted(self, curves: Array, mixed: Array, directions: Array) -> Array:
        """Weights of photographs (m, n) for lights, each at the level of its elevation, in their own unit."""
        x = self.curve.level(directions[:, 2])
        phi = np.arctan2(directions[:, 1], directions[:, 0])
        return curve_weights(curves, x, phi) @ mixed * self.curve.a_max


def _around(interpolate: LightWeights, curve: LevelCurve, cosines: Array, phi: Array) -> tuple[Array, Array]:
    """Weights of photographs for lights at all cosines of every azimuth, and how much darker than by these weights it
    is there: beyond the outermost lights by the level curve, else 1."""
    radius = np.sqrt(np.maximum(1 - cosines**2, 0))
    within = interpolate.within(np.stack([np.outer(f(phi), radius).ravel() for f in (np.cos, np.sin)], -1))
    there = curve.level(np.sqrt(np.maximum(1 - np.square(within).sum(-1), 0)))
    return interpolate(within), np.tile(curve.level(cosines), len(phi)) / np.maximum(there, _DARK)


def _mean_curve(stack: LightStack, interpolate: LightWeights, curve: LevelCurve, phi: Array) -> LevelCurve:
    """Levels by the mean over all azimuths: lights are seldom spread evenly over them."""
    cosines = np.linspace(0, 1, _CURVE_STEPS + 1)[1:]
    weights, fading = _around(interpolate, curve, cosines, phi)
    return LevelCurve.of(cosines, (weights @ stack.averages * fading).reshape(len(phi), -1).mean(0))


def fit_azimuth(
    images: NDArray[np.float32],
    directions: Array,
    rank: int | None = None,
    progress: Callable[[float], None] | None = None,
    stack: LightStack | None = None,
    most: int = MAX_RANK,
) -> AzimuthFit:
    """Fit a map over azimuth to photographs (n, H, W, 3) under lights of directions (n, 3).

    Parameters
    ----------
    rank : by default the lowest that predicts photographs left out as well as any, at most `most`
    stack : of these photographs, where it is at hand
    """
    say = progress or (lambda share: None)
    stack = stack or LightStack.of(images, directions)
    say(0.2)
    choice = chosen(stack)
    errors = left_out_by_rank(stack, choice, most)
    ranks = range(1, len(errors) + 1)
    if rank is None:
        least = min(found.sum() for found in errors)
        rank = next(r for r in ranks if errors[r - 1].sum() <= (1 + _WORTH) ** 2 * least)
    rank = min(rank, len(errors))
    nodes = Nodes.of(stack, choice, levels=level_count(stack))
    curves, mixed, lost = nodes.reduced(stack, rank)
    say(0.3)
    flat = images.reshape(len(images), -1)
    coefficients = np.empty((flat.shape[1], rank), np.float32)
    for start in range(0, len(coefficients), BLOCK):
        here = slice(start, start + BLOCK)
        coefficients[here] = flat[:, here].T @ mixed.T.astype(np.float32)
        say(0.3 + 0.4 * start / len(coefficients))
    basis = AzimuthBasis(coefficients.reshape(*images.shape[1:], rank), curves.astype(np.float32))
    held_out, own = errors[rank - 1], np.diag(stack.products)
    rows = [
        {
            "index": k,
            "level": float(stack.averages[k] / nodes.curve.a_max),
            "rms": float(np.sqrt(held_out[k])) / nodes.curve.a_max,
            "relative": float(np.sqrt(held_out[k] / max(own[k], 1e-300))),
        }
        for k in np.argsort(stack.averages, kind="stable").tolist()
    ]
    signal = float(np.sqrt(np.einsum("ij,ij->i", nodes.weights @ stack.products, nodes.weights).mean()))
    error = relative_error(stack, held_out)
    return AzimuthFit(levelled(basis), nodes.curve, choice, error, rows, (lost, signal))


def level_count(stack: LightStack) -> int:
    """Levels of the curves: more where a highlight leaves most photographs near black."""
    return LEVELS if np.median(stack.averages) > _DIM * stack.averages.max() else MOST_LEVELS


def chosen(stack: LightStack) -> AzimuthChoice:
    """The interpolation of least smoothing that predicts photographs left out about as well as any."""
    trials = [AzimuthChoice(smoothing, even) for smoothing in SMOOTHINGS for even in (False, True)]
    errors = [relative_error(stack, left_out(stack, choice)) for choice in trials]
    best = trials[int(np.argmin(errors))]
    # What is left out has its neighbours farther away than any light between those that are there.
    good = [e <= (1 + _AS_GOOD) * min(errors) and t.even == best.even for t, e in zip(trials, errors, strict=True)]
    return trials[good.index(True)]


def left_out(stack: LightStack, choice: AzimuthChoice) -> Array:
    """Squared errors (n,) of photographs left out, of a map that is not reduced."""
    found = np.zeros(len(stack))
    for kept, left in stack.folds():
        nodes = Nodes.of(stack.part(kept), choice)
        curves = np.zeros((len(kept), nodes.azimuths, nodes.levels))
        curves[:, :, 1:] = nodes.weights.T.reshape(len(kept), nodes.azimuths, -1)
        weights = nodes.predicted(curves, np.eye(len(kept)), stack.directions[left])
        found[left] = stack.errors(weights, left, kept)
    return found


def left_out_by_rank(stack: LightStack, choice: AzimuthChoice, most: int = MAX_RANK) -> list[Array]:
    """The same by rank, from 1 to `most`, or as many as photographs allow."""
    folds = stack.folds()
    most = min(most, *(len(kept) for kept, _ in folds))
    found = [np.zeros(len(stack)) for _ in range(most)]
    for kept, left in folds:
        part = stack.part(kept)
        nodes = Nodes.of(part, choice)
        curves, mixed, _ = nodes.reduced(part, most)
        for rank, errors in enumerate(found, 1):
            # Those of a lower rank are the first of a higher.
            weights = nodes.predicted(curves[:rank], mixed[:rank], stack.directions[left])
            errors[left] = stack.errors(weights, left, kept)
    return found


def levelled(basis: AzimuthBasis) -> AzimuthBasis:
    """The same with its mean over texels and azimuths at each level the level itself, and one look at the zenith.

    Ranks and values that are held at 0 move the means a little.
    """
    curves = basis.curves.copy()
    curves[:, :, -1] = curves[:, :, -1].mean(1, keepdims=True)
    again = replace(basis, curves=curves)
    means = np.insert(node_means(again).mean(0), 0, 0.0)
    levels = np.linspace(0, 1, len(means))
    factor = np.divide(levels, means, out=np.zeros_like(levels), where=means > 0)
    return replace(again, curves=(curves * factor).astype(np.float32))
