"""Sampling a table's directions: per theta_o bin an alias table over half-vector cells (DESIGN.md section 5).

A cell is a rectangle in (m, phi_h), m = 1 - cos theta_h, where phi_h in [0, pi] is measured from the viewer's
azimuth and a fair coin chooses the side. Cell edges are m_k = (k / K)^(2 p): the square warp of the chord
(p = 2) resolves a peak of 0.02 degrees with 64 cells, where a Bezier warp (densest at alpha = 0, linear in the chord
at the pole) ends at 0.9 degrees; a matte material does better with p = 1. Inside a cell the half vector is
uniform in solid angle, reflecting the viewer about it gives the light direction, and the density

    pdf(wi) = pdf_h(cell) / (4 |wo . h|)

is exact whatever the material. One texel answers a draw: the acceptance probability, the alias, and the density
of either cell.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from . import xp_numpy
from .directions import spherical
from .source import Array, BrdfSource
from .tables.treated_source import TreatedSource

# Share of draws that follow the cosine instead of the material, so that pdf > 0 wherever light can come from.
COSINE_FLOOR = 0.05
# Quadrature points per cell side, and elevations of the viewer per bin: the estimate need not be exact, the pdf is. One
# elevation is not enough: a ridge of the table that two of its slices hold in two places moves within the bin, and what
# the bin's middle does not show is drawn by the cosine floor alone (fireflies of 400 times the mean, against 30).
_POINTS = 2
_ELEVATIONS = 4


@dataclass(frozen=True)
class SamplerLayout:
    """Sizes of a sampler's bins and cells.

    Parameters
    ----------
    n_o : bins of the viewer's elevation, equal in the chord sqrt(1 - cos theta_o)
    n_h, n_phi : half-vector cells in elevation and azimuth (over [0, pi])
    warp_power : p of the edges m_k = (k / n_h)^(2 p)
    """

    n_o: int = 64
    n_h: int = 64
    n_phi: int = 32
    warp_power: int = 2

    @property
    def cells(self) -> int:
        """Cells per bin, the texture's width."""
        return self.n_h * self.n_phi

    def edges(self) -> Array:
        """1 - cos theta_h at the n_h + 1 cell edges."""
        return (np.arange(self.n_h + 1) / self.n_h) ** (2.0 * self.warp_power)

    def bin_chords(self) -> Array:
        """Chords sqrt(1 - cos theta_o) at the bin centres, (n_o,)."""
        return (np.arange(self.n_o) + 0.5) / self.n_o


@dataclass(frozen=True)
class AliasSampler:
    """Alias tables: `texels` (n_o, cells, 4) float32 hold acceptance, alias, and pdf_h of the own and alias cell."""

    layout: SamplerLayout
    texels: Array

    def cell_pdf(self) -> Array:
        """Density of the half vector per solid angle, (n_o, n_h, n_phi); it covers both sides of the viewer."""
        return self.texels[..., 2].reshape(-1, self.layout.n_h, self.layout.n_phi)

    def sample(self, wo: Array, random: Array) -> tuple[Array, Array]:
        """Draw light directions.

        Parameters
        ----------
        wo : (..., 3) viewer directions in the x-z plane, x >= 0
        random : (..., 4) numbers in [0, 1]: cell, alias, and the two jitters

        Returns
        -------
        wi (..., 3) and its pdf (...) per solid angle; wi below the horizon is a draw that carries no light.
        """
        u = [random[..., k] for k in range(4)]
        bin_index, cell_index = choose_texel(xp_numpy, self.layout, wo, u[0])
        texel = self.texels[bin_index.astype(np.intp), cell_index.astype(np.intp)]
        return reflect_from_cell(xp_numpy, self.layout, wo, cell_index, texel[..., :3], texel[..., 3], *u[1:])

    def pdf(self, wi: Array, wo: Array) -> Array:
        """Density (...) with which `sample` draws wi when seen from wo (in the x-z plane)."""
        bin_index, cell, wo_half = find_texel(xp_numpy, self.layout, wi, wo)
        return self.texels[bin_index.astype(np.intp), cell.astype(np.intp), 2] / (4 * wo_half)


