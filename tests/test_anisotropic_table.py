"""Four-dimensional tables in numpy: grids, poles, seams, filters, packing, and the sampler's density."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from measured_materials.bake import xp_numpy
from measured_materials.bake.directions import spherical
from measured_materials.bake.errors import BakeError
from measured_materials.bake.sampling.cell_sampler import build_sampler, find_texel
from measured_materials.bake.sampling.slope_cells import SlopeLayout
from measured_materials.bake.sources import analytic
from measured_materials.bake.tables.accuracy import direction_pairs, linear_estimate
from measured_materials.bake.tables.atlas import AtlasLayout, pack, unpack
from measured_materials.bake.tables.grids.anisotropic_grids import (
    NORMAL_KINDS,
    AnisotropicHalfGrid,
    AnisotropicNormalGrid,
    slope_unwarp,
)
from measured_materials.bake.tables.grids.grid import Grid
from measured_materials.bake.tables.grids.parameterization import LogWarp
from measured_materials.bake.tables.search.anisotropic_search import total_intensity
from measured_materials.bake.tables.search.grid_search import BASES, choose_grid
from measured_materials.bake.tables.table import FILTERS, Table, tabulate
from scipy import stats

BRUSHED = analytic.Ggx(alpha=0.1, alpha_y=0.4, f0=(0.9, 0.7, 0.4))
WARPS = LogWarp(0.1, 0.03), LogWarp(0.4, 0.01)
GRIDS: dict[str, Grid] = {
    "normal": AnisotropicNormalGrid((16, 10, 10, 24), 0.4, 0.2),
    "normal, folded": AnisotropicNormalGrid((8, 10, 10, 24), 0.4, 0.2, folded=True),
    "identity": AnisotropicNormalGrid((8, 10, 10, 24), folded=True, parameterization="identity"),
    "uniform": AnisotropicNormalGrid((16, 10, 10, 24), parameterization="uniform"),
    "fitted": AnisotropicNormalGrid((8, 10, 10, 24), folded=True, parameterization="fitted", warps=WARPS),
    "half": AnisotropicHalfGrid((16, 9, 20, 24), 0.2, 0.6, folded=False),
    "half, folded": AnisotropicHalfGrid((8, 9, 20, 24), 0.2, 0.6),
}


@pytest.mark.parametrize("name", GRIDS)
def test_samples_lie_where_the_lookup_expects_them(name: str) -> None:
    grid = GRIDS[name]
    index = np.meshgrid(*(np.arange(n) for n in grid.shape), indexing="ij")
    wi, wo = grid.directions(*index)
    assert np.abs(np.linalg.norm([wi, wo], axis=-1) - 1).max() < 1e-12
    assert min(wi[..., 2].min(), wo[..., 2].min()) > 0
    # Ends are taken short of the horizon and beside the poles, and pairs below the horizon are moved onto it.
    inside = (wi[..., 2] > 0.08) & (wo[..., 2] > 0.08)
    inside &= np.logical_and.reduce([(i > 0) & (i < n - 1) for i, n in zip(index[1:3], grid.shape[1:3])])
    if grid.boundaries[3] != "around":
        inside &= (index[3] > 0) & (index[3] < grid.shape[3] - 1)
    found = grid.coordinates(xp_numpy, wi, wo)
    for k, (position, whole) in enumerate(zip(found, index)):
        away = position - whole
        if grid.boundaries[k] == "around":
            away = (away + grid.shape[k] / 2) % grid.shape[k] - grid.shape[k] / 2
        if grid.basis == "half" and k == 1:
            # Moved theta_d: only those that the horizon does not cut.
            away = np.where(np.minimum(wi[..., 2], wo[..., 2]) > 0.3, away, 0)
        assert np.abs(away[inside]).max() < 1e-6, k


@pytest.mark.parametrize("name", GRIDS)
@pytest.mark.parametrize("filter", FILTERS)
def test_a_grey_lambertian_table_returns_its_albedo(name: str, filter: str) -> None:
    """Everywhere, at poles, seams and horizon: no gutter is missing, and weights sum to 1."""
    grid = GRIDS[name]
    table = tabulate(analytic.Lambert(0.5), grid)
    pairs = direction_pairs(4000, turned=True)
    value = table.evaluate(pairs.wi, pairs.wo, filter)
    if grid.basis == "normal":
        np.testing.assert_allclose(value, 0.5 / np.pi, rtol=1e-6)
    else:
        # Cosines are tabulated, not a constant: these steps leave an error, most at grazing where they are small.
        steep = np.minimum(pairs.wi[:, 2], pairs.wo[:, 2]) > 0.3
        off = np.abs(value[steep] * np.pi / 0.5 - 1)
        assert off.max() < (0.8 if filter == "nearest" else 0.15)
        assert np.median(off) < (0.15 if filter == "nearest" else 0.02)


@pytest.mark.parametrize("name", GRIDS)
def test_table_returns_the_estimate(name: str) -> None:
    """Tabulate and reconstruct against the sixteen samples round each pair, but for the poles' means."""
    grid, pairs = GRIDS[name], direction_pairs(3000, turned=True)
    whole = tabulate(BRUSHED, grid).evaluate(pairs.wi, pairs.wo)
    estimate = linear_estimate(BRUSHED, grid, pairs)
    _, b, r, _ = grid.coordinates(xp_numpy, pairs.wi, pairs.wo)
    near_pole = (b > grid.shape[1] - 2) | ((r > grid.shape[2] - 2) & (grid.basis == "normal"))
    keep = ~near_pole
    # float32 samples.
    np.testing.assert_allclose(whole[keep], estimate[keep], rtol=2e-6, atol=1e-6)


