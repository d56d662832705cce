"""Directions towards the bright parts of a world, and the density of drawing them: for aimed sampling.

The sphere is cut into cells of equal solid angle: columns even in azimuth, rows even in z, row 0 at the nadir (the
cylindrical projection of Archimedes and Lambert, in the order of Blender's pixels). So jitter inside a cell is even in
solid angle by itself, no cell is wasted on the poles, and direction and texture coordinates belong together without an
arccosine:

    u = 1/2 + atan2(y, x) / (2 pi),    v = (1 + z) / 2

An alias table over the cells answers a draw with one texel, and the density of any direction with another: column and
row of the alias, density per steradian, acceptance. What is drawn is not the world but what stands out of its mean,
max(L - mean L, 0): the rest is found as well by the material's own sampler, with which the draws are combined by the
balance heuristic (the idea is that of Karlik, Sik, Vevoda, Skrivan and Krivanek 2019, MIS Compensation). A sample of a
matte mirror under nine worlds has a noise of 0.07 to 0.9 of its mean this way, 0.7 to 1.3 where all of the world is
drawn, 0.5 to 120 unaimed.

A stale table costs noise, never bias: the density is the table's own, whatever the world looks like now.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from .. import xp_numpy
from ..source import Array
from .alias_tables import alias_tables

# A cell is as large as 1.5 sun discs. Powers of two, so that the 24 bits of a random number choose evenly; 15 are left
# to place the draw in the cell.
COLUMNS, ROWS = 512, 256
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
# Pixels around the world that cells are averaged from, about 10 to a cell.
_LATTICE = 2048
# Draws keep this part of a cell away from its edges: there rounding might look the density up next door, where it may
# be 0. The draw's density is then wrong by as much, which no picture shows.
_MARGIN = 2.5e-4
# Irradiance expected of the structure is not believed to be less than this part of its mean over all normals.
_LEAST = 0.1
# Where aiming pays. Its 53 nodes cost a mirror of few nodes a quarter of its time, hence at least the root of 1.25 must
# be gained. A noise of 0.2 a sample is that of Diffuse BSDF under such worlds, and nobody complains of it.
LARGEST_RATIO, LEAST_NOISE = 0.8, 0.2


@dataclass(frozen=True)
class CellLight:
    """Mean luminance of each cell, and the root of its mean square; (rows, columns), row 0 at the nadir."""

    mean: Array
    rms: Array


@dataclass(frozen=True)
class WorldStructure:
    """Structure of a world: what stands out of its mean, and what it is worth to aim at it.

    Parameters
    ----------
    flux : integral of what stands out over all directions; luminance times steradian
    toward : (3,) the same, times the direction
    background : irradiance of the rest, about
    unaimed, aimed : standard deviation of a sample over its mean, on matte surfaces of all normals under this world
        alone, as `predicted_noise` has it
    bright_light, bright_sky : shares of the light, and of the sphere, of the cells that stand out
    """

    flux: float
    toward: tuple[float, float, float]
    background: float
    unaimed: float
    aimed: float
    bright_light: float
    bright_sky: float

    @property
    def pays(self) -> bool:
        """Whether aiming makes good for its nodes, and for noise that anyone would see."""
        return self.unaimed > LEAST_NOISE and self.aimed < LARGEST_RATIO * self.unaimed


def cell_light(
    radiance: Array, to_world: Array | None = None, *, columns: int = COLUMNS, rows: int = ROWS
) -> CellLight:
    """Average an equirectangular picture over cells of equal solid angle.

    Parameters
    ----------
    radiance : (H, W, 3 or more) linear; row 0 at the zenith, azimuth falling from pi at the left edge to -pi, as Cycles
        has it. Negative and undefined values count as 0.
    to_world : (3, 3) rotation or reflection from the picture's directions to those of the world
    """
    luminance = np.asarray(radiance[..., :3], np.float32) @ _LUMINANCE
    luminance = np.clip(np.nan_to_num(luminance, nan=0.0, posinf=65504.0), 0, None)
    mean, square, x_edges, y_edges = _on_lattice(luminance)
    z_edges = np.cos(y_edges * np.pi)
    solid_angle = (z_edges[:-1] - z_edges[1:])[:, None] * (np.diff(x_edges) * 2 * np.pi)
    azimuth = (0.5 - 0.5 * (x_edges[:-1] + x_edges[1:])) * 2 * np.pi
    z = 0.5 * (z_edges[:-1] + z_edges[1:])
    sine = np.sqrt(1 - z * z)
    turn = np.eye(3) if to_world is None else np.asarray(to_world, np.float64)
    x, y, up = (
        (row[0] * np.cos(azimuth) + row[1] * np.sin(azimuth)) * sine[:, None] + row[2] * z[:, None] for row in turn
    )
    column = np.minimum((0.5 + np.arctan2(y, x) / (2 * np.pi)) * columns, columns - 1).astype(np.intp)
    cell = np.clip((1 + up) * (rows / 2), 0, rows - 1).astype(np.intp) * columns + column
    sums = [
        np.bincount(cell.ravel(), (solid_angle * part).ravel(), rows * columns).reshape(rows, columns)
        for part in (np.ones_like(mean), mean, square)
    ]
    area = np.maximum(sums[0], 1e-30)
    return CellLight(sums[1] / area, np.sqrt(sums[2] / area))


def _on_lattice(luminance: Array) -> tuple[Array, Array, Array, Array]:
    """Mean and mean square over a lattice about `_LATTICE` wide, and its edges in [0, 1] across and down."""
    height, width = luminance.shape
    if width < _LATTICE:
        for axis in (0, 1):
            luminance = _magnified(luminance, math.ceil(_LATTICE / width), axis)
        across, down = (np.linspace(0, 1, n + 1) for n in luminance.shape[::-1])
        return luminance, luminance * luminance, across, down
    # Cycles interpolates: of a bright pixel an eighth of the light lies beyond either edge.
    for axis in (0, 1):
        luminance = 0.75 * luminance + 0.125 * (_shifted(luminance, 1, axis) + _shifted(luminance, -1, axis))
    starts = [
        np.linspace(0, n, min(n, m), endpoint=False).astype(np.intp)
        for n, m in ((height, _LATTICE // 2), (width, _LATTICE))
    ]
    mean, square = (
        np.add.reduceat(np.add.reduceat(values, starts[0], 0, np.float64), starts[1], 1)
        for values in (luminance, luminance * luminance)
    )
    edges = [np.append(start, n) / n for start, n in zip(starts, (height, width))]
    pixels = np.diff(edges[0] * height)[:, None] * np.diff(edges[1] * width)
    return mean / pixels, square / pixels, edges[1], edges[0]


def _magnified(values: Array, factor: int, axis: int) -> Array:
    """Linear interpolation at `factor` places a pixel."""
    place = (np.arange(values.shape[axis] * factor) + 0.5) / factor - 0.5
    below = np.floor(place).astype(np.intp)
    weight = np.expand_dims((place - below).astype(np.float32), 1 - axis)
    size = values.shape[axis]
    low, high = (k % size if axis else np.clip(k, 0, size - 1) for k in (below, below + 1))
    return np.take(values, low, axis) * (1 - weight) + np.take(values, high, axis) * weight


def _shifted(values: Array, step: int, axis: int) -> Array:
    """The neighbours: around the world across, the same row again beyond a pole."""
    rolled = np.roll(values, step, axis)
    if axis == 0:
        edge = 0 if step > 0 else -1
        rolled[edge] = values[edge]
    return rolled


def world_structure(cells: CellLight, largest_share: float = 0.9) -> tuple[WorldStructure, Array]:
    """Structure of a world, and the weights (rows, columns) of cells to draw it by."""
    mean = float(cells.mean.mean())
    rows, columns = cells.mean.shape
    excess = np.maximum(cells.mean - mean, 0)
    # Under a density even in each cell, the variance is least in proportion to the root of the mean square.
    weights = np.where(excess > 0, np.maximum(cells.rms - mean, 0), 0)
    # An even world leaves rounding errors.
    if excess.sum() <= 1e-5 * cells.mean.sum():
        weights = np.zeros_like(weights)
    solid_angle = 4 * np.pi / (rows * columns)
    toward = np.tensordot(excess, cell_directions(columns, rows), 2) * solid_angle
    flux = float(excess.sum() * solid_angle)
    background = math.pi * float(np.minimum(cells.mean, mean).mean())
    bright = weights > 0
    light = max(float(cells.mean.sum()), 1e-30)
    unaimed, aimed = predicted_noise(cells, weights, toward, flux, background, largest_share)
    structure = WorldStructure(
        flux,
        (float(toward[0]), float(toward[1]), float(toward[2])),
        background,
        unaimed,
        aimed,
        float(cells.mean[bright].sum() / light),
        float(bright.mean()),
    )
    return structure, weights


def predicted_noise(
    cells: CellLight, weights: Array, toward: Array, flux: float, background: float, largest_share: float
) -> tuple[float, float]:
    """Standard deviation of one sample over its mean, on a matte surface, without and with aiming.

    By quadrature over the cells, for draws by the cosine alone and for their mixture with draws by `weights` in the
    shares that the shader gives them; the mean over 26 normals around the sphere.
    """
    rows, columns = cells.mean.shape
    solid_angle = 4 * np.pi / (rows * columns)
    directions = cell_directions(columns, rows).reshape(-1, 3)
    mean, square = cells.mean.ravel(), (cells.rms**2).ravel()
    density = weights.ravel() / max(weights.sum() * solid_angle, 1e-30)
    totals = []
    for normal in (np.array(n) for n in product((-1, 0, 1), repeat=3) if any(n)):
        normal = normal / np.linalg.norm(normal)
        up = np.flatnonzero(directions @ normal > 0)
        cosine = directions[up] @ normal
        expected = expected_world_light(xp_numpy, toward / 2, flux / 4, normal)
        share = min(expected / max(expected + background, 1e-30), largest_share)
        moment = square[up] * cosine * cosine * solid_angle
        mixture = share * density[up] + (1 - share) * cosine / np.pi
        irradiance = float(mean[up] @ cosine) * solid_angle
        totals.append((irradiance**2, float((moment / (cosine / np.pi)).sum()), float((moment / mixture).sum())))
    squared_mean, unaimed, aimed = np.mean(totals, 0)
    if squared_mean <= 0:
        return 0.0, 0.0
    first, second = (float(np.sqrt(max(moment / squared_mean - 1, 0.0))) for moment in (unaimed, aimed))
    return first, second


def cell_directions(columns: int, rows: int) -> Array:
    """Unit vectors (rows, columns, 3) to the middle of each cell."""
    azimuth = (np.arange(columns) + 0.5) * (2 * np.pi / columns) - np.pi
    z = (np.arange(rows) + 0.5)[:, None] * (2 / rows) - 1
    sine = np.sqrt(1 - z * z)
    return np.stack(np.broadcast_arrays(sine * np.cos(azimuth), sine * np.sin(azimuth), z), -1)


def world_texels(weights: Array) -> Array:
    """Alias table (rows, columns, 4) float32 of cells drawn in proportion to weights, row 0 at the nadir.

    Column and row of the alias, density per steradian, acceptance.
    """
    rows, columns = weights.shape
    probability = (weights / weights.sum()).reshape(1, -1)
    acceptance, alias = alias_tables(probability)
    density = probability * (rows * columns / (4 * np.pi))
    texels = np.stack([alias % columns, alias // columns, density, acceptance], -1)
    return texels.reshape(rows, columns, 4).astype(np.float32)


def choose_cell(xp: Any, columns: int, rows: int, u1: Any, u2: Any) -> tuple[Any, Any, Any]:
    """Texture coordinates to read, cell (column, row, 0) and place in it, for two random numbers.

    All are vectors whose third component means nothing. What choosing leaves of the numbers is the place.
    """
    # Random numbers include 1: a last float below it.
    across, up = u1 * (columns * (1 - 2.0**-24)), u2 * (rows * (1 - 2.0**-24))
    cell = xp.vec(xp.floor(across), xp.floor(up), 0.0)
    at = (cell + xp.vec(0.5, 0.5, 0.0)) * xp.vec(1 / columns, 1 / rows, 0.0)
    place = xp.vec(across, up, 0.0) - cell
    margin = xp.vec(_MARGIN, _MARGIN, 0.0)
    return at, cell, xp.scale(place, 1 - 2 * _MARGIN) + margin


def draw_in_world(xp: Any, columns: int, rows: int, cell: Any, alias: Any, keep: Any, place: Any) -> Any:
    """Direction, from the texel of a chosen cell.

    Parameters
    ----------
    cell, place : of `choose_cell`
    alias : the texel's first three numbers
    keep : 1 with the probability of the texel's acceptance, else 0
    """
    at = (xp.where_vector(keep, cell, alias) + place) * xp.vec(2 * math.pi / columns, 2 / rows, 0.0)
    azimuth, z, _ = xp.components(at - xp.vec(math.pi, 1.0, 0.0))
    sine = xp.sqrt(1 - z * z)
    return xp.vec(sine * xp.cos(azimuth), sine * xp.sin(azimuth), z)


def world_coordinates(xp: Any, wi: Any) -> tuple[Any, Any]:
    """Texture coordinates (u, v), v upwards, of the cell around a direction."""
    x, y, z = xp.components(wi)
    return xp.arctan2(y, x) * (1 / (2 * math.pi)) + 0.5, z * 0.5 + 0.5


def expected_world_light(xp: Any, toward: Any, flux: Any, normal: Any) -> Any:
    """About the irradiance of what stands out, from the first two orders of spherical harmonics.

    Parameters
    ----------
    toward, flux : half of `WorldStructure.toward`, a quarter of its `flux`
    """
    return xp.maximum(xp.dot(toward, normal) + flux, flux * _LEAST)


def expected_world_light_on_sheet(xp: Any, toward: Any, flux: Any, normal: Any, front: Any) -> Any:
    """The same of both sides of a sheet, as `bake.sampling.lamps.expected_light_on_sheet` has it."""
    before, behind = (expected_world_light(xp, toward, flux, side) for side in (normal, xp.scale(normal, -1.0)))
    return before * front + behind * (1 - front)
