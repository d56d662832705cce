"""Tables, their continuation at the ends, the atlas, filters, fitted splines and the search for alpha."""

from __future__ import annotations

import numpy as np
import pytest
from measured_materials.bake import xp_numpy
from measured_materials.bake.directions import spherical
from measured_materials.bake.sources import analytic
from measured_materials.bake.tables.accuracy import DirectionPairs, direction_pairs, linear_estimate
from measured_materials.bake.tables.atlas import AtlasLayout, atlas_uv, pack, unpack
from measured_materials.bake.tables.bspline_fit import fit_coefficients, sample_spline
from measured_materials.bake.tables.grids.grid import HORIZON_SHARES
from measured_materials.bake.tables.grids.half_vector_grid import HalfVectorGrid
from measured_materials.bake.tables.grids.normal_vector_grid import MAX_RESOLUTION, NormalVectorGrid
from measured_materials.bake.tables.grids.parameterization import PARAMETERIZATIONS
from measured_materials.bake.tables.padding import GUTTER, pad_slices
from measured_materials.bake.tables.search.alpha_search import estimate_intensity, search_alpha
from measured_materials.bake.tables.search.isotropic_search import half_sizes
from measured_materials.bake.tables.table import FILTERS, Table, tabulate
from measured_materials.bake.tables.treated_source import TreatedSource


@pytest.mark.parametrize("kind", PARAMETERIZATIONS)
@pytest.mark.parametrize("filter", FILTERS)
def test_grey_lambert_is_reproduced_exactly(kind: str, filter: str) -> None:
    """Constant in, the same constant out: albedo / pi to float32, at the pole, the horizon and between."""
    table = tabulate(analytic.Lambert(), NormalVectorGrid(8, kind, 0.2, 0.8))
    pairs = direction_pairs(5000)
    assert np.abs(table.evaluate(pairs.wi, pairs.wo, filter) * np.pi / 0.5 - 1).max() < 3e-7


@pytest.mark.parametrize("kind", PARAMETERIZATIONS)
def test_samples_are_met_at_their_nodes(kind: str) -> None:
    """At a node every interpolating filter returns the sample itself."""
    rng = np.random.default_rng(0)
    n = 12
    values = rng.random((n, n, 2 * n, 3)).astype(np.float32)
    values[:, -1] = values[:, -1, :1]
    values[-1] = values[-1, :, :1]
    table = Table(NormalVectorGrid(n, kind, 0.3, 0.6), values)
    i_o, i_i, i_phi = (a.ravel() for a in np.meshgrid(range(1, n - 1), range(1, n - 1), range(2 * n), indexing="ij"))
    wi, wo = table.grid.directions(i_o, i_i, i_phi)
    for filter in ("nearest", "trilinear"):
        assert np.abs(table.evaluate(wi, wo, filter) - values[i_o, i_i, i_phi]).max() < 1e-13


def test_trilinear_converges_with_the_square_of_the_resolution() -> None:
    """A smooth lobe: halving the spacing quarters the error."""
    source, pairs = analytic.Ggx(alpha=0.4), direction_pairs(4096)
    # The value grows without bound at the horizon: below 70 degrees it is smooth.
    keep = (pairs.wi[:, 2] > 0.34) & (pairs.wo[:, 2] > 0.34)
    pairs = DirectionPairs(pairs.wi[keep], pairs.wo[keep], pairs.weight[keep])
    truth = source.evaluate(pairs.wi, pairs.wo)
    rms = [
        pairs.rms(tabulate(source, NormalVectorGrid(n, "uniform")).evaluate(pairs.wi, pairs.wo) - truth)
        for n in (16, 32, 64)
    ]
    assert rms[0] / rms[1] > 3 and rms[1] / rms[2] > 3


