"""Sampling a table's directions by a warp of the unit square: two random numbers, and an exact density.

A draw follows the cosine, as often as a bin of viewers has it, or else a half vector whose distribution is tabulated:
what the material reflects beyond a matte one. The mixture's density

    p(wi) = P cos(theta_i) / pi + (1 - P) p_h(h) / (4 |wo . h|)

is matched by few cells, since a matte material needs none, and is positive wherever light can come from.

The half vector has two coordinates s and t in [0, 1], in which cells are even: rows in s, columns in t. Of each bin of
viewers one row of texels holds the inverse of the distribution of s, `strata` entries of `inverse_tables`, in alpha P;
then for each row of cells that of t, one entry for each column, in alpha (1 - P) times the density of a cell over the
unit square: the same texture tells the density of any direction. Neighbouring random numbers give neighbouring
directions, hence low-discrepancy numbers stay so.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from .. import xp_numpy
from ..source import Array
from .cell_sampler import COSINE_FLOOR, Evaluates, HalfVector, MomentLayout, cell_moments
from .inverse_tables import inverse_table, inverted, joined, stratum

# Matte parts that are tried: where this share of the cosine falls on cells that reflect less.
_QUANTILES = (0.0, 0.003, 0.01, 0.03, 0.06, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9, 1.0)

# Reads the viewer's texel, RGB and alpha, at the middle of a column: 0.5 for the first.
Read = Callable[[Any], tuple[Any, Any]]


class WarpLayout(MomentLayout, Protocol):
    """Bins of viewers, and coordinates of half vectors; formulas take the namespace `xp`.

    Attributes
    ----------
    strata : of the first random number
    width : texels of a bin

    Methods
    -------
    place_of : s and t, in rows and columns, of the half vector of a pair of directions, and that half vector
    number_of_t : the number that t is drawn by, for the second random number
    half_at : the half vector at s and t, in rows and columns, given the second random number
    pdf : density of wi per solid angle, from a density over the unit square of s and t
    """

    @property
    def strata(self) -> int: ...
    @property
    def width(self) -> int: ...
    def place_of(self, xp: Any, wi: Any, wo: Any) -> tuple[Any, Any, HalfVector]: ...
    def number_of_t(self, xp: Any, u: Any) -> Any: ...
    def half_at(self, xp: Any, wo: Any, s: Any, t: Any, u: Any) -> Any: ...
    def pdf(self, xp: Any, value: Any, half: HalfVector, wo_half: Any) -> Any: ...


@dataclass(frozen=True)
class WarpSampler:
    """Warp tables: `texels` (bins, width, 4) float32."""

    layout: WarpLayout
    texels: Array

    def sample(self, wo: Array, random: Array) -> tuple[Array, Array]:
        """Draw light directions.

        Parameters
        ----------
        wo : (..., 3) viewer directions; in the x-z plane, x >= 0, where the layout is of an isotropic material
        random : (..., 2 or more) numbers in [0, 1], of which two are used

        Returns
        -------
        wi (..., 3) and its pdf (...) per solid angle; wi below the horizon is a draw that carries no light.
        """
        wi = draw(xp_numpy, self.layout, self._read(wo), wo, random[..., 0], random[..., 1])
        return wi, self.pdf(wi, wo)

    def pdf(self, wi: Array, wo: Array) -> Array:
        """Density (...) with which `sample` draws wi when seen from wo."""
        found: Array = density(xp_numpy, self.layout, self._read(wo), wi, wo)
        return found

    def _read(self, wo: Array) -> Read:
        row = self.layout.bin_of(xp_numpy, wo).astype(np.intp)

        def read(column: Any) -> tuple[Array, Array]:
            texel = self.texels[row, np.floor(column).astype(np.intp)].astype(np.float64)
            return texel[..., :3], texel[..., 3]

        return read


def draw(xp: Any, layout: WarpLayout, read: Read, wo: Any, u: Any, v: Any) -> Any:
    """Light direction from two random numbers."""
    rows, columns = layout.shape[-2:]
    _, matte = read(0.5)
    is_matte = u < matte
    rest = xp.where(is_matte, xp.divide(u, matte), xp.divide(u - matte, 1 - matte))
    s = inverted(xp, rest, read(stratum(xp, rest, layout.strata) + 0.5)[0])
    row = xp.minimum(xp.floor(s), rows - 1.0)
    of_t = layout.number_of_t(xp, v)
    t = inverted(xp, of_t, read(row * columns + stratum(xp, of_t, columns) + (layout.strata + 0.5))[0])
    half = layout.half_at(xp, wo, s, t, v)
    reflected = xp.scale(half, 2 * xp.dot(wo, half)) - wo
    # Of no draw but those of the cosine, so that on SVM's stack nothing of it waits from the beginning.
    radius, angle = xp.sqrt(rest), xp.where(is_matte, 2 * v - 1, 0.0) * np.pi
    cosine = xp.vec(radius * xp.cos(angle), radius * xp.sin(angle), xp.sqrt(1 - rest))
    return xp.where_vector(is_matte, cosine, reflected)


def density(xp: Any, layout: WarpLayout, read: Read, wi: Any, wo: Any) -> Any:
    """Density per solid angle with which `draw` gives wi."""
    rows, columns = layout.shape[-2:]
    s, t, half = layout.place_of(xp, wi, wo)
    # Before the texture is read, so that on SVM's stack a number waits for it instead of vectors.
    _, _, cosine = xp.components(wi)
    of_cosine = xp.maximum(cosine, 0.0) * (1 / np.pi)
    of_half = layout.pdf(xp, 1.0, half, xp.dot(wo, half.direction))
    row, column = xp.minimum(xp.floor(s), rows - 1.0), xp.minimum(xp.floor(t), columns - 1.0)
    _, value = read(row * columns + column + (layout.strata + 0.5))
    _, matte = read(0.5)
    return value * of_half + matte * of_cosine


def matte_part(material: Array, matte: Array) -> tuple[Array, Array]:
    """How often draws should follow the cosine, and what is left for the half vectors.

    What a material reflects in a cell is parted into so much of a Lambertian one and a rest; of several levels of the
    former that of least variance is taken, for each bin.

    Parameters
    ----------
    material, matte : (bins, rows, columns) of `cell_moments`, cells all alike

    Returns
    -------
    probability (bins,) of the cosine, at least `COSINE_FLOOR`; density (bins, rows, columns) of the rest over the unit
    square, 0 where nothing is left
    """
    shape = material.shape
    f, c = (values.reshape(shape[0], -1) for values in (material, matte))
    ratio = np.divide(f, c, out=np.full(f.shape, np.inf), where=c > 0)
    order = ratio.argsort(1)
    ratio, passed = (np.take_along_axis(values, order, 1) for values in (ratio, c))
    passed = passed.cumsum(1) / passed.sum(1, keepdims=True)
    best = np.full(shape[0], np.inf)
    probability, rest = np.ones(shape[0]), np.zeros(f.shape)
    for quantile in _QUANTILES:
        at = np.minimum((passed < quantile - 1e-9).sum(1), (c > 0).sum(1) - 1)
        level = np.take_along_axis(ratio, at[:, None], 1)
        over = np.where(c > 0, np.maximum(f - level * c, 0), 0)
        mean = over.mean(1, keepdims=True)
        share = np.maximum(np.divide(level, level + mean, out=np.ones_like(mean), where=mean > 0), COSINE_FLOOR)
        share = np.where(mean > 1e-9 * level, share, 1.0)
        left = np.divide(over, mean, out=np.zeros_like(over), where=share < 1)
        mixture = share * c + (1 - share) * left
        moment = np.divide(f * f, mixture, out=np.zeros_like(f), where=c > 0).mean(1)
        less = moment < best
        best, probability = np.where(less, moment, best), np.where(less, share[:, 0], probability)
        rest = np.where(less[:, None], left, rest)
    return probability, rest.reshape(shape)


def build_warp(source: Evaluates, layout: WarpLayout, progress: Callable[[float], None] | None = None) -> WarpSampler:
    """Warp tables for a source; `progress` is called with the share done."""
    probability, rest = matte_part(*cell_moments(source, layout, progress))
    bins, rows, columns = rest.shape
    across, roots = joined(rest.reshape(-1, columns), columns)
    along, _ = joined(roots.reshape(bins, rows), layout.strata)
    of_cell = along[..., None] * across.reshape(rest.shape) * (rows * columns)
    texels = np.zeros((bins, layout.width, 4))
    texels[:, : layout.strata, :3] = inverse_table(along, layout.strata)
    texels[:, : layout.strata, 3] = probability[:, None]
    texels[:, layout.strata :, :3] = inverse_table(across, columns).reshape(bins, -1, 3)
    texels[:, layout.strata :, 3] = ((1 - probability)[:, None, None] * of_cell).reshape(bins, -1)
    return WarpSampler(layout, texels.astype(np.float32))
