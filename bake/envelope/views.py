"""A BRDF seen from several elevations, sampled over the light by a quadrature that resolves highlights."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..errors import BakeError
from ..quadrature import gauss_legendre
from ..source import Array, BrdfSource
from ..tables.treated_source import TreatedSource

# The viewer's elevation is taken between these, where directions and values are still well defined.
_CHORDS = 1e-5, np.sqrt(1 - 1e-3)
_PEAK = 5e-4  # theta_h in radians below which the nodes are evenly spaced; the narrowest closure is ten times wider
_CHUNK = 1 << 16


@dataclass(frozen=True)
class Views:
    """f cos(theta_i) from V viewing elevations at P light directions each, symmetric in phi_delta.

    Attributes
    ----------
    chords : (V,) sqrt(1 - cos theta_o)
    wo : (V, 1, 3) in the x-z plane
    wi : (V, P, 3) on one side of it
    areas : (V, P) solid angle, both sides together
    values : (V, P, 3) f cos(theta_i)
    """

    chords: Array
    wo: Array
    wi: Array
    areas: Array
    values: Array

    @property
    def energy(self) -> Array:
        """Integral of f cos(theta_i), (V, 3): the albedo seen from there."""
        return np.einsum("vp,vpc->vc", self.areas, self.values)


def sample_views(
    source: BrdfSource | TreatedSource,
    chords: Array,
    n_h: int,
    n_phi: int,
    progress: Callable[[float], None] | None = None,
) -> Views:
    """Sample a source; other sizes n_h and n_phi give other directions, none shared.

    Raises BakeError for values that are not finite.
    """
    wi, wo, areas = light_directions(chords, n_h, n_phi)
    values = np.empty(wi.shape)
    step = max(1, _CHUNK // areas.shape[1])
    for start in range(0, len(wi), step):
        part = slice(start, start + step)
        values[part] = source.evaluate(wi[part], np.broadcast_to(wo[part], wi[part].shape))
        if progress:
            progress(min(start + step, len(wi)) / len(wi))
    if not np.isfinite(values).all():
        raise BakeError(source.name, "holds values that are not finite", "check the file")
    return Views(chords, wo, wi, areas, values * wi[..., 2:])


def light_directions(chords: Array, n_h: int, n_phi: int) -> tuple[Array, Array, Array]:
    """wi (V, P, 3), wo (V, 1, 3) and solid angles (V, P) of a Gauss-Legendre quadrature over half vectors.

    As in `bake.albedo`: d omega_i = 4 (wo . h) d omega_h, nodes in log(theta_h + peak) up to where the light meets the
    horizon, and in phi_h gathered at pi / 2, where that edge bends sharply when the viewer is low.
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
