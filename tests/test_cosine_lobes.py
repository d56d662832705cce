"""Cosine lobes in numpy: against float64 truth, in their ranges, and their factors against quadrature."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from measured_materials.bake import xp_numpy
from measured_materials.bake.directions import spherical
from measured_materials.bake.lobes.cosine_lobes import (
    COSINE_LOBES,
    HEAVY,
    coefficient_table,
    cosine_lobe,
    cubic_coefficients,
    cubic_lobe,
    draw_lobe,
    half_chord_square,
    half_vector_norm,
    lobe_density,
    lobe_norm,
    steepest,
    tabulated_coefficients,
)
from measured_materials.bake.sources.analytic import BlinnPhong, ModifiedPhong
from measured_materials.bake.tables.albedo import directional_albedo
from scipy.integrate import quad

every_lobe = pytest.mark.parametrize("name", COSINE_LOBES)
EXPONENTS = (0.01, 0.3, 0.9, 1.0, 1.3, 2.0, 4.0, 5.0, 30.0, 256.0, 1e4, 1e6, 1e8)


def value(name: str, u: np.ndarray, n: float) -> np.ndarray:
    return np.asarray(cosine_lobe(xp_numpy, name, u, np.full_like(u, n)))


def half_width(n: float) -> float:
    return -math.expm1(-math.log(2) / n)


def edges(n: float, dtype: type) -> np.ndarray:
    """u in order: 0, a dense set over the lobe and the tail, the join, 1, and an ulp on either side of both."""
    p = half_width(max(n, 1.0))
    u = np.concatenate([[0, 1, 1.5, 2, 1e-30], np.geomspace(1e-4 / n, 1, 400), np.linspace(0, 2 * p, 200)])
    u = u[u <= 2].astype(dtype)
    for x in (dtype(p), dtype(1)):
        u = np.append(u, [np.nextafter(x, dtype(0)), x, np.nextafter(x, dtype(2))])
    return np.unique(u)


@pytest.mark.parametrize("n", EXPONENTS)
def test_power_keeps_its_digits_in_float32(n: float) -> None:
    """As the base alone, rounded by up to 3e-8, does not: n times that is lost."""
    u = edges(n, np.float32)
    n = float(np.float32(n))
    with np.errstate(divide="ignore"):
        exponent = n * np.log1p(-np.minimum(u.astype(float), 1))
    # Below the smallest normal number of float32 digits end.
    kept = exponent > -80
    found = value("power", u, n)
    # powf is good to an ulp, the correction's exponent of up to n 3e-8 = 3 to three.
    assert np.abs(found[kept] / np.exp(exponent[kept]) - 1).max() < 1e-6
    assert found[u >= 1].max() == 0
    if n >= 1e4:
        plain = np.power(np.maximum(1 - u, 0), np.float32(n))
        assert np.abs(plain[kept] / np.exp(exponent[kept]) - 1).max() > 20 * 1e-6


def cubic_truth(u: np.ndarray, n: float) -> np.ndarray:
    """Romanyuk's conditions solved in float64: f(1) = 1, f(0) = 0, f(q) = 1/2, f'(q) = n / (2 q), in powers of c."""
    q = 0.5 ** (1 / n)
    system = [[1, 1, 1], [q**3, q**2, q], [3 * q**2, 2 * q, 1]]
    k = np.linalg.solve(system, [1, 0.5, n / (2 * q)])
    c = 1 - u
    tail = c / (2 * n * (q - c) + 2 * c)
    return np.where(c > q, ((k[0] * c + k[1]) * c + k[2]) * c, tail)


@pytest.mark.parametrize("n", [1.1, 2.0, 10.0, 100.0, 256.0])
def test_cubic_is_the_one_of_its_conditions(n: float) -> None:
    """The linear system has lost n^2 ulps by itself, so n is small here."""
    u = edges(n, np.float64)
    u = u[(u < 1) & (np.abs(u - half_width(n)) > 1e-12)]
    assert np.abs(value("cubic", u, n) - cubic_truth(u, n)).max() < 1e-16 * (1000 + 100 * n**2)


@every_lobe
@pytest.mark.parametrize("n", EXPONENTS)
def test_float32_against_float64(name: str, n: float) -> None:
    u = edges(n, np.float32)
    n = float(np.float32(n))
    # At 1 the lobes that do not vanish there jump; half an ulp below, float32 rounds up to it.
    truth = value(name, u.astype(float), n)
    # Absolute, of a peak of 1: a dozen roundings, whatever n is.
    assert np.abs(value(name, u, n) - truth).max() < 1e-6


@every_lobe
@given(st.floats(-2, 8), st.booleans())
def test_is_a_lobe_for_every_exponent(name: str, decades: float, single: bool) -> None:
    """1 at the peak, falling, never negative, 0 from 90 degrees on; in float32 and float64, at every edge."""
    dtype = np.float32 if single else np.float64
    n = 10.0**decades
    u = edges(n, dtype)
    found = value(name, u, n)
    assert np.isfinite(found).all() and (found >= 0).all() and found[0] == 1
    assert (found[u >= 1] == 0).all()
    # Neighbours may differ by their rounding.
    assert (np.diff(found) <= 16 * np.finfo(dtype).eps * np.maximum(found[:-1], np.finfo(dtype).tiny)).all()


@given(st.floats(0, 8))
def test_cubic_meets_its_tail_and_its_tangent(decades: float) -> None:
    """Value 1/2 on both sides of the join, and the slope of cos^n on the upper one."""
    n = 10.0**decades
    p, g, a = (float(k) for k in cubic_coefficients(xp_numpy, np.float64(n)))
    assert p == pytest.approx(half_width(n), rel=2e-15)
    above, at = (float(value("cubic", np.array([u]), n)[0]) for u in (np.nextafter(p, 0), p))
    assert above == pytest.approx(0.5, abs=1e-8) and at == pytest.approx(0.5, abs=1e-15)
    step = 1e-6 * p
    slope = (value("cubic", np.array([p - step]), n)[0] - 0.5) / step
    assert slope == pytest.approx(n / (2 * (1 - p)), rel=1e-5)
    assert 0 <= g <= 0.5 and -0.05 <= a <= 0.155


def test_table_of_coefficients() -> None:
    """64 rows over 1 / n serve every exponent from 1 to infinity."""
    n = np.geomspace(1, 1e8, 3001)
    table = coefficient_table()
    worst = 0.0
    for share in np.linspace(0, 1, 41):
        p, g, a = tabulated_coefficients(table, n)
        u = share * half_width(1.0) if share == 1 else share * -np.expm1(-math.log(2) / n)
        worst = max(worst, np.abs(cubic_lobe(xp_numpy, u, n, (p, g, a)) - value("cubic", u * np.ones_like(n), n)).max())
    # Linear interpolation errs by a sixteenth of a row, squared, times the curvature (seen: 9.3e-6).
    assert worst < 1.2e-5
    assert (
        np.abs(
            np.stack(tabulated_coefficients(table, np.array([1.0, 1e300]))) - [[0.5, 0], [0, 0.5], [0, 0.1534264]]
        ).max()
        < 1e-6
    )


def integral(name: str, n: float) -> float:
    """Of lobe times cosine over the hemisphere, by adaptive quadrature between all joints."""
    joints = {0, 1, half_width(max(n, 1)), 4 / n, 1 - math.cos(math.pi / math.sqrt(n)) if n > 4 else 1}
    joints |= {10.0**k / n for k in range(-1, 9)}
    places = sorted(j for j in joints if j <= 1)
    parts = [
        quad(lambda u: float(value(name, np.float64(u), n)) * (1 - u), low, high, epsabs=0, epsrel=1e-11)[0]
        for low, high in itertools.pairwise(places)
    ]
    return 2 * math.pi * sum(parts)


@every_lobe
@pytest.mark.parametrize("n", [0.01, 0.499, 0.501, 0.999, 1.0, 1.01, 1.99, 2.01, 5.0, 30.0, 1e4, 1e8])
def test_factor_against_quadrature(name: str, n: float) -> None:
    found = float(lobe_norm(xp_numpy, name, np.float64(n)))
    assert found * integral(name, n) == pytest.approx(1, rel=3e-8)
    # What a 2 % error of the factor would be.
    assert 1.02 * found * integral(name, n) != pytest.approx(1, rel=1e-2)
    single = float(lobe_norm(xp_numpy, name, np.full(1, n, np.float32))[0])
    # Near n = 2 Schlick's closed form takes the difference of numbers ten times as large.
    assert single == pytest.approx(float(lobe_norm(xp_numpy, name, np.float64(np.float32(n)))), rel=5e-6)


@every_lobe
@pytest.mark.parametrize("n", [0.3, 1.0, 20.0, 1e3])
def test_albedo_at_the_normal_is_one(name: str, n: float) -> None:
    """Of both analytic models, and less elsewhere."""
    angles = np.radians([0, 30, 60, 80])
    phong = directional_albedo(ModifiedPhong(0, 1, n, name), angles)[:, 0]
    blinn = directional_albedo(BlinnPhong(0, 1, n, name), angles)[:, 0]
    # The quadrature of `directional_albedo` meets kinks, and at n < 1 a root at the horizon.
    assert phong[0] == pytest.approx(1, abs=2e-3) and blinn[0] == pytest.approx(1, abs=2e-3)
    assert phong.max() < 1 + 2e-3
    if name == "power":
        assert half_vector_norm(name, n) == pytest.approx(
            (n + 2) * (n + 4) / (8 * math.pi * (2 ** (-n / 2) + n)), rel=1e-9
        )


@every_lobe
@pytest.mark.parametrize("n", [1.0, 30.0, 1e4])
def test_drawing(name: str, n: float) -> None:
    """The density is that of the draw, integrates to 1, and a heavy lobe never outweighs it."""
    random = np.linspace(0, 1, 2001)
    u = np.sort(draw_lobe(xp_numpy, name, random, n))
    # By cos^n a random number of 0 counts as the smallest of float32, 2^-126.
    assert u[0] == 0 and u[-1] == pytest.approx(1 if name in HEAVY else -math.expm1(-126 * math.log(2) / (n + 1)))
    middle = 0.5 * (u[1:] + u[:-1])
    share = lobe_density(xp_numpy, name, middle, n) * 2 * math.pi * np.diff(u)
    # Steps of 1/2000, of which the midpoint rule misses what the density bends, most at the ends.
    assert np.median(np.abs(share * 2000 - 1)) < 1e-3 and share.sum() == pytest.approx(1, abs=2e-3)
    if name in HEAVY:
        weight = value(name, u[:-1], n) / lobe_density(xp_numpy, name, u[:-1], n)
        assert weight.max() <= 1.002 * weight[0]


@every_lobe
@pytest.mark.parametrize("n", [0.01, 1.0, 3.0, 50.0, 1e8])
def test_steepest(name: str, n: float) -> None:
    u = np.concatenate([np.geomspace(1e-4 / n, 1, 20001), np.linspace(0, 1, 1001)])
    u = u[u <= 1]
    found = float((value(name, u, n) * np.sqrt(u * (2 - u))).max())
    assert found <= float(steepest(xp_numpy, name, n))
    if n >= 1e8:
        assert found > 0.999 * float(steepest(xp_numpy, name, n))


def test_chord_keeps_small_angles() -> None:
    """An angle of 1e-4 between float32 vectors: the cosine knows nothing of it, the chord four digits."""
    a, b = (spherical(t, 0.3).astype(np.float32) for t in (0.5, 0.5001))
    u = half_chord_square(xp_numpy, a, b)
    assert u == pytest.approx(0.5e-8, rel=5e-3)
    assert float(1 - np.sum(a * b)) != pytest.approx(0.5e-8, rel=0.5)
