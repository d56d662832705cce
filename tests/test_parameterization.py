"""The parameterisations in numpy: round trips, published properties, and digits kept in float32."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from measured_materials.bake import xp_numpy
from measured_materials.bake.directions import spherical
from measured_materials.bake.tables.grids import parameterization as par

ALPHA = st.floats(0, 1)
UNIT = st.floats(0, 1)
END = st.floats(np.log(par.NARROWEST_END), np.log(par.WIDEST_END)).map(lambda x: float(np.exp(x)))
WITH_ALPHA = ("identity", "uniform", "bezier", "squared")


@pytest.mark.parametrize("kind", WITH_ALPHA)
@given(s=UNIT, alpha=ALPHA)
def test_round_trip(kind: str, s: float, alpha: float) -> None:
    """s -> chord -> s, over the whole square of s and alpha."""
    v = float(par.inverse(xp_numpy, kind, s, alpha))
    assert 0 <= v <= 1 + 1e-15
    # Where the map is infinitely sparse at an end (alpha 0 or 1), s ~ t^2 keeps the digits of s, not of t.
    assert abs(float(par.forward(xp_numpy, kind, v, alpha)) - s) < 1e-14


@given(s=UNIT, near=END, far=END)
def test_fitted_round_trip(s: float, near: float, far: float) -> None:
    """The closed inverse is exact, over every warp that a table may have."""
    warp = par.LogWarp(near, far)
    v = float(par.inverse(xp_numpy, "fitted", s, warp))
    assert 0 <= v <= 1
    # At the sparse ends s grows at most 1 / (C narrowest end) times as fast as v.
    assert abs(float(par.forward(xp_numpy, "fitted", v, warp)) - s) < 1e-12


@given(near=END, far=END)
def test_fitted_density_is_what_it_says(near: float, far: float) -> None:
    """ds/dv in proportion to 1 / (v + near) + 1 / (1 + far - v): bounded both ways, s falling from 1 to 0."""
    warp = par.LogWarp(near, far)
    v = np.linspace(0.05, 0.95, 40)
    step = 1e-5
    slope = (par.forward(xp_numpy, "fitted", v - step, warp) - par.forward(xp_numpy, "fitted", v + step, warp)) / (
        2 * step
    )
    density = 1 / (v + near) + 1 / (1 + far - v)
    # Central differences of step 1e-5 at least 0.05 from a pole: (step / 0.05)^2 / 3, and rounding of 1e-16 / step.
    assert np.allclose(slope / density, slope[0] / density[0], rtol=1e-6)
    assert par.forward(xp_numpy, "fitted", np.array([0.0, 1.0]), warp) == pytest.approx([1, 0], abs=1e-12)


@pytest.mark.parametrize("kind", WITH_ALPHA)
@pytest.mark.parametrize("alpha", [0, 0.5, 1])
def test_ends_and_monotony(kind: str, alpha: float) -> None:
    """F(0) = 0 at the horizon, F(1) = 1 at the normal, falling with the chord between."""
    v = np.linspace(0, 1, 1001)
    s = par.forward(xp_numpy, kind, v, alpha)
    assert s[0] == pytest.approx(1, abs=1e-15) and s[-1] == pytest.approx(0, abs=1e-15)
    assert (np.diff(s) < 0).all()


def test_bezier_equals_the_papers_curve() -> None:
    """The stable form is the quadratic Bezier of Mallett & Yuksel 2016, equation 5, traced by parameter t."""
    for alpha in (0.0, 0.2, 0.7, 1.0):
        t = np.linspace(0, 1, 200)
        x = 1 - (1 - t) ** 2  # cos g along the curve
        s = 2 * t * (1 - t) * alpha + t**2
        assert np.allclose(par.bezier_forward(xp_numpy, np.sqrt(1 - x), alpha), s, atol=1e-12)


def test_uniform_is_linear_in_the_angle() -> None:
    """F(x) = 1 - (2 / pi) acos x."""
    angle = np.linspace(0, np.pi / 2, 91)
    chord = np.sqrt(2) * np.sin(angle / 2)
    assert np.allclose(par.uniform_forward(xp_numpy, chord), 1 - 2 / np.pi * angle, atol=1e-14)


@pytest.mark.parametrize("alpha", [0.0, 0.02, 0.25, 0.5, 0.75, 0.98, 1.0])
def test_inverse_keeps_float32_digits(alpha: float) -> None:
    """Worst angle error of the two-sided inverse in float32, for which the design's trial saw 1.3e-7 rad."""
    s = np.linspace(0, 1, 20001, dtype=np.float32)
    v32 = par.bezier_inverse(xp_numpy, s, np.float32(alpha))
    v64 = par.bezier_inverse(xp_numpy, s.astype(float), float(np.float32(alpha)))
    assert v32.dtype == np.float32
    angle = par.chord_to_theta(xp_numpy, v32.astype(float)) - par.chord_to_theta(xp_numpy, v64)
    assert np.abs(angle).max() < 3e-7