@pytest.mark.parametrize("alpha", [0.1, 0.3])
def test_one_value_at_the_pole_and_no_crease_at_phi_0_and_pi(alpha: float) -> None:
    """The cubic filter gives the normal one value from every azimuth, and no slope across phi_delta 0 and pi."""
    table = tabulate(analytic.Ggx(alpha=alpha), NormalVectorGrid(32, "bezier", 0.3, 0.3))
    phi = np.linspace(0, np.pi, 50)
    for theta in (0.0, 0.3, 1.2):
        other = np.broadcast_to(spherical(theta, 0.0), (50, 3))
        for wi, wo in ((spherical(1e-6, phi), other), (other, spherical(1e-6, phi))):
            ring = table.evaluate(wi, wo, "bspline")[:, 0]
            # Where the lobe is so narrow that 2 mean - row would be negative, 0 stands in for it: a few per cent.
            assert np.ptp(ring) < (1e-4 if alpha == 0.3 else 0.05) * ring.mean()
    step = 1e-4
    for phi_0 in (0.0, np.pi):
        near = table.evaluate(spherical(0.5, phi_0 + np.array([0, step])), spherical(0.5, np.zeros(2)), "bspline")[:, 0]
        assert abs(near[1] - near[0]) / step < 0.01 * near[0]


def test_padding_continues_what_it_says() -> None:
    """Mirrored azimuth, one value at the normal, held at the horizon, and never negative."""
    values = 1 + np.random.default_rng(1).random((6, 6, 12, 3)).astype(np.float32)
    grid = NormalVectorGrid(6, "uniform")
    padded = pad_slices(grid, values)
    inner = padded[:6, GUTTER:-GUTTER, GUTTER:-GUTTER]
    assert (inner == values).all()
    assert (padded[:6, GUTTER:-GUTTER, 0] == values[:, :, 2]).all()
    assert (padded[:6, 0, GUTTER:-GUTTER] == values[:, 0]).all()
    assert np.ptp(padded[:6, -GUTTER, GUTTER:-GUTTER] + values[:, -2], axis=1).max() < 7e-7
    assert np.ptp(padded[6, GUTTER:-GUTTER, GUTTER:-GUTTER] + values[-2], axis=1).max() < 7e-7
    assert (pad_slices(grid, values**20) >= 0).all()


@pytest.mark.parametrize("n", [4, 5, 16, 33, 64, 100])
def test_atlas_round_trip_and_place(n: int) -> None:
    """Packing loses nothing, stays within texture limits, and atlas_uv points at the right texel's centre."""
    values = np.random.default_rng(n).random((n, n, 2 * n, 3)).astype(np.float32)
    grid = NormalVectorGrid(n, "uniform")
    pixels, layout = pack(grid, values), AtlasLayout.of(grid)
    assert pixels.shape == (layout.size[1], layout.size[0], 3) and max(layout.size) <= 16384
    assert (unpack(grid, pixels) == values).all()
    i_o, i_i, i_phi = (np.arange(n), (np.arange(n) * 7) % n, (np.arange(n) * 5) % (2 * n))
    u, v = atlas_uv(xp_numpy, layout, i_o.astype(float), i_i.astype(float), i_phi.astype(float))
    x, y = u * layout.size[0], (1 - v) * layout.size[1]
    assert np.allclose(x % 1, 0.5, atol=1e-6) and np.allclose(y % 1, 0.5, atol=1e-6)
    assert (pixels[y.astype(int), x.astype(int)] == values[i_o, i_i, i_phi]).all()


def test_largest_table_fits_a_texture() -> None:
    """256 x 256 x 512 is the reference size of the figures of Mallett & Yuksel 2016."""
    assert max(AtlasLayout.of(NormalVectorGrid(MAX_RESOLUTION, "uniform")).size) <= 16384
    for reciprocal in (True, False):
        assert all(AtlasLayout.of(HalfVectorGrid(sizes)) for sizes in half_sizes(MAX_RESOLUTION, reciprocal))


