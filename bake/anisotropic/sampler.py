"""Sampling an anisotropic table's directions: per viewer an alias table over cells of the half vector's slopes.

Bins are (theta_o, phi_o); phi_o covers half a turn where the material looks the same after half a turn, and the cells
then turn with the viewer. A cell is a rectangle in the warped slopes u = x / (width + |x|) of h, see
`AnisotropicHalfGrid`: a polar cell would cut across the ridge that brushing makes. Inside a cell (u, v) is even, hence

    pdf_h = p_cell cells / 4  du/dx dv/dy / h_z^3,   pdf(wi) = pdf_h / (4 wo . h),

exact whatever the material; du/dx = width / (width + |x|)^2, and dx dy = d omega_h / h_z^3.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import xp_numpy
from ..alias_sampler import COSINE_FLOOR, alias_tables
from ..directions import spherical
from ..source import Array, BrdfSource
from ..tables.anisotropic_grids import azimuth_index, slope_unwarp, slope_warp
from ..tables.table import Table

# Quadrature points per cell side, and viewers per bin side: the estimate need not be exact, the pdf is.
_POINTS = 2
_VIEWERS = 2
# Of the warped slope: 1e-6 from its end, which float32 still tells from 1, slopes are a million times the width.
_EDGE = 1 - 1e-6


@dataclass(frozen=True)
class SlopeLayout:
    """Sizes of a sampler's bins and cells.

    Parameters
    ----------
    n_theta : bins of the viewer's elevation, equal in the chord sqrt(1 - cos theta_o)
    n_phi : bins of the viewer's azimuth, the first one around 0
    n_x, n_y : cells of the half vector's slopes
    width_x, width_y : slopes at half of the way from the middle to the edge
    folded : the azimuth covers half a turn
    """

    n_theta: int = 16
    n_phi: int = 16
    n_x: int = 32
    n_y: int = 32
    width_x: float = 0.3
    width_y: float = 0.3
    folded: bool = False

    @property
    def cells(self) -> int:
        """Cells per bin, the texture's width."""
        return self.n_x * self.n_y

    @property
    def bins(self) -> int:
        """The texture's height."""
        return self.n_theta * self.n_phi


@dataclass(frozen=True)
class SlopeSampler:
    """Alias tables: `texels` (bins, cells, 4) float32 hold acceptance, alias, and p_cell cells of either cell."""

    layout: SlopeLayout
    texels: Array

    def sample(self, wo: Array, random: Array) -> tuple[Array, Array]:
        """Draw light directions.

        Parameters
        ----------
        wo : (..., 3) viewer directions
        random : (..., 4) numbers in [0, 1]: cell, alias, and the two places in the cell

        Returns
        -------
        wi (..., 3) and its pdf (...) per solid angle; wi below the horizon is a draw that carries no light.
        """
        u = [random[..., k] for k in range(4)]
        bin_index = viewer_bin(xp_numpy, self.layout, wo)
        cell = np.minimum(np.floor(u[0] * self.layout.cells), self.layout.cells - 1)
        texel = self.texels[bin_index.astype(np.intp), cell.astype(np.intp)].astype(np.float64)
        return reflect_from_cell(xp_numpy, self.layout, wo, cell, texel[..., :3], texel[..., 3], *u[1:])

    def pdf(self, wi: Array, wo: Array) -> Array:
        """Density (...) with which `sample` draws wi when seen from wo."""
        bin_index, cell, density = find_texel(xp_numpy, self.layout, wi, wo)
        return self.texels[bin_index.astype(np.intp), cell.astype(np.intp), 2] * density


def viewer_bin(xp: Any, layout: SlopeLayout, wo: Any) -> Any:
    """Row of the texture for a viewer."""
    x, y, _ = xp.components(wo)
    chord = xp.length(wo - xp.vec(0.0, 0.0, 1.0)) * (1 / np.sqrt(2))
    # A smooth normal may show its back: indices are held inside.
    elevation = xp.minimum(xp.floor(chord * layout.n_theta), layout.n_theta - 1.0)
    azimuth = xp.floor(azimuth_index(xp, x, y, layout.n_phi, layout.folded) + 0.5)
    azimuth = xp.where(azimuth > layout.n_phi - 0.5, 0.0, azimuth)
    return elevation * layout.n_phi + azimuth


