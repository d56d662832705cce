"""Lobes of shading maps in numpy: value, peak and sampling."""

from __future__ import annotations

import numpy as np
import pytest
from measured_materials.bake import xp_numpy
from measured_materials.bake.directions import spherical
from measured_materials.bake.lobes import lobe_sampling
from measured_materials.bake.lobes.lobe_sampling import COSINE_SHARE, lobe_pdf, sample_lobe
from measured_materials.bake.lobes.lobes import PHONG, Lobe
from measured_materials.bake.sources import analytic
from scipy import stats
from support.lobe_cases import NARROW, WIDE, identity, pairs

VIEWS = (0.0, 0.5, 1.2, 1.5)


def hemisphere(n_z: int = 600, n_phi: int = 360) -> tuple[np.ndarray, float]:
    """Directions (n, 3) at the midpoints of cells of equal solid angle, and that angle."""
    z, phi = np.meshgrid((np.arange(n_z) + 0.5) / n_z, (np.arange(n_phi) + 0.5) * 2 * np.pi / n_phi, indexing="ij")
    return spherical(np.arccos(z), phi).reshape(-1, 3), 2 * np.pi / (n_z * n_phi)


every_lobe = pytest.mark.parametrize("lobe", WIDE + NARROW, ids=identity)
wide_lobe = pytest.mark.parametrize("lobe", WIDE, ids=identity)


@every_lobe
def test_value_is_a_brdf(lobe: Lobe) -> None:
    """Finite, not negative, reciprocal, and 0 on and below the horizon."""
    wi, wo = pairs()
    value = lobe.value(wi, wo)
    assert np.isfinite(value).all() and (value >= 0).all()
    assert np.allclose(value, lobe.value(wo, wi), rtol=1e-9, atol=1e-300)
    below = wi * [1, 1, -1]
    flat = spherical(np.pi / 2, np.linspace(0, 6, 50)) * [1, 1, 0]
    assert (lobe.value(below, wo) == 0).all() and (lobe.value(flat, wo[:50]) == 0).all()


@pytest.mark.parametrize("theta_o", [*VIEWS, 1.56])
@wide_lobe
def test_albedo(lobe: Lobe, theta_o: float) -> None:
    """At most 1, and exactly 1 where the model says so."""
    wi, solid_angle = hemisphere()
    albedo = float((lobe.value(wi, spherical(theta_o, 0.0)) * wi[:, 2]).sum() * solid_angle)
    # What the lattice makes of lobes that it barely resolves.
    assert albedo < 1 + 5e-3
    if lobe.name == "lambert" or (lobe.name in PHONG and theta_o == 0):
        assert albedo == pytest.approx(1, abs=2e-3)
    if lobe.name == "oren_nayar":
        # A white surface loses nothing; the model's average of the loss, 5.6 for 5.5999..., is a fit.
        assert albedo == pytest.approx(1, abs=5e-3)


def test_against_independent_sources() -> None:
    """GGX and Phong as the analytic sources have them."""
    wi, wo = pairs(seed=2)
    for alpha in (0.003, 0.2, 1.0):
        expected = analytic.Ggx(alpha=alpha, f0=(1, 1, 1)).evaluate(wi, wo)[..., 0]
        assert np.allclose(Lobe("ggx", alpha).value(wi, wo), expected, rtol=1e-9)
    for exponent in (1.0, 60.0, 1e4):
        source = analytic.ModifiedPhong(diffuse=(0.3,) * 3, specular=(0.7,) * 3, exponent=exponent)
        expected = source.evaluate(wi, wo)[..., 0]
        # The source works with logarithms near the peak; here the base just below 1 has been rounded once.
        assert np.allclose(Lobe("phong", exponent, 0.3).value(wi, wo), expected, rtol=1e-9)


def test_phongs_native_part_lies_below() -> None:
    """kd / pi never exceeds the lobe."""
    wi, wo = pairs()
    lobe = Lobe("phong", 20.0, 0.4)
    assert lobe.native_share == 0.4 and Lobe("ggx").native_share == 1
    assert (lobe.native_share * Lobe("lambert").value(wi, wo) <= lobe.value(wi, wo)).all()


LOOSEST = {"lambert": 1.0, "oren_nayar": 1.01, "ggx": 1.25, "sheen": 2.0, **dict.fromkeys(PHONG, 2.0), "phong": 1.15}


