"""Normal, matte part and gloss of a texel together, for swatches whose gloss outshines their matte part.

Where a wide lobe is most of what is seen, no light is free of it: a fit that takes gloss for an outlier finds slopes
twice as steep, for a highlight follows the half vector. Here the whole law, rho / pi n . l + k D(h) G / (4 n . v)
with one roughness for the swatch (as of `gloss`), is fitted to every texel: rho and k, which enter linearly and are
not negative, are solved for at every step (variable projection, Golub & Pereyra 1973), slopes by the steps of
Levenberg and Marquardt with Cauchy weights, from the normal found before, from half its slope and from none,
whichever ends best.

It is taken for a swatch only where it explains its photographs nearly whole, which a lobe of another form, or shadows
within the texels, do not let it: cloth and suede stay as they were.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..source import luminance
from .gloss import ROUGHNESSES, Gloss, ggx_lobe, half_vectors
from .normals import CAUCHY, LEAST_SPREAD, Surface

Array = NDArray[Any]
# Texels that roughness is chosen by, and every how many of the candidates are tried.
_TRIED, _EVERY = 256, 2
# Rounds of every start, and of the best one.
_FIRST, _THEN = 6, 10
_CHUNK = 1 << 14
# The whole law is believed where it leaves less of the mean brightness than this in the median, over photographs and
# texels, and that is less than this part of what was left before: 0.003 to 0.004 of plastic whose lobe is GGX, 0.02 to
# 0.12 of other forms and of fibres.
_LEFT, _BETTER = 0.012, 0.5
_LONGEST_STEP, _DIFFERENCE = 0.3, 1e-4
# Of roughness: the least, and the steps that it is known to.
_LEAST, _FINEST = 0.05, 0.01


def joint_surface(
    images: NDArray[np.float32],
    directions: NDArray[np.float64],
    surface: Surface,
    left: Array,
    progress: Callable[[float], None] | None = None,
) -> tuple[Surface, Gloss] | None:
    """The surface and its gloss by the whole law; None where that does not explain the photographs.

    Parameters
    ----------
    images, directions : as of `photometric_stereo`
    surface : to start from
    left : (H, W), mean absolute difference that it and its gloss leave of the photographs
    """
    say = progress or (lambda share: None)
    count, height, width, _ = images.shape
    seen = luminance(images).reshape(count, -1).astype(np.float64)
    start = surface.normals.reshape(-1, 3).astype(np.float64)
    chosen = np.random.default_rng(0).choice(len(start), min(_TRIED, len(start)), replace=False)
    problem = _Problem(seen[:, chosen], directions)
    roughness, least = _roughness(problem, start[chosen])
    mean = max(float(problem.seen.mean()), 1e-30)
    before = float(np.median(left.reshape(-1)[chosen])) / mean
    if least / mean > _LEFT or least / mean > _BETTER * before:
        return None
    parts = []
    for first in range(0, len(start), _CHUNK):
        part = slice(first, first + _CHUNK)
        found = _better_of(_Problem(seen[:, part], directions), start[part], roughness**2)
        parts.append(_surface_of(images.reshape(count, -1, 3)[:, part], directions, found, roughness**2))
        say(min((first + _CHUNK) / len(start), 1.0))
    normals, albedo, strength, off = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    shape = (height, width)
    made = replace(
        surface,
        normals=normals.reshape(*shape, 3).astype(np.float32),
        albedo=albedo.reshape(*shape, 3).astype(np.float32),
        misfit=off.reshape(shape).astype(np.float32),
    )
    strong = strength.reshape(shape).astype(np.float32)
    return made, Gloss(np.full(shape, roughness, np.float32), strong, strong > 0)


@dataclass(frozen=True, eq=False)
class _Fit:
    """Slopes p, q, what is linear, the difference (n, T), and the weights of the photographs."""

    p: Array
    q: Array
    rho: Array
    strength: Array
    off: Array
    weight: Array

    @property
    def normals(self) -> Array:
        found: Array = np.stack([-self.p, -self.q, np.ones_like(self.p)], -1)
        return found / np.linalg.norm(found, axis=-1, keepdims=True)

    @property
    def left(self) -> Array:
        """Mean absolute difference (T,)."""
        found: Array = np.abs(self.off).mean(0)
        return found


class _Problem:
    """Texels with values (n, T) under lights (n, 3)."""

    def __init__(self, seen: Array, directions: Array) -> None:
        self.seen, self.directions, self.half = seen, directions, half_vectors(directions)
        self._level = np.maximum(np.median(seen, axis=0), 1e-12)

    def solved(self, p: Array, q: Array, alpha: float, weight: Array) -> _Fit:
        """The linear part at these slopes, by weighted least squares without negative values."""
        normals = np.stack([-p, -q, np.ones_like(p)], -1)
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        lit = np.maximum(self.directions @ normals.T, 0)
        matte = lit / np.pi
        lobe = ggx_lobe(alpha, lit, np.clip(self.half @ normals.T, 0, 1), normals[:, 2])
        mm, ml, ll = ((weight * a * b).sum(0) for a, b in ((matte, matte), (matte, lobe), (lobe, lobe)))
        ms, ls = (weight * matte * self.seen).sum(0), (weight * lobe * self.seen).sum(0)
        scale = np.maximum(mm * ll - ml * ml, 1e-30)
        rho, strength = (ll * ms - ml * ls) / scale, (mm * ls - ml * ms) / scale
        alone = ms / np.maximum(mm, 1e-30), ls / np.maximum(ll, 1e-30)
        rho, strength = (
            np.where(rho < 0, 0, np.where(strength < 0, alone[0], rho)),
            np.where(rho < 0, alone[1], np.where(strength < 0, 0, strength)),
        )
        return _Fit(p, q, rho, strength, self.seen - rho * matte - strength * lobe, weight)

    def weights(self, off: Array) -> Array:
        """Cauchy's, by the median of the differences."""
        middle = 1.4826 * np.median(np.abs(off), axis=0)
        weight: Array = 1 / (1 + (off / (CAUCHY * np.maximum(middle, LEAST_SPREAD * self._level))) ** 2)
        return weight

    def fitted(self, start: _Fit | Array, alpha: float, rounds: int) -> _Fit:
        """By so many steps from a fit or from normals (T, 3)."""
        if isinstance(start, _Fit):
            fit = start
        else:
            z = np.maximum(start[:, 2], 0.05)
            fit = self.solved(-start[:, 0] / z, -start[:, 1] / z, alpha, np.ones_like(self.seen))
        damping = np.full(len(fit.p), 1e-2)
        for _ in range(rounds):
            fit = self.solved(fit.p, fit.q, alpha, self.weights(fit.off))
            weight = fit.weight
            across = (self.solved(fit.p + _DIFFERENCE, fit.q, alpha, weight).off - fit.off) / _DIFFERENCE
            up = (self.solved(fit.p, fit.q + _DIFFERENCE, alpha, weight).off - fit.off) / _DIFFERENCE
            a, b, c = ((weight * x * y).sum(0) for x, y in ((across, across), (across, up), (up, up)))
            g, h = (weight * across * fit.off).sum(0), (weight * up * fit.off).sum(0)
            a, c = a * (1 + damping) + 1e-30, c * (1 + damping) + 1e-30
            scale = np.maximum(a * c - b * b, 1e-300)
            p, q = -(c * g - b * h) / scale, -(a * h - b * g) / scale
            held = np.minimum(1, _LONGEST_STEP / np.maximum(np.hypot(p, q), 1e-12))
            other = self.solved(fit.p + held * p, fit.q + held * q, alpha, weight)
            better = (weight * other.off**2).sum(0) < (weight * fit.off**2).sum(0)
            fit = _chosen(better, other, fit)
            damping = np.where(better, 0.3 * damping, 5 * damping)
        return fit


