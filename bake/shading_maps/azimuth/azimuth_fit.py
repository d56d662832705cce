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

from .azimuth_basis import BLOCK, MAX_RANK, AzimuthBasis, curve_weights, levels_of, node_means
from .level_curve import LevelCurve
from .light_stack import LightStack, relative_error
from .light_weights import PLATES, LightWeights, Plate

Array = NDArray[np.float64]

AZIMUTHS, LEVELS = 32, 40
SMOOTHINGS = (1e-4, 1e-3, 1e-2, 1e-1)
# Radiance in parts of a_max that counts as none.
_DARK = 1e-4
# A level is brought back to its mean by this factor at most: where nothing is left there is nothing to scale up.
_MOST = 2.0
_TINY = 1e-300
_CURVE_STEPS = 64
# Singular values of photographs below this part of the largest are rounding.
_SAME = 1e-7
# Smoothing that lowers the error of photographs left out by less than this part of it is not worth its blur, nor are
# lamps then uneven.
_AS_GOOD = 0.02
# Another plate than the plain one must lower that error by this part of it.
_CLEAR = 0.07
# A higher rank must lower the error of photographs left out by this part of it, or that of those that are there by more
# than this part of their own RMS: between neighbours that stand close, it is theirs.
_WORTH, _LOST = 0.002, 0.02


@dataclass(frozen=True)
class AzimuthChoice:
    """How photographs are interpolated.

    Parameters
    ----------
    smoothing : of `LightWeights`
    even : whether the mean over the texels is the level at every azimuth, as where only lamps differ; else its mean
        over all azimuths is, as where the swatch itself reflects more to some sides
    plate : of `LightWeights`
    """

    smoothing: float
    even: bool
    plate: Plate = "plain"


@dataclass(frozen=True, eq=False)
class Prepared:
    """Photographs lit from every side, and how they are to be interpolated, which takes trials to find.

    Attributes
    ----------
    choice : of all photographs, by which the map is made
    by_fold : of each fold of `LightStack.folds` what is chosen by the errors at photographs of the other folds alone.
        Those are errors of maps that the fold's own photographs are in, so that these are not wholly new to it; but
        their own errors are not chosen to be least
    errors : (n,) squared ones of that, of a map that is not reduced
    """

    products: LightStack
    choice: AzimuthChoice
    by_fold: tuple[AzimuthChoice, ...]
    errors: Array

    @classmethod
    def of(cls, products: LightStack) -> Prepared:
        """With the interpolations that are `chosen`."""
        tried = trials(products)
        folds = products.folds()
        by_fold = tuple(chosen(products.part(kept), {t: e[kept] for t, e in tried.items()}) for kept, _ in folds)
        errors = np.zeros(len(products))
        for (_, left), choice in zip(folds, by_fold, strict=True):
            errors[left] = tried[choice][left]
        return cls(products, chosen(products, tried), by_fold, errors)


@dataclass(frozen=True, eq=False)
class AzimuthFit:
    """A map with what it came from.

    Attributes
    ----------
    curve : levels of lights by their angle
    error : `relative_error` of photographs left out, predicted from the others at the level of their elevation, with
        the interpolation and the rank that are chosen by the errors at photographs of other folds (`Prepared.by_fold`)
    held_out : the same of each photograph: index, level, "rms" in parts of a_max, and "relative" to its own RMS
    lost : mean squares (N - 1,) over texels and azimuths at each level but 0 of what the rank loses, and of the map
        itself, in parts of a_max
    """

    basis: AzimuthBasis
    curve: LevelCurve
    choice: AzimuthChoice
    error: float
    held_out: list[dict[str, float]]
    lost: tuple[Array, Array]