@pytest.mark.parametrize("lobe", [*WIDE, *NARROW, Lobe("sheen", 0.5), Lobe("ggx", 0.03)], ids=identity)
def test_peak_is_an_upper_bound_and_a_close_one(lobe: Lobe) -> None:
    """Over all lights, those around the mirror direction most densely, seen from 0 to 89.9 degrees."""
    everywhere, _ = hemisphere(400, 90)
    near = np.concatenate([-np.geomspace(1e-6, 1.6, 700), [0], np.geomspace(1e-6, 1.6, 700)])
    # Seen from close to the horizon, sheen is brightest for a light as low, in a patch as small as the viewer is high.
    elevation, azimuth = np.meshgrid(np.geomspace(1e-4, 0.3, 120), np.pi - np.geomspace(1e-4, np.pi, 120))
    grazing = spherical(np.pi / 2 - elevation, azimuth).reshape(-1, 3)
    for theta_o in np.radians([0, 1, 5, 20, 40, 60, 75, 85, 88, 89.5, 89.9]):
        wo = spherical(theta_o, 0.0)
        theta_i = theta_o + near
        plane = spherical(theta_i[np.abs(theta_i) < np.pi / 2], np.pi)
        wi = np.concatenate([everywhere, grazing, plane])
        found = float((lobe.value(wi, wo) * wi[:, 2]).max())
        bound = float(lobe.peak(wo))
        assert found <= bound * (1 + 1e-12)
        # The scale of a shading map is set by the peak at the normal. 3 %: what the lattice misses.
        loosest = LOOSEST[lobe.name] if theta_o > 0 else 1.0
        assert bound <= found * loosest * 1.03, np.degrees(theta_o)


