"""Normals, albedo and gloss of a surface by turns: what the one explains, the other no longer has to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..source import luminance
from .gloss import Gloss, fit_gloss
from .normals import Surface, photometric_stereo

_ROUNDS = 3
# Gloss that adds less than this share to what is seen changes nothing that is worth another turn.
_FAINT = 0.01
# A turn serves a texel if it explains the photographs by so much better, without turning the normal by more degrees, or
# leaving less of the albedo: a dark varnish can be all gloss of any normal.
_BETTER, _MOST_TURNED, _LEAST_ALBEDO = 0.9, 12.0, 0.4


def surface_of(
    images: NDArray[np.float32], directions: NDArray[np.float64], progress: Callable[[float], None] | None = None
) -> tuple[Surface, Gloss]:
    """The surface under a GGX lobe for each texel.

    A highlight as wide as the lights are apart is no outlier: some of it stays in the albedo, and pulls normals towards
    the lights. Once a lobe is known it is taken off the photographs, and the matte rest is fitted anew, which a texel
    takes only where that serves it.

    Parameters
    ----------
    images, directions : as of `photometric_stereo`

    Raises
    ------
    BakeError : as `photometric_stereo`
    """
    say = progress or (lambda share: None)
    seen = luminance(images)
    surface = first = photometric_stereo(images, directions, progress=lambda share: say(0.4 * share))
    gloss = fit_gloss(images, directions, surface)
    shown = gloss.shown(directions, surface.normals)
    error = _unexplained(seen, directions, surface, shown)
    say(0.5)
    for turn in range(_ROUNDS - 1):
        if shown.mean() < _FAINT * images.mean():
            break
        other = photometric_stereo(np.maximum(images - shown[..., None], 0), directions)
        lobe = fit_gloss(images, directions, other)
        added = lobe.shown(directions, other.normals)
        left = _unexplained(seen, directions, other, added)
        turned = (other.normals * first.normals).sum(-1) < np.cos(np.radians(_MOST_TURNED))
        dark = luminance(other.albedo) < _LEAST_ALBEDO * luminance(first.albedo)
        better = (left < _BETTER * error) & ~turned & ~dark
        surface = _chosen(better, other, surface)
        gloss = replace(
            gloss,
            roughness=np.where(better, lobe.roughness, gloss.roughness),
            strength=np.where(better, lobe.strength, gloss.strength),
        )
        shown, error = np.where(better, added, shown), np.where(better, left, error)
        say(0.5 + 0.5 * (turn + 1) / (_ROUNDS - 1))
    say(1.0)
    return surface, gloss


def _unexplained(
    seen: NDArray[np.float32], directions: NDArray[np.float64], surface: Surface, shown: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Mean absolute difference (H, W) of the photographs to matte part and gloss together."""
    lit = np.maximum(np.einsum("ni,hwi->nhw", directions, surface.normals), 0)
    error: NDArray[np.float64] = np.abs(seen - lit * luminance(surface.albedo) / np.pi - shown).mean(0)
    return error


def _chosen(where: NDArray[np.bool_], a: Surface, b: Surface) -> Surface:
    """Texels of `a` where that is so, of `b` elsewhere."""
    return Surface(
        np.where(where[..., None], a.normals, b.normals),
        np.where(where[..., None], a.albedo, b.albedo),
        np.where(where, a.weights, b.weights),
        np.where(where, a.misfit, b.misfit),
    )