def test_poles_do_not_depend_on_the_azimuth() -> None:
    """A source that contradicts itself at the normal, as real files do, gives a table that does not."""

    class Contradictory:
        name, isotropic, bilateral, facts = "contradictory", True, True, {}

        def evaluate(self, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
            wi, wo = np.broadcast_arrays(wi, wo)
            cosine = wi[..., 0] / np.maximum(np.hypot(wi[..., 0], wi[..., 1]), 1e-300)
            return np.repeat((1 + cosine**2)[..., None], 3, -1)

    for alpha_phi in (0.0, 0.5, 1.0):
        table = tabulate(Contradictory(), NormalVectorGrid(32, "bezier", 0.4, alpha_phi))
        assert (table.values[:, -1] == table.values[:, -1, :1]).all()
        assert (table.values[-1] == table.values[-1, :, :1]).all()
        # cos^2 of the azimuth has the mean 1/2, however the samples crowd.
        assert table.values[3, -1, 0, 0] == pytest.approx(1.5, abs=0.01)
        assert table.values[-1, 3, 0, 0] == pytest.approx(1.5, abs=0.01)


def test_treatment_is_counted() -> None:
    """Negative values become 0, mirror images are averaged, and both are stated."""

    class Skewed:
        name, isotropic, bilateral, facts = "skewed", True, False, {}

        def evaluate(self, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
            wi, wo = np.broadcast_arrays(wi, wo)
            side = wi[..., 1] * wo[..., 0]
            return np.stack([1 + 0.5 * side, np.full_like(side, -1), np.ones_like(side)], -1)

    treated = TreatedSource(Skewed())
    pairs = direction_pairs(2000)
    value = treated.evaluate(pairs.wi, pairs.wo)
    assert np.allclose(value, [1, 0, 1])
    facts = treated.treatment()
    assert facts["negative_share"] == pytest.approx(1 / 3) and facts["asymmetry"] > 0.01


def test_direction_pairs_integrate_uniformly() -> None:
    """Weights turn the mean into one over both hemispheres: known integrals, diffuse and sharply peaked."""
    pairs = direction_pairs(65536)
    assert pairs.weight.mean() == pytest.approx(1, abs=0.007)
    assert (pairs.weight * pairs.wi[:, 2]).mean() == pytest.approx(0.5, abs=1.5e-3)
    # A narrow GGX without Fresnel or masking: E[f cos] over uniform wi, wo by an independent quadrature of albedo.
    from measured_materials.bake.tables.albedo import directional_albedo

    source = analytic.Ggx(alpha=0.01, f0=(1.0, 1.0, 1.0))
    nodes, weights = np.polynomial.legendre.leggauss(32)
    cosine = 0.5 + 0.5 * nodes
    albedo = directional_albedo(source, np.arccos(cosine))[:, 0] @ (0.5 * weights) / (2 * np.pi)
    value = source.evaluate(pairs.wi, pairs.wo)[:, 0] * pairs.wi[:, 2]
    assert (pairs.weight * value).mean() == pytest.approx(albedo, rel=0.01)


@pytest.mark.parametrize("alpha", [0.02, 0.1])
def test_the_error_metric_is_not_luck(alpha: float) -> None:
    """The RMS of one table from four other sets of directions: equal within what `rms_uncertainty` states."""
    source = analytic.Ggx(alpha=alpha)
    table = tabulate(source, NormalVectorGrid(64, "bezier", 0.5, 0.1))
    found = []
    for offset in (0.5, 0.1, 0.3, 0.8):
        pairs = direction_pairs(32768, offset)
        difference = table.evaluate(pairs.wi, pairs.wo) - source.evaluate(pairs.wi, pairs.wo)
        found.append((pairs.rms(difference), pairs.rms_uncertainty(difference)))
    rms, uncertainty = np.array(found).T
    assert np.ptp(rms) / rms.mean() < 0.1
    assert np.ptp(rms) / rms.mean() < 6 * uncertainty.max()


def test_horizon_converges_with_the_square_of_the_resolution_where_it_is_bounded() -> None:
    """Sampled close to the horizon, a BRDF that stays bounded there is met to second order up to 89.5 degrees."""

    class Bounded:
        name, isotropic, bilateral, facts = "bounded", True, True, {}

        def evaluate(self, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
            wi, wo = np.broadcast_arrays(wi, wo)
            return np.repeat(((1 + (1 - wi[..., :1]) ** 5) * (1 + (1 - wo[..., 2:]) ** 5)), 3, -1)

    z = np.cos(np.radians(np.linspace(60, 89.5, 40)))
    wi, wo = spherical(np.arccos(z), 0.7), spherical(np.arccos(z[::-1]), 0.0)
    error = []
    for n in (32, 64):
        table = tabulate(Bounded(), NormalVectorGrid(n, "uniform", horizon_share=HORIZON_SHARES[1]))
        error.append(np.abs(table.evaluate(wi, wo) / Bounded().evaluate(wi, wo) - 1).max())
    assert error[1] < 0.0025 and error[0] / error[1] > 3


def test_estimate_without_the_table_is_the_tables_own() -> None:
    """The search's shortcut equals evaluating the finished trilinear table."""
    source, grid, pairs = analytic.Ggx(alpha=0.2), NormalVectorGrid(16, "bezier", 0.4, 0.2), direction_pairs(3000)
    full = tabulate(source, grid).evaluate(pairs.wi, pairs.wo)
    quick = linear_estimate(source, grid, pairs)
    # The finished table is float32 and averages over the azimuth at the poles.
    assert pairs.rms(full - quick) < 2e-3 * pairs.rms(full)


def test_alpha_search_beats_uniform_and_reports_both_metrics() -> None:
    """On a glossy lobe the error choice is at least twice better than uniform, and the trials cover the square."""
    source, pairs = analytic.Ggx(alpha=0.05), direction_pairs(8192, offset=0.1)
    truth = source.evaluate(pairs.wi, pairs.wo)
    found = search_alpha(source, 64)
    assert len(found.trials) >= 25
    rms = {
        kind: pairs.rms(linear_estimate(source, grid, pairs) - truth)
        for kind, grid in {
            "bezier": NormalVectorGrid(64, "bezier", found.by_error.alpha_theta, found.by_error.alpha_phi),
            "uniform": NormalVectorGrid(64, "uniform"),
        }.items()
    }
    assert rms["bezier"] < 0.6 * rms["uniform"]
    assert found.by_intensity.intensity == max(t.intensity for t in found.trials)
    assert {"by_error", "by_intensity", "intensity_finds_least_error"} <= set(found.facts())


@pytest.mark.parametrize("alphas", [(0.0, 0.0), (0.5, 0.25), (1.0, 1.0)])
def test_intensity_estimate_is_close_to_the_sum(alphas: tuple[float, float]) -> None:
    """The lattice of samples against the whole table."""
    source, grid = analytic.Ggx(alpha=0.2), NormalVectorGrid(32, "bezier", *alphas)
    assert estimate_intensity(source, grid) == pytest.approx(tabulate(source, grid).total_intensity, rel=1.5e-3)


@pytest.mark.parametrize("alpha", [0.15, 0.4])
def test_fitted_spline_is_non_negative_and_closer_than_plain(alpha: float) -> None:
    """Fitted coefficients: nowhere negative, nearer to the samples than the samples as coefficients."""
    grid = NormalVectorGrid(24, "bezier", 0.3, 0.1)
    samples = tabulate(analytic.Ggx(alpha=alpha), grid).values
    fitted = fit_coefficients(grid, samples)
    assert (fitted >= 0).all() and np.isfinite(fitted).all()
    plain_error = np.abs(sample_spline(grid, samples) - samples).mean()
    assert np.abs(sample_spline(grid, fitted) - samples).mean() < 0.5 * plain_error


def test_spline_at_nodes_equals_the_evaluated_table() -> None:
    """`sample_spline` knows the same continuation at the ends as the evaluation."""
    table = tabulate(analytic.Ggx(alpha=0.3), NormalVectorGrid(10, "uniform"))
    i_o, i_i, i_phi = (a.ravel() for a in np.meshgrid(range(1, 9), range(1, 9), range(20), indexing="ij"))
    wi, wo = table.grid.directions(i_o, i_i, i_phi)
    at_nodes = sample_spline(table.grid, table.values)[i_o, i_i, i_phi]
    assert np.allclose(table.evaluate(wi, wo, "bspline"), at_nodes, rtol=1e-4)