@dataclass(frozen=True, eq=False)
class Nodes:
    """A map over azimuth of no pixels: at each node weights of photographs.

    Attributes
    ----------
    curve : levels of lights by their angle
    weights : (P (N - 1), n) at azimuth p and level i, levels of an azimuth together, in parts of a_max
    x : (N - 1,) the levels, without 0
    """

    curve: LevelCurve
    weights: Array
    x: Array
    azimuths: int = AZIMUTHS

    @classmethod
    def of(cls, stack: LightStack, choice: AzimuthChoice, azimuths: int = AZIMUTHS, levels: int = LEVELS) -> Nodes:
        """Interpolate photographs.

        Beyond the outermost lights the swatch looks as it does under the nearest of them, and darkens with the level,
        as Kautz et al. 2004 go from the lowest photograph to black.
        """
        curve = LevelCurve.of(stack.directions[:, 2], stack.averages)
        phi = 2 * np.pi * np.arange(azimuths) / azimuths
        interpolate = LightWeights(stack.directions, choice.smoothing, curve, choice.plate)
        if not choice.even:
            curve = _mean_curve(stack, interpolate, curve, phi)
        x = levels_of(levels)[1:]
        weights, fading = _around(interpolate, curve, curve.cosine(x), phi)
        seen = weights @ stack.averages
        wanted = np.tile(x * curve.a_max, azimuths)
        if not choice.even:
            faded = (seen * fading).reshape(azimuths, -1)
            wanted *= np.ravel(faded / np.maximum(faded.mean(0), _DARK * curve.a_max))
        # Where extrapolation leaves next to nothing there is nothing to scale up.
        weights *= (wanted / np.maximum(seen, _DARK * curve.a_max) / curve.a_max)[:, None]
        return cls(curve, weights, x, azimuths)

    def reduced(self, stack: LightStack, rank: int) -> tuple[Array, Array, Array]:
        """Curves (rank, P, N), photographs' weights (rank, n) of their coefficients, and the mean square that is lost
        at each level, (N - 1,).

        Coefficients are the leading singular vectors of nodes and photographs together, all in parts of their level:
        dim light counts as the eye counts it. A node counts by the lights that it stands for, of which equally many
        have every cosine to the normal; the photographs together count as much as all nodes, which spread evenly where
        photographs may stand in a row. Nothing of this rank loses less by that measure.
        """
        values, vectors = np.linalg.eigh(stack.products)
        root = vectors * np.sqrt(np.maximum(values, 0))
        level = np.tile(self.x, self.azimuths)[:, None]
        seen = self.weights @ root
        lights = np.tile(np.gradient(np.insert(self.curve.cosine(self.x), 0, 0.0))[1:], self.azimuths)[:, None]
        of_nodes = seen / level * np.sqrt(lights / lights.sum())
        own = np.maximum(stack.averages / self.curve.a_max, _DARK)[:, None]
        of_photographs = root / self.curve.a_max / own / np.sqrt(len(own))
        rows = np.concatenate([of_nodes, of_photographs])
        chosen = np.linalg.eigh(rows.T @ rows)[1][:, ::-1][:, :rank]
        left = seen @ chosen / level
        # Directions of no light, as of photographs that are sums of others, have no weights.
        mixed = chosen.T @ np.linalg.pinv(root, rcond=_SAME)
        peak = np.abs(left).max(0)
        peak = np.where(peak > 0, peak, 1) * np.where(left.sum(0) < 0, -1, 1)
        left, mixed = left / peak, mixed * peak[:, None]
        curves = left.T.reshape(left.shape[1], self.azimuths, len(self.x))
        off = (level * left @ mixed - self.weights) @ root
        return np.concatenate([curves[:, :, :1], curves], -1), mixed, self.by_level(np.square(off).sum(1))

    def by_level(self, squares: Array) -> Array:
        """Means over azimuths (N - 1,) of a number at each node."""
        means: Array = squares.reshape(self.azimuths, len(self.x)).mean(0)
        return means

    def unreduced(self) -> tuple[Array, Array]:
        """Curves (n, P, N) and weights (n, n), of one curve for each photograph."""
        curves = (self.weights / np.tile(self.x, self.azimuths)[:, None]).T.reshape(-1, self.azimuths, len(self.x))
        return np.concatenate([curves[:, :, :1], curves], -1), np.eye(len(curves))

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
    prepared: Prepared | None = None,
    most: int = MAX_RANK,
) -> AzimuthFit:
    """Fit a map over azimuth to photographs (n, H, W, 3) under lights of directions (n, 3).

    Parameters
    ----------
    rank : by default that which is `called_for`, at most `most`
    prepared : these photographs, where they have been tried
    """
    say = progress or (lambda share: None)
    prepared = prepared or Prepared.of(LightStack.of(images, directions))
    say(0.2)
    stack, choice = prepared.products, prepared.choice
    by_rank = {trial: left_out_by_rank(stack, trial, most) for trial in {choice, *prepared.by_fold}}
    nodes, held_out = Nodes.of(stack, choice), foretold(prepared, by_rank, rank)
    errors = by_rank[choice]
    if rank is None:
        rank = called_for(stack, nodes, errors)
    rank = min(rank, len(errors))
    curves, mixed, lost = nodes.reduced(stack, rank)
    say(0.3)
    flat = images.reshape(len(images), -1)
    coefficients = np.empty((flat.shape[1], rank), np.float32)
    for start in range(0, len(coefficients), BLOCK):
        here = slice(start, start + BLOCK)
        coefficients[here] = flat[:, here].T @ mixed.T.astype(np.float32)
        say(0.3 + 0.4 * start / len(coefficients))
    basis = AzimuthBasis(coefficients.reshape(*images.shape[1:], rank), curves.astype(np.float32))
    own = np.diag(stack.products)
    rows = [
        {
            "index": k,
            "level": float(stack.averages[k] / nodes.curve.a_max),
            "rms": float(np.sqrt(held_out[k])) / nodes.curve.a_max,
            "relative": float(np.sqrt(held_out[k] / max(own[k], _TINY))),
        }
        for k in np.argsort(stack.averages, kind="stable").tolist()
    ]
    signal = nodes.by_level(np.einsum("ij,ij->i", nodes.weights @ stack.products, nodes.weights))
    error = relative_error(stack, held_out)
    return AzimuthFit(levelled(basis), nodes.curve, choice, error, rows, (lost, signal))


