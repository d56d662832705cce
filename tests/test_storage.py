"""Storage: what quantisation does to values, how they are scaled into range, and what a texel costs."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from measured_materials.bake.images.image_io import read_image, write_image
from measured_materials.bake.images.storage import IMAGE_STORAGES, Storage, quantize, scale_for

LARGEST = {"float32": float(np.finfo(np.float32).max), "half": 65504.0, "rgbe": 1.69e38, "byte": 1.0}
NEVER_NEGATIVE = {Storage.RGBE, Storage.BYTE}


def images(storage: Storage) -> st.SearchStrategy[np.ndarray]:
    bound = float(np.float32(LARGEST[storage]))
    low = 0.0 if storage in NEVER_NEGATIVE else -bound
    shape = st.tuples(st.integers(1, 4), st.integers(1, 12), st.just(3))
    return hnp.arrays(np.float32, shape, elements=st.floats(low, bound, width=32))


@pytest.mark.parametrize("storage", IMAGE_STORAGES)
@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_quantize_is_what_the_file_gives_back(tmp_path: Path, storage: Storage, data: st.DataObject) -> None:
    pixels = data.draw(images(storage))
    path = tmp_path / f"image{storage.suffix}"
    write_image(path, pixels, storage)
    expected = quantize(pixels, storage)
    np.testing.assert_array_equal(read_image(path).view(np.uint32), expected.view(np.uint32))
    # What was stored once is stored again without any further change.
    np.testing.assert_array_equal(quantize(expected, storage).view(np.uint32), expected.view(np.uint32))


def test_float32_keeps_every_bit() -> None:
    pixels = np.array([1e30, -1e-40, -0.0, 1 / 3], np.float32)
    assert quantize(pixels, Storage.FLOAT32).tobytes() == pixels.tobytes()


def test_rgbe_is_the_nearest_and_unbiased() -> None:
    pixels = np.random.default_rng(0).uniform(0.5, 0.998, (200_000, 3)).astype(np.float32)
    stored = quantize(pixels, Storage.RGBE)
    # All peaks lie in [1/2, 255.5/256): steps of 2^-8, so rounding to nearest errs by half of that at most.
    assert np.abs(stored - pixels).max() <= 2.0**-9
    # Truncation would lose 2^-9 = 2e-3 on average; the mean of 6e5 errors of sigma 1.1e-3 scatters by 1.5e-6.
    assert abs(float((stored.astype(float) - pixels).mean())) < 1e-5


@pytest.mark.parametrize("peak", [1.0, 0.998, 0.9980468, 0.99999994, 2.0**-105, 1.01e-32, 1.69e38])
def test_rgbe_around_powers_of_two(peak: float) -> None:
    stored = quantize(np.array([peak, peak / 2, 0], np.float32), Storage.RGBE)
    assert stored[0] == pytest.approx(peak, rel=2**-8) and stored[1] == pytest.approx(peak / 2, rel=2**-7)
    assert stored[2] == 0


def test_rgbe_flushes_the_darkest() -> None:
    assert not quantize(np.array([9e-33, 1e-40, 0], np.float32), Storage.RGBE).any()


@pytest.mark.parametrize(
    "storage, value, word",
    [
        ("float32", np.nan, "not finite"),
        ("float32", 1e39, "overflow float32"),
        ("half", np.inf, "not finite"),
        ("half", 65505.0, "overflow half"),
        ("half", -65505.0, "overflow half"),
        ("half", 1e39, "overflow half"),
        ("rgbe", 1.75e38, "overflow rgbe"),
        ("rgbe", -1e-30, "negative"),
        ("byte", 1.0000002, "above 1 overflow byte"),
        ("byte", -1e-30, "negative"),
        ("byte", np.nan, "not finite"),
    ],
)
def test_what_cannot_be_stored_is_an_error(storage: str, value: float, word: str) -> None:
    with pytest.raises(ValueError, match=word):
        quantize(np.full((2, 3), value), Storage(storage))


def test_rgbe_needs_three_channels() -> None:
    with pytest.raises(ValueError, match="3 channels"):
        quantize(np.ones((2, 2, 4)), Storage.RGBE)


def test_byte_is_the_nearest_of_256_steps() -> None:
    pixels = np.linspace(0, 1, 100_001, dtype=np.float32)
    stored = quantize(pixels, Storage.BYTE)
    assert len(np.unique(stored)) == 256 and (stored[0], stored[-1]) == (0, 1)
    # Half a step; the sums of float32 numbers near 1 add 2^-24 each.
    assert np.abs(stored - pixels).max() <= 0.5 / 255 + 2.0**-23
    assert np.rint(stored * 255).max() == 255


@pytest.mark.parametrize("storage", [s for s in IMAGE_STORAGES if s is not Storage.BYTE])
@settings(max_examples=200, deadline=None)
@given(data=st.data())
def test_scale_fits_and_keeps_precision(storage: Storage, data: st.DataObject) -> None:
    elements = st.floats(0 if storage == "rgbe" else -(2.0**126), 2.0**126, width=32)
    pixels = data.draw(hnp.arrays(np.float32, (5, 3), elements=elements))
    scale = scale_for(pixels, storage)
    assert math.frexp(scale)[0] == 0.5
    scaled = pixels.astype(np.float64) * scale
    quantize(scaled, storage)  # does not overflow
    smallest = {"float32": 2.0**-126, "half": 2.0**-14, "rgbe": 2.0**-106}[storage]
    shared = np.abs(scaled).max(axis=-1) if storage == "rgbe" else np.abs(scaled)
    if (shared[shared > 0] < smallest).any() and scale < 2.0**126:
        with pytest.raises(ValueError):  # more precision was not to be had
            quantize(scaled * 2, storage)
    if scale > 1:  # and it was not moved without need
        assert (np.abs(shared[shared > 0]) < 2 * smallest).any()
    if scale < 1:
        with pytest.raises(ValueError):
            quantize(scaled * 2, storage)


@settings(max_examples=300, deadline=None)
@given(pixels=hnp.arrays(np.float32, 5, elements=st.floats(0, 2.0**126, width=32)))
def test_byte_scale_brings_the_largest_to_1(pixels: np.ndarray) -> None:
    scale = scale_for(pixels, Storage.BYTE)
    assert scale == np.float32(scale) and 2.0**-126 <= scale <= 2.0**126
    stored = quantize(pixels * np.float32(scale), Storage.BYTE)  # does not overflow
    quantize(pixels.astype(np.float64) * scale, Storage.BYTE)
    if pixels.max() >= 2.0**-126:
        assert stored.max() == 1


@pytest.mark.parametrize(
    "values, storage, scale",
    [
        ([0.0, 0.0, 0.0], "half", 1.0),
        ([1.0, 2.0**-14, 65504.0], "half", 1.0),
        ([1.0, 2.0**-15, 3.0], "half", 2.0),
        ([65505.0, 1.0, 1.0], "half", 0.5),
        ([1.0, 1e-9, 1.0], "half", 2.0**15),
        ([1e6, 1e-9, 1.0], "half", 2.0**-4),
        ([1e6, 1e-9, -1.0], "float32", 1.0),
        ([1e6, 1e-9, 1.0], "rgbe", 1.0),
        ([1e-35, 0.0, 0.0], "rgbe", 2.0**11),
        ([0.0, 0.0, 0.0], "byte", 1.0),
        ([1.0, 1e-9, 0.5], "byte", 1.0),
        ([4.0, 1e-9, 0.0], "byte", 0.25),
        ([0.8, 0.5, 0.0], "byte", 1.25),
    ],
)
def test_scales(values: list[float], storage: str, scale: float) -> None:
    assert scale_for(np.array(values), Storage(storage)) == scale


def test_scaling_saves_half_from_its_denormals() -> None:
    pixels = np.random.default_rng(1).uniform(1e-6, 1e-4, 1000)

    def error(scale: float) -> float:
        return float(np.abs(quantize(pixels * scale, Storage.HALF) / scale / pixels - 1).max())

    # 11 significant bits; unscaled, the smallest values have about 4.
    assert error(scale_for(pixels, Storage.HALF)) <= 2.0**-11 < 2.0**-6 < error(1)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_no_scale_for_what_is_not_finite(bad: float) -> None:
    with pytest.raises(ValueError, match="not finite"):
        scale_for(np.array([1.0, bad, 1.0]), Storage.HALF)


def test_bytes_per_texel() -> None:
    assert [s.file_bytes(3) for s in IMAGE_STORAGES] == [12, 6, 4, 3]
    assert [s.file_bytes(1) for s in IMAGE_STORAGES] == [4, 2, 4, 1]
    # As Cycles 4.5 states them in its image statistics for files, and for images packed into the .blend.
    assert [s.render_bytes(3) for s in IMAGE_STORAGES] == [16, 8, 16, 4]
    assert [s.render_bytes(4) for s in (Storage.FLOAT32, Storage.HALF, Storage.BYTE)] == [16, 8, 4]
    assert [s.render_bytes(1) for s in (Storage.FLOAT32, Storage.HALF, Storage.BYTE)] == [4, 2, 1]
    floats = [s for s in IMAGE_STORAGES if s is not Storage.BYTE]
    assert {s.render_bytes(c, packed=True) for s in floats for c in (1, 3, 4)} == {16}
    assert {Storage.BYTE.render_bytes(c, packed=True) for c in (1, 3, 4)} == {4}


def test_storage_is_its_own_name() -> None:
    assert Storage("half") is Storage.HALF and Storage.HALF == "half"
    assert json.dumps(Storage.RGBE) == '"rgbe"'
    assert [s.suffix for s in IMAGE_STORAGES] == [".exr", ".exr", ".hdr", ".png"]