def turned(xp: Any, layout: SlopeLayout, wo: Any) -> Any:
    """-1 for a viewer that sees the cells of a folded sampler after half a turn, else 1."""
    if not layout.folded:
        return 1.0
    x, y, _ = xp.components(wo)
    index = azimuth_index(xp, x, y, layout.n_phi, False) * 2
    # The bin around 0 begins half a bin before it.
    after = xp.where(index > layout.n_phi - 0.5, 1.0, 0.0) * xp.where(index < 2 * layout.n_phi - 0.5, 1.0, 0.0)
    return 1 - 2 * after


def reflect_from_cell(
    xp: Any,
    layout: SlopeLayout,
    wo: Any,
    cell: Any,
    texel: Any,
    alias_weight: Any,
    u_alias: Any,
    u_x: Any,
    u_y: Any,
) -> tuple[Any, Any]:
    """Light direction and pdf from the texel (acceptance, alias, weight) of a drawn cell and three random numbers."""
    acceptance, alias, own = xp.components(texel)
    keep = u_alias < acceptance
    chosen, weight = xp.where(keep, cell, alias), xp.where(keep, own, alias_weight)
    i_y = xp.floor((chosen + 0.5) * (1 / layout.n_x))
    i_x = chosen - i_y * layout.n_x
    u = _inside((i_x + u_x) * (2 / layout.n_x) - 1, xp)
    v = _inside((i_y + u_y) * (2 / layout.n_y) - 1, xp)
    side = turned(xp, layout, wo)
    x, y = slope_unwarp(xp, u, layout.width_x) * side, slope_unwarp(xp, v, layout.width_y) * side
    half = xp.normalize(xp.vec(x, y, 1.0))
    wo_half = xp.dot(wo, half)
    wi = xp.scale(half, 2 * wo_half) - wo
    # Seen from behind, a half vector reflects downwards: such a draw carries nothing, its density is still positive.
    return wi, weight * _density(xp, layout, x, y, half, xp.maximum(wo_half, 1e-6))


def find_texel(xp: Any, layout: SlopeLayout, wi: Any, wo: Any) -> tuple[Any, Any, Any]:
    """(bin, cell) of the texel whose weight holds for a pair of directions, and the density per unit of weight."""
    xs, ys, zs = xp.components(wi + wo)
    zs = xp.maximum(zs, 1e-6)
    half = xp.normalize(xp.vec(xs, ys, zs))
    x, y = xp.divide(xs, zs), xp.divide(ys, zs)
    side = turned(xp, layout, wo)
    i_x = _cell_index(xp, slope_warp(xp, x * side, layout.width_x), layout.n_x)
    i_y = _cell_index(xp, slope_warp(xp, y * side, layout.width_y), layout.n_y)
    density = _density(xp, layout, x, y, half, xp.maximum(xp.dot(wo, half), 1e-6))
    return viewer_bin(xp, layout, wo), i_y * layout.n_x + i_x, density


def _inside(u: Any, xp: Any) -> Any:
    """Random numbers include 0 and 1, where the slope is infinite."""
    return xp.minimum(xp.maximum(u, -_EDGE), _EDGE)


def _cell_index(xp: Any, u: Any, n: int) -> Any:
    return xp.minimum(xp.floor((u + 1) * (0.5 * n)), n - 1.0)


def _density(xp: Any, layout: SlopeLayout, x: Any, y: Any, half: Any, wo_half: Any) -> Any:
    """Density of wi in 1/sr for cells of weight 1, all equally probable."""
    to_x = layout.width_x + xp.maximum(x, -x)
    to_y = layout.width_y + xp.maximum(y, -y)
    _, _, hz = xp.components(half)
    spread = to_x * to_x * to_y * to_y * (hz * hz * hz) * wo_half
    return xp.divide(layout.width_x * layout.width_y / 16, spread)


