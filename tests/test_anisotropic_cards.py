"""Anisotropic node groups on render cards: the same numbers as numpy."""

from __future__ import annotations

import numpy as np
import pytest
from measured_materials.bake import xp_numpy
from measured_materials.bake.directions import normalize, spherical
from measured_materials.bake.sampling.cell_sampler import build_sampler
from measured_materials.bake.sampling.slope_cells import SlopeLayout
from measured_materials.bake.sources import analytic
from measured_materials.bake.tables.atlas import pack
from measured_materials.bake.tables.grids.anisotropic_grids import AnisotropicHalfGrid, AnisotropicNormalGrid
from measured_materials.bake.tables.grids.grid import Grid
from measured_materials.bake.tables.grids.parameterization import LogWarp
from measured_materials.bake.tables.table import FILTERS, Table
from measured_materials.nodes.alias_sampler_group import alias_pdf_group, alias_sampler_group
from measured_materials.nodes.group import call
from measured_materials.nodes.table_lookup_group import table_lookup_group
from measured_materials.nodes.tangent_frame_group import tangent_frame_group
from support.cards import card, data_image

WARPS = LogWarp(0.1, 0.03), LogWarp(0.4, 0.01)
GRIDS: dict[str, Grid] = {
    "normal": AnisotropicNormalGrid((12, 7, 8, 20), 0.4, 0.3),
    "normal, folded": AnisotropicNormalGrid((6, 7, 8, 20), 0.4, 0.3, folded=True),
    "uniform": AnisotropicNormalGrid((12, 7, 8, 20), parameterization="uniform"),
    "fitted": AnisotropicNormalGrid((6, 7, 8, 20), folded=True, parameterization="fitted", warps=WARPS),
    "half": AnisotropicHalfGrid((12, 6, 15, 17), 0.2, 0.6, folded=False),
    "half, folded": AnisotropicHalfGrid((6, 6, 15, 17), 0.2, 0.6),
}
BRUSHED = analytic.Ggx(alpha=0.1, alpha_y=0.4)


def random_table(grid: Grid) -> Table:
    """White noise: the harshest table there is."""
    values = np.random.default_rng(3).random((*grid.shape, 3)).astype(np.float32)
    if grid.basis == "half":
        values[:, -1] = values[:, -1].mean(0)
    else:
        values[:, :, -1] = values[:, :, -1].mean(2, keepdims=True)
    return Table(grid, values)


