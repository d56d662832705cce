"""The warp sampler in numpy: inverse tables, chi-square by quadrature of its pdf, coverage, bounds and variance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from measured_materials.bake import xp_numpy
from measured_materials.bake.directions import spherical
from measured_materials.bake.sampling.cell_sampler import Evaluates
from measured_materials.bake.sampling.half_vector_warp import HalfVectorWarp
from measured_materials.bake.sampling.inverse_tables import inverse_table, inverted, joined, stratum
from measured_materials.bake.sampling.slope_warp import SlopeWarp
from measured_materials.bake.sampling.warp_choice import WIDTHS, fitted_warp
from measured_materials.bake.sampling.warp_sampler import WarpSampler, build_warp
from measured_materials.bake.sources import analytic
from numpy.typing import NDArray
from scipy import stats

Array = NDArray[np.float64]

SMALL = HalfVectorWarp(8, 24, 12, 1e-2)
SAMPLERS: dict[str, tuple[Evaluates, HalfVectorWarp | SlopeWarp]] = {
    "lambert": (analytic.Lambert(), SMALL),
    "satin": (analytic.Ward(alpha=0.3, diffuse=(0.3, 0.1, 0.05), specular=0.2), SMALL),
    "rough": (analytic.Ggx(alpha=0.4), SMALL),
    "glossy": (analytic.Ggx(alpha=0.05), replace(SMALL, linear=1e-3)),
    "brushed": (analytic.Ggx(alpha=0.15, alpha_y=0.5), SlopeWarp(4, 6, 14, 12, 0.1, 0.3)),
    "brushed, half a turn": (analytic.Ggx(alpha=0.15, alpha_y=0.5), SlopeWarp(4, 6, 14, 12, 0.1, 0.3, True)),
}
VIEWS = ((0.0, 0.0), (0.3, 0.0), (0.9, 0.0), (1.3, 0.0), (1.5, 0.0))
TURNED = ((0.05, 1.0), (0.7, -2.0), (1.2, 0.6), (1.45, 2.9))
CHI_BINS = 80, 160
QUICK = "satin", "brushed, half a turn"


def sampler_of(name: str) -> WarpSampler:
    source, layout = SAMPLERS[name]
    return build_warp(source, layout)


def views_of(name: str) -> tuple[tuple[float, float], ...]:
    return TURNED if name.startswith("brushed") else VIEWS


# --- inverse tables -----------------------------------------------------------------------------------------


def random_weights(rows: int = 200, cells: int = 24) -> Array:
    """Of every kind: smooth, spiky, dark at either end, a single cell, none."""
    rng = np.random.default_rng(3)
    w = rng.random((rows, cells)) ** rng.integers(1, 12, (rows, 1))
    w[:40, :9] = 0
    w[20:60, -7:] = 0
    w[60] = 0
    w[61] = 0
    w[61, 13] = 2
    w[62] = 1
    return w


@pytest.mark.parametrize("strata", [16, 24, 48])
def test_joined_cells_keep_to_what_a_table_can_hold(strata: int) -> None:
    """Sums of 1; no piece below a stratum; nothing at dark ends; a row of nothing is even."""
    weights = random_weights()
    p, roots = joined(weights, strata)
    assert np.abs(p.sum(1) - 1).max() < 1e-12
    for row, w in zip(p, weights):
        pieces = [part.sum() for part in np.split(row, np.flatnonzero(np.diff(row)) + 1) if part.any()]
        assert min(pieces) >= 1 / strata or len(pieces) == 1
        lit = np.flatnonzero(w)
        if lit.size:
            assert not row[: lit[0]].any() and not row[lit[-1] + 1 :].any() and (row[lit] > 0).all()
    assert roots[60] == 0 and np.allclose(p[60], 1 / 24)
    assert (roots >= weights.sum(1) * (1 - 1e-12)).all()


def test_joining_costs_no_more_than_it_must() -> None:
    """No split of the cells into two pieces has less variance than what was found, where two are possible."""
    weights = random_weights()[62:]
    _, roots = joined(weights, 24)
    for w, found in zip(weights, roots):
        first, end = np.flatnonzero(w)[[0, -1]] + [0, 1]
        for cut in range(first + 1, end):
            parts = w[first:cut], w[cut:end]
            each = [np.sqrt(len(part) * (part**2).sum()) for part in parts]
            if min(each) >= sum(each) / 20:
                assert found <= sum(each) * (1 + 1e-9)


def test_tables_invert_the_distribution() -> None:
    """A broken line through all corners, float32 as in the texture; against np.interp of the cumulative sums."""
    p, _ = joined(random_weights(), 32)
    table = inverse_table(p, 32).astype(np.float32).astype(float)
    u = np.linspace(0, 1, 4001)
    for row, entries in zip(p, table):
        found = inverted(xp_numpy, u, entries[stratum(xp_numpy, u, 32).astype(int)])
        edges = np.concatenate([[0], row.cumsum()])
        held = np.flatnonzero(row)
        inside = np.arange(held[0], held[-1] + 2)
        assert np.abs(found - np.interp(u, edges[inside], inside)).max() < 2e-5


# --- draws and densities -------------------------------------------------------------------------------------


def expected_counts(sampler: WarpSampler, wo: Array, count: int) -> Array:
    """Integral of the pdf over each bin of (z, azimuth): midpoints, finer where a highlight may be narrow."""
    n_z, n_phi = CHI_BINS
    masses = np.zeros(CHI_BINS)
    mirror = int((wo[2] + 1) * n_z / 2)
    for row in range(n_z // 2, n_z):
        k_z, k_phi = (800, 8) if row == n_z - 1 else (48, 32) if abs(row - mirror) < 4 else (16, 16)
        z = (row + (np.arange(k_z) + 0.5) / k_z) * (2 / n_z) - 1
        phi = (np.arange(n_phi * k_phi) + 0.5) * (2 * np.pi / (n_phi * k_phi)) - np.pi
        wi = spherical(np.arccos(z)[:, None], phi[None, :])
        density = sampler.pdf(wi, np.broadcast_to(wo, wi.shape))
        masses[row] = density.reshape(k_z, n_phi, k_phi).mean((0, 2)) * (2 / n_z) * (2 * np.pi / n_phi)
    return masses * count


def chi_square(drawing: WarpSampler, asked: WarpSampler, wo: Array, count: int = 1_000_000) -> float:
    """p-value of the histogram of draws above the horizon over 80 x 160 bins; all below are one bin more."""
    random = np.random.default_rng(1).random((count, 2))
    wi, _ = drawing.sample(np.broadcast_to(wo, (count, 3)), random)
    found, _, _ = np.histogram2d(wi[:, 2], np.arctan2(wi[:, 1], wi[:, 0]), CHI_BINS, [[-1, 1], [-np.pi, np.pi]])
    found = found[CHI_BINS[0] // 2 :].ravel()
    expected = expected_counts(asked, wo, count)[CHI_BINS[0] // 2 :].ravel()
    found, expected = np.append(found, count - found.sum()), np.append(expected, count - expected.sum())
    small = expected < 10
    found = np.append(found[~small], found[small].sum())
    expected = np.append(expected[~small], expected[small].sum())
    held = expected > 0
    statistic = ((found - expected)[held] ** 2 / expected[held]).sum()
    return float(stats.chi2.sf(statistic, held.sum() - 1))


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.slow] * (n not in QUICK)) for n in SAMPLERS])
def test_chi_square(name: str) -> None:
    """A million draws in 80 x 160 bins for each viewer; Sidak at 1 % over them, fixed seeds."""
    sampler = sampler_of(name)
    for view in views_of(name):
        p = chi_square(sampler, sampler, spherical(*view))
        print(name, view, p)
        assert p > 1 - (1 - 0.01) ** (1 / len(views_of(name))), view


def test_chi_square_finds_a_wrong_sampler() -> None:
    """Draws by the next bin's tables, and draws that follow the cosine a twentieth too seldom, are found out."""
    sampler = sampler_of("satin")
    seldom = sampler.texels.copy()
    seldom[:, : sampler.layout.strata, 3] *= 0.95
    for texels in (np.roll(sampler.texels, 1, 0), seldom):
        assert chi_square(WarpSampler(sampler.layout, texels), sampler, spherical(0.9, 0.0)) < 1e-6


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.slow] * (n not in QUICK)) for n in SAMPLERS])
def test_density_integrates_to_one(name: str) -> None:
    """Over all directions, with what is drawn below the horizon counted."""
    sampler = sampler_of(name)
    for view in views_of(name):
        wo = spherical(*view)
        random = np.random.default_rng(5).random((400_000, 2))
        wi, _ = sampler.sample(np.broadcast_to(wo, (len(random), 3)), random)
        below = (wi[:, 2] < 0).mean()
        above = expected_counts(sampler, wo, 1).sum()
        print(name, view, above, below)
        assert above + below == pytest.approx(1, abs=0.003)


