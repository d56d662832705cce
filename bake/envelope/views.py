"""A BRDF seen by several viewers, sampled over the light by quadratures that resolve highlights."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .. import xp_numpy
from ..directions import spherical
from ..errors import BakeError
from ..quadrature import gauss_legendre
from ..source import Array, BrdfSource
from ..tables.grids.anisotropic_grids import slope_unwarp
from ..tables.treated_source import TreatedSource

# The viewer's elevation is taken between these, where directions and values are still well defined.
_CHORDS = 1e-5, np.sqrt(1 - 1e-3)
_PEAK = 5e-4  # theta_h in radians below which the nodes are evenly spaced; the narrowest closure is ten times wider
_CHUNK = 1 << 17

Sizes = tuple[int, int]
Widths = tuple[float, float]
# Of light directions: wi (V, P, 3), wo (V, 1, 3) and the solid angles (V, P), 0 where the light lies below the horizon.
Directions = tuple[Array, Array, Array]


@dataclass(frozen=True)
class Views:
    """f cos(theta_i) from V viewers at P light directions each.

    Attributes
    ----------
    chords, phi : (V,) sqrt(1 - cos theta_o) and azimuth of the viewers
    wo : (V, 1, 3)
    wi : (V, P, 3)
    areas : (V, P) solid angle
    values : (V, P, 3) f cos(theta_i)
    """

    chords: Array
    phi: Array
    wo: Array
    wi: Array
    areas: Array
    values: Array

    @property
    def energy(self) -> Array:
        """Integral of f cos(theta_i), (V, 3): the albedo seen from there."""
        return np.einsum("vp,vpc->vc", self.areas, self.values)


def sample_views(source: BrdfSource | TreatedSource, chords: Array, n_h: int, n_phi: int) -> Views:
    """Sample an isotropic source from elevations (V,); other sizes n_h and n_phi give other directions, none shared.

    Raises BakeError for values that are not finite.
    """
    return _sampled(source, chords, np.zeros(len(chords)), light_directions(chords, n_h, n_phi))


def slope_views(source: BrdfSource | TreatedSource, chords: Array, phi: Array, widths: Widths, sizes: Sizes) -> Views:
    """Sample a source from viewers (V,) all around; other sizes give other directions.

    Raises BakeError for values that are not finite.
    """
    return _sampled(source, chords, phi, slope_directions(chords, phi, widths, sizes))


def _sampled(source: BrdfSource | TreatedSource, chords: Array, phi: Array, directions: Directions) -> Views:
    wi, wo, areas = directions
    values = np.zeros(wi.shape)
    flat, lit = wi.reshape(-1, 3), np.flatnonzero(areas)
    seen_from = wo[:, 0]
    for start in range(0, len(lit), _CHUNK):
        part = lit[start : start + _CHUNK]
        values.reshape(-1, 3)[part] = source.evaluate(flat[part], seen_from[part // areas.shape[1]])
    if not np.isfinite(values).all():
        raise BakeError(source.name, "holds values that are not finite", "check the file")
    return Views(chords, phi, wo, wi, areas, values * np.maximum(wi[..., 2:], 0))


def light_directions(chords: Array, n_h: int, n_phi: int) -> Directions:
    """Gauss-Legendre quadrature over half vectors, for viewers in the x-z plane and light on one side of it.

    As in `bake.tables.albedo`: d omega_i = 4 (wo . h) d omega_h, nodes in log(theta_h + peak) up to where the light
    meets the horizon, and in phi_h gathered at pi / 2, where that edge bends sharply when the viewer is low. Solid
    angles are of both sides together.
    """
    v = np.clip(chords, *_CHORDS)[:, None, None]
    cos_o, sin_o = (1 - v) * (1 + v), v * np.sqrt(2 - v * v)
    x_h, weight_h = gauss_legendre(n_h)
    x_phi, weight_phi = (a[:, None] for a in gauss_legendre(n_phi))
    steepness = np.arcsinh(np.pi / 2 / cos_o)
    phi = np.pi / 2 + cos_o * np.sinh(steepness * x_phi)
    horizon = 0.5 * np.arctan2(cos_o, -sin_o * np.cos(phi))
    growth = np.log1p(horizon / _PEAK)
    theta = _PEAK * np.expm1(growth * 0.5 * (x_h + 1))
    area = 0.5 * weight_h * growth * (theta + _PEAK) * np.sin(theta)
    area = area * weight_phi * cos_o * steepness * np.cosh(steepness * x_phi)
    phi = np.broadcast_to(phi, theta.shape)
    half = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
    wo = np.stack([sin_o, np.zeros_like(sin_o), cos_o], -1)
    cos_d = (half * wo).sum(-1, keepdims=True)
    wi = 2 * cos_d * half - wo
    # Twice for the other side; rounding may leave a direction just under the horizon.
    area = np.where(wi[..., 2] > 0, 2 * 4 * cos_d[..., 0] * area, 0)
    count = len(chords)
    return wi.reshape(count, -1, 3), wo.reshape(count, 1, 3), area.reshape(count, -1)


def slope_directions(chords: Array, phi: Array, widths: Widths, sizes: Sizes) -> Directions:
    """The midpoint rule over warped slopes of the half vector, light on all sides; see `bake.tables.grids`.

    Parameters
    ----------
    chords, phi : (V,)
    widths : of the slopes along x and y, where the highlight is resolved
    sizes : directions along either
    """
    axes = [
        np.asarray(slope_unwarp(xp_numpy, (np.arange(n) + 0.5) / n * 2 - 1, width)) for n, width in zip(sizes, widths)
    ]
    steps = [(2 / n) * (width + np.abs(x)) ** 2 / width for n, width, x in zip(sizes, widths, axes)]
    x, y = (g.ravel() for g in np.meshgrid(*axes))
    half = xp_numpy.normalize(np.stack([x, y, np.ones_like(x)], -1))
    solid = np.outer(steps[1], steps[0]).ravel() * half[:, 2] ** 3
    wo = spherical(2 * np.arcsin(np.clip(chords, *_CHORDS) / np.sqrt(2)), phi)
    cos_d = wo @ half.T
    wi = 2 * cos_d[..., None] * half - wo[:, None]
    areas = np.where((wi[..., 2] > 0) & (cos_d > 0), 4 * cos_d * solid, 0)
    return wi, wo[:, None], areas


def gauss_chords(n: int) -> tuple[Array, Array]:
    """Chords (n,) and weights that sum to 1 of the cosine-weighted mean over theta_o, d(sin^2) = 4 v (1 - v^2) dv."""
    x, weight = gauss_legendre(n)
    v = 0.5 * (x + 1)
    return v, 2 * weight * v * (1 - v * v)


def chord_of(wo: Array) -> Array:
    """sqrt(1 - cos theta_o), (...), of unit vectors (..., 3); at most 1."""
    return np.minimum(np.linalg.norm(wo - np.array([0.0, 0.0, 1.0]), axis=-1) / np.sqrt(2), 1.0)


def interpolated(nodes: Array, chords: Array) -> Array:
    """Values (n, ...) at nodes evenly spaced in the chord, at other chords, linearly."""
    position = np.asarray(chords, np.float64) * (len(nodes) - 1)
    low = np.clip(np.floor(position), 0, len(nodes) - 2).astype(np.intp)
    t = (position - low).reshape(*np.shape(position), *[1] * (nodes.ndim - 1))
    result: Array = nodes[low] * (1 - t) + nodes[low + 1] * t
    return result