def find_texel(xp: Any, layout: SamplerLayout, wi: Any, wo: Any) -> tuple[Any, Any, Any]:
    """(bin, cell) of the texel whose pdf_h holds for a pair of directions, and wo . h."""
    half = xp.normalize(wi + wo)
    apart = half - xp.vec(0.0, 0.0, 1.0)
    m = xp.dot(apart, apart) * 0.5
    x, y, _ = xp.components(half)
    angle = xp.arctan2(y, x) * (layout.n_phi / np.pi)
    i_phi = xp.minimum(xp.floor(xp.maximum(angle, -angle)), layout.n_phi - 1.0)
    i_h = xp.minimum(xp.floor(xp.power(m, 0.5 / layout.warp_power) * layout.n_h), layout.n_h - 1.0)
    bin_index, _ = choose_texel(xp, layout, wo, 0 * m)
    return bin_index, i_h * layout.n_phi + i_phi, xp.dot(wo, half)


def choose_texel(xp: Any, layout: SamplerLayout, wo: Any, u: Any) -> tuple[Any, Any]:
    """(bin, cell) indices of the texel to read for a viewer direction and a random number."""
    chord = xp.length(wo - xp.vec(0.0, 0.0, 1.0)) * (1 / np.sqrt(2))
    # Random numbers include 1 and a smooth normal may show its back: indices are held inside.
    bin_index = xp.minimum(xp.floor(chord * layout.n_o), layout.n_o - 1.0)
    return bin_index, xp.minimum(xp.floor(u * layout.cells), layout.cells - 1.0)


def reflect_from_cell(
    xp: Any,
    layout: SamplerLayout,
    wo: Any,
    cell: Any,
    texel: Any,
    alias_pdf: Any,
    u_alias: Any,
    u_h: Any,
    u_phi: Any,
) -> tuple[Any, Any]:
    """Light direction and pdf from the texel of a drawn cell and three random numbers.

    `texel` holds (acceptance, alias, pdf_h), `alias_pdf` the alias cell's pdf_h.
    """
    acceptance, alias, own_pdf = xp.components(texel)
    keep = u_alias < acceptance
    chosen = xp.where(keep, cell, alias)
    pdf_h = xp.where(keep, own_pdf, alias_pdf)
    i_h = xp.floor((chosen + 0.5) * (1 / layout.n_phi))
    i_phi = chosen - i_h * layout.n_phi
    low, high = _edge(layout, i_h), _edge(layout, i_h + 1)
    m = low + u_h * (high - low)
    # One number serves side and place in the cell: the upper half of [0, 1] is one side, the lower the other.
    side = u_phi > 0.5
    place = xp.where(side, 2 * u_phi - 1, 2 * u_phi)
    phi = (i_phi + place) * (np.pi / layout.n_phi)
    sine = xp.sqrt(m * (2 - m))
    half = xp.vec(sine * xp.cos(phi), sine * xp.sin(phi) * xp.where(side, 1.0, -1.0), 1 - m)
    wo_half = xp.dot(wo, half)
    wi = xp.scale(half, 2 * wo_half) - wo
    # Seen from behind, a half vector reflects downwards: such a draw carries nothing, its density is still positive.
    return wi, xp.divide(pdf_h, 4 * xp.maximum(wo_half, 1e-6))


def _edge(layout: SamplerLayout, index: Any) -> Any:
    """1 - cos theta_h at a cell edge, by multiplications alone."""
    x = index * (1 / layout.n_h)
    result = x * x
    for _ in range(layout.warp_power - 1):
        result = result * (x * x)
    return result