@pytest.mark.parametrize("name", SAMPLERS)
def test_stated_density_is_that_of_the_warp(name: str) -> None:
    """Independent of the chi-square: the inverse of the warp's own Jacobian, by differences of neighbouring draws."""
    sampler = sampler_of(name)
    rng, step = np.random.default_rng(8), 1e-6
    random = rng.uniform(0.01, 0.99, (20_000, 2))
    view = np.array(views_of(name))[rng.integers(1, 4, len(random))]
    wo = spherical(view[:, 0], view[:, 1])
    wi, pdf = sampler.sample(wo, random)
    du, dv = ((sampler.sample(wo, random + np.array(d))[0] - wi) / step for d in ((step, 0), (0, step)))
    area = np.linalg.norm(np.cross(du, dv), axis=-1)
    up = (wi[:, 2] > 0.02) & (area > 0)
    # Where the cosine and the half vectors both lead to a direction their densities add: look at draws of one alone.
    matte = sampler.texels[sampler.layout.bin_of(xp_numpy, wo).astype(int), 0, 3]
    is_matte = random[:, 0] < matte
    ratio = pdf * area
    own = np.where(is_matte, matte * np.maximum(wi[:, 2], 0) / np.pi, pdf - matte * np.maximum(wi[:, 2], 0) / np.pi)
    off = np.abs(own * area - 1)[up]
    assert np.median(off) < 1e-4 and np.quantile(off, 0.95) < 5e-3
    assert (ratio[up] > 1 - 5e-3).mean() > 0.95


