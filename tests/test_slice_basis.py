"""Shared curves: as close as any of their rank, exact where the map has no more, non-negative where asked."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from measured_materials.bake.errors import BakeError
from measured_materials.bake.shading_maps.power_law import fit
from measured_materials.bake.shading_maps.slice_basis import SliceBasis, _least_nonnegative, fit_basis
from scipy.optimize import nnls


def mixture(n: int = 8, size: tuple[int, int] = (20, 30), noise: float = 0.0) -> np.ndarray:
    """Texels that mix an early and a late rising curve, which neither is a power law."""
    x = np.linspace(0, 1, n)
    early, late = np.minimum(3 * x, 1), np.maximum(2 * x - 1, 0)
    rng = np.random.default_rng(31)
    weights = rng.gamma(2, 0.5, (2, *size, 3))
    slices = early.reshape(-1, 1, 1, 1) * weights[0] + late.reshape(-1, 1, 1, 1) * weights[1]
    slices *= rng.normal(1, noise, slices.shape)
    return np.maximum(slices, 0).astype(np.float32)


@pytest.mark.parametrize("rank", [1, 2, 3])
def test_no_other_basis_of_this_rank_is_closer(rank: int) -> None:
    slices = mixture(noise=0.2)
    basis = fit_basis(slices, rank)
    assert basis.coefficients.shape == (20, 30, 3, rank) and basis.curves.shape == (rank, 8)
    assert basis.coefficients.dtype == basis.curves.dtype == np.float32
    residual = basis.coefficients.astype(float) @ basis.curves.astype(float) - np.moveaxis(slices, 0, -1)
    singular = np.linalg.svd(slices[1:].reshape(7, -1).astype(float), compute_uv=False)
    # Eckart & Young 1936; the float32 of coefficients and curves adds 1e-7 of the signal to each number.
    assert np.square(residual).sum() == pytest.approx(np.square(singular[rank:]).sum(), rel=1e-5)


@pytest.mark.parametrize("nonnegative, tolerance", [(False, 1e-6), (True, 1e-2)])
def test_a_map_of_two_curves_needs_two(nonnegative: bool, tolerance: float) -> None:
    # Alternating least squares creep at the end, hence the second tolerance: 1 % of the mean of 1.
    slices = mixture()
    assert fit_basis(slices, 2, nonnegative=nonnegative).rms(slices) < tolerance < 0.05 < fit(slices).rms(slices)
    assert fit_basis(slices, 1).rms(slices) > 0.05


@pytest.mark.parametrize("rank", [1, 2, 3])
def test_nonnegative_costs_little(rank: int) -> None:
    slices = mixture(noise=0.1)
    free, bound = fit_basis(slices, rank), fit_basis(slices, rank, nonnegative=True)
    assert (bound.coefficients >= 0).all() and (bound.curves >= 0).all()
    x = np.linspace(0, 1, 8).reshape(-1, 1, 1, 1)
    unclipped = np.sqrt(np.square(bound.coefficients @ bound.curves - np.moveaxis(slices, 0, -1)).mean())
    assert bound.rms(slices) == pytest.approx(unclipped, rel=1e-4)
    assert free.rms(slices) <= bound.rms(slices) * 1.001 <= 1.15 * free.rms(slices)
    np.testing.assert_allclose(bound.evaluate(x), np.moveaxis(bound.coefficients @ bound.curves, -1, 0), atol=1e-5)


def test_least_squares_under_the_constraint_are_exact() -> None:
    rng = np.random.default_rng(32)
    for rank in (1, 2, 3, 4):
        curves = rng.random((rank, 7))
        data = rng.normal(0.3, 1, (7, 200))
        found = _least_nonnegative(curves @ curves.T, curves @ data)
        for column in range(200):
            expected = nnls(curves.T, data[:, column])[0]
            np.testing.assert_allclose(found[:, column], expected, atol=1e-9)


def test_all_but_the_first_slice_at_full_rank() -> None:
    slices = np.random.default_rng(33).random((4, 5, 6, 3)).astype(np.float32)
    slices[0] = 0
    basis = fit_basis(slices, 3)
    assert basis.rms(slices) < 1e-6
    # Between the slices a straight line, as the slices themselves are looked up.
    np.testing.assert_allclose(basis.evaluate(0.5), 0.5 * (slices[1] + slices[2]), atol=1e-6)


def test_evaluate() -> None:
    curves = np.array([[0, 0.5, 1], [0, 1, -1]], np.float32)
    basis = SliceBasis(np.ones((2, 4, 3, 2), np.float32), curves)
    assert not basis.evaluate(0).any() and not basis.evaluate(-1).any()
    np.testing.assert_allclose(basis.evaluate(0.25), 0.75)
    np.testing.assert_array_equal(basis.evaluate(1), 0)
    np.testing.assert_array_equal(basis.evaluate(7), basis.evaluate(1))
    negative = SliceBasis(np.ones((1, 1, 3, 1), np.float32), -curves[:1])
    assert not negative.evaluate(0.5).any()
    per_texel = np.array([0, 0.25, 0.5, 0.75])[None, :, None]
    np.testing.assert_allclose(basis.evaluate(per_texel)[1, :, 2], [0, 0.75, 1.5, 0.75])
    assert basis.evaluate(np.linspace(0, 1, 5).reshape(5, 1, 1, 1)).shape == (5, 2, 4, 3)


def test_curves_point_up_and_reach_1() -> None:
    for nonnegative in (False, True):
        curves = fit_basis(mixture(noise=0.2), 3, nonnegative=nonnegative).curves
        np.testing.assert_allclose(np.abs(curves).max(axis=1), 1, rtol=1e-6)
        assert (curves.sum(axis=1) > 0).all() and not curves[:, 0].any()


@pytest.mark.parametrize("nonnegative", [False, True])
def test_many_texels_and_repeatability(nonnegative: bool) -> None:
    slices = mixture(6, (160, 160), 0.1)  # more texels than a block, or than the curves are fitted to
    first, second = (fit_basis(slices, 2, nonnegative=nonnegative) for _ in range(2))
    np.testing.assert_array_equal(first.coefficients, second.coefficients)
    assert fit_basis(slices, 1).rms(slices) > 2 * first.rms(slices)


def test_every_channel_counts_in_a_large_map() -> None:
    x = np.linspace(0, 1, 8).reshape(-1, 1, 1, 1)
    weights = np.random.default_rng(34).gamma(2, 0.5, (1, 128, 192, 3))
    slices = (weights * x ** np.array([0.4, 0.4, 3])).astype(np.float32)
    # Two curves hold it exactly; without blue among the samples the error would be a tenth of the mean of 1.
    assert fit_basis(slices, 2, nonnegative=True).rms(slices) < 1e-2


@pytest.mark.parametrize("nonnegative", [False, True])
@settings(max_examples=40, deadline=None)
@given(data=st.data())
def test_any_finite_slices(nonnegative: bool, data: st.DataObject) -> None:
    shape = data.draw(st.tuples(st.integers(3, 6), st.integers(1, 3), st.integers(1, 3), st.sampled_from([1, 3])))
    values = st.floats(-100, 1e6, width=32) | st.sampled_from([0.0, 1.0, 2.0**-120, 2.0**50])
    slices = data.draw(hnp.arrays(np.float32, shape, elements=values))
    basis = fit_basis(slices, 2, nonnegative=nonnegative)
    assert np.isfinite(basis.coefficients).all() and np.isfinite(basis.curves).all()
    assert (basis.evaluate(0.3) >= 0).all()


@pytest.mark.parametrize(
    "slices, rank, word",
    [
        (np.ones((8, 4, 4)), 2, "shape"),
        (np.full((8, 4, 4, 3), np.inf), 2, "not finite"),
        (np.ones((8, 4, 4, 3)), 0, "basis rank: is 0"),
        (np.ones((8, 4, 4, 3)), 5, "basis rank: is 5"),
        (np.ones((8, 4, 4, 3)), 2.0, "basis rank: is 2.0"),
        (np.ones((8, 4, 4, 3)), True, "basis rank: is True"),
        (np.ones((3, 4, 4, 3)), 3, "basis rank: is 3 for 3 slices"),
    ],
)
def test_unusable_input(slices: np.ndarray, rank: int, word: str) -> None:
    with pytest.raises(BakeError, match=word):
        fit_basis(slices, rank)
