"""A GGX lobe for each texel, of what is brighter than its matte part: the roughness and the strength of its gloss.

The camera looks along z, so light of direction l shows f cos = k D(h) G(l, v) / (4 n . v), D of Walter et al. 2007
(equation 33) and G of Heitz 2014. k stands for Fresnel's reflectance, which at the angles that a lamp above a camera
makes is nearly F0. Only texels that a light comes near to the mirror direction of tell their lobe; the others take the
median of those, for a swatch is mostly one material.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..source import luminance
from .normals import Surface

_CHUNK = 1 << 13
# Roughness as Principled BSDF has it, alpha its square.
ROUGHNESSES: NDArray[np.float64] = np.linspace(0.1, 1.0, 19)
# A lobe is told by a light whose half vector leans from the normal by less than so many widths of the lobe, and that is
# brighter than the matte part by this share.
_SEEN, _STANDS_OUT = 1.5, 0.25
# Share of texels that must tell a lobe before the others are taken to have their median.
_ENOUGH = 0.05


@dataclass(frozen=True, eq=False)
class Gloss:
    """A lobe for each texel.

    roughness : (H, W) as of Principled BSDF, in [0, 1]
    strength : (H, W), about F0, on the scale of the photographs; 0 where none is seen anywhere
    told : (H, W), whether the texel tells its own
    """

    roughness: NDArray[np.float32]
    strength: NDArray[np.float32]
    told: NDArray[np.bool_]

    def shown(self, directions: NDArray[np.float64], normals: NDArray[np.floating]) -> NDArray[np.float32]:
        """What it adds to the photographs (n, H, W) of a surface with these normals (H, W, 3)."""
        count, (height, width) = len(directions), self.roughness.shape
        half = half_vectors(directions)
        n = normals.reshape(-1, 3).astype(np.float64)
        alpha, strength = (x.reshape(-1).astype(np.float64) for x in (self.roughness**2, self.strength))
        shown = np.zeros((count, height * width), np.float32)
        for start in range(0, height * width, _CHUNK):
            part = slice(start, start + _CHUNK)
            tilt = np.clip(half @ n[part].T, 0, 1)
            shown[:, part] = strength[part] * ggx_lobe(alpha[part], directions @ n[part].T, tilt, n[part, 2])
        return shown.reshape(count, height, width)


def fit_gloss(images: NDArray[np.float32], directions: NDArray[np.float64], surface: Surface) -> Gloss:
    """The lobe of each texel; see the module. Arguments as of `photometric_stereo`."""
    count, height, width, _ = images.shape
    seen = luminance(images).reshape(count, -1).astype(np.float64)
    normals = surface.normals.reshape(-1, 3).astype(np.float64)
    matte = luminance(surface.albedo).reshape(-1) / np.pi
    half = half_vectors(directions)
    roughness, strength = np.empty(height * width), np.empty(height * width)
    told = np.zeros(height * width, bool)
    for start in range(0, height * width, _CHUNK):
        part = slice(start, start + _CHUNK)
        n = normals[part]
        lit, tilt = directions @ n.T, np.clip(half @ n.T, 0, 1)
        rest = seen[:, part] - matte[part] * np.maximum(lit, 0)
        # Where less is seen than the matte part, something casts a shadow: no gloss is to be told from that.
        counted = (lit > 0) & (rest > -0.3 * matte[part] * lit)
        found, size, width_of, explains = _best(rest, lit, tilt, n[:, 2], counted)
        roughness[part], strength[part] = found, size
        shows = (rest > _STANDS_OUT * matte[part] * np.maximum(lit, 0)) & counted
        near = np.arccos(tilt) < _SEEN * width_of
        told[part] = (shows & near).any(0) & (size > 0) & explains
    usual = [float(np.median(x[told])) for x in (roughness, strength)] if told.mean() > _ENOUGH else [1.0, 0.0]
    shape = (height, width)
    rough, strong = (
        np.where(told, x, value).reshape(shape).astype(np.float32)
        for x, value in zip((roughness, strength), usual, strict=True)
    )
    return Gloss(rough, strong, told.reshape(shape))


def _best(
    rest: NDArray[np.float64],
    lit: NDArray[np.float64],
    tilt: NDArray[np.float64],
    facing: NDArray[np.float64],
    counted: NDArray[np.bool_],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Roughness, strength, half width in radians (T,), and whether the lobe explains more than half of the rest.

    The least of the errors lies on a parabola through the best of the candidates and its neighbours.
    """
    errors = np.empty((len(ROUGHNESSES), rest.shape[1]))
    for k, roughness in enumerate(ROUGHNESSES):
        _, errors[k] = _strength(float(roughness) ** 2, rest, lit, tilt, facing, counted)
    best = errors.argmin(0)
    middle = np.clip(best, 1, len(ROUGHNESSES) - 2)
    below, there, above = (np.take_along_axis(errors, (middle + step)[None], 0)[0] for step in (-1, 0, 1))
    bend = below - 2 * there + above
    shift = np.where(bend > 0, 0.5 * (below - above) / np.where(bend > 0, bend, 1.0), 0.0)
    between = ROUGHNESSES[middle] + np.clip(shift, -1, 1) * (ROUGHNESSES[1] - ROUGHNESSES[0])
    # At the ends of the candidates the parabola is another candidate's.
    found: NDArray[np.float64] = np.where(best == middle, between, ROUGHNESSES[best]).astype(np.float64)
    strength, least = _strength(found**2, rest, lit, tilt, facing, counted)
    whole = np.maximum((counted * rest**2).sum(0), 1e-30)
    return found, strength, np.arctan(found**2), least < 0.5 * whole


def _strength(
    alpha: float | NDArray[np.float64],
    rest: NDArray[np.float64],
    lit: NDArray[np.float64],
    tilt: NDArray[np.float64],
    facing: NDArray[np.float64],
    counted: NDArray[np.bool_],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Strength of a lobe of this alpha by least squares, and the sum of squares that it leaves, (T,) each."""
    lobe = ggx_lobe(alpha, lit, tilt, facing) * counted
    k = np.maximum((lobe * rest).sum(0) / np.maximum((lobe**2).sum(0), 1e-30), 0)
    return k, (counted * (rest - k * lobe) ** 2).sum(0)


def half_vectors(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Between lights (n, 3) and a camera that looks along z."""
    half = directions + np.array([0.0, 0.0, 1.0])
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    return half


def ggx_lobe(
    alpha: float | NDArray[np.float64], lit: NDArray[np.float64], tilt: NDArray[np.float64], facing: NDArray[np.float64]
) -> NDArray[np.float64]:
    """D G / (4 n . v) of cosines to the light, of the half vector and (T,) to the viewer (Heitz 2014, equation 99).

    As `bake.lobes.microfacets.ggx_lobe`, times the light's cosine, where only cosines are known.
    """
    a2 = alpha * alpha
    d = a2 / (np.pi * (tilt**2 * (a2 - 1) + 1) ** 2)
    c, v = np.maximum(lit, 0), np.maximum(facing, 1e-4)
    lobe: NDArray[np.float64] = d * c / (2 * (v * np.sqrt(a2 + (1 - a2) * c**2) + c * np.sqrt(a2 + (1 - a2) * v**2)))
    return lobe