@pytest.mark.parametrize("name", SAMPLERS)
def test_pdf_is_positive_wherever_light_can_come_from(name: str) -> None:
    """Without exception over 100 000 pairs, down to 0.06 degrees above the horizon; at least a twentieth of cosine."""
    sampler = sampler_of(name)
    rng = np.random.default_rng(4)
    z = np.concatenate([rng.random(50_000), 10 ** rng.uniform(-3, 0, 50_000)])
    wi = spherical(np.arccos(z), rng.uniform(-np.pi, np.pi, len(z)))
    wo = spherical(np.arccos(rng.permutation(z)), rng.uniform(-np.pi, np.pi, len(z)) * name.startswith("brushed"))
    assert (sampler.pdf(wi, wo) >= 0.0499 * z / np.pi).all()


def test_ends_of_the_random_numbers_stay_inside() -> None:
    for name in ("glossy", "brushed", "lambert"):
        sampler = sampler_of(name)
        random = np.stack(np.meshgrid(*[[0.0, 0.5, 1.0]] * 2), -1).reshape(-1, 2)
        for theta_o in (0.0, 1.0, np.pi / 2):
            wi, pdf = sampler.sample(np.broadcast_to(spherical(theta_o, 0.0), (len(random), 3)), random)
            assert np.isfinite(wi).all() and np.isfinite(pdf).all() and (pdf >= 0).all()
            assert np.allclose(np.linalg.norm(wi, axis=-1), 1, atol=1e-9)