def cell_moments(source: BrdfSource | TreatedSource, layout: SamplerLayout) -> tuple[Array, Array]:
    """Root mean square over each cell of the ideal half-vector density, for the material and for the cosine.

    The density that leaves no variance is g = f cos(theta_i) 4 |wo . h|; under a density constant per cell the
    variance is least when cells are drawn in proportion to the root of the mean of g^2, over the cell and over the
    elevations of the viewer that share the bin. Channels are averaged.

    Returns
    -------
    material, cosine : (n_o, n_h, n_phi)
    """
    edges = layout.edges()
    offset = (np.arange(_POINTS) + 0.5) / _POINTS
    m = (edges[:-1, None] + offset * np.diff(edges)[:, None]).reshape(-1)
    phi = (np.arange(layout.n_phi * _POINTS) + 0.5) * np.pi / (layout.n_phi * _POINTS)
    sine = np.sqrt(m * (2 - m))[:, None]
    half = np.stack([sine * np.cos(phi), sine * np.sin(phi), np.broadcast_to(1 - m[:, None], (len(m), len(phi)))], -1)
    material = np.zeros((layout.n_o, layout.n_h, layout.n_phi))
    cosine = np.zeros_like(material)
    chords = (np.arange(layout.n_o * _ELEVATIONS) + 0.5) / (layout.n_o * _ELEVATIONS)
    for i, chord in enumerate(chords):
        wo = spherical(2 * np.arcsin(chord / np.sqrt(2)), 0.0)
        wo_half = half @ wo
        wi = 2 * wo_half[..., None] * half - wo
        visible = (wi[..., 2] > 0) & (wo_half > 0)
        weight = np.where(visible, np.maximum(wi[..., 2], 0) * 4 * np.maximum(wo_half, 0), 0)
        g = np.zeros((*weight.shape, 3))
        g[visible] = source.evaluate(wi[visible], np.broadcast_to(wo, wi[visible].shape))
        g *= weight[..., None]
        material[i // _ELEVATIONS] += _cell_mean((g * g).mean(-1), layout)
        cosine[i // _ELEVATIONS] += _cell_mean((weight / np.pi) ** 2, layout)
    return np.sqrt(material / _ELEVATIONS), np.sqrt(cosine / _ELEVATIONS)


def _cell_mean(values: Array, layout: SamplerLayout) -> Array:
    return values.reshape(layout.n_h, _POINTS, layout.n_phi, _POINTS).mean((1, 3))


def build_sampler(source: BrdfSource | TreatedSource, layout: SamplerLayout) -> AliasSampler:
    """Alias tables for a source, a cosine floor included."""
    material, cosine = cell_moments(source, layout)
    cosine = np.maximum(cosine, 0.25 * _neighbourhood_maximum(cosine))
    solid_angle = np.diff(layout.edges())[:, None] * (2 * np.pi / layout.n_phi)
    probability = (1 - COSINE_FLOOR) * _normalized(material * solid_angle, cosine * solid_angle)
    probability += COSINE_FLOOR * _normalized(cosine * solid_angle, cosine * solid_angle)
    flat = probability.reshape(layout.n_o, -1)
    acceptance, alias = alias_tables(flat)
    pdf = (probability / solid_angle).reshape(layout.n_o, -1)
    texels = np.stack([acceptance, alias, pdf, np.take_along_axis(pdf, alias, -1)], -1)
    return AliasSampler(layout, texels.astype(np.float32))


def _neighbourhood_maximum(values: Array) -> Array:
    """Largest value among a cell and its neighbours, in the neighbouring bins too.

    At the horizon a cell may be visible in a sliver that no quadrature point meets, or only from part of its bin.
    """
    for axis in range(values.ndim):
        ends = [(1, 1) if k == axis else (0, 0) for k in range(values.ndim)]
        padded = np.pad(values, ends)
        n = values.shape[axis]
        values = np.max([np.take(padded, np.arange(k, k + n), axis) for k in range(3)], 0)
    return values


def _normalized(weight: Array, fallback: Array) -> Array:
    """Probabilities per bin; a bin in which nothing is reflected follows the fallback."""
    total = weight.sum((1, 2), keepdims=True)
    empty = total <= 0
    weight = np.where(empty, fallback, weight)
    return weight / np.where(empty, fallback.sum((1, 2), keepdims=True), total)


def alias_tables(probability: Array) -> tuple[Array, Array]:
    """Vose's alias method, one table per row.

    Parameters
    ----------
    probability : (R, C), each row summing to 1

    Returns
    -------
    acceptance (R, C) in [0, 1] and alias (R, C) integers
    """
    rows, columns = probability.shape
    acceptance = np.ones((rows, columns))
    alias = np.tile(np.arange(columns), (rows, 1))
    for row in range(rows):
        scaled = (probability[row] * (columns / probability[row].sum())).tolist()
        small = [i for i, p in enumerate(scaled) if p < 1]
        large = [i for i, p in enumerate(scaled) if p >= 1]
        while small and large:
            low, high = small.pop(), large[-1]
            acceptance[row, low], alias[row, low] = scaled[low], high
            scaled[high] -= 1 - scaled[low]
            if scaled[high] < 1:
                small.append(large.pop())
    return acceptance, alias