def directions(count: int = 6000) -> tuple[np.ndarray, np.ndarray]:
    """Pairs from the pole to a degree above the horizon, mirror pairs and wo = n among them, in all azimuths."""
    rng = np.random.default_rng(6)
    wi, wo = (spherical(rng.uniform(0, 1.55, count), rng.uniform(-np.pi, np.pi, count)) for _ in range(2))
    part = slice(0, count // 3)
    half = spherical(rng.uniform(0, 0.3, count // 3), rng.uniform(-np.pi, np.pi, count // 3))
    wi[part] = 2 * np.sum(wo[part] * half, -1, keepdims=True) * half - wo[part]
    wo[-40:-20] = 0, 0, 1
    keep = wi[:, 2] > 0.02
    return normalize(wi[keep]).astype(np.float32), normalize(wo[keep]).astype(np.float32)


@pytest.mark.parametrize("name", GRIDS)
@pytest.mark.parametrize("filter", FILTERS)
def test_lookup(name: str, filter: str) -> None:
    """Coordinates, slices, gutters, the image's filter and the blend along the other two axes."""
    grid = GRIDS[name]
    table = random_table(grid)
    image = data_image(f"table {name}", pack(grid, table.values))
    group = table_lookup_group(f"card {name} {filter}", image, grid, filter)
    wi, wo = directions()
    (found,) = card(lambda a, b: call(group, a, b, 0.5), wi, wo)
    wi, wo = wi.astype(float), wo.astype(float)
    factor = np.broadcast_to(grid.factor(xp_numpy, wi, wo), len(wi))
    off = np.abs(found - table.evaluate(wi, wo, filter)).max(-1) * factor
    position = np.stack(grid.coordinates(xp_numpy, wi, wo), -1)
    if filter == "nearest":
        # At the border between two samples either is right; float32 decides within 1e-3 of a sample.
        off = off[(np.abs(position - np.floor(position) - 0.5) > 1e-3).all(-1)]
    # Azimuths lose eps / sine at a pole, where the slices still differ: 6e-8 / 1e-3 of 12 samples. Elsewhere texture
    # coordinates have 2^-24 of up to 300 texels, and white noise turns a sample's share into as much value.
    assert np.quantile(off, 0.995) < 3e-4
    assert off.max() < 5e-3
    assert np.median(off) < 2e-5


@pytest.mark.parametrize("name", ["normal", "half, folded"])
@pytest.mark.parametrize("filter", ["trilinear", "bspline"])
def test_stochastic_slice_averages_to_the_blend(name: str, filter: str) -> None:
    grid = GRIDS[name]
    table = random_table(grid)
    image = data_image(f"stochastic {name}", pack(grid, table.values))
    group = table_lookup_group(f"stochastic {name} {filter}", image, grid, filter, stochastic=True)
    wi, wo = (w[-40:] for w in directions())
    steps = 1600
    u = np.tile((np.arange(steps) + 0.5) / steps, len(wi)).astype(np.float32)
    (found,) = card(group_call(group), np.repeat(wi, steps, 0), np.repeat(wo, steps, 0), u)
    wi, wo = wi.astype(float), wo.astype(float)
    factor = np.broadcast_to(grid.factor(xp_numpy, wi, wo), len(wi))[:, None]
    off = (found.reshape(len(wi), steps, 3).mean(1) - table.evaluate(wi, wo, filter)) * factor
    # An even grid of 1600 numbers misses each of at most 15 jumps by half a step.
    assert np.abs(off).max() < 15 * 0.5 / steps


def group_call(group: object) -> object:
    return lambda a, b, r: call(group, a, b, r)


@pytest.mark.parametrize("folded", [False, True])
def test_sampler(folded: bool) -> None:
    """Directions and densities of draws equal numpy's, random numbers of exactly 0 and 1 included."""
    layout = SlopeLayout(6, 8, 14, 12, 0.1, 0.4, folded)
    sampler = build_sampler(BRUSHED, layout)
    image = data_image("slopes", sampler.texels)
    draw, ask = (make(f"card slopes {folded}", image, layout) for make in (alias_sampler_group, alias_pdf_group))
    rng = np.random.default_rng(5)
    count = 6000
    theta = np.concatenate([[0, 1e-4, np.pi / 2 - 1e-3], np.arccos(rng.random(count - 3))])
    wo = spherical(theta, rng.uniform(-np.pi, np.pi, count)).astype(np.float32)
    u = rng.random((count, 4)).astype(np.float32)
    u[:81] = np.stack(np.meshgrid(*[[0, 0.37, 1]] * 4), -1).reshape(-1, 4)
    keep = away_from_borders(sampler, wo, u)
    wo, u = wo[keep], u[keep]
    wi, pdf = card(lambda o, *r: call(draw, o, *r), wo, *u.T)
    expected_wi, expected_pdf = sampler.sample(wo.astype(float), u.astype(float))
    # A place in a cell is known to 2^-24 / 0.07 of it; slopes out to the tail magnify that by 1 / (1 - u)^2.
    assert np.quantile(np.abs(wi - expected_wi).max(-1), 0.98) < 4e-6
    up = expected_wi[:, 2] > 0.01
    off = np.abs(pdf / expected_pdf - 1)[up]
    assert np.median(off) < 1e-6 and np.quantile(off, 0.98) < 1e-4
    (density,) = card(lambda i, o: call(ask, i, o), wi[up], wo[up])
    truth = sampler.pdf(wi[up].astype(float), wo[up].astype(float))
    off = np.abs(density / truth - 1)
    # At the edge of a cell either of two is right.
    assert np.median(off) < 1e-6 and np.quantile(off, 0.98) < 1e-4


def away_from_borders(sampler: object, wo: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Draws whose bin, cell and acceptance are decided by more than float32's last bits."""
    layout = sampler.layout
    near = [layout.bin_of(xp_numpy, normalize(wo.astype(float) + d)) for d in 1e-5 * np.vstack([np.eye(3), -np.eye(3)])]
    same = np.ptp(near, 0) == 0
    cell = u[:, 0].astype(float) * layout.cells
    row = layout.bin_of(xp_numpy, wo.astype(float)).astype(int)
    acceptance = sampler.texels[row, np.minimum(cell, layout.cells - 1).astype(int), 0]
    edge = (u[:, 0] == 0) | (u[:, 0] == 1)
    return same & (np.abs(u[:, 1] - acceptance) > 1e-5) & (edge | (np.abs(cell - np.round(cell)) > 1e-3))


def test_tangent_frame_is_right_handed_and_keeps_the_tangent() -> None:
    """At every angle: orthonormal, t x b = n, the tangent in the half plane given, and wo what numpy says."""
    rng = np.random.default_rng(9)
    normal, incoming, tangent = (normalize(rng.normal(size=(2000, 3))).astype(np.float32) for _ in range(3))
    tangent[:5] = normal[:5]  # no tangent at all
    wo, t, b = card(lambda *v: call(tangent_frame_group(), *v), normal, incoming, tangent)
    np.testing.assert_allclose(np.cross(t, b), normal, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(t, axis=1), 1, atol=1e-6)
    side = np.sum(t * tangent, 1) - np.sqrt(np.maximum(1 - np.sum(normal * tangent, 1) ** 2, 0))
    # Near the normal a tangent has few digits across it.
    across = np.linalg.norm(np.cross(normal, tangent), axis=1)
    assert np.abs(side[5:] * across[5:]).max() < 1e-5
    front = np.sum(normal * incoming, 1) > 2e-3
    back = wo[:, :1] * t + wo[:, 1:2] * b + wo[:, 2:] * normal
    assert np.abs(back - incoming)[front].max() < 2e-6
