"""The alias sampler in numpy: alias tables, chi-square against the stated pdf, coverage, and variance."""

from __future__ import annotations

import numpy as np
import pytest
from measured_materials.bake.directions import spherical
from measured_materials.bake.sampling.alias_tables import alias_tables
from measured_materials.bake.sampling.cell_sampler import CellSampler, build_sampler
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sources import analytic
from measured_materials.bake.tables.accuracy import estimator_variance
from scipy import integrate, stats

SOURCES = {
    "lambert": analytic.Lambert(),
    "rough": analytic.Ggx(alpha=0.4),
    "glossy": analytic.Ggx(alpha=0.05),
    "mirror-like": analytic.Ggx(alpha=0.002),
}
VIEWS = (0.0, 0.3, 0.9, 1.3, 1.5)


def test_alias_tables_return_the_probabilities() -> None:
    """Summing acceptance and aliases gives each row back, zeros and one-hot rows included."""
    rng = np.random.default_rng(0)
    p = rng.random((6, 300)) ** 8
    p[3, :150] = 0
    p[4] = 0
    p[4, 17] = 1
    p /= p.sum(1, keepdims=True)
    acceptance, alias = alias_tables(p)
    for row in range(6):
        mass = acceptance[row].copy()
        np.add.at(mass, alias[row], 1 - acceptance[row])
        assert np.allclose(mass / 300, p[row], atol=1e-12)


def chi_square(sampler: CellSampler, theta_o: float, count: int = 200_000, seed: int = 1) -> float:
    """p-value of the histogram of drawn directions over (cos theta, phi) against the integral of the pdf."""
    n_z, n_phi = 12, 16
    wo = spherical(theta_o, 0.0)
    random = np.random.default_rng(seed).random((count, 4))
    wi, _ = sampler.sample(np.broadcast_to(wo, (count, 3)), random)
    found = np.histogram2d(wi[:, 2], np.arctan2(wi[:, 1], wi[:, 0]), [n_z, n_phi], [[-1, 1], [-np.pi, np.pi]])[
        0
    ].ravel()
    expected = count * _bin_masses(sampler, wo, n_z, n_phi)
    # What is expected in fewer than ten draws joins one pool, as is the custom.
    small = expected < 10
    found = np.append(found[~small], found[small].sum())
    expected = np.append(expected[~small], expected[small].sum())
    keep = expected > 0
    statistic = ((found - expected)[keep] ** 2 / expected[keep]).sum()
    return float(stats.chi2.sf(statistic, keep.sum() - 1))


def _bin_masses(sampler: CellSampler, wo: np.ndarray, n_z: int, n_phi: int) -> np.ndarray:
    """Integral of the pdf over each bin, from the half-vector cells: their mass is known, their image is not.

    Each cell is cut into points of equal solid angle, which are reflected and counted with the cell's mass: this
    uses neither `sample`'s inversion nor its jitter. The cells' mass itself is what is stored.
    """
    layout = sampler.layout
    k = 24
    edges = layout.edges()
    offset = (np.arange(k) + 0.5) / k
    m = (edges[:-1, None] + offset * np.diff(edges)[:, None]).reshape(-1)
    phi = (np.arange(layout.n_phi * k) + 0.5) * np.pi / (layout.n_phi * k)
    sine = np.sqrt(m * (2 - m))[:, None]
    chord = np.linalg.norm(wo - [0, 0, 1]) / np.sqrt(2)
    pdf = sampler.texels[min(int(chord * layout.n_o), layout.n_o - 1), :, 2].reshape(layout.n_h, layout.n_phi)
    mass = pdf * np.diff(edges)[:, None] * (2 * np.pi / layout.n_phi)
    mass = np.repeat(np.repeat(mass, k, 0), k, 1) / k**2 / 2
    total = np.zeros(n_z * n_phi)
    for sign in (1, -1):
        half = np.stack(
            [sine * np.cos(phi), sign * sine * np.sin(phi), np.broadcast_to(1 - m[:, None], mass.shape)], -1
        )
        wi = 2 * (half @ wo)[..., None] * half - wo
        total += np.histogram2d(
            wi[..., 2].ravel(),
            np.arctan2(wi[..., 1], wi[..., 0]).ravel(),
            [n_z, n_phi],
            [[-1, 1], [-np.pi, np.pi]],
            weights=mass.ravel(),
        )[0].ravel()
    return total


@pytest.mark.parametrize("name", SOURCES)
def test_chi_square(name: str) -> None:
    """Five viewer angles each; Sidak at 1 % over them, fixed seeds."""
    sampler = build_sampler(SOURCES[name], SamplerLayout(n_o=32, n_h=32, n_phi=16))
    for theta_o in VIEWS:
        # 24 x 24 points per cell leave border bins off by up to 0.1 %: 200 000 draws cannot see that.
        assert chi_square(sampler, theta_o) > 1 - (1 - 0.01) ** (1 / len(VIEWS)), theta_o


def test_chi_square_finds_a_wrong_sampler() -> None:
    """Tables read one row off (the next bin's) are found out."""
    sampler = build_sampler(SOURCES["rough"], SamplerLayout(n_o=8, n_h=32, n_phi=16))
    wrong = CellSampler(sampler.layout, np.roll(sampler.texels, 1, 0))
    honest_masses = _bin_masses(sampler, spherical(0.9, 0.0), 12, 16)
    wi, _ = wrong.sample(
        np.broadcast_to(spherical(0.9, 0.0), (200_000, 3)), np.random.default_rng(1).random((200_000, 4))
    )
    found = np.histogram2d(wi[:, 2], np.arctan2(wi[:, 1], wi[:, 0]), [12, 16], [[-1, 1], [-np.pi, np.pi]])[0].ravel()
    expected = 200_000 * honest_masses
    keep = expected > 10
    assert stats.chi2.sf(((found - expected)[keep] ** 2 / expected[keep]).sum(), keep.sum() - 1) < 1e-6