def test_neighbouring_numbers_give_neighbouring_directions() -> None:
    """Steps of 2^-12 of either number move a direction by less than 0.1, but where cosine and half vectors meet or a
    row of cells ends: 2 % of them, against nearly all of an alias table's."""
    sampler = sampler_of("rough")
    random = np.random.default_rng(9).uniform(0, 1 - 2**-12, (20_000, 2))
    wo = np.broadcast_to(spherical(0.7, 0.0), (len(random), 3))
    wi, _ = sampler.sample(wo, random)
    for step in ((2**-12, 0), (0, 2**-12)):
        moved, _ = sampler.sample(wo, random + np.array(step))
        assert (np.linalg.norm(moved - wi, axis=-1) > 0.1).mean() < 0.02


@pytest.mark.parametrize("theta_o", [0.1, 0.9, 1.4])
def test_light_that_the_table_does_not_foresee_stays_bounded(theta_o: float) -> None:
    """A twentieth of all draws follows the cosine, hence Lambertian light has at most 20 times its second moment."""
    sampler = build_warp(analytic.Ggx(alpha=0.002), HalfVectorWarp(linear=1e-6))
    z, phi = np.meshgrid((np.arange(400) + 0.5) / 400, (np.arange(400) + 0.5) / 400 * 2 * np.pi)
    wi = spherical(np.arccos(z.ravel()), phi.ravel())
    pdf = sampler.pdf(wi, np.broadcast_to(spherical(theta_o, 0.0), wi.shape))
    found = ((wi[:, 2] / np.pi) ** 2 / pdf).mean() * 2 * np.pi
    print(theta_o, found)
    assert 12 < found < 20.1


@pytest.mark.parametrize("theta_o", [0.2, 0.9, 1.4])
@pytest.mark.parametrize("name", ["satin", "glossy", "brushed"])
def test_draws_are_unbiased(name: str, theta_o: float) -> None:
    """The mean of f cos / pdf is the albedo."""
    from measured_materials.bake.tables.albedo import directional_albedo

    sampler, source = sampler_of(name), SAMPLERS[name][0]
    wo = np.broadcast_to(spherical(theta_o, 0.0), (200_000, 3))
    wi, pdf = sampler.sample(wo, np.random.default_rng(6).random((len(wo), 2)))
    up = wi[:, 2] > 0
    value = np.zeros(len(wo))
    value[up] = source.evaluate(wi[up], wo[up]).mean(-1) * wi[up, 2] / pdf[up]
    albedo = directional_albedo(source, theta_o).mean()  # type: ignore[arg-type]
    assert abs(value.mean() - albedo) < 4 * value.std() / np.sqrt(len(wo)) + 1e-3 * albedo


NOISE = {  # relative variance of a sample of an even sky, mean of four viewers; alias tables have 0.0058, 0.018, 0.064
    "lambert": (analytic.Lambert(), 1e-9),
    "satin": (SAMPLERS["satin"][0], 0.022),
    "glossy": (analytic.Ggx(alpha=0.02), 0.065),
}


@pytest.mark.parametrize("name", NOISE)
def test_noise_of_the_usual_sizes(name: str) -> None:
    """At a tenth of an alias table's bytes no more noise than it has; with a width that is chosen by itself."""
    source, most = NOISE[name]
    layout = fitted_warp(source, HalfVectorWarp())
    assert layout.linear in WIDTHS
    sampler = build_warp(source, layout)
    random = np.random.default_rng(0).random((65536, 2))
    total = 0.0
    for theta_o in (0.1, 0.6, 1.1, 1.4):
        wo = np.broadcast_to(spherical(theta_o, 0.0), (len(random), 3))
        wi, pdf = sampler.sample(wo, random)
        value = np.zeros(len(wo))
        up = wi[:, 2] > 0
        value[up] = source.evaluate(wi[up], wo[up]).mean(-1) * wi[up, 2] / pdf[up]
        total += value.var() / value.mean() ** 2 / 4
    print(name, layout.linear, total)
    assert total < most
    assert sampler.texels.nbytes * 9.4 < 64 * 64 * 32 * 16
