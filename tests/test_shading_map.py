"""Averages, slices, envelope and atlas of shading maps, in numpy."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from measured_materials.bake.bundle.bundle import MATERIAL, read_bundle
from measured_materials.bake.errors import BakeError
from measured_materials.bake.images.storage import Storage, round_down
from measured_materials.bake.lobes.lobes import Lobe
from measured_materials.bake.photographs.stack import PhotoStack
from measured_materials.bake.shading_maps.albedo import map_albedo_facts, resolved_scale
from measured_materials.bake.shading_maps.bake import ArcSettings, bake_stack
from measured_materials.bake.shading_maps.envelope_split import bounded_envelope, split
from measured_materials.bake.shading_maps.record import ShadingMapRecord
from measured_materials.bake.shading_maps.render_settings import UNCALIBRATED_SIGMA, RenderSettings
from measured_materials.bake.shading_maps.shading_map import (
    ANGLE_KNOTS,
    ShadingMap,
    averages_of,
    held_out_errors,
    level_by_cosine,
    linearise,
)
from measured_materials.bake.shading_maps.slice_atlas import GUTTER, SliceLayout, pack_slices, unpack_slices
from measured_materials.bake.shading_maps.store import store_map
from support.swatches import identity_map, map_bundle, rough_map


def photographs(levels: list[float], size: int = 6, seed: int = 0) -> np.ndarray:
    """(n, size, size, 3), each of exactly this average."""
    images = np.random.default_rng(seed).uniform(0.2, 1, (len(levels), size, size, 3))
    images *= (np.array(levels) / images.mean((1, 2, 3)))[:, None, None, None]
    return images.astype(np.float32)


@given(
    st.lists(st.floats(0.01, 50), min_size=2, max_size=9, unique=True).filter(lambda a: max(a) > 1.01 * min(a)),
    st.integers(2, 12),
)
@settings(max_examples=60, deadline=None)
def test_slices_have_even_means_and_nothing_new(levels: list[float], slices: int) -> None:
    images = photographs(levels)
    made = linearise(images, slices)
    assert made.map.slices.shape == (slices, 6, 6, 3)
    # float32 images of averages up to 50: the mean keeps six digits.
    assert np.abs(made.map.slices.mean((1, 2, 3)) - np.linspace(0, 1, slices)).max() < 1e-5
    assert not made.map.slices[0].any() and made.map.slices.min() >= 0
    if np.diff(np.sort(levels))[-1] > 1e-3 * max(levels):  # nearer ones are merged
        brightest = images[np.argmax(levels)] / np.float32(made.a_max)
        assert np.abs(made.map.slices[-1] - brightest).max() < 1e-5
    assert list(made.averages[made.order]) == sorted(made.averages)


def test_every_slice_lies_between_its_two_photographs() -> None:
    """Kautz et al. 2004, equation 1, black being one of the photographs: slice 1 lies below the darkest one."""
    images = photographs([0.3, 1.0, 0.55])
    made = linearise(images, 6)
    expected = {1: 0.2 / 0.3 * images[0], 2: images[0] + (0.1 / 0.25) * (images[2] - images[0])}
    expected[4] = images[2] + (0.25 / 0.45) * (images[1] - images[2])
    for k, slice_ in expected.items():
        assert np.abs(made.map.slices[k] - slice_).max() < 1e-5


def test_photographs_of_one_brightness_become_their_mean() -> None:
    images = photographs([0.5, 0.5, 1.0])
    made = linearise(images, 3)
    assert np.abs(made.map.slices[1] - (images[0] + images[1]) / 2).max() < 1e-5


@pytest.mark.parametrize(
    ("images", "cause"),
    [
        (photographs([0.5]), "1 photograph"),
        (photographs([0.5, 0.5, 0.50001]), "3 photographs of the same average brightness"),
        (np.zeros((3, 4, 4, 3), np.float32), "black"),
        (photographs([0.5, 1]) - np.float32(0.4), "negative"),
        (np.full((2, 4, 4, 3), np.nan, np.float32), "not finite"),
    ],
)
def test_stacks_without_a_shading_map(images: np.ndarray, cause: str) -> None:
    with pytest.raises(BakeError, match=cause):
        linearise(images)


@pytest.mark.parametrize("slices", [1, 0, 65])
def test_impossible_counts(slices: int) -> None:
    with pytest.raises(BakeError, match="slices"):
        linearise(photographs([0.5, 1]), slices)


def test_held_out_photographs_of_a_swatch_that_is_linear_in_light_are_predicted() -> None:
    levels = [0.1, 0.3, 0.35, 0.8, 1.0]
    images = np.array(levels, np.float32)[:, None, None, None] * photographs([1.0])
    rows = held_out_errors(images)
    assert [row["index"] for row in rows] == [1, 2, 3]
    assert max(row["rms"] for row in rows) < 1e-6
    planted = images.copy()
    planted[2, :3] *= 1.4
    planted[2] *= levels[2] / planted[2].mean()
    assert next(row for row in held_out_errors(planted) if row["index"] == 2)["relative"] > 0.1


@pytest.mark.parametrize("storage", [Storage.FLOAT32, Storage.HALF, Storage.BYTE])
@pytest.mark.parametrize("above", ["clamp", "scale"])
@pytest.mark.parametrize("peak", [0.7, 1.0, 1.9, 5.0])
def test_envelope_never_exceeds_the_map_as_far_as_f_r_reaches(storage: Storage, above: str, peak: float) -> None:
    """Swept to r_max, on the slices and between them, stored in every format."""
    shading_map = rough_map(seed=4)
    m = bounded_envelope(split(shading_map, storage, 1 / 16), peak, above)
    rows, columns = np.mgrid[0:16, 0:16]
    uv = np.stack([(columns + 0.5) / 16, 1 - (rows + 0.5) / 16], -1)
    for x in np.concatenate([np.linspace(0, peak, 121), np.linspace(0, min(peak, 1), 6)]):
        reflected = shading_map.evaluate(uv, np.full((16, 16), x), above)
        # Numpy's interpolation between float32 slices rounds at 1e-7 of values up to 3.
        assert (m * x <= reflected + 1e-6).all()
    assert m.mean() > 0.1


def test_without_the_bound_at_the_end_the_envelope_would_exceed() -> None:
    """Beyond a_max a clamped map stays and m alone goes on (addon/docs/method.md, section 11)."""
    shading_map = rough_map(seed=4)
    parts = split(shading_map)
    assert (parts.envelope * 5 > shading_map.slices[-1] + 1e-3).mean() > 0.5


@pytest.mark.parametrize("storage", ["float32", "half", "byte"])
def test_rounding_down(storage: str) -> None:
    values = np.random.default_rng(3).uniform(0, 1, (64, 64, 3)).astype(np.float32)
    values[0, 0], values[0, 1] = 0, 1
    stored = round_down(values, Storage(storage))
    assert (stored <= values).all() and (stored >= 0).all()
    step = {"float32": 0.0, "half": 2.0**-11, "byte": 1 / 255}[storage] * (1 + 1e-5)
    assert (values - stored).max() <= step


def test_split_is_lossless_and_tells_its_energy() -> None:
    shading_map = rough_map()
    parts = split(shading_map)
    assert np.abs(parts.map().slices - shading_map.slices).max() < 1e-6
    assert parts.residual.min() >= 0
    # By quadrature over levels: what m x leaves of S.
    levels = np.linspace(0, 1, 2001)
    total = np.trapezoid if hasattr(np, "trapezoid") else np.trapz
    means = np.array([np.interp(levels, shading_map.levels, s) for s in shading_map.slices.reshape(6, -1).T])
    carried = 0.5 * parts.envelope.reshape(-1).mean() / total(means.mean(0), levels)
    assert parts.envelope_energy == pytest.approx(carried, rel=1e-3)
    assert split(identity_map()).envelope_energy == pytest.approx(1, abs=1e-6)
    assert split(identity_map()).share.max() < 1e-5


def test_atlas_repeats_the_other_end_around_every_tile() -> None:
    tiles = np.random.default_rng(0).random((3, 9, 5, 3), np.float32)
    image = pack_slices(tiles)
    layout = SliceLayout(3, 9, 5)
    assert image.shape == (layout.rows, 5, 3)
    assert np.array_equal(unpack_slices(image, layout), tiles)
    for k in range(3):
        block = image[k * layout.pitch : (k + 1) * layout.pitch]
        assert np.array_equal(block[:GUTTER], tiles[k, -GUTTER:])
        assert np.array_equal(block[-GUTTER:], tiles[k, :GUTTER])
    with pytest.raises(ValueError, match="not 5 x"):
        unpack_slices(image[1:], layout)
    with pytest.raises(BakeError, match="16384"):
        SliceLayout(16, 2048, 2048)


def test_level_of_the_photograph_at_an_elevation() -> None:
    cosines = np.array([0.2, 0.9, 0.5])
    directions = np.stack([np.sqrt(1 - cosines**2), np.zeros(3), cosines], -1)
    levels = level_by_cosine(directions, np.array([0.1, 1.0, 0.6]))
    knots = np.linspace(0, 1, ANGLE_KNOTS)
    assert levels == pytest.approx(np.interp(knots, [0, 0.2, 0.5, 0.9], [0, 0.1, 0.6, 1.0]))
    assert level_by_cosine(None, levels) == pytest.approx(knots)


def test_scale_where_peak_meets_the_brightest_photograph() -> None:
    peak = 1 / math.pi
    assert resolved_scale(RenderSettings(), None) == pytest.approx((UNCALIBRATED_SIGMA, UNCALIBRATED_SIGMA * peak))
    assert resolved_scale(RenderSettings(), 0.1) == pytest.approx((0.1 / peak, 0.1))
    assert resolved_scale(RenderSettings(sigma=0.3), 0.1) == pytest.approx((0.3, 0.1))
    assert resolved_scale(RenderSettings(a_max=0.2), 0.1) == pytest.approx((0.2 / peak, 0.2))
    assert resolved_scale(RenderSettings(sigma=0.3), None) == pytest.approx((0.3, 0.3 * peak))


def test_albedo_of_a_map_that_is_linear_in_light_is_that_of_its_f_r() -> None:
    render = RenderSettings(Lobe("lambert"), sigma=0.6)
    facts = map_albedo_facts(identity_map(colour=(1.0, 1.0, 1.0)), render, None)
    assert facts["white_sky"] == pytest.approx([0.6] * 3, rel=1e-4)
    bright = map_albedo_facts(identity_map(colour=(1.8, 0.6, 0.6)), render, None)
    assert bright["above_one_deg"]


@pytest.mark.parametrize("compression", ["none", "power", "basis"])
@pytest.mark.parametrize("storage", ["float32", "half"])
def test_bundles_come_back(tmp_path: Path, compression: str, storage: str) -> None:
    render = RenderSettings(Lobe("phong", 40.0, 0.3), 0.7, "scale", "angular", "reference", "extend", 0.2)
    shading_map = rough_map()
    bundle = map_bundle(tmp_path / "map", shading_map, render, compression=compression, storage=Storage(storage))
    assert ShadingMapRecord.read(bundle).render == render
    stored = store_map(shading_map, compression, Storage(storage))[2]
    again = ShadingMapRecord.read(bundle).load_map()
    assert np.abs(again.slices - stored.slices).max() < 1e-5
    if compression == "none":
        assert np.abs(again.slices - shading_map.slices).max() < (1e-6 if storage == "float32" else 2e-3)


@pytest.mark.parametrize("storage", ["rgbe", "byte"])
def test_small_storage_of_slices(tmp_path: Path, storage: str) -> None:
    shading_map = rough_map()
    bundle = map_bundle(tmp_path / "map", shading_map, RenderSettings(), storage=Storage(storage))
    # 8 bits of a range of about 3, or 8 bits of the brightest channel.
    assert np.abs(ShadingMapRecord.read(bundle).load_map().slices - shading_map.slices).max() < 0.03


def test_storage_that_cannot_hold_exponents(tmp_path: Path) -> None:
    with pytest.raises(BakeError, match="too coarse"):
        store_map(rough_map(), "power", Storage.BYTE)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("model", "neural"),
        ("slices", 9),
        ("slices", 1.5),
        ("height", 17),
        ("scale", 0),
        ("scale", "1"),
        ("a_max", -1),
        ("level_by_cosine", [0.1]),
        ("level_by_cosine", ["a"] * ANGLE_KNOTS),
        ("gutter", 0),
    ],
)
def test_damaged_facts_are_told(tmp_path: Path, key: str, value: object) -> None:
    bundle = map_bundle(tmp_path / "map", rough_map(), RenderSettings())
    file = bundle.path / MATERIAL
    document = json.loads(file.read_text())
    document["map"][key] = value
    file.write_text(json.dumps(document))
    with pytest.raises(BakeError):
        ShadingMapRecord.read(read_bundle(bundle.path))


def test_damaged_lighting_is_told(tmp_path: Path) -> None:
    bundle = map_bundle(tmp_path / "map", rough_map(), RenderSettings())
    file = bundle.path / MATERIAL
    for change in (
        {"sigma": -1},
        {"lobe": {"name": "ggx", "alpha": 7}},
        {"lobe": 3},
        {"above": "fold"},
        {"a_max": "x"},
    ):
        document = json.loads(file.read_text())
        document["render"].update(change)
        file.write_text(json.dumps(document))
        with pytest.raises(BakeError):
            ShadingMapRecord.read(read_bundle(bundle.path))


def test_bake_tells_what_it_did(tmp_path: Path) -> None:
    angles = np.radians([10, 25, 40, 60, 85])
    images = photographs(list(0.3 * np.sin(angles)), size=16)
    directions = np.stack([np.cos(angles), 0 * angles, np.sin(angles)], -1)
    stack = PhotoStack(images, tuple("abcde"), directions, True, ("a word",), {"decoding": "linear"})
    result = bake_stack(stack, tmp_path / "swatch", ArcSettings(lobe_auto=True))
    facts = json.loads((result.path / MATERIAL).read_text())
    assert facts["kind"] == "shading_map" and facts["warnings"] == ["a word"]
    assert facts["render"]["lobe"] == {"name": "lambert"}
    assert facts["map"]["a_max"] == pytest.approx(0.3 * math.sin(angles[-1]), rel=1e-5)
    assert facts["averages"]["before"] == pytest.approx(list(averages_of(images)))
    assert facts["averages"]["elevations_deg"] == pytest.approx([10, 25, 40, 60, 85])
    assert facts["averages"]["after"] == pytest.approx(list(np.linspace(0, 1, 8)), abs=1e-5)
    assert len(facts["errors"]["held_out"]) == 3
    assert 0 < facts["map"]["envelope_energy"] < 1
    assert isinstance(ShadingMapRecord.read(read_bundle(result.path)).load_map(), ShadingMap)


@pytest.mark.parametrize("method", ["auto", "offset", "quilt"])
def test_tiled_maps_keep_even_means(tmp_path: Path, method: str) -> None:
    images = photographs([0.2, 0.5, 0.6, 1.0], size=40)
    result = bake_stack(
        PhotoStack(images, tuple("abcd"), None, True, ()), tmp_path / "tiled", ArcSettings(tileable=method)
    )
    assert result.facts["tiling"]["seams"]["after"]["visibility"] > 0
    assert result.facts["averages"]["after"] == pytest.approx(list(np.linspace(0, 1, 8)), abs=1e-5)
    # White noise has the same average everywhere, so that calibration hardly moves.
    assert result.facts["map"]["a_max"] == pytest.approx(1.0, rel=0.05)


def test_a_highlight_that_takes_up_the_slices_is_told(tmp_path: Path) -> None:
    def warnings(levels: list[float]) -> list[str]:
        stack = PhotoStack(photographs(levels), tuple("abcd"), None, False, ())
        return bake_stack(stack, tmp_path / "swatch", ArcSettings()).facts["warnings"]

    assert not warnings([0.2, 0.4, 0.7, 1.0])
    assert "3 of 4 photographs are darker than the first of 8 slices" in warnings([0.02, 0.04, 0.1, 1.0])[0]


def test_what_no_image_or_memory_holds_is_refused_before_it_is_made(tmp_path: Path) -> None:
    wide = np.broadcast_to(np.float32(0.5), (2, 3000, 4000, 3))
    stack = PhotoStack(wide, ("a", "b"), None, False, ())
    for settings_ in (ArcSettings(slices=64), ArcSettings(slices=64, compression="power")):
        with pytest.raises(BakeError, match=r"16384|more than 4 GiB"):
            bake_stack(stack, tmp_path / "wide", settings_)
    with pytest.raises(BakeError, match="made to tile"):
        ArcSettings(slices=2, tileable="auto")
    hot = np.full((2, 300, 300, 3), 1e-6, np.float32)
    hot[1, 0, 0] = 1000
    with pytest.raises(BakeError, match="hot pixel"):
        bake_stack(PhotoStack(hot, ("a", "b"), None, False, ()), tmp_path / "hot", ArcSettings(compression="power"))
    assert not list(tmp_path.iterdir())
