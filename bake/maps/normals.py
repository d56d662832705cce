"""Photometric stereo: the normal and the albedo of each texel, from how bright it is under each light.

A matte texel of albedo rho and normal n shows rho / pi n . l under a light of direction l and unit irradiance (Woodham
1980, "Photometric method for determining surface orientation from multiple images"): three lights determine rho n, more
of them by least squares. Cloth and paint are not that matte: texels lie in the shadow of their neighbours, and shine.
Both are outliers of the linear law, the one below it, the other above. So the fit begins with the lights that are
neither the darkest nor the brightest of a texel, and is repeated with Cauchy weights (Holland & Welsch 1977) of what it
leaves, narrower above the law than below it, for gloss is common and deep shadow is not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import BakeError
from ..source import luminance

_CHUNK = 1 << 14
_ROUNDS = 12
# Of a texel's lights, in order of brightness: those that the first fit leaves out at either end.
_DARKEST, _BRIGHTEST = 0.25, 0.2
# Cauchy's constant for 95 % efficiency where errors are normal, and the part of it that is used above the law.
CAUCHY, _ABOVE = 2.385, 0.6
# Deviations below this part of a texel's brightness are noise of any photograph.
LEAST_SPREAD = 0.01
# Directions whose least singular value is below this part of the largest lie in one plane, but for errors of reading.
_PLANE = 0.08
_LEAST_LIGHTS = 4


@dataclass(frozen=True, eq=False)
class Surface:
    """What each texel is.

    normals : (H, W, 3) unit vectors, x right, y up, z to the camera
    albedo : (H, W, 3), linear Rec.709, on the scale of the photographs times pi
    misfit : (H, W), RMS of what the law leaves, in parts of the mean, photographs counting as far as they are believed
    """

    normals: NDArray[np.float32]
    albedo: NDArray[np.float32]
    misfit: NDArray[np.float32]


def photometric_stereo(
    images: NDArray[np.float32],
    directions: NDArray[np.float64],
    *,
    robust: bool = True,
) -> Surface:
    """Normals and albedo of texels from photographs.

    Parameters
    ----------
    images : (n, H, W, 3), linear, f cos(theta_i) in 1/sr or on any one scale
    directions : (n, 3), unit vectors to the lights, as of `Surface.normals`
    robust : by repeated weights; else plain least squares (Woodham 1980), which gloss and shadow pull off

    Raises
    ------
    BakeError : fewer than four lights, or all of them in one plane
    """
    check_directions(directions)
    count, height, width, _ = images.shape
    bright = luminance(images).reshape(count, -1).astype(np.float64)
    pixels = images.reshape(count, -1, 3)
    normals = np.empty((height * width, 3), np.float32)
    albedo = np.empty_like(normals)
    misfit = np.empty(height * width, np.float32)
    for start in range(0, height * width, _CHUNK):
        part = slice(start, start + _CHUNK)
        seen = bright[:, part]
        found, weight = _fit(seen, directions, robust)
        length = np.linalg.norm(found, axis=-1, keepdims=True)
        unit = np.where(length > 0, found / np.where(length > 0, length, 1), [0.0, 0.0, 1.0])
        # A texel that is seen faces the camera.
        unit[:, 2] = np.maximum(unit[:, 2], 0.02)
        unit /= np.linalg.norm(unit, axis=-1, keepdims=True)
        lit = np.maximum(directions @ unit.T, 0)
        power = np.maximum((weight * lit**2).sum(0), 1e-12)
        scale = np.einsum("nt,ntc->tc", weight * lit, pixels[:, part]) / power[:, None]
        off = seen - lit * luminance(scale)
        believed = np.maximum(weight.sum(0), 1e-12)
        mean = np.maximum((weight * seen).sum(0) / believed, 1e-12)
        normals[part], albedo[part] = unit, np.pi * scale
        misfit[part] = np.sqrt((weight * off**2).sum(0) / believed) / mean
    shape = (height, width)
    return Surface(normals.reshape(*shape, 3), albedo.reshape(*shape, 3), misfit.reshape(shape))


def check_directions(directions: NDArray[np.float64] | None) -> None:
    """Raise BakeError where these lights do not tell a normal."""
    if directions is None:
        raise BakeError("lights", "have no known directions", "give a lights file, or angles in the file names")
    if len(directions) < _LEAST_LIGHTS:
        cause = f"are {len(directions)} only, but normals that bear a shadow need {_LEAST_LIGHTS}"
        raise BakeError("lights", cause, "photograph it under eight or more, from all sides")
    values = np.linalg.svd(directions, compute_uv=False)
    if values[2] < _PLANE * values[0]:
        remedy = "add photographs lit from the sides; a single arc becomes a shading map instead (bake photographs)"
        raise BakeError("lights", "lie in one plane, which leaves the slope across it unknown", remedy)


def _fit(
    seen: NDArray[np.float64], directions: NDArray[np.float64], robust: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """rho / pi n (T, 3) of texels with values (n, T), and the weights (n, T) of the last round."""
    if not robust:
        weight = np.ones_like(seen)
        return _solved(seen, directions, weight), weight
    between = _between(seen)
    weight = between.astype(np.float64)
    found = _solved(seen, directions, weight)
    level = np.maximum(np.median(seen, axis=0), 1e-12)
    middle = int(between[:, 0].sum()) // 2
    for _ in range(_ROUNDS):
        law = directions @ found.T
        off = seen - np.maximum(law, 0)
        # The median of those between, of which every texel has as many.
        median = np.partition(np.where(between, np.abs(off), np.inf), middle, axis=0)[middle]
        width = CAUCHY * np.maximum(1.4826 * median, LEAST_SPREAD * level) * np.where(off > 0, _ABOVE, 1.0)
        # Light from behind a texel says nothing of its normal.
        weight = np.where(law > 0, 1 / (1 + (off / width) ** 2), 0.0)
        found = _solved(seen, directions, weight)
    return found, weight


def _between(seen: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which values (n, T) are neither among the darkest of their texel nor among its brightest: at least four."""
    count = len(seen)
    low, high = int(_DARKEST * count), int(_BRIGHTEST * count)
    while count - low - high < _LEAST_LIGHTS and low + high:
        low, high = (low - 1, high) if low >= high else (low, high - 1)
    rank = seen.argsort(0).argsort(0)
    between: NDArray[np.bool_] = (rank >= low) & (rank < count - high)
    return between


def _solved(
    seen: NDArray[np.float64], directions: NDArray[np.float64], weight: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Weighted least squares (T, 3)."""
    products = (directions[:, :, None] * directions[:, None, :]).reshape(-1, 9)
    squares = (weight.T @ products).reshape(-1, 3, 3)
    # Where few lights are left, the rest leans towards the camera by a little.
    trace = np.trace(squares, axis1=1, axis2=2)
    squares += (1e-4 * trace + 1e-12)[:, None, None] * np.eye(3)
    right = (weight * seen).T @ directions
    found: NDArray[np.float64] = np.linalg.solve(squares, right[..., None])[..., 0]
    return found