@pytest.mark.parametrize(
    "theta_o", [pytest.param(view, marks=[] if view in (0.3, 1.5) else [pytest.mark.slow]) for view in VIEWS]
)
def test_pdf_integrates_to_one_by_quadrature(theta_o: float) -> None:
    """Over the whole sphere of light directions, by scipy's adaptive quadrature: independent of the sampler's cells."""
    sampler = build_sampler(SOURCES["rough"], SamplerLayout(n_o=16, n_h=8, n_phi=8))
    wo = spherical(theta_o, 0.0)

    def ring(z: float) -> float:
        phi = (np.arange(2048) + 0.5) * (2 * np.pi / 2048)
        wi = np.stack([np.sqrt(1 - z * z) * np.cos(phi), np.sqrt(1 - z * z) * np.sin(phi), np.full_like(phi, z)], -1)
        wi = wi[(wi @ wo) > -1 + 1e-9]
        half = wi + wo
        inside = half[:, 2] > 0  # half vectors of the upper hemisphere are all that is drawn
        return float(sampler.pdf(wi[inside], np.broadcast_to(wo, wi[inside].shape)).sum() * (2 * np.pi / 2048))

    z = np.linspace(-1, 1, 4001)
    total = integrate.simpson([ring(x) for x in z], x=z)
    # Piecewise constant cells seen through a fixed lattice; half vectors at more than 90 degrees to wo are lost draws.
    lost = _share_facing_away(sampler, wo)
    assert total + lost == pytest.approx(1, abs=0.01)


def _share_facing_away(sampler: CellSampler, wo: np.ndarray) -> float:
    """Probability of half vectors that the viewer sees from behind."""
    random = np.random.default_rng(3).random((100_000, 4))
    wi, _ = sampler.sample(np.broadcast_to(wo, (100_000, 3)), random)
    # wi = 2 (wo.h) h - wo with h.z >= 0: seen from behind exactly where wi + wo points down.
    return float(((wi + wo)[:, 2] < 0).mean())


@pytest.mark.parametrize("name", SOURCES)
def test_pdf_is_positive_wherever_light_can_come_from(name: str) -> None:
    """Without exception over 100 000 pairs, down to 0.06 degrees above the horizon."""
    sampler = build_sampler(SOURCES[name], SamplerLayout())
    rng = np.random.default_rng(4)
    z = np.concatenate([rng.random(50_000), 10 ** rng.uniform(-3, 0, 50_000)])
    wi = spherical(np.arccos(z), rng.uniform(-np.pi, np.pi, len(z)))
    wo = spherical(np.arccos(rng.permutation(z)), 0.0)
    assert (sampler.pdf(wi, wo) > 0).all()


def test_sample_and_pdf_agree_at_the_ends_of_the_random_numbers() -> None:
    """Numbers of exactly 0 and 1 stay inside the tables; between them `pdf` repeats what `sample` said."""
    sampler = build_sampler(SOURCES["glossy"], SamplerLayout(n_o=8, n_h=16, n_phi=8))
    random = np.stack(np.meshgrid(*[[0.0, 0.5, 1.0]] * 4), -1).reshape(-1, 4)
    for theta_o in (0.0, 1.0, np.pi / 2):
        wi, pdf = sampler.sample(np.broadcast_to(spherical(theta_o, 0.0), (len(random), 3)), random)
        assert np.isfinite(wi).all() and np.isfinite(pdf).all() and (pdf >= 0).all()
        assert np.allclose(np.linalg.norm(wi, axis=-1), 1, atol=1e-12)
        inner = np.random.default_rng(2).random((2000, 4))
        wo = np.broadcast_to(spherical(theta_o, 0.0), (len(inner), 3))
        wi, pdf = sampler.sample(wo, inner)
        # At the last digits of a cell's border the reflected direction may be counted to its neighbour.
        equal = np.isclose(sampler.pdf(wi, wo), pdf, rtol=1e-9) | ((wi + wo)[:, 2] <= 1e-6)
        assert equal.mean() > 0.998


@pytest.mark.parametrize("theta_o", [0.2, 0.9, 1.4])
def test_table_sampling_is_unbiased_and_quieter_than_cosine(theta_o: float) -> None:
    """Mean of f cos / pdf is the albedo; its variance on gloss is at least a hundred times below cosine's."""
    from measured_materials.bake.tables.albedo import directional_albedo

    source = SOURCES["glossy"]
    sampler = build_sampler(source, SamplerLayout())
    wo = np.broadcast_to(spherical(theta_o, 0.0), (200_000, 3))
    random = np.random.default_rng(6).random((200_000, 4))

    def integrand(wi: np.ndarray) -> np.ndarray:
        return source.evaluate(wi, wo) * np.maximum(wi[:, 2:], 0)

    mean, variance = estimator_variance(integrand, lambda u: sampler.sample(wo, u), random)
    albedo = directional_albedo(source, theta_o).mean()
    assert abs(mean - albedo) < 4 * np.sqrt(variance / len(random)) + 1e-4 * albedo

    def cosine(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        wi = spherical(np.arcsin(np.sqrt(u[:, 0])), 2 * np.pi * u[:, 1])
        return wi, wi[:, 2] / np.pi

    assert estimator_variance(integrand, cosine, random)[1] > 100 * variance