@pytest.mark.parametrize("name", GRIDS)
@pytest.mark.parametrize("filter", ["trilinear", "bspline"])
def test_no_seam_and_no_star(name: str, filter: str) -> None:
    """Across the seams of both azimuths, and round the pole, values go on without a step."""
    grid = GRIDS[name]
    rng = np.random.default_rng(2)
    # Above half of their range: `beyond_pole` holds at 0 what would be negative.
    values = 0.5 + 0.5 * rng.random((*grid.shape, 3)).astype(np.float32)
    if grid.basis == "half":
        values[:, -1] = values[:, -1].mean(0)
    else:
        values[:, :, -1] = values[:, :, -1].mean(2, keepdims=True)
    table = Table(grid, values)
    theta_i, theta_o, delta = rng.uniform(0.1, 1.2, (3, 400))
    step = 1e-7
    for seam in (0.0, np.pi / 2, np.pi, -np.pi / 2):
        before, after = (
            table.evaluate(spherical(theta_i, seam + delta + d), spherical(theta_o, seam + d), filter)
            for d in (-step, step)
        )
        # White noise changes by up to 1 a sample, of which 2e-7 rad is 1e-6 at most.
        assert np.abs(after - before).max() < 1e-4
        before, after = (
            table.evaluate(spherical(theta_i, delta + seam + d), spherical(theta_o, delta), filter)
            for d in (-step, step)
        )
        assert np.abs(after - before).max() < 1e-4
    if grid.basis == "half":
        # Round theta_d = 0 there is one value.
        wi, wo = pairs_about(spherical(0.4, 0.3), 1e-6, np.arange(0, 6.3, 0.2))
        around = table.evaluate(wi, wo, filter)
        assert np.ptp(around, 0).max() < 1e-4