def chi_square(lobe: Lobe, theta_o: float, pdf_of: Lobe | None = None, count: int = 200_000) -> float:
    """p-value of drawn directions over (z, phi) and "below the horizon" against the integral of the pdf."""
    n_z, n_phi, fine_z, fine_phi = 10, 16, 200, 48
    wo = spherical(theta_o, 0.7)
    random = np.random.default_rng(int(1000 * theta_o)).random((count, 3))
    wi, _ = lobe_sampling.sample(lobe, np.broadcast_to(wo, (count, 3)), random)
    up = wi[:, 2] > 0
    ranges = [[0, 1], [-np.pi, np.pi]]
    found = np.histogram2d(wi[up, 2], np.arctan2(wi[up, 1], wi[up, 0]), [n_z, n_phi], ranges)[0].ravel()
    other = pdf_of or lobe
    lattice, solid_angle = hemisphere(n_z * fine_z, n_phi * fine_phi)
    pdf = np.broadcast_to(lobe_pdf(xp_numpy, other.name, lattice, wo, other.p1, other.p2), len(lattice))
    # The lattice starts at phi = 0, the histogram at -pi.
    pdf = np.roll(pdf.reshape(n_z * fine_z, n_phi * fine_phi), n_phi * fine_phi // 2, 1)
    expected = pdf.reshape(n_z, fine_z, n_phi, fine_phi).sum((1, 3)).ravel() * (count * solid_angle)
    found, expected = np.append(found, (~up).sum()), np.append(expected, count - expected.sum())
    small = expected < 10
    found = np.append(found[~small], found[small].sum())
    expected = np.append(expected[~small], max(expected[small].sum(), 0))
    keep = expected > 1
    statistic = ((found - expected)[keep] ** 2 / expected[keep]).sum()
    return float(stats.chi2.sf(statistic, keep.sum() - 1))


@wide_lobe
def test_chi_square(lobe: Lobe) -> None:
    """Four viewers each, in an azimuth of their own; Sidak at 1 % over them, fixed seeds."""
    for theta_o in VIEWS:
        assert chi_square(lobe, theta_o) > 1 - (1 - 0.01) ** (1 / len(VIEWS)), theta_o


@pytest.mark.parametrize(
    "drawn, stated",
    [
        (Lobe("ggx", 0.5), Lobe("ggx", 0.52)),
        (Lobe("phong", 60.0, 0.3), Lobe("phong", 57.0, 0.3)),
        (Lobe("phong", 60.0, 0.3), Lobe("phong", 60.0, 0.33)),
        (Lobe("sheen", 1.0), Lobe("lambert")),
    ],
)
def test_chi_square_finds_a_wrong_pdf(drawn: Lobe, stated: Lobe) -> None:
    """The test above is able to fail."""
    assert chi_square(drawn, 0.5, stated) < 1e-4


@pytest.mark.parametrize("theta_o", [0.0, 0.5, 1.2])
@pytest.mark.parametrize("lobe", [*WIDE, *NARROW[:3]], ids=identity)
def test_pdf_integrates_to_one(lobe: Lobe, theta_o: float) -> None:
    """Over the upper hemisphere, in cells that shrink toward the mirror direction, with the share drawn below it."""
    wo = spherical(theta_o, 0.0)
    edges = np.linspace(0, 1, 1201) ** 3 * np.pi
    angle, phi = np.meshgrid((edges[1:] + edges[:-1]) / 2, (np.arange(360) + 0.5) * np.pi / 180, indexing="ij")
    solid_angle = np.broadcast_to(-np.diff(np.cos(edges))[:, None] * np.pi / 180, angle.shape).ravel()
    local = spherical(angle, phi).reshape(-1, 3)
    cos_o, sin_o = wo[2], -wo[0]  # of the mirror direction
    x, y, z = local.T
    wi = np.stack([cos_o * x + sin_o * z, y, cos_o * z - sin_o * x], -1)
    up = wi[:, 2] > 0
    pdf = np.broadcast_to(lobe_pdf(xp_numpy, lobe.name, wi, wo, lobe.p1, lobe.p2), len(wi))
    inside = float((pdf * solid_angle)[up].sum())
    random = np.random.default_rng(5).random((200_000, 3))
    drawn, _ = lobe_sampling.sample(lobe, np.broadcast_to(wo, (len(random), 3)), random)
    below = float((drawn[:, 2] <= 0).mean())
    # The horizon cuts through a ring of the lattice, 3e-3 at most; the share is counted to 4 standard errors.
    assert inside + below == pytest.approx(1, abs=3e-3 + 4 * np.sqrt(below / len(random)))


@every_lobe
def test_sample_states_its_pdf_at_any_random_number(lobe: Lobe) -> None:
    """Exactly 0 and 1 included: finite, unit length or nothing, and the pdf is that of `lobe_pdf`."""
    ends = np.stack(np.meshgrid(*[[0.0, 0.5, 1.0]] * 3), -1).reshape(-1, 3)
    random = np.concatenate([ends, np.random.default_rng(3).random((2000, 3))])
    for theta_o in (0.0, 1e-4, 0.8, 1.5, np.pi / 2 - 1e-3):
        for dtype in (np.float64, np.float32):
            wo = np.broadcast_to(spherical(theta_o, 2.0), random.shape).astype(dtype)
            wi, pdf = lobe_sampling.sample(lobe, wo, random.astype(dtype))
            assert np.isfinite(wi).all() and np.isfinite(pdf).all() and (pdf >= 0).all()
            length = np.linalg.norm(wi, axis=-1)
            assert (np.isclose(length, 1, atol=1e-6) | (wi[:, 2] <= 0)).all()
            weight = lobe.value(wi, wo) * np.maximum(wi[:, 2], 0)
            assert (pdf[weight > 0] > 0).all()


@pytest.mark.parametrize("theta_o", [0.0, 0.5, 1.5])
@every_lobe
def test_estimator_is_unbiased_and_bounded(lobe: Lobe, theta_o: float) -> None:
    """Mean of f cos / pdf is the albedo, and no draw of a glossy lobe weighs more than its share allows."""
    wo = np.broadcast_to(spherical(theta_o, 0.0), (100_000, 3))
    wi, pdf = lobe_sampling.sample(lobe, wo, np.random.default_rng(7).random((len(wo), 3)))
    r = lobe.value(wi, wo) * np.maximum(wi[:, 2], 0)
    weight = np.divide(r, pdf, out=np.zeros_like(r), where=pdf > 0)
    if lobe.name == "ggx":
        assert weight.max() <= 1 / (1 - COSINE_SHARE) + 1e-9  # G2 / G1 <= 1
    if lobe.name == "phong":
        # (n + 2) / (n + 1) cos, at a share of at least 1 - max(kd, COSINE_SHARE); kd / pi against its own share.
        assert weight.max() <= 1 + (lobe.p1 + 2) / (lobe.p1 + 1) / (1 - COSINE_SHARE)
    if lobe in WIDE:
        lattice, solid_angle = hemisphere(1200, 720)
        albedo = float((lobe.value(lattice, wo[0]) * lattice[:, 2]).sum() * solid_angle)
        assert weight.mean() == pytest.approx(albedo, abs=5 * weight.std() / np.sqrt(len(wo)) + 5e-3 * albedo)
    elif theta_o == 0 and lobe.name != "sheen":
        assert weight.mean() == pytest.approx(1, abs=5 * weight.std() / np.sqrt(len(wo)) + 1e-3)


def test_sampling_takes_another_share() -> None:
    """A caller whose S(r) is steep may need fewer cosine draws."""
    wo = spherical(0.3, 0.0)
    u = np.full(1000, 0.5), np.full(1000, 0.5), np.linspace(0, 1, 1000)
    for share in (0.05, 0.5):
        wi, _ = sample_lobe(xp_numpy, "ggx", np.broadcast_to(wo, (1000, 3)), *u, 0.1, 0.0, share)
        assert (wi[:, 2] == wi[0, 2]).mean() == pytest.approx(share, abs=2e-3)
