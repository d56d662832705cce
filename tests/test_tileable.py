"""Tiling of slices: borders that wrap, one set of seams for all slices, and input that cannot be tiled."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from measured_materials.bake.errors import BakeError
from measured_materials.bake.source import Array
from measured_materials.bake.tiling import tileable
from measured_materials.bake.tiling.seams import cheapest_cut, feathered, stack_features
from measured_materials.bake.tiling.straighten import find_shear
from measured_materials.bake.tiling.tileable import TileSettings, make_tileable
from measured_materials.bake.tiling.visibility import seam_novelty, seam_steps

METHODS = ("offset", "quilt")


def weave(height: int = 120, width: int = 150, turn: float = 0.0) -> Array:
    """Four slices of a plain weave, periods 23.4 and 18.2 texels, turned by `turn` radians."""
    y, x = np.mgrid[:height, :width].astype(float)
    x, y = x * np.cos(turn) - y * np.sin(turn), x * np.sin(turn) + y * np.cos(turn)
    warp, weft = np.sin(2 * np.pi * x / 23.4), np.sin(2 * np.pi * y / 18.2)
    relief = np.where(warp * weft > 0, np.abs(warp), np.abs(weft)) + 0.02 * noise(height, width)[..., 0]
    light = np.linspace(0, 1, 4)[:, None, None]
    slope = np.gradient(relief, axis=1)
    tone = np.stack([0.5 + 0.2 * np.sign(warp * weft), np.full_like(warp, 0.5), 0.5 - 0.1 * np.sign(warp * weft)], -1)
    return (light * np.clip(0.3 + relief + (1 - light) * slope, 0.01, None))[..., None].astype(np.float32) * tone


def noise(height: int, width: int, seed: int = 0) -> Array:
    """Smooth grain in [0, 1], (H, W, 3)."""
    grain = np.random.default_rng(seed).random((height + 4, width + 4, 3))
    return sum(grain[i : i + height, i : i + width] for i in range(5)) / 5


def stack(grain: Array) -> Array:
    """Slices that are 0, 1/3, 2/3 and 1 times a picture."""
    return (np.linspace(0, 1, 4)[:, None, None, None] * grain).astype(np.float32)


# Measured: 21 repeated as it is; 0.9 and 2.0 tiled. 1 is what the weave has itself, whose repetition is so exact that
# the fraction of a texel by which quilted patches are out of step already counts.
@pytest.mark.parametrize("method, bound", [("offset", 1.15), ("quilt", 3)])
def test_seams_of_a_weave_vanish(method: Any, bound: float) -> None:
    facts = make_tileable(weave(), TileSettings(method=method)).facts
    before, after = facts["seams"]["before"], facts["seams"]["after"]
    assert before["visibility"] > 10
    assert after["visibility"] < bound
    assert after["steps"]["worst"] < before["steps"]["worst"]


@pytest.mark.parametrize("method", METHODS)
def test_neighbours_across_the_border_differ_no_more_than_others(method: Any) -> None:
    tile = make_tileable(weave(), TileSettings(method=method)).slices[1:]
    for axis in (1, 2):
        step = np.abs(np.roll(tile, -1, axis=axis) - tile).mean(axis=(0, 3))
        lines = step.mean(axis=2 - axis)
        # The last line is the border; of the others the largest is where threads change.
        assert lines[-1] <= 1.1 * lines[:-1].max()


def seam_in_the_middle(height: int, width: int) -> Array:
    """Source texels that show a seam left and right of the left half."""
    source = np.moveaxis(np.indices((height, width)), 0, 2).copy()
    source[:, : width // 2, 1] -= 1000
    return source


def test_planted_step_is_seen() -> None:
    tile = make_tileable(stack(noise(90, 96)), TileSettings(method="offset")).slices
    source = seam_in_the_middle(*tile.shape[1:3])
    step = tile.copy()
    step[:, :, : tile.shape[2] // 2] *= 1.2
    honest, planted = seam_steps(tile, source), seam_steps(step, source)
    assert honest["worst"] < 1.15 * honest["expected"]
    assert planted["worst"] > 1.5 * planted["expected"]


def test_planted_broken_thread_is_seen() -> None:
    tile = make_tileable(weave(), TileSettings(method="offset")).slices[3]
    source, swatch = seam_in_the_middle(*tile.shape[:2]), weave()[3]
    broken = tile.copy()
    broken[:, : tile.shape[1] // 2] = np.roll(tile[:, : tile.shape[1] // 2], 5, axis=0)
    assert seam_novelty(tile, source, swatch, 0) < 1.3
    assert seam_novelty(broken, source, swatch, 0) > 2


def test_tile_of_a_weave_holds_whole_periods() -> None:
    height, width = make_tileable(weave(), TileSettings(method="offset")).slices.shape[1:3]
    # A texel is the resolution of a period; the sign pattern repeats after one whole sine.
    assert abs(height / 18.2 - round(height / 18.2)) * 18.2 <= 1.2
    assert abs(width / 23.4 - round(width / 23.4)) * 23.4 <= 1.2


def test_turned_weave_is_set_straight() -> None:
    turned = weave(160, 180, turn=0.015)
    plain = make_tileable(turned, TileSettings(method="offset", straighten=False)).facts
    straight = make_tileable(turned, TileSettings(method="offset")).facts
    assert straight["straightened"] and not plain["straightened"]
    assert straight["seams"]["after"]["visibility"] < 0.8 * plain["seams"]["after"]["visibility"]
    shear = find_shear(turned[3], 0.6)
    # Half a texel over a shift of 100 texels or more.
    np.testing.assert_allclose([shear.rise, shear.lean], [-0.015, 0.015], atol=0.005)


def test_band_too_narrow_to_be_set_straight_is_tiled_as_it_is() -> None:
    # Turned by 0.035 rad, 600 texels rise by more than the band is high.
    band = weave(20, 600, turn=0.035)
    assert find_shear(stack_features(band)[0], 0.6).rim(20, 600)[0] > 2
    assert not make_tileable(band, TileSettings(method="offset")).facts["straightened"]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("feather", [0, 2])
def test_all_slices_are_cut_and_blended_alike(method: Any, feather: int) -> None:
    base = noise(90, 70).astype(np.float32)
    code = np.stack(np.indices((90, 70)), axis=2).astype(np.float32)
    coded = np.concatenate([code, code[..., :1]], axis=2)
    slices = np.stack([base, 0.25 * base, 3 * base + 1, coded, 2 * coded + 5])
    tiled = make_tileable(slices, TileSettings(method=method, feather=feather, straighten=False))
    first, quarter, affine, places, affine_places = tiled.slices
    # Blends are affine, so affine functions survive them; single precision.
    np.testing.assert_allclose(quarter, 0.25 * first, atol=1e-6)
    np.testing.assert_allclose(affine, 3 * first + 1, atol=1e-5)
    np.testing.assert_allclose(affine_places, 2 * places + 5, atol=1e-3)
    if not feather:
        np.testing.assert_array_equal(places[..., :2], tiled.source)
        np.testing.assert_array_equal(first, base[tiled.source[..., 0], tiled.source[..., 1]])


@pytest.mark.parametrize("method", METHODS)
def test_slices_stay_in_order_and_range(method: Any) -> None:
    slices = stack(noise(64, 80))
    tile = make_tileable(slices, TileSettings(method=method)).slices
    assert tile.dtype == np.float32
    assert not tile[0].any()
    assert (np.diff(tile, axis=0) >= 0).all()
    assert tile.max() <= slices.max() * (1 + 1e-6)


def test_same_input_same_tile_and_another_seed_another_quilt() -> None:
    slices = stack(noise(64, 80))
    settings = TileSettings(method="quilt", seed=3)
    first, second = make_tileable(slices, settings), make_tileable(slices.copy(), settings)
    np.testing.assert_array_equal(first.slices, second.slices)
    assert first.facts == second.facts
    other = make_tileable(slices, TileSettings(method="quilt", seed=4))
    assert not np.array_equal(first.source, other.source)


@pytest.mark.parametrize("method", ["auto", *METHODS])
@pytest.mark.parametrize("size", [(16, 16), (16, 61), (200, 17), (17, 600)])
@pytest.mark.parametrize("feather", [0, 32])
def test_small_and_narrow_swatches(method: Any, size: tuple[int, int], feather: int) -> None:
    tiled = make_tileable(stack(noise(*size)), TileSettings(method=method, feather=feather))
    height, width = tiled.slices.shape[1:3]
    assert size[0] / 2 <= height <= size[0] and size[1] / 2 <= width <= size[1]
    assert np.isfinite(tiled.slices).all() and tiled.slices.min() >= 0
    assert tiled.source.shape == (height, width, 2)
    assert (tiled.source >= 0).all() and (tiled.source < size).all()


@pytest.mark.parametrize("method", ["auto", *METHODS])
@pytest.mark.parametrize("value", [0, 1e-12, 0.3, 1e20])
def test_constant_stays_constant(method: Any, value: float) -> None:
    slices = np.full((3, 40, 50, 3), value, np.float32)
    slices[0] = 0
    tiled = make_tileable(slices, TileSettings(method=method, level=True))
    np.testing.assert_allclose(tiled.slices[1:], value, rtol=1e-5)
    assert tiled.facts["seams"]["before"]["visibility"] <= 1.01


def test_levelling_removes_uneven_light_and_keeps_means() -> None:
    falloff = np.linspace(1, 1.8, 80)[:, None]
    slices = stack(noise(64, 80) * falloff)
    plain, level = (make_tileable(slices, TileSettings(method="offset", level=on)) for on in (False, True))
    assert level.facts["seams"]["after"]["visibility"] < plain.facts["seams"]["after"]["visibility"]
    thirds = level.slices[3].mean(axis=(0, 2))
    # The light rises by 80 % over the frame; grain alone leaves a few percent in such bands.
    bands = [float(band.mean()) for band in np.array_split(thirds, 4)]
    assert max(bands) / min(bands) < 1.06
    np.testing.assert_allclose(level.facts["means"], 1, atol=0.03)


def test_grain_does_not_lose_its_contrast() -> None:
    slices = stack(noise(96, 96))
    tiled = make_tileable(slices)
    # Blends are narrow: a variance lost by them is a few percent at most.
    assert tiled.slices[3].std() > 0.95 * slices[3].std()


def test_auto_takes_the_less_visible() -> None:
    rng = np.random.default_rng(5)
    blotches = np.kron(rng.random((5, 5, 3)), np.ones((20, 20, 1)))
    slices = stack(0.2 + blotches + 0.1 * noise(100, 100))
    seen = {m: make_tileable(slices, TileSettings(method=m)).facts for m in ("auto", *METHODS)}
    visibility = {method: facts["seams"]["after"]["visibility"] for method, facts in seen.items()}
    assert visibility["auto"] <= max(tileable._GOOD_ENOUGH, visibility["offset"])
    assert seen["auto"]["seams"] == seen[seen["auto"]["method"]]["seams"]


def test_auto_does_not_quilt_an_uneven_swatch_from_its_plain_corner() -> None:
    picture = 0.1 + 0.1 * noise(100, 100)
    picture[:60, :70] += np.kron(np.random.default_rng(5).random((12, 14, 3)), np.ones((5, 5, 1)))
    drift = {}
    for method in ("auto", *METHODS):
        facts = make_tileable(stack(picture), TileSettings(method=method)).facts
        drift[method] = max(abs(ratio - 1) for ratio in facts["means"])
    assert drift["auto"] <= max(0.1, drift["offset"])


def test_facts_are_json_and_progress_rises() -> None:
    told: list[tuple[str, float]] = []
    tiled = make_tileable(weave(60, 60), TileSettings(method="quilt"), lambda *what: told.append(what))
    assert json.loads(json.dumps(tiled.facts)) == tiled.facts
    shares = [share for _, share in told]
    assert shares == sorted(shares) and shares[-1] == 1


def test_cut_follows_a_bent_gap_at_no_cost() -> None:
    cost = np.ones((12, 15), np.float32)
    gap = np.array([3, 3, 3, 9, 9, 9, 9, 5, 5, 5, 4, 3])
    for y, x in enumerate(gap):
        low, high = min(x, gap[y - 1], gap[(y + 1) % 12]), max(x, gap[y - 1], gap[(y + 1) % 12])
        cost[y, low - 1 : high + 1] = 0
    for closed in (False, True):
        cuts, total = cheapest_cut(cost, 1, closed)
        assert total == 0
        assert (cost[np.arange(12), cuts] == 0).all() and (cost[np.arange(12), cuts - 1] == 0).all()


def test_closed_cut_is_the_best_of_all_starts() -> None:
    cost = np.random.default_rng(2).random((20, 12)).astype(np.float32)

    def closed_cost(cuts: Array) -> float:
        total = 0.0
        for y, (x, after) in enumerate(zip(cuts, np.roll(cuts, -1))):
            total += cost[y, x - 1] + cost[y, x]
            low, high = min(x, after), max(x, after)
            total += cost[y, low:high].sum() + cost[(y + 1) % 20, low:high].sum()
        return total / 40

    cuts, told = cheapest_cut(cost, 1, closed=True)
    assert told == pytest.approx(closed_cost(cuts), rel=1e-5)
    assert told <= closed_cost(cheapest_cut(cost, 1)[0]) + 1e-6


def test_feather_ends_where_it_says() -> None:
    mask = np.arange(40)[None] < np.full((40, 1), 20)
    weights = feathered(mask, 3)
    assert (weights[:, :14] == 1).all() and (weights[:, 26:] == 0).all()
    assert (np.diff(weights, axis=1) <= 0).all() and 0 < weights[0, 18] < 1


@pytest.mark.parametrize(
    "slices, word",
    [
        (np.ones((32, 32, 3)), "shape"),
        (np.ones((2, 32, 32, 4)), "shape"),
        (np.ones((0, 32, 32, 3)), "shape"),
        (np.full((1, 32, 32, 3), "a"), "shape"),
        (np.full((1, 32, 32, 3), 1j), "shape"),
        ([np.ones((32, 32, 3)), np.ones((31, 32, 3))], "shape"),
        (None, "shape"),
        (np.ones((1, 15, 32, 3)), "too small"),
        (np.broadcast_to(np.float32(1), (1, 16, 8193, 3)), "too large"),
        (np.broadcast_to(np.float32(1), (100, 4000, 4000, 3)), "too large"),
        (np.full((1, 32, 32, 3), np.nan), "not finite"),
        (np.full((1, 32, 32, 3), np.inf), "not finite"),
        (np.full((1, 32, 32, 3), -1.0), "negative"),
        (np.full((1, 32, 32, 3), 1e300), "not finite"),
    ],
)
def test_unusable_slices(slices: Any, word: str) -> None:
    with pytest.raises(BakeError, match=word) as error:
        make_tileable(slices)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "wrong",
    [
        {"method": "poisson"}, {"method": None}, {"method": []},
        {"keep": 0.2}, {"keep": 1.0}, {"keep": float("nan")}, {"keep": "0.6"},
        {"feather": -1}, {"feather": 1.5}, {"feather": 33},
        {"patch": 4}, {"patch": 10.0}, {"patch": 1e9},
        {"seed": -1}, {"seed": 0.5}, {"seed": None},
    ],
)  # fmt: skip
def test_wrong_settings(wrong: dict[str, Any]) -> None:
    with pytest.raises(BakeError, match=next(iter(wrong))):
        TileSettings(**wrong)


def test_quilt_of_too_many_patches() -> None:
    slices = np.ones((1, 400, 400, 3), np.float32)
    with pytest.raises(BakeError, match="patches"):
        make_tileable(slices, TileSettings(method="quilt", patch=8))
