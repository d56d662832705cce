"""Analytic BRDFs: known values, reciprocity, range, and stability near peaks and at grazing."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from measured_materials.bake.directions import normalize, spherical
from measured_materials.bake.errors import BakeError
from measured_materials.bake.lobes.cosine_lobes import COSINE_LOBES
from measured_materials.bake.lobes.microfacets import conductor, dielectric, ggx_ndf
from measured_materials.bake.source import BrdfSource
from measured_materials.bake.sources.analytic import (
    ANALYTIC,
    Analytic,
    AshikhminShirley,
    BlinnPhong,
    Ggx,
    Lambert,
    MetallicPaint,
    ModifiedPhong,
    OrenNayar,
    Ward,
    by_name,
)
from measured_materials.bake.tables.albedo import directional_albedo
from scipy.integrate import quad

UP = np.array([0.0, 0.0, 1.0])
SOURCES = [
    Lambert(),
    ModifiedPhong(exponent=1e6),
    BlinnPhong(exponent=1e6),
    *(ModifiedPhong(exponent=200, lobe=lobe) for lobe in COSINE_LOBES),
    *(BlinnPhong(exponent=200, lobe=lobe) for lobe in COSINE_LOBES),
    Ward(),
    Ward(alpha=0.02, alpha_y=0.3, variant="ward"),
    Ward(alpha=1e-3, variant="duer"),
    Ggx(alpha=1e-5),
    Ggx(alpha=0.05, alpha_y=0.5, fresnel="dielectric"),
    Ggx(fresnel="conductor", eta=(0.2, 0.9, 1.1), k=(3.9, 2.4, 2.2)),
    Ggx(fresnel="dielectric", eta=0.7),
    OrenNayar(sigma=1.0),
    MetallicPaint(),
    AshikhminShirley(),
    AshikhminShirley(exponent=1e6, exponent_y=10),
]


@pytest.mark.parametrize("source", SOURCES, ids=lambda s: f"{s.name}-{SOURCES.index(s)}")
class TestEverySource:
    def test_is_a_source(self, source: Analytic) -> None:
        assert isinstance(source, BrdfSource)
        json.dumps(source.facts)

    @given(st.floats(0, 1.6), st.floats(0, 1.6), st.floats(-7, 7))
    def test_is_finite_not_negative_and_reciprocal(
        self, source: Analytic, theta_i: float, theta_o: float, phi: float
    ) -> None:
        wi, wo = spherical(theta_i, phi), spherical(theta_o, 0.3)
        value, swapped = source.evaluate(wi, wo), source.evaluate(wo, wi)
        assert np.isfinite(value).all() and value.min() >= 0
        if min(wi[2], wo[2]) <= 0:
            assert np.all(value == 0)
        # A cosine of 1e-6 has 10 digits left, and the lobes raise it to powers.
        assert np.allclose(value, swapped, rtol=1e-6, atol=1e-300)

    def test_at_grazing_and_in_retro_reflection(self, source: Analytic) -> None:
        low = spherical(math.pi / 2 - 10.0 ** -np.arange(1, 18.0), 0.0)
        for wi, wo in ((low, low * [-1, -1, 1]), (low, low), (low, UP), (UP, low)):
            value = source.evaluate(wi, wo)
            assert np.isfinite(value).all() and value.min() >= 0

    def test_isotropy_and_mirror_symmetry_are_as_declared(self, source: Analytic) -> None:
        rng = np.random.default_rng(1)
        wi, wo = (normalize(np.abs(rng.normal(size=(400, 3))) + np.array([0, 0, 0.1])) for _ in range(2))
        turn = np.array([[0.6, 0.8, 0], [-0.8, 0.6, 0], [0, 0, 1]])
        turned = np.allclose(source.evaluate(wi @ turn, wo @ turn), source.evaluate(wi, wo), rtol=1e-6)
        assert turned == source.isotropic == source.bilateral


def test_values_known_in_closed_form() -> None:
    tilted = spherical(math.radians(60), 0.0)
    assert np.allclose(Lambert((0.1, 0.5, 1)).evaluate(tilted, UP) * math.pi, [0.1, 0.5, 1])
    phong = ModifiedPhong(0, 1, 10)
    assert np.allclose(phong.evaluate(UP, UP), 12 / (2 * math.pi))
    assert np.allclose(phong.evaluate(tilted, UP), 12 / (2 * math.pi) * 0.5**10)
    assert np.allclose(Ggx(alpha=0.3, f0=1).evaluate(UP, UP), 1 / (4 * math.pi * 0.09))
    for variant in ("ward", "duer", "bounded"):
        assert np.allclose(Ward(0, 1, 0.2, variant=variant).evaluate(UP, UP), 1 / (4 * math.pi * 0.04))
    # sigma = 0 is Lambert; at normal light and view Oren-Nayar is its A.
    assert np.allclose(OrenNayar(1, 0).evaluate(tilted, tilted), 1 / math.pi)
    assert np.allclose(OrenNayar(1, 0.5).evaluate(UP, UP) * math.pi, 1 - 0.5 * 0.25 / 0.58)


def test_oren_nayar_against_its_angular_form() -> None:
    rng = np.random.default_rng(2)
    theta_i, theta_o = rng.uniform(0.01, 1.5, (2, 500))
    phi = rng.uniform(0, 2 * math.pi, 500)
    a, b = 1 - 0.5 * 0.16 / 0.49, 0.45 * 0.16 / 0.25
    large, small = np.maximum(theta_i, theta_o), np.minimum(theta_i, theta_o)
    expected = (a + b * np.maximum(np.cos(phi), 0) * np.sin(large) * np.tan(small)) / math.pi
    got = OrenNayar(1, 0.4).evaluate(spherical(theta_i, phi), spherical(theta_o, 0.0))[:, 0]
    assert np.allclose(got, expected, rtol=1e-12)


def test_ward_against_its_angular_form() -> None:
    rng = np.random.default_rng(3)
    wi, wo = (spherical(rng.uniform(0, 1.4, 300), rng.uniform(0, 6.3, 300)) for _ in range(2))
    half = normalize(wi + wo)
    tan2, phi = np.tan(np.arccos(half[:, 2])) ** 2, np.arctan2(half[:, 1], half[:, 0])
    gauss = np.exp(-tan2 * (np.cos(phi) ** 2 / 0.04 + np.sin(phi) ** 2 / 0.16))
    expected = gauss / (4 * math.pi * 0.08 * np.sqrt(wi[:, 2] * wo[:, 2]))
    got = Ward(0, 1, 0.2, 0.4, "ward").evaluate(wi, wo)[:, 0]
    assert np.allclose(got, expected, rtol=1e-8, atol=1e-12)


def test_ashikhmin_shirley_against_its_angular_form() -> None:
    rng = np.random.default_rng(4)
    wi, wo = (spherical(rng.uniform(0, 1.4, 300), rng.uniform(0, 6.3, 300)) for _ in range(2))
    half = normalize(wi + wo)
    phi, cos_d = np.arctan2(half[:, 1], half[:, 0]), np.sum(half * wi, -1)
    power = half[:, 2] ** (20 * np.cos(phi) ** 2 + 300 * np.sin(phi) ** 2)
    fresnel = 0.3 + 0.7 * (1 - cos_d) ** 5
    lobe = math.sqrt(21 * 301) / (8 * math.pi) * power * fresnel / (cos_d * np.maximum(wi[:, 2], wo[:, 2]))
    base = 28 * 0.2 * 0.7 / (23 * math.pi) * (1 - (1 - wi[:, 2] / 2) ** 5) * (1 - (1 - wo[:, 2] / 2) ** 5)
    got = AshikhminShirley(exponent=20, exponent_y=300).evaluate(wi, wo)[:, 0]
    assert np.allclose(got, lobe + base, rtol=1e-9)


ANISOTROPIC = [
    Ggx(alpha=0.1, alpha_y=0.5, f0=1),
    Ward(alpha=0.1, alpha_y=0.4, diffuse=0.4, specular=0.6),
    AshikhminShirley(exponent=400, exponent_y=10, diffuse=1, specular=0.3),
]


@pytest.mark.parametrize("source", ANISOTROPIC, ids=lambda s: s.name)
@pytest.mark.parametrize("phi_o", [0.0, 0.7, math.pi / 2])
def test_anisotropic_albedo_is_at_most_one(source: Analytic, phi_o: float) -> None:
    albedo = directional_albedo(source, np.radians([0, 40, 70, 85]), phi_o=phi_o)
    # The quadrature's own error on a lobe of axes 1 : 5.
    assert 0.3 < albedo.min() and albedo.max() < 1 + 1e-3


@pytest.mark.parametrize("alpha", [1e-5, 1e-3, 0.1, 1.0, 3.0])
def test_ggx_distribution_integrates_to_one(alpha: float) -> None:
    def ring(log_tangent: float) -> float:
        theta = math.atan(math.exp(log_tangent))
        # d theta = sin cos d log tan
        weight = 2 * math.pi * math.sin(theta) * math.cos(theta) * math.sin(theta) * math.cos(theta)
        return float(ggx_ndf(spherical(theta, 0.0), alpha, alpha)) * weight

    total, _ = quad(ring, math.log(alpha) - 20, math.log(alpha) + 20, limit=200)
    assert abs(total - 1) < 1e-8


def test_ggx_anisotropic_distribution_integrates_to_one() -> None:
    # Over slopes (tan theta cos phi, tan theta sin phi) the density is D cos^4 theta.
    nodes, weights = np.polynomial.legendre.leggauss(400)
    log_r, angle = 15 * nodes, np.arange(64) * (2 * math.pi / 64)
    r = np.exp(log_r)[:, None]
    half = normalize(np.stack(np.broadcast_arrays(0.02 * r * np.cos(angle), 0.3 * r * np.sin(angle), 1.0), -1))
    density = ggx_ndf(half, 0.02, 0.3) * half[..., 2] ** 4 * 0.02 * 0.3 * r**2
    assert abs(15 * weights @ density.mean(1) * 2 * math.pi - 1) < 1e-9


@pytest.mark.parametrize("alpha", [0.05, 0.4, 1.0])
@pytest.mark.parametrize("theta_o", [0.0, 0.8, 1.4])
def test_ggx_shadowing_is_height_correlated_smith(alpha: float, theta_o: float) -> None:
    wi, wo = spherical(0.5, 2.0)[None], spherical(theta_o, 0.0)[None]

    def lam(w: np.ndarray) -> float:
        tan = math.hypot(w[0, 0], w[0, 1]) / w[0, 2]
        return (math.sqrt(1 + (alpha * tan) ** 2) - 1) / 2

    half = normalize(wi + wo)
    expected = ggx_ndf(half, alpha, alpha) / (1 + lam(wi) + lam(wo)) / (4 * wi[0, 2] * wo[0, 2])
    assert np.allclose(Ggx(alpha=alpha, f0=1).evaluate(wi, wo)[:, 0], expected, rtol=1e-12)


def test_fresnel_known_values() -> None:
    one = np.array([1.0])
    assert np.isclose(dielectric(one, np.array([1.5]))[0], 0.04)
    brewster = math.cos(math.atan(1.5))
    # At Brewster's angle only the perpendicular part is left: half of ((n^2 - 1) / (n^2 + 1))^2.
    assert np.isclose(dielectric(np.array([brewster]), np.array([1.5]))[0], 0.5 * (1.25 / 3.25) ** 2)
    assert dielectric(np.array([0.1]), np.array([1 / 1.5]))[0] == 1
    cosine = np.linspace(1e-6, 1, 50)
    assert np.allclose(conductor(cosine, np.array(1.5), np.array(0.0)), dielectric(cosine, np.array(1.5)), atol=1e-12)
    eta, k = 0.2, 3.9
    assert np.isclose(conductor(one, np.array(eta), np.array(k))[0], ((eta - 1) ** 2 + k**2) / ((eta + 1) ** 2 + k**2))
    # Complex arithmetic, the textbook's own form.
    n = complex(eta, k)
    sine2 = 1 - cosine**2
    refracted = np.sqrt(n**2 - sine2)
    rs = (cosine - refracted) / (cosine + refracted)
    rp = (n**2 * cosine - refracted) / (n**2 * cosine + refracted)
    assert np.allclose(conductor(cosine, np.array(eta), np.array(k)), (abs(rs) ** 2 + abs(rp) ** 2) / 2, rtol=1e-9)


@pytest.mark.parametrize("exponent", [1.0, 300.0, 1e6])
def test_lobes_keep_their_shape_near_the_peak(exponent: float) -> None:
    offset = np.array([1e-8, 1e-6, 1e-5, 1e-4, 1e-3])
    wo = spherical(0.7, 0.0)
    mirror = spherical(0.7 + offset, math.pi)
    got = ModifiedPhong(0, 1, exponent).evaluate(mirror, wo)[:, 0] * (2 * math.pi) / (exponent + 2)
    assert np.allclose(got, np.exp(exponent * np.log(np.cos(offset))), rtol=1e-7)
    half = spherical(offset, 0.0)
    blinn = BlinnPhong(0, 1, exponent)
    ratio = blinn.evaluate(half, half)[:, 0] / blinn.evaluate(UP, UP)[0]
    assert np.allclose(ratio, np.exp(exponent * np.log(np.cos(offset))), rtol=1e-7)


def test_by_name() -> None:
    lobes = {"phong", "blinn-phong", "ashikhmin-shirley", "ward", "ggx"}
    assert set(ANALYTIC) == {"lambert", "oren-nayar", "metallic-paint", "thin-cloth"} | lobes
    source = by_name("Blinn_Phong", specular=0.5, exponent=9)
    assert isinstance(source, BlinnPhong) and source.specular == (0.5, 0.5, 0.5)
    assert by_name("ggx", f0=[0.1, 0.2, 0.3]) == Ggx(f0=(0.1, 0.2, 0.3))
    assert not by_name("ward", alpha_y=0.5).isotropic and by_name("ward", alpha=0.5, alpha_y=0.5).isotropic


@pytest.mark.parametrize(
    ("name", "parameters", "says"),
    [
        ("gxx", {}, "lambert, phong"),
        ("ggx", {"roughness": 1}, "no parameter roughness"),
        ("ggx", {"alpha": 0}, "from 1e-05"),
        ("ggx", {"alpha": math.nan}, "alpha = nan"),
        ("ggx", {"alpha": "wide"}, "a number"),
        ("ggx", {"f0": (1, 2)}, "three numbers"),
        ("ggx", {"fresnel": "metal"}, "schlick, dielectric, conductor"),
        ("lambert", {"diffuse": 1.5}, "from 0 to 1"),
        ("phong", {"exponent": -1}, "from 0"),
        ("phong", {"lobe": "quartic"}, "power, schlick, lyon, cosine, cubic"),
        ("lambert", {"diffuse": None}, "three numbers"),
    ],
)
def test_by_name_refuses(name: str, parameters: dict, says: str) -> None:
    with pytest.raises(BakeError, match=says.replace("(", r"\(")):
        by_name(name, **parameters)