def cell_moments(
    source: BrdfSource | Table, layout: SlopeLayout, progress: Callable[[float], None] | None = None
) -> tuple[Array, Array]:
    """Root mean square over each cell and bin of f cos(theta_i) / density, for the material and for a Lambertian one.

    That is what the cells' probabilities have to follow for least variance. Channels are averaged.

    Returns
    -------
    material, matte : (n_theta, n_phi, n_y, n_x)
    """
    u = ((np.arange(layout.n_x * _POINTS) + 0.5) / (layout.n_x * _POINTS)) * 2 - 1
    v = ((np.arange(layout.n_y * _POINTS) + 0.5) / (layout.n_y * _POINTS)) * 2 - 1
    x = np.asarray(slope_unwarp(xp_numpy, u, layout.width_x))[None, :]
    y = np.asarray(slope_unwarp(xp_numpy, v, layout.width_y))[:, None]
    half = xp_numpy.normalize(np.stack(np.broadcast_arrays(x, y, 1.0), -1))
    shape = (layout.n_theta, layout.n_phi, layout.n_y, layout.n_x)
    material, matte = np.zeros(shape), np.zeros(shape)
    chords = (np.arange(layout.n_theta * _VIEWERS) + 0.5) / (layout.n_theta * _VIEWERS)
    turn = np.pi if layout.folded else 2 * np.pi
    azimuths = turn * (np.arange(layout.n_phi * _VIEWERS) - 0.5 * (_VIEWERS - 1)) / (layout.n_phi * _VIEWERS)
    for i, chord in enumerate(chords):
        if progress:
            progress(i / len(chords))
        for j, phi in enumerate(azimuths):
            wo = spherical(2 * np.arcsin(chord / np.sqrt(2)), phi)
            wo_half = half @ wo
            wi = 2 * wo_half[..., None] * half - wo
            seen = (wi[..., 2] > 0) & (wo_half > 0)
            density = _density(xp_numpy, layout, x, y, half, np.maximum(wo_half, 1e-6))
            weight = np.where(seen, wi[..., 2] / density, 0)
            g = np.zeros((*weight.shape, 3))
            g[seen] = source.evaluate(wi[seen], np.broadcast_to(wo, wi[seen].shape))
            place = i // _VIEWERS, j // _VIEWERS
            material[place] += _cell_mean(((g * weight[..., None]) ** 2).mean(-1), layout)
            matte[place] += _cell_mean((weight / np.pi) ** 2, layout)
    return np.sqrt(material / _VIEWERS**2), np.sqrt(matte / _VIEWERS**2)


def _cell_mean(values: Array, layout: SlopeLayout) -> Array:
    return values.reshape(layout.n_y, _POINTS, layout.n_x, _POINTS).mean((1, 3))


def build_slope_sampler(
    source: BrdfSource | Table, layout: SlopeLayout, progress: Callable[[float], None] | None = None
) -> SlopeSampler:
    """Alias tables for a source, a Lambertian floor included: every direction above the horizon may be drawn."""
    material, matte = cell_moments(source, layout, progress)
    matte = np.maximum(matte, 0.25 * _around(matte))
    shape = (layout.bins, layout.cells)
    material, matte = material.reshape(shape), matte.reshape(shape)
    floor = matte / matte.sum(1, keepdims=True)
    total = material.sum(1, keepdims=True)
    followed = np.where(total > 0, material / np.where(total > 0, total, 1), floor)
    probability = (1 - COSINE_FLOOR) * followed + COSINE_FLOOR * floor
    acceptance, alias = alias_tables(probability)
    weight = probability * layout.cells
    texels = np.stack([acceptance, alias, weight, np.take_along_axis(weight, alias, -1)], -1)
    return SlopeSampler(layout, texels.astype(np.float32))


def _around(values: Array) -> Array:
    """Largest value among a cell and its neighbours, in other bins too: a cell may be visible in a sliver."""
    for axis in range(values.ndim):
        n = values.shape[axis]
        ends = np.arange(-1, n + 1)
        padded = np.take(values, ends % n if axis == 1 else np.clip(ends, 0, n - 1), axis)
        values = np.max([np.take(padded, np.arange(k, k + n), axis) for k in range(3)], 0)
    return values