def pairs_about(half: np.ndarray, theta_d: float, phi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    tangent = np.cross(half, [0.0, 1.0, 0.0])
    tangent /= np.linalg.norm(tangent)
    across = np.cross(half, tangent)
    d = np.sin(theta_d) * (np.cos(phi)[:, None] * tangent + np.sin(phi)[:, None] * across)
    return d + np.cos(theta_d) * half, -d + np.cos(theta_d) * half


def test_viewer_at_the_pole_sees_the_light_alone() -> None:
    """As phi_o turns about theta_o = 0 with the light at rest, only the steps' own error is left: no star.

    Half basis: none at all, h and d do not turn. Normal basis: the light meets other samples of phi_delta at each
    phi_o; the variation has to stay below the table's error against the source.
    """
    phi = np.linspace(0, 2 * np.pi, 97)
    wo = spherical(1e-6, phi)
    for light in (spherical(0.3, 0.4), spherical(0.9, 2.0)):
        for name, grid in GRIDS.items():
            table = tabulate(BRUSHED, grid)
            value = table.evaluate(np.broadcast_to(light, wo.shape), wo)
            truth = BRUSHED.evaluate(light, wo[0])
            star = np.ptp(value, 0).max() / truth.max()
            if grid.basis == "half":
                assert star < 1e-4, name
            else:
                assert star < 2 * np.abs(value / truth - 1).max(), name


@pytest.mark.parametrize("name", GRIDS)
@pytest.mark.parametrize("filter", ["trilinear", "bspline"])
def test_viewer_at_the_very_pole(name: str, filter: str) -> None:
    """Where a camera looks straight down on a plate wo is n to the last bit, and the light still has a side."""
    table = tabulate(BRUSHED, GRIDS[name])
    light = spherical(0.4, np.arange(0, 6.3, 0.1))
    at, beside = (table.evaluate(light, np.array(wo), filter) for wo in ([0.0, 0, 1], [1e-9, 0, 1]))
    np.testing.assert_allclose(at, beside, rtol=1e-6)
    assert at.max() > 2 * at.min()


@pytest.mark.parametrize("name", GRIDS)
def test_atlas_round_trip(name: str) -> None:
    grid = GRIDS[name]
    values = np.random.default_rng(1).random((*grid.shape, 3)).astype(np.float32)
    texture = pack(grid, values)
    assert texture.shape[1::-1] == AtlasLayout.of(grid).size
    np.testing.assert_array_equal(unpack(grid, texture), values)


def test_a_texture_too_large_is_refused() -> None:
    with pytest.raises(BakeError, match="lower resolution"):
        AtlasLayout.of(AnisotropicHalfGrid((64, 64, 256, 256)))


def test_finer_tables_are_closer() -> None:
    """Second order: at twice the samples an error of at most 0.4 of what it was, in either basis."""
    pairs = direction_pairs(4096, turned=True)
    truth = BRUSHED.evaluate(pairs.wi, pairs.wo)
    for coarse, fine in (
        (AnisotropicNormalGrid((16, 10, 10, 40), 0.4, 0.2), AnisotropicNormalGrid((32, 20, 20, 80), 0.4, 0.2)),
        (AnisotropicHalfGrid((8, 8, 24, 24), 0.2, 0.8), AnisotropicHalfGrid((16, 16, 48, 48), 0.2, 0.8)),
    ):
        first, second = (pairs.rms(linear_estimate(BRUSHED, g, pairs) - truth) for g in (coarse, fine))
        assert second < 0.4 * first


LAYOUTS = {
    "whole": SlopeLayout(6, 8, 12, 10, 0.1, 0.4),
    "folded": SlopeLayout(6, 4, 12, 10, 0.1, 0.4, folded=True),
}


@pytest.mark.parametrize("name", LAYOUTS)
def test_density_integrates_to_one(name: str) -> None:
    """Over all slopes, hence over all directions with those below the horizon."""
    layout = LAYOUTS[name]
    sampler = build_sampler(BRUSHED, layout)
    u = ((np.arange(600) + 0.5) / 300) - 1
    x, y = layout.width_x * u / (1 - np.abs(u)), layout.width_y * u / (1 - np.abs(u))
    x, y = np.meshgrid(x, y)
    half = np.stack([x, y, np.ones_like(x)], -1)
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    for theta_o, phi_o in ((0.02, 1.0), (0.7, 0.0), (0.7, 2.9), (0.7, 3.3), (1.3, -1.0)):
        wo = spherical(theta_o, phi_o)
        wo_half = half @ wo
        wi = 2 * wo_half[..., None] * half - wo
        jacobian = 4 * np.maximum(wo_half, 1e-6) * half[..., 2] ** 3
        area = (1 / 300) ** 2 * (layout.width_x + np.abs(x)) ** 2 / layout.width_x
        area *= (layout.width_y + np.abs(y)) ** 2 / layout.width_y
        # Half vectors that see the viewer from behind have no light direction: their share by the cells themselves.
        front = wo_half > 1e-6
        pdf = sampler.pdf(wi[front], np.broadcast_to(wo, wi[front].shape))
        inside = (pdf * (jacobian * area)[front]).sum()
        row = sampler.texels[int(layout.bin_of(xp_numpy, wo)), :, 2].reshape(layout.n_y, layout.n_x)
        side = -1 if layout.folded and np.pi - np.pi / 8 < phi_o % (2 * np.pi) < 2 * np.pi - np.pi / 8 else 1
        i_y, i_x = (
            np.minimum((1 + side * g) * n / 2, n - 1).astype(int)
            for g, n in zip(np.meshgrid(u, u)[::-1], (layout.n_y, layout.n_x))
        )
        behind = (row[i_y, i_x][~front]).sum() / 600**2
        # The midpoint rule is exact inside a cell, whose density in (u, v) is constant.
        assert abs(inside + behind - 1) < 1e-4


@pytest.mark.parametrize("name", LAYOUTS)
def test_draws_follow_the_density(name: str) -> None:
    """Chi-square over cells of slopes, for viewers on either side; and `pdf` is what `sample` says."""
    layout = LAYOUTS[name]
    sampler = build_sampler(BRUSHED, layout)
    rng = np.random.default_rng(4)
    count = 200_000
    for theta_o, phi_o in ((0.05, 2.0), (0.8, 3.0), (0.8, -0.2), (1.3, 4.0)):
        wo = np.broadcast_to(spherical(theta_o, phi_o), (count, 3))
        wi, pdf = sampler.sample(wo, rng.random((count, 4)))
        assert np.abs(np.linalg.norm(wi, axis=-1) - 1).max() < 1e-12
        # Where float64 puts a draw into the neighbouring cell, the densities are those of two cells.
        again = sampler.pdf(wi, wo)
        valid = (wi + wo)[:, 2] > 1e-6
        close = np.isclose(again, pdf, rtol=1e-6)
        assert close[valid].mean() > 0.9999
        bin_index, cell, _ = find_texel(xp_numpy, layout, wi[valid], wo[valid])
        seen = np.bincount(cell.astype(int), minlength=layout.cells)
        row = sampler.texels[int(bin_index[0]), :, 2]
        expected = row * (count / layout.cells)
        # Half vectors behind the viewer have no light direction: their cells' draws cannot be told apart.
        whole = (expected > 20) & in_front(layout, wo[0])
        assert row[whole].sum() > 0.8 * row.sum()
        statistic = ((seen - expected)[whole] ** 2 / expected[whole]).sum()
        # A false alarm once in a million runs; the seed is fixed.
        assert statistic < stats.chi2.isf(1e-6, whole.sum())


def in_front(layout: SlopeLayout, wo: np.ndarray) -> np.ndarray:
    """Cells (C,) of which every corner sees the viewer from the front: wo . (x, y, 1) > 0 is a half plane of slopes."""
    side = float(np.asarray(layout.side(xp_numpy, wo)))
    edges = [
        np.asarray(slope_unwarp(xp_numpy, np.clip(np.linspace(-1, 1, n + 1), -1 + 1e-6, 1 - 1e-6), width)) * side
        for n, width in ((layout.n_x, layout.width_x), (layout.n_y, layout.width_y))
    ]
    front = wo[0] * edges[0] + wo[1] * edges[1][:, None] + wo[2] > 0
    return (front[1:, 1:] & front[1:, :-1] & front[:-1, 1:] & front[:-1, :-1]).ravel()


def test_sampler_lowers_the_variance() -> None:
    """Against the cosine: of a brushed metal seen at 45 degrees it needs a fiftieth of the samples."""
    sampler = build_sampler(BRUSHED, SlopeLayout(8, 8, 24, 24, 0.1, 0.4))
    rng = np.random.default_rng(8)
    u = rng.random((40_000, 4))
    wo = np.broadcast_to(spherical(0.8, 1.1), (len(u), 3))
    wi, pdf = sampler.sample(wo, u)
    weight = BRUSHED.evaluate(wi, wo)[:, 0] * np.maximum(wi[:, 2], 0) / pdf
    matte = spherical(np.arcsin(np.sqrt(u[:, 0])), 2 * np.pi * u[:, 1])
    flat = BRUSHED.evaluate(matte, wo)[:, 0] * np.pi
    assert abs(weight.mean() / flat.mean() - 1) < 0.05  # 40 000 draws by the cosine are good to 2 %
    assert weight.var() < 0.02 * flat.var()


# --- choice -----------------------------------------------------------------------------------------------


def chosen(basis: str, kind: str, **options: object) -> Grid:
    bases = BASES if basis == "auto" else (basis,)
    return choose_grid(BRUSHED, 24, bases, parameterization=kind, **options).grid  # type: ignore[arg-type]


def test_a_named_parameterization_is_taken() -> None:
    pairs = direction_pairs(4000, turned=True)
    truth, rms = BRUSHED.evaluate(pairs.wi, pairs.wo), {}
    for kind in NORMAL_KINDS:
        grid = chosen("auto" if kind in ("identity", "uniform") else "normal", kind)
        assert isinstance(grid, AnisotropicNormalGrid) and grid.parameterization == kind
        rms[kind] = pairs.rms(linear_estimate(BRUSHED, grid, pairs) - truth)
    assert rms["fitted"] < rms["bezier"] < rms["uniform"] < rms["identity"]
    assert isinstance(chosen("auto", "auto"), AnisotropicHalfGrid)


def test_alpha_given_or_of_largest_intensity() -> None:
    given = chosen("normal", "bezier", alpha=(0.3, 0.6))
    assert isinstance(given, AnisotropicNormalGrid) and (given.alpha_theta, given.alpha_phi) == (0.3, 0.6)
    by_intensity = chosen("normal", "bezier", alpha="intensity")
    assert isinstance(by_intensity, AnisotropicNormalGrid)
    # More of the table lies in the highlight, at every resolution that is summed.
    assert total_intensity(BRUSHED, by_intensity, 24) > total_intensity(BRUSHED, replace(given, alpha_phi=0.9), 24)


@pytest.mark.parametrize("basis, kind", [("half", "bezier"), ("auto", "squared"), ("normal", "squared")])
def test_what_a_basis_does_not_have_is_refused(basis: str, kind: str) -> None:
    with pytest.raises(BakeError, match="parameterization: cannot be"):
        chosen(basis, kind)
