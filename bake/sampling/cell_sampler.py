"""Sampling a table's directions: per viewer an alias table over cells of the half vector.

A row of the tables belongs to a bin of viewers, a column to a cell of half vectors; a `CellLayout` says which. One
texel answers a draw: the probability of keeping the cell (acceptance), the cell taken otherwise (alias), and a number
of either cell from which its density follows. A place inside the cell gives the half vector, and reflecting the viewer
about it the light direction, whose density

    pdf(wi) = pdf_h / (4 |wo . h|)

is exact whatever the material (Walter, Marschner, Li & Torrance 2007, equation 14). Cells are drawn so that the
variance is least, with a floor of draws that follow the cosine.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from .. import xp_numpy
from ..source import Array
from .alias_tables import alias_tables

# Share of draws that follow the cosine instead of the material, so that pdf > 0 wherever light can come from.
COSINE_FLOOR = 0.05
# Quadrature points per cell side: the estimate need not be exact, the pdf is.
_POINTS = 2


class Evaluates(Protocol):
    """A BRDF: a source, treated or not, or a table."""

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """BRDF (..., 3) in 1/sr without the cosine."""
        ...


class HalfVector(NamedTuple):
    """A unit half vector of the namespace `xp`, and its two coordinates in which cells are rectangles."""

    direction: Any
    first: Any
    second: Any


class MomentLayout(Protocol):
    """Bins of viewers and cells of half vectors, as far as it takes to know how often cells should be drawn.

    Attributes
    ----------
    shape : sizes along each axis: those of the bins, then rows and columns of the cells
    periodic : axes of `shape` whose last entry is followed by the first
    bins : the texture's height

    Methods
    -------
    bin_of : row of the texture for a viewer; the namespace `xp` is numpy's or the shader nodes'
    weight : a light direction's cosine over the density that a probability even over `areas` gives it
    points : half vectors (rows count, columns count, 3) at count x count places of every cell
    viewers : (bins, n, 3), over which a bin's cells are averaged
    areas : what cells are as large as, of a shape that broadcasts to (rows, columns)
    """

    @property
    def shape(self) -> tuple[int, ...]: ...
    @property
    def periodic(self) -> tuple[int, ...]: ...
    @property
    def bins(self) -> int: ...
    def bin_of(self, xp: Any, wo: Any) -> Any: ...
    def weight(self, cosine: Array, half: HalfVector, wo_half: Array) -> Array: ...
    def points(self, count: int) -> HalfVector: ...
    def viewers(self) -> Array: ...
    def areas(self) -> Array: ...


class CellLayout(MomentLayout, Protocol):
    """Cells that alias tables choose from; formulas take the namespace `xp`, numpy's or the shader nodes'.

    Attributes
    ----------
    cells : the texture's width

    Methods
    -------
    cell_of : cell in which the half vector of a pair of directions lies, and that half vector
    half_vector : the one at the place (u, v) in [0, 1]^2 of a cell
    pdf : density of wi per solid angle, from what is stored of the half vector's cell
    stored : what is stored of cells (bins, rows, columns) drawn with these probabilities
    """

    @property
    def cells(self) -> int: ...
    def cell_of(self, xp: Any, wi: Any, wo: Any) -> tuple[Any, HalfVector]: ...
    def half_vector(self, xp: Any, wo: Any, cell: Any, u: Any, v: Any) -> HalfVector: ...
    def pdf(self, xp: Any, value: Any, half: HalfVector, wo_half: Any) -> Any: ...
    def stored(self, probability: Array) -> Array: ...


@dataclass(frozen=True)
class CellSampler:
    """Alias tables: `texels` (bins, cells, 4) float32 hold acceptance, alias, and what is stored of either cell."""

    layout: CellLayout
    texels: Array

    def sample(self, wo: Array, random: Array) -> tuple[Array, Array]:
        """Draw light directions.

        Parameters
        ----------
        wo : (..., 3) viewer directions; in the x-z plane, x >= 0, where the layout is of an isotropic material
        random : (..., 4) numbers in [0, 1]: cell, alias, and the two places in the cell

        Returns
        -------
        wi (..., 3) and its pdf (...) per solid angle; wi below the horizon is a draw that carries no light.
        """
        u = [random[..., k] for k in range(4)]
        row, cell = self.layout.bin_of(xp_numpy, wo), draw_cell(xp_numpy, self.layout, u[0])
        texel = self.texels[row.astype(np.intp), cell.astype(np.intp)].astype(np.float64)
        return reflect_from_cell(xp_numpy, self.layout, wo, cell, texel[..., :3], texel[..., 3], *u[1:])

    def pdf(self, wi: Array, wo: Array) -> Array:
        """Density (...) with which `sample` draws wi when seen from wo."""
        row, cell, density = find_texel(xp_numpy, self.layout, wi, wo)
        found: Array = density(self.texels[row.astype(np.intp), cell.astype(np.intp), 2])
        return found


def draw_cell(xp: Any, layout: CellLayout, u: Any) -> Any:
    """Column of the texture for a random number; these include 1, which is held inside."""
    return xp.minimum(xp.floor(u * layout.cells), layout.cells - 1.0)


def find_texel(xp: Any, layout: CellLayout, wi: Any, wo: Any) -> tuple[Any, Any, Callable[[Any], Any]]:
    """Row and column of the texel that holds for a pair of directions, and the density of what is stored there."""
    cell, half = layout.cell_of(xp, wi, wo)
    wo_half = xp.dot(wo, half.direction)
    return layout.bin_of(xp, wo), cell, lambda value: layout.pdf(xp, value, half, wo_half)


def reflect_from_cell(
    xp: Any,
    layout: CellLayout,
    wo: Any,
    cell: Any,
    texel: Any,
    alias_value: Any,
    u_alias: Any,
    u: Any,
    v: Any,
) -> tuple[Any, Any]:
    """Light direction and pdf from the texel of a drawn cell and three random numbers.

    `texel` holds (acceptance, alias, own value), `alias_value` is that of the alias cell.
    """
    acceptance, alias, own = xp.components(texel)
    keep = u_alias < acceptance
    chosen = xp.where(keep, cell, alias)
    value = xp.where(keep, own, alias_value)
    half = layout.half_vector(xp, wo, chosen, u, v)
    wo_half = xp.dot(wo, half.direction)
    wi = xp.scale(half.direction, 2 * wo_half) - wo
    # Seen from behind, a half vector reflects downwards: such a draw carries nothing, its density is still positive.
    return wi, layout.pdf(xp, value, half, wo_half)


def cell_moments(
    source: Evaluates, layout: MomentLayout, progress: Callable[[float], None] | None = None, points: int = _POINTS
) -> tuple[Array, Array]:
    """Root mean square over each cell of what leaves no variance, for the material and for a Lambertian one.

    That is f cos(theta_i) over the density of even draws. Under a density constant per cell the variance is least when
    cells are drawn in proportion to the root of the mean of its square, over the cell and over the viewers that share
    the bin. Channels are averaged.

    Returns
    -------
    material, matte : (bins, rows, columns)
    """
    half = layout.points(points)
    directions, shape = half.direction, layout.shape[-2:]
    material, matte = np.zeros((2, layout.bins, *shape))
    seen_from = layout.viewers()
    for row, viewers in enumerate(seen_from):
        if progress:
            progress(row / layout.bins)
        for wo in viewers:
            wo_half = directions @ wo
            wi = 2 * wo_half[..., None] * directions - wo
            visible = (wi[..., 2] > 0) & (wo_half > 0)
            weight = np.where(visible, layout.weight(wi[..., 2], half, wo_half), 0)
            lit = np.flatnonzero(visible)
            seen = wi.reshape(-1, 3).take(lit, 0)
            value = source.evaluate(seen, np.broadcast_to(wo, seen.shape)) * weight.take(lit)[:, None]
            squares = np.zeros(weight.shape)
            squares.reshape(-1)[lit] = xp_numpy.dot(value, value) / 3
            material[row] += _cell_mean(squares, shape, points)
            matte[row] += _cell_mean((weight / np.pi) ** 2, shape, points)
    count = seen_from.shape[1]
    return np.sqrt(material / count), np.sqrt(matte / count)


def _cell_mean(values: Array, shape: tuple[int, ...], points: int) -> Array:
    rows, columns = shape
    return values.reshape(rows, points, columns, points).mean((1, 3))


def cell_probabilities(
    source: Evaluates, layout: MomentLayout, progress: Callable[[float], None] | None = None, points: int = _POINTS
) -> Array:
    """Probabilities (bins, rows, columns) of least variance, a cosine floor included."""
    material, matte = cell_moments(source, layout, progress, points)
    around = _neighbourhood_maximum(matte.reshape(layout.shape), layout.periodic).reshape(matte.shape)
    areas = layout.areas()
    material, matte = material * areas, np.maximum(matte, 0.25 * around) * areas
    return (1 - COSINE_FLOOR) * _normalized(material, matte) + COSINE_FLOOR * _normalized(matte, matte)


def build_sampler(
    source: Evaluates, layout: CellLayout, progress: Callable[[float], None] | None = None
) -> CellSampler:
    """Alias tables for a source; `progress` is called with the share done."""
    probability = cell_probabilities(source, layout, progress)
    acceptance, alias = alias_tables(probability.reshape(layout.bins, -1))
    value = layout.stored(probability).reshape(layout.bins, -1)
    texels = np.stack([acceptance, alias, value, np.take_along_axis(value, alias, -1)], -1)
    return CellSampler(layout, texels.astype(np.float32))


def _neighbourhood_maximum(values: Array, periodic: tuple[int, ...]) -> Array:
    """Largest value among a cell and its neighbours, in the neighbouring bins too.

    At the horizon a cell may be visible in a sliver that no quadrature point meets, or only from part of its bin.
    """
    for axis, n in enumerate(values.shape):
        ends = np.arange(-1, n + 1)
        padded = np.take(values, ends % n if axis in periodic else np.clip(ends, 0, n - 1), axis)
        values = np.max([np.take(padded, np.arange(k, k + n), axis) for k in range(3)], 0)
    return values


def _normalized(weight: Array, fallback: Array) -> Array:
    """Probabilities per bin; a bin in which nothing is reflected follows the fallback."""
    total = weight.sum((1, 2), keepdims=True)
    empty = total <= 0
    weight = np.where(empty, fallback, weight)
    return weight / np.where(empty, fallback.sum((1, 2), keepdims=True), total)
