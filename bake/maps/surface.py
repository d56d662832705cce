"""Normals, albedo and gloss of a surface by turns: what the one explains, the other no longer has to."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..source import luminance
from .gloss import Gloss, fit_gloss
from .joint import joint_surface
from .normals import Surface, photometric_stereo

_ROUNDS = 3
# Texels that are fitted at a time.
_CHUNK = 1 << 16
# A turn serves a texel if it explains the photographs by so much better, without turning the normal by more degrees, or
# leaving less of the albedo: a dark varnish can be all gloss of any normal.
_BETTER, _MOST_TURNED, _LEAST_ALBEDO = 0.9, 12.0, 0.4
# A swatch has gloss if with it less is left than this part of what the matte part alone leaves, where it is told: 0.4
# to 0.7 of plates and stone that have some, 0.9 to 0.95 of suede and wool, whose fibres only look so.
_WORTH = 0.85
Part = TypeVar("Part", Surface, Gloss)


def surface_of(
    images: NDArray[np.float32], directions: NDArray[np.float64], progress: Callable[[float], None] | None = None
) -> tuple[Surface, Gloss]:
    """The surface under a GGX lobe for each texel.

    A highlight as wide as the lights are apart is no outlier: some of it stays in the albedo, and pulls normals towards
    the lights. Once a lobe is known it is taken off the photographs, and the matte rest is fitted anew, which a texel
    takes only where that serves it. Where a lobe outshines the matte part, both are fitted at once (`joint`).

    Parameters
    ----------
    images, directions : as of `photometric_stereo`

    Raises
    ------
    BakeError : as `photometric_stereo`
    """
    say = progress or (lambda share: None)
    rows = max(1, _CHUNK // images.shape[2])
    parts = [slice(start, start + rows) for start in range(0, images.shape[1], rows)]
    surface = _by_parts(lambda part: photometric_stereo(images[:, part], directions), parts, lambda x: say(0.4 * x))
    first, gloss = surface, fit_gloss(images, directions, surface)
    say(0.5)
    for turn in range(_ROUNDS - 1):
        if not gloss.strength.any():
            break
        matte = partial(_matte, images, directions, surface, gloss)
        other = _by_parts(matte, parts)
        lobe = fit_gloss(images, directions, other)
        turned = (other.normals * first.normals).sum(-1) < np.cos(np.radians(_MOST_TURNED))
        dark = luminance(other.albedo) < _LEAST_ALBEDO * luminance(first.albedo)
        before, after = (_left(images, directions, *pair, parts) for pair in ((surface, gloss), (other, lobe)))
        better = (after < _BETTER * before) & ~turned & ~dark
        if not better.any():
            break
        surface, gloss = _chosen(better, other, surface), _chosen(better, lobe, gloss)
        say(0.5 + 0.3 * (turn + 1) / (_ROUNDS - 1))
    if gloss.strength.any():
        bare = Gloss(np.ones_like(gloss.roughness), np.zeros_like(gloss.strength), np.zeros_like(gloss.told))
        left, alone = (_left(images, directions, *pair, parts) for pair in ((surface, gloss), (first, bare)))
        if left[gloss.told].sum() > _WORTH * alone[gloss.told].sum():
            surface, gloss, left = first, bare, alone
        whole = joint_surface(images, directions, surface, left, lambda share: say(0.8 + 0.2 * share))
        if whole is not None:
            better = _left(images, directions, *whole, parts) < left
            surface, gloss = _chosen(better, whole[0], surface), _chosen(better, whole[1], gloss)
    say(1.0)
    return surface, gloss


def _matte(
    images: NDArray[np.float32], directions: NDArray[np.float64], surface: Surface, gloss: Gloss, part: slice
) -> Surface:
    """Rows of a surface of what the gloss leaves."""
    known, lobes = _cut(part, surface, gloss)
    shown = lobes.shown(directions, known.normals)
    return photometric_stereo(np.maximum(images[:, part] - shown[..., None], 0), directions)


def _by_parts(
    made: Callable[[slice], Surface], parts: Sequence[slice], progress: Callable[[float], None] | None = None
) -> Surface:
    """A surface made by rows, which takes the memory of few."""
    found = []
    for done, part in enumerate(parts, 1):
        found.append(made(part))
        if progress:
            progress(done / len(parts))
    return Surface(*(np.concatenate([getattr(one, f.name) for one in found]) for f in fields(Surface)))


def _cut(part: slice, surface: Surface, gloss: Gloss) -> tuple[Surface, Gloss]:
    """Rows of both."""
    return (
        Surface(*(getattr(surface, f.name)[part] for f in fields(Surface))),
        Gloss(*(getattr(gloss, f.name)[part] for f in fields(Gloss))),
    )


def _left(
    images: NDArray[np.float32],
    directions: NDArray[np.float64],
    surface: Surface,
    gloss: Gloss,
    parts: Sequence[slice],
) -> NDArray[np.float64]:
    """`_unexplained` of a whole swatch (H, W), by rows."""
    return np.concatenate([_unexplained(images[:, part], directions, *_cut(part, surface, gloss)) for part in parts])


def _unexplained(
    images: NDArray[np.float32], directions: NDArray[np.float64], surface: Surface, gloss: Gloss
) -> NDArray[np.float64]:
    """Mean absolute difference (H, W) of the photographs to matte part and gloss together."""
    lit = np.maximum(np.einsum("ni,hwi->nhw", directions, surface.normals), 0)
    explained = lit * luminance(surface.albedo) / np.pi + gloss.shown(directions, surface.normals)
    error: NDArray[np.float64] = np.abs(luminance(images) - explained).mean(0)
    return error


def _chosen(where: NDArray[np.bool_], a: Part, b: Part) -> Part:
    """Texels of `a` where that is so, of `b` elsewhere."""
    arrays = [(f.name, getattr(a, f.name), getattr(b, f.name)) for f in fields(a)]
    picked = {name: np.where(where[..., None] if x.ndim == 3 else where, x, y) for name, x, y in arrays}
    return replace(b, **picked)