def _chosen(better: Array, a: _Fit, b: _Fit) -> _Fit:
    return _Fit(*(np.where(better, getattr(a, name), getattr(b, name)) for name in _Fit.__dataclass_fields__))


def _better_of(problem: _Problem, start: Array, alpha: float) -> _Fit:
    """From all starts, and on from the best."""
    half = start * [1.0, 1.0, 2.0]
    best = problem.fitted(start, alpha, _FIRST)
    for other in (half, np.broadcast_to([0.0, 0.0, 1.0], start.shape)):
        fit = problem.fitted(other, alpha, _FIRST)
        best = _chosen(fit.left < best.left, fit, best)
    return problem.fitted(best, alpha, _THEN)


def _roughness(problem: _Problem, start: Array) -> tuple[float, float]:
    """The roughness that leaves the least, by ever narrower steps about the best candidate, and the median of what is
    left then."""

    @cache
    def left(roughness: float) -> tuple[float, float]:
        fit = _better_of(problem, start, roughness**2)
        return float(fit.left.mean()), float(np.median(np.abs(fit.off)))

    best = min((round(float(r), 6) for r in ROUGHNESSES[::_EVERY]), key=left)
    step = _EVERY * float(ROUGHNESSES[1] - ROUGHNESSES[0])
    while step > _FINEST:
        step /= 2
        best = min((best, *(round(min(max(best + way * step, _LEAST), 1.0), 6) for way in (-1, 1))), key=left)
    return best, left(best)[1]


def _surface_of(pixels: Array, directions: Array, fit: _Fit, alpha: float) -> tuple[Array, Array, Array, Array]:
    """Normals, albedo by channel, strength, and the misfit as of `Surface`."""
    normals = fit.normals
    lit = np.maximum(directions @ normals.T, 0)
    lobe = ggx_lobe(alpha, lit, np.clip(half_vectors(directions) @ normals.T, 0, 1), normals[:, 2])
    matte = pixels - (fit.strength * lobe)[..., None]
    power = np.maximum((fit.weight * lit**2).sum(0), 1e-12)
    albedo = np.pi * np.maximum(np.einsum("nt,ntc->tc", fit.weight * lit, matte) / power[:, None], 0)
    believed = np.maximum(fit.weight.sum(0), 1e-12)
    mean = np.maximum((fit.weight * luminance(pixels)).sum(0) / believed, 1e-12)
    return normals, albedo, fit.strength, np.sqrt((fit.weight * fit.off**2).sum(0) / believed) / mean
