"""The instrument that compares noisy pictures, tried on noise whose truth is known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy import stats
from support.monte_carlo import assert_agree, compare

SIDE, LEVEL = 40, 0.05
Noise = Callable[[np.random.Generator, int], np.ndarray]

_rows = np.arange(SIDE)[:, None, None]
EXPECTATION = (0.2 + 0.8 * _rows / SIDE) * np.ones((1, SIDE, 1)) * np.array([0.8, 0.5, 0.3])
ALL = (1, SIDE, SIDE, 1)


def normal(rng: np.random.Generator, seeds: int) -> np.ndarray:
    return 0.3 * rng.standard_normal((seeds, *ALL[1:])) + 0.05 * rng.standard_normal((seeds, *ALL[1:3], 3))


def uneven(rng: np.random.Generator, seeds: int) -> np.ndarray:
    """Half of the picture thirty times as noisy as the other."""
    return np.where(_rows < SIDE // 2, 1.5, 0.05) * rng.standard_normal((seeds, *ALL[1:]))


def lognormal(rng: np.random.Generator, seeds: int) -> np.ndarray:
    return np.exp(1.5 * rng.standard_normal((seeds, *ALL[1:])) - 1.5**2 / 2) - 1


def flashes(rng: np.random.Generator, seeds: int) -> np.ndarray:
    """All light in 1 % of the pixels: a mirror that rarely meets a small lamp."""
    return (rng.random((seeds, *ALL[1:])) < 0.01) / 0.01 - 1


def renders(noise: Noise, rng: np.random.Generator, seeds: int) -> np.ndarray:
    return EXPECTATION * (1 + noise(rng, seeds))


@pytest.mark.parametrize(
    "noise_a, noise_b",
    [(normal, normal), (uneven, uneven), (lognormal, lognormal), (lognormal, normal), (flashes, normal)],
)
def test_false_alarms_stay_within_the_level(noise_a: Noise, noise_b: Noise) -> None:
    rng = np.random.default_rng(1)
    tries = 100
    alarms = sum(
        not compare(renders(noise_a, rng, 8), renders(noise_b, rng, 8), level=LEVEL).passed for _ in range(tries)
    )
    # More than this many would turn up in one of a thousand runs of a test of exactly this level.
    assert alarms <= stats.binom.ppf(0.999, tries, LEVEL)


@pytest.mark.parametrize("noise, seeds", [(normal, 5), (uneven, 12), (lognormal, 5)])
def test_detectable_effect_is_found_with_the_stated_power(noise: Noise, seeds: int) -> None:
    rng = np.random.default_rng(2)
    tries, found, part_found = 40, 0, 0
    for _ in range(tries):
        a, b = renders(noise, rng, seeds), renders(noise, rng, seeds)
        effect = compare(a, b, level=LEVEL).detectable_effect
        found += not compare(a, b * (1 + effect), level=LEVEL).passed
        part_found += not compare(a, b * (1 + effect / 3), level=LEVEL).passed
    # The one side: 95 % power, less what one of a thousand runs would miss by chance. The other: an effect stated
    # much too large would be no statement; a third of it must escape in most cases.
    assert found >= stats.binom.ppf(0.001, tries, 0.95)
    assert part_found < 0.7 * tries


def test_planted_two_percent_is_found_everywhere_and_in_one_tile() -> None:
    rng = np.random.default_rng(3)
    a, b = renders(normal, rng, 16), renders(normal, rng, 16)
    equal, everywhere = compare(a, b), compare(a, 0.98 * b)
    assert_agree(equal, finds=0.02)
    assert not everywhere.passed
    assert everywhere.relative_difference == pytest.approx(0.98 * (1 + equal.relative_difference) - 1)
    b[:, 16:24, 24:32] *= 1.2  # six standard errors of one tile, lost in the mean of the whole
    local = compare(a, b)
    assert not local.passed and local.worst_tile[:2] == (2, 3)
    assert local.worst_tile_difference == pytest.approx(0.2, abs=0.1)


def test_tolerance_accepts_a_stated_bias_and_nothing_beyond() -> None:
    rng = np.random.default_rng(4)
    a, b = renders(normal, rng, 16), renders(normal, rng, 16)
    assert compare(a, 1.02 * b, tolerance=0.02).passed
    assert not compare(a, 1.04 * b, tolerance=0.02).passed


def test_mask_hides_what_lies_outside() -> None:
    rng = np.random.default_rng(5)
    a, b = renders(normal, rng, 8), renders(normal, rng, 8)
    mask = np.zeros((SIDE, SIDE), bool)
    mask[5:37, 3:30] = True
    b[:, ~mask] = np.nan
    a[:, ~mask] = 1e6
    assert compare(a, np.nan_to_num(b), mask).passed
    assert compare(a, b, mask).passed


def test_noise_that_hides_everything_does_not_count_as_agreement() -> None:
    rng = np.random.default_rng(6)
    result = compare(renders(lognormal, rng, 4), renders(lognormal, rng, 4))
    with pytest.raises(AssertionError, match="too noisy"):
        assert_agree(result, finds=0.02)
    rare = [np.where(rng.random((6, SIDE, SIDE, 1)) < 2e-4, 5000.0, 0.0) * EXPECTATION for _ in range(2)]
    with pytest.raises(AssertionError, match=r"too skewed|too noisy"):
        assert_agree(compare(rare[0], EXPECTATION + 0 * rare[1]), finds=10.0)


def test_noiseless_pictures_agree_to_float_rounding() -> None:
    picture = np.broadcast_to(EXPECTATION, (3, SIDE, SIDE, 3)).astype(np.float32)
    assert compare(picture, picture).passed
    assert compare(picture, np.nextafter(picture, np.float32(2))).passed
    assert not compare(picture, picture * 1.0001).passed
    assert compare(0 * picture, 0 * picture).passed


@pytest.mark.parametrize(
    "shapes, mask, words",
    [
        (((4, 8, 8, 3), (4, 8, 9, 3)), None, "fit"),
        (((4, 8, 8, 3), (2, 8, 8, 3)), None, "seeds"),
        (((4, 8, 8, 3), (4, 8, 8, 3)), np.zeros((8, 8), bool), "empty"),
    ],
)
def test_nonsense_is_refused(shapes: tuple, mask: np.ndarray | None, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        compare(np.ones(shapes[0]), np.ones(shapes[1]), mask)


def test_value_that_is_not_finite_is_refused() -> None:
    broken = np.ones((4, 8, 8, 3))
    broken[2, 3, 3, 1] = np.nan
    with pytest.raises(ValueError, match="finite"):
        compare(np.ones((4, 8, 8, 3)), broken)
