"""The power law: known laws come back, Newton is nowhere worse than brute force, and nothing upsets it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from measured_materials.bake.errors import BakeError
from measured_materials.bake.shading_maps import power_law
from measured_materials.bake.shading_maps.power_law import PowerLaw, fit, fit_brute_force, rms_error


def slices_of(k: np.ndarray, exponent: np.ndarray, n: int = 8) -> np.ndarray:
    x = np.arange(n) / (n - 1)
    return (k * x.reshape(-1, 1, 1, 1) ** exponent).astype(np.float32)


def texel_errors(slices: np.ndarray, law: PowerLaw) -> np.ndarray:
    """Squared error of each texel and channel, summed over the slices, in float64."""
    x = np.arange(len(slices)) / (len(slices) - 1)
    found = law.k.astype(float) * x.reshape(-1, 1, 1, 1) ** law.exponent.astype(float)
    return np.asarray(np.square(found - slices).sum(axis=0))


def hard_slices(kind: str, n: int = 8, size: tuple[int, int] = (24, 32)) -> np.ndarray:
    shape, rng = (n, *size, 3), np.random.default_rng(21)
    if kind == "noisy law":
        clean = slices_of(rng.gamma(3, 0.3, shape[1:]), np.exp(rng.normal(0, 0.5, shape[1:])), n)
        slices = np.maximum(clean * rng.normal(1, 0.15, shape), 0)
    elif kind == "noise":
        slices = rng.random(shape)
    elif kind == "spikes":
        slices = np.exp(2 * rng.normal(size=shape))
    else:
        slices = (rng.random(shape) > 0.6).astype(float)
    slices[0] = 0
    return slices.astype(np.float32)


@pytest.mark.parametrize("free_k", [False, True])
@pytest.mark.parametrize("fitter", [fit, fit_brute_force])
@pytest.mark.parametrize("n", [3, 8, 17])
def test_a_power_law_comes_back(fitter, free_k: bool, n: int) -> None:
    rng = np.random.default_rng(22)
    k = rng.uniform(0.01, 30, (13, 11, 3)).astype(np.float32)
    exponent = np.exp(rng.uniform(np.log(0.1), np.log(10), k.shape)).astype(np.float32)
    law = fitter(slices_of(k, exponent, n), free_k=free_k)
    assert law.k.shape == law.exponent.shape == k.shape
    assert law.k.dtype == law.exponent.dtype == np.float32
    # The slices are rounded to 2^-24, and sums of their squares are compared: seen 1e-5 in 150 sets of numbers. Of
    # three slices only the middle one tells, at K = 10 by x^K = 2^-10: seen 2e-3 by Newton's three steps, from one
    # candidate to where the next one's power is half.
    assert np.abs(law.exponent / exponent - 1).max() < (6e-3 if n == 3 and fitter is fit else 3e-5)
    assert np.abs(law.k / k - 1).max() < 1e-5
    slices = slices_of(k, exponent, n)
    assert np.abs(law.evaluate(np.linspace(0, 1, n).reshape(-1, 1, 1, 1)) - slices).max() < 2.0**-12 * k.max()
    assert law.rms(slices) < 2e-5 * k.max()


@pytest.mark.parametrize("free_k", [False, True])
@pytest.mark.parametrize("kind", ["noisy law", "noise", "spikes", "steps"])
@pytest.mark.parametrize("n", [3, 8, 12])
def test_nowhere_worse_than_brute_force(kind: str, n: int, free_k: bool) -> None:
    slices = hard_slices(kind, n)
    newton, brute = fit(slices, free_k=free_k), fit_brute_force(slices, free_k=free_k)
    ours, theirs = texel_errors(slices, newton), texel_errors(slices, brute)
    signal = np.square(slices.astype(float)).sum(axis=0)
    # Rounding, except where noise has two minima of nearly equal depth closer together than the starting exponents.
    excess = (ours - theirs) / np.maximum(signal, 1e-30)
    assert excess.max() < 1e-4 and (excess > 1e-6).mean() < 2e-3
    assert newton.rms(slices) <= brute.rms(slices) * (1 + 1e-6)


@pytest.mark.parametrize("fitter", [fit, fit_brute_force])
def test_free_k_is_never_worse(fitter) -> None:
    slices = hard_slices("noise")
    paper, free = (texel_errors(slices, fitter(slices, free_k=free)) for free in (False, True))
    assert (free <= paper * (1 + 1e-4)).all() and free.sum() < 0.95 * paper.sum()


def test_paper_keeps_the_last_slice() -> None:
    slices = hard_slices("spikes")
    np.testing.assert_array_equal(fit(slices).k, slices[-1])
    np.testing.assert_array_equal(fit(slices).evaluate(1), slices[-1])


def test_derivatives_against_differences() -> None:
    """Newton's slopes are those of the squared error."""
    block = hard_slices("noisy law", 8, (4, 5)).reshape(8, -1)[1:].astype(np.float64)
    log_x = np.log(np.arange(1, 8) / 7)[:, None]
    exponent, h = np.linspace(0.3, 4, block.shape[1]), 1e-4

    def sums(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        b = np.exp(log_x * at)
        p = np.stack([(block * b * log_x**n).sum(0) for n in range(3)])
        return p, np.stack([(b * b * (2 * log_x) ** n).sum(0) for n in range(3)])

    def paper_cost(at: np.ndarray) -> np.ndarray:
        p, q = sums(at)
        return block[-1] * q[0] - 2 * p[0]

    def free_cost(at: np.ndarray) -> np.ndarray:
        p, q = sums(at)
        return -(p[0] ** 2) / q[0]

    p, q = sums(exponent)
    slope, curvature, _ = power_law._paper_slope(p, q, block[-1])
    costs = [paper_cost(exponent + step) for step in (-h, 0, h)]
    np.testing.assert_allclose(slope, (costs[2] - costs[0]) / (2 * h), rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(curvature, (costs[2] - 2 * costs[1] + costs[0]) / h**2, rtol=1e-3, atol=1e-4)
    slope = power_law._free_slope(p, q, block[-1])[0] * p[0] / q[0] ** 2
    difference = (free_cost(exponent + h) - free_cost(exponent - h)) / (2 * h)
    np.testing.assert_allclose(slope, difference, rtol=1e-4, atol=1e-6)
    # The curvature belongs to the slope without its factor.
    slopes = [power_law._free_slope(*sums(exponent + step), block[-1]) for step in (-h, 0, h)]
    np.testing.assert_allclose(slopes[1][1], (slopes[2][0] - slopes[0][0]) / (2 * h), rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("free_k", [False, True])
@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_any_finite_slices_give_finite_laws_within_bounds(free_k: bool, data: st.DataObject) -> None:
    shape = data.draw(st.tuples(st.integers(2, 9), st.integers(1, 3), st.integers(1, 3), st.sampled_from([1, 3])))
    values = st.floats(-100, 1e6, width=32) | st.sampled_from([0.0, 1.0, 2.0**-120, 2.0**100])
    slices = data.draw(hnp.arrays(np.float32, shape, elements=values))
    law = fit(slices, free_k=free_k, bounds=(0.1, 8))
    assert np.isfinite(law.k).all() and (law.k >= 0).all()
    assert (law.exponent >= np.float32(0.1)).all() and (law.exponent <= 8).all()
    for x in (0.0, 1e-6, 0.5, 1.0):
        assert np.isfinite(law.evaluate(x)).all() and (law.evaluate(x) >= 0).all()


@pytest.mark.parametrize("free_k", [False, True])
def test_black_texels_and_the_bounds(free_k: bool) -> None:
    slices = np.zeros((8, 1, 4, 3), np.float32)
    slices[1:, 0, 1] = 1  # constant: K tends to 0
    slices[-1, 0, 2] = 1  # only the last slice: K tends to infinity
    slices[1:-1, 0, 3] = 1  # nothing in the last slice
    law = fit(slices, free_k=free_k)
    assert (law.k[0, 0] == 0).all() and (law.exponent[0, 0] == 1).all()
    np.testing.assert_allclose(law.exponent[0, 1:3], [[0.05] * 3, [20] * 3], rtol=1e-6)
    assert (law.k[0, 3] == 0).all() != free_k
    assert fit(slices[:, :, :1]).rms(slices[:, :, :1]) == 0


def test_two_slices_are_a_straight_line() -> None:
    slices = hard_slices("noise", 2)
    for law in (fit(slices), fit(slices, free_k=True), fit_brute_force(slices)):
        assert (law.exponent == 1).all()
        np.testing.assert_array_equal(law.k, slices[1])


def test_evaluate() -> None:
    law = PowerLaw(np.full((2, 3, 3), 2, np.float32), np.full((2, 3, 3), 0.5, np.float32))
    np.testing.assert_allclose(law.evaluate(0.25), 1, rtol=1e-6)
    np.testing.assert_allclose(law.evaluate(4), 4, rtol=1e-6)
    assert not law.evaluate(0).any() and not law.evaluate(-1).any()
    per_texel = np.array([0.0, 0.25, 1.0], np.float32)[None, :, None]
    np.testing.assert_allclose(law.evaluate(per_texel)[0, :, 0], [0, 1, 2], rtol=1e-6)
    assert law.evaluate(np.linspace(0, 1, 5).reshape(5, 1, 1, 1)).shape == (5, 2, 3, 3)


def test_rms_counts_every_slice() -> None:
    slices = np.ones((4, 2, 2, 3), np.float32)
    assert rms_error(slices, lambda x: np.zeros((2, 2, 3), np.float32)) == 1
    half_off = PowerLaw(np.full((2, 2, 3), 0.5, np.float32), np.full((2, 2, 3), 1e-6, np.float32))
    assert half_off.rms(slices) == pytest.approx(np.sqrt((1 + 3 * 0.25) / 4), rel=1e-4)  # slice 0 counts as 0


def test_types_of_numbers_and_blocks_do_not_matter() -> None:
    slices = hard_slices("noisy law", 6, (70, 50))  # 10 500 texels: more than a block
    expected = fit(slices)
    for other in (slices.astype(np.float64), np.asfortranarray(slices), slices[:, ::-1][:, ::-1]):
        np.testing.assert_array_equal(fit(other).exponent, expected.exponent)
    # Products of matrices may be summed in another order when their sizes change.
    np.testing.assert_allclose(fit(slices[:, 60:]).exponent, expected.exponent[60:], rtol=1e-3)
    assert np.isfinite(fit((slices * 20).astype(np.uint8)).exponent).all()


@pytest.mark.parametrize(
    "slices, options, word",
    [
        (np.ones((8, 4, 4)), {}, r"shape \(8, 4, 4\)"),
        (np.ones((1, 4, 4, 3)), {}, "shape"),
        (np.ones((8, 0, 4, 3)), {}, "shape"),
        ("slices", {}, "not an array of numbers"),
        ([[1], [2, 3]], {}, "not an array of numbers"),
        (np.ones((8, 2, 2, 3), complex), {}, "not an array of numbers"),
        (np.full((8, 2, 2, 3), np.nan), {}, "not finite .slice 0"),
        (np.full((8, 2, 2, 3), 1e39), {}, "not finite"),
        (np.ones((8, 2, 2, 3)), {"bounds": (2, 1)}, "bounds: are 2 and 1"),
        (np.ones((8, 2, 2, 3)), {"bounds": (0, 1)}, "bounds: are 0 and 1"),
        (np.ones((8, 2, 2, 3)), {"bounds": (0.1, np.nan)}, "bounds"),
    ],
)
@pytest.mark.parametrize("fitter", [fit, fit_brute_force])
def test_unusable_input(fitter, slices, options, word: str) -> None:
    with pytest.raises(BakeError, match=word):
        fitter(slices, **options)