@pytest.mark.parametrize("near", [par.NARROWEST_END, 0.01, par.WIDEST_END])
@pytest.mark.parametrize("far", [par.NARROWEST_END, 0.1, par.WIDEST_END])
def test_fitted_inverse_keeps_float32_digits(near: float, far: float) -> None:
    """The angle of every node in float32."""
    warp = par.LogWarp(near, far)
    s = np.linspace(0, 1, 20001, dtype=np.float32)
    v32 = par.inverse(xp_numpy, "fitted", s, warp)
    v64 = par.inverse(xp_numpy, "fitted", s.astype(float), warp)
    assert v32.dtype == np.float32
    angle = par.chord_to_theta(xp_numpy, v32.astype(float)) - par.chord_to_theta(xp_numpy, v64)
    # The exponential of up to 16 carries 16 half-ulps of relative error, times at most 1/4 of the range of v; theta
    # grows twice as fast as v.
    assert np.abs(angle).max() < 2e-6


def test_density_follows_the_formula_not_the_papers_sentence() -> None:
    """alpha = 0 leaves the last two of 64 elevations 13.7 degrees apart at grazing, alpha = 1 at the normal."""
    chords = par.theta_nodes("bezier", 64, 0.0)
    theta = np.degrees(par.chord_to_theta(xp_numpy, chords))
    assert theta[0] - theta[1] == pytest.approx(13.7, abs=0.1)
    assert theta[-2] - theta[-1] < 1
    theta = np.degrees(par.chord_to_theta(xp_numpy, par.theta_nodes("bezier", 64, 1.0)))
    assert theta[0] - theta[1] < 1 and theta[-2] - theta[-1] > 8


@given(theta_i=UNIT, theta_o=UNIT, phi=st.floats(-np.pi, np.pi), turn=st.floats(0, 6.28))
def test_coordinates_are_isotropic_and_mirror_symmetric(
    theta_i: float, theta_o: float, phi: float, turn: float
) -> None:
    """Turning both directions about the normal, or mirroring phi_delta, changes nothing."""
    to = theta_o * np.pi / 2
    ti = theta_i * np.pi / 2
    first = par.normal_basis_coordinates(xp_numpy, spherical(ti, phi), spherical(to, 0.0), "bezier", 0.4, 0.3)
    second = par.normal_basis_coordinates(xp_numpy, spherical(ti, turn - phi), spherical(to, turn), "bezier", 0.4, 0.3)
    assert all(0 <= u <= 1 for u in first)
    assert np.allclose(first[:2], second[:2], atol=1e-12)
    # Within 1e-6 rad of a pole the azimuth itself is rounding noise, and the table is constant there.
    if min(ti, to) > 1e-6:
        assert first[2] == pytest.approx(second[2], abs=1e-7)


@given(theta_i=UNIT, theta_o=UNIT, phi=st.floats(-np.pi, np.pi), turn=st.floats(0, 6.28))
def test_half_vector_coordinates_are_isotropic_symmetric_and_reciprocal(
    theta_i: float, theta_o: float, phi: float, turn: float
) -> None:
    """Turning, mirroring and exchanging directions changes nothing; without reciprocity exchange turns u_phi over."""
    ti, to = theta_i * np.pi / 2, theta_o * np.pi / 2
    shapes = (par.LogWarp(0.4, 0.1), par.LogWarp(0.01, 4.0), par.LogWarp())
    kinds = ("fitted",) * 3
    wi, wo = spherical(ti, phi), spherical(to, 0.0)
    first = par.half_basis_coordinates(xp_numpy, wi, wo, kinds, shapes, True)
    turned = par.half_basis_coordinates(xp_numpy, spherical(ti, turn - phi), spherical(to, turn), kinds, shapes, True)
    swapped = par.half_basis_coordinates(xp_numpy, wo, wi, kinds, shapes, True)
    assert all(0 <= u <= 1 for u in first)
    # Both within 1e-4 rad of the horizon, theta_d is the quotient of two small chords.
    if min(np.cos(ti), np.cos(to)) > 1e-4:
        # The chord of theta_h is wrong by 1e-16 and s grows 20 times as fast as it.
        assert np.allclose(first[:2], turned[:2], atol=1e-9) and np.allclose(first[:2], swapped[:2], atol=1e-9)
        # Within 1e-4 rad of theta_h = 0 or theta_d = 0 phi_d is rounding noise, and the table is constant there.
        if np.linalg.norm(wi - wo) > 1e-4 and np.linalg.norm((wi + wo)[:2]) > 1e-4:
            assert first[2] == pytest.approx(turned[2], abs=1e-6)
            assert first[2] == pytest.approx(swapped[2], abs=1e-6)
            one = par.half_basis_coordinates(xp_numpy, wi, wo, kinds, shapes, False)[2]
            other = par.half_basis_coordinates(xp_numpy, wo, wi, kinds, shapes, False)[2]
            assert one + other == pytest.approx(1, abs=1e-6)