def called_for(stack: LightStack, nodes: Nodes, errors: list[Array]) -> int:
    """The lowest rank that predicts photographs left out as well as any does, by their errors of each rank from 1 on,
    and that loses next to nothing of those that are there."""
    return max(_predicting(errors), _keeping(stack, nodes, len(errors)))


def _predicting(errors: list[Array]) -> int:
    least = min(found.sum() for found in errors)
    return next(r for r, found in enumerate(errors, 1) if found.sum() <= (1 + _WORTH) ** 2 * least)


def _keeping(stack: LightStack, nodes: Nodes, most: int) -> int:
    _, mixed, _ = nodes.reduced(stack, most)
    own = np.diag(stack.products)
    # Coefficients are orthogonal over the texels.
    crossed = mixed @ stack.products
    shares = np.square(crossed) / np.maximum(np.einsum("ij,ij->i", crossed, mixed), _TINY)[:, None]
    for rank, kept in enumerate(np.cumsum(shares, axis=0), 1):
        if relative_error(stack, np.maximum(own - kept, 0)) < _LOST:
            return rank
    return most


def foretold(prepared: Prepared, by_rank: dict[AzimuthChoice, list[Array]], rank: int | None) -> Array:
    """Squared errors (n,) of photographs left out, with the interpolation, and the rank where none is given, that are
    chosen by the errors at photographs of the other folds, of which the rank also loses next to nothing.

    The least of many trials is too good an error at the photographs by which it is the least.
    """
    stack, found = prepared.products, np.zeros(len(prepared.products))
    for (kept, left), choice in zip(stack.folds(), prepared.by_fold, strict=True):
        errors = by_rank[choice]
        if rank is None:
            used = called_for(part := stack.part(kept), Nodes.of(part, choice), [each[kept] for each in errors])
        else:
            used = min(rank, len(errors))
        found[left] = errors[used - 1][left]
    return found


def trials(stack: LightStack) -> dict[AzimuthChoice, Array]:
    """`left_out` of every interpolation that is tried."""
    choices = (AzimuthChoice(s, even, plate) for plate in PLATES for s in SMOOTHINGS for even in (False, True))
    return {choice: left_out(stack, choice) for choice in choices}


def chosen(stack: LightStack, tried: dict[AzimuthChoice, Array]) -> AzimuthChoice:
    """The interpolation of least smoothing that predicts photographs left out about as well as any, by errors (n,).

    It is by the plain plate, which holds Lambertian texels exactly, unless another is clearly better.
    """
    errors = {trial: relative_error(stack, found) for trial, found in tried.items()}

    def least(plate: Plate, *even: bool) -> float:
        return min(error for t, error in errors.items() if t.plate == plate and t.even in even)

    plate = min(PLATES, key=lambda one: least(one, False, True))
    if least(plate, False, True) > (1 - _CLEAR) * least(PLATES[0], False, True):
        plate = PLATES[0]
    even = least(plate, True) < (1 - _AS_GOOD) * least(plate, False)
    # What is left out has its neighbours farther away than any light between those that are there.
    good = (1 + _AS_GOOD) * least(plate, even)
    return next(t for t, error in errors.items() if (t.plate, t.even) == (plate, even) and error <= good)


def left_out(stack: LightStack, choice: AzimuthChoice) -> Array:
    """Squared errors (n,) of photographs left out, of a map that is not reduced."""
    found = np.zeros(len(stack))
    for kept, left in stack.folds():
        nodes = Nodes.of(stack.part(kept), choice)
        weights = nodes.predicted(*nodes.unreduced(), stack.directions[left])
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
    means = node_means(again).mean(0)
    factor = 1 / np.clip(means, 1 / _MOST, _MOST)
    return replace(again, curves=(curves * np.insert(factor, 0, factor[0])).astype(np.float32))
