"""Float images in and out: bit-exact, and unimpressed by damaged or boastful files."""

from __future__ import annotations

import resource
import struct
import subprocess
import sys
import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from measured_materials.bake.errors import BakeError
from measured_materials.bake.images import image_io
from measured_materials.bake.images.storage import IMAGE_STORAGES, Storage, quantize

CASES = [(storage, c) for storage in IMAGE_STORAGES for c in (1, 3, 4) if storage != "rgbe" or c == 3]


@pytest.fixture(params=["OpenEXR", "OpenImageIO", "numpy"])
def library(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Each of the libraries alone, as if the others were not installed."""
    loaders = {"OpenEXR": image_io.load_openexr, "OpenImageIO": image_io.load_openimageio}
    if request.param in loaders and loaders[request.param]() is None:
        pytest.skip(f"{request.param} is not installed")
    for name in loaders.keys() - {request.param}:
        monkeypatch.setattr(image_io, f"load_{name.lower()}", lambda: None)
    return str(request.param)


def nasty_pixels(storage: Storage, channels: int) -> np.ndarray:
    """Alpha above 1, negatives, signed zero, the extremes and the denormals of the storage."""
    rng = np.random.default_rng(7)
    pixels = rng.normal(size=(37, 23, channels)).astype(np.float32) * 100
    if storage == "byte":
        pixels = np.minimum(np.abs(pixels) / 200, 1)
    extremes = {"float32": (1e30, 1e-40), "half": (65504, 6e-8), "rgbe": (1.6e38, 1e-31), "byte": (1, 1e-40)}[storage]
    pixels[0, 0], pixels[1, 2], pixels[2, 3] = *extremes, -0.0
    return np.abs(pixels) if storage in ("rgbe", "byte") else pixels


def bits(pixels: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(pixels, np.float32).view(np.uint32)


@pytest.mark.parametrize("storage, channels", CASES)
def test_round_trip_is_bit_exact(library: str, tmp_path: Path, storage: Storage, channels: int) -> None:
    pixels = nasty_pixels(storage, channels)
    path = tmp_path / f"image{storage.suffix}"
    image_io.write_image(path, pixels, storage)
    back = image_io.read_image(path)
    assert back.dtype == np.float32 and back.flags.c_contiguous
    np.testing.assert_array_equal(bits(back), bits(quantize(pixels, storage)))
    header = image_io.read_header(path)
    assert (header.height, header.width, header.channels, header.storage) == (37, 23, channels, storage)
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("storage, channels", CASES)
def test_blender_sees_the_same_values(tmp_path: Path, storage: Storage, channels: int) -> None:
    bpy = pytest.importorskip("bpy")
    rng = np.random.default_rng(3)
    pixels = (rng.random((5, 9, channels)) * (1 if storage == "byte" else 4)).astype(np.float32)
    path = tmp_path / f"image{storage.suffix}"
    image_io.write_image(path, pixels, storage)
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.name, image.alpha_mode = "Non-Color", "CHANNEL_PACKED"
    seen = np.array(image.pixels[:], np.float32).reshape(5, 9, 4)[::-1]  # Blender counts rows from the bottom
    bpy.data.images.remove(image)
    expected = np.broadcast_to(quantize(pixels, storage), (5, 9, 3)) if channels == 1 else quantize(pixels, storage)
    np.testing.assert_array_equal(seen[..., : expected.shape[2]], expected)


@pytest.mark.parametrize("storage, channels", CASES)
def test_equal_images_make_equal_files(library: str, tmp_path: Path, storage: Storage, channels: int) -> None:
    first, second = (tmp_path / f"{name}{storage.suffix}" for name in "ab")
    for path in (first, second):
        image_io.write_image(path, nasty_pixels(storage, channels), storage, {"name": "x"})
    assert first.read_bytes() == second.read_bytes()
    year = str(np.datetime64("now").astype("datetime64[Y]")).encode()
    assert year + b":" not in first.read_bytes()


def test_attributes_come_back(library: str, tmp_path: Path) -> None:
    given_ = {"material": '{"alpha": 0.25}', "a": "line\nline", "long" * 20: "x"}
    image_io.write_image(tmp_path / "a.exr", np.ones((2, 2, 3)), Storage.HALF, given_)
    assert image_io.read_header(tmp_path / "a.exr").attributes == given_


# --- failing writes ---------------------------------------------------------------------------------------


@contextmanager
def full_disk() -> Iterator[None]:
    """Files may not grow beyond 2000 bytes, which the system reports as it does a full disk.

    Entered around one write only: the limit holds for the test runner's own output too, when that is a file.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("storage", IMAGE_STORAGES)
def test_failed_write_keeps_the_older_file(library: str, tmp_path: Path, storage: Storage) -> None:
    path = tmp_path / f"image{storage.suffix}"
    image_io.write_image(path, np.ones((2, 2, 3)), storage)
    older = path.read_bytes()
    large = np.random.default_rng(0).random((99, 99, 3))
    with full_disk(), pytest.raises(BakeError, match=r"image.* cannot be written"):
        image_io.write_image(path, large, storage)
    assert path.read_bytes() == older and list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    "name, pixels, storage, word",
    [
        ("a.hdr", np.ones((2, 2, 3)), "float32", "does not end in .exr"),
        ("a.exr", np.ones((2, 2)), "half", "shape"),
        ("a.exr", np.ones((2, 2, 2)), "half", "shape"),
        ("a.exr", np.ones((0, 2, 3)), "half", "shape"),
        ("a.exr", np.full((2, 2, 3), 65505.0), "half", "overflow"),
        ("a.exr", np.full((2, 2, 3), np.nan), "float32", "not finite"),
        ("a.hdr", np.full((2, 2, 3), -1.0), "rgbe", "negative"),
        ("a.hdr", np.ones((2, 2, 4)), "rgbe", "3 channels"),
        ("absent/a.exr", np.ones((2, 2, 3)), "half", "cannot be written"),
        ("absent/a.png", np.ones((2, 2, 3)), "byte", "cannot be written"),
        ("a.exr", np.ones((2, 2, 3)), "byte", "does not end in .png"),
        ("a.png", np.full((2, 2, 3), 1.01), "byte", "overflow"),
        ("a.png", np.full((2, 2, 3), -0.01), "byte", "negative"),
    ],
)
def test_unwritable_images(tmp_path: Path, name: str, pixels: np.ndarray, storage: str, word: str) -> None:
    with pytest.raises(BakeError, match=word):
        image_io.write_image(tmp_path / name, pixels, Storage(storage))
    assert not list(tmp_path.iterdir())


@pytest.fixture
def no_library(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(image_io, "load_openexr", lambda: None)
    monkeypatch.setattr(image_io, "load_openimageio", lambda: None)


def test_without_a_library_other_compressions_are_refused(tmp_path: Path, no_library: None) -> None:
    for compression in (1, 4):  # run lengths, PIZ
        (tmp_path / "a.exr").write_bytes(exr(compression=compression))
        with pytest.raises(BakeError, match="pip install OpenEXR"):
            image_io.read_image(tmp_path / "a.exr")


@pytest.mark.parametrize("storage, channels", [case for case in CASES if case[0].suffix == ".exr"])
def test_numpy_and_the_libraries_read_each_other(tmp_path: Path, storage: Storage, channels: int) -> None:
    pixels = quantize(nasty_pixels(storage, channels), storage)
    none = {"load_openexr": lambda: None, "load_openimageio": lambda: None}
    attributes = {"note": "x" * 5000, "a name of more than thirty-one letters": "y"}
    with pytest.MonkeyPatch.context() as patch:
        for name, nothing in none.items():
            patch.setattr(image_io, name, nothing)
        image_io.write_image(tmp_path / "numpy.exr", pixels, storage, attributes)
    assert image_io.read_header(tmp_path / "numpy.exr").attributes.items() >= attributes.items()
    for library in none:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(image_io, (none.keys() - {library}).pop(), none[library])
            if getattr(image_io, library)() is None:
                continue
            np.testing.assert_array_equal(bits(image_io.read_image(tmp_path / "numpy.exr")), bits(pixels))
            image_io.write_image(tmp_path / "library.exr", pixels, storage, attributes)
            patch.setattr(image_io, library, none[library])
            np.testing.assert_array_equal(bits(image_io.read_image(tmp_path / "library.exr")), bits(pixels))


@pytest.mark.parametrize("compression", [0, 2, 3])
def test_numpy_reads_flat_and_line_by_line_compressed_files(tmp_path: Path, no_library: None, compression: int) -> None:
    openimageio = pytest.importorskip("OpenImageIO")
    pixels = np.random.default_rng(3).normal(size=(35, 19, 3)).astype(np.float32)
    spec = openimageio.ImageSpec(19, 35, 3, "float")
    spec.attribute("compression", {0: "none", 2: "zips", 3: "zip"}[compression])
    spec.y = -5  # the data window need not start at 0
    stream = openimageio.ImageOutput.create("openexr")
    assert stream.open(str(tmp_path / "a.exr"), spec) and stream.write_image(pixels)
    stream.close()
    np.testing.assert_array_equal(bits(image_io.read_image(tmp_path / "a.exr")), bits(pixels))


def test_numpy_survives_damage_anywhere(tmp_path: Path, no_library: None) -> None:
    path = tmp_path / "a.exr"
    image_io.write_image(path, np.random.default_rng(4).random((40, 9, 3)), Storage.HALF)
    whole = path.read_bytes()
    for position in range(0, len(whole), 7):
        data = bytearray(whole)
        data[position] ^= 0xFF
        path.write_bytes(data)
        try:
            assert image_io.read_image(path).ndim == 3
        except BakeError:
            pass


@pytest.mark.parametrize("blocked", [False, True])
def test_wheel_library_loads_without_importing_bpy(blocked: bool) -> None:
    code = f"""
import sys
if {blocked}: sys.modules["bpy"] = None
from measured_materials.bake.images.image_io import load_openimageio
found = load_openimageio()
assert {blocked} or found
assert sys.modules.get("bpy") is None
"""
    subprocess.run([sys.executable, "-P", "-c", code], check=True, timeout=60)


# --- hostile EXR files ------------------------------------------------------------------------------------


def attribute(name: str, kind: str, value: bytes) -> bytes:
    return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(value)) + value


def exr(
    window: tuple[int, ...] = (0, 0, 3, 3),
    names: str = "BGR",
    kind: int = 1,
    step: int = 1,
    compression: int = 3,
    flags: int = 0,
    version: int = 2,
    tail: int = 4096,
    extra: bytes = b"",
) -> bytes:
    """A made-up file whose header says what a test needs, followed by zeros."""
    channels = b"".join(n.encode() + b"\0" + struct.pack("<4i", kind, 0, step, step) for n in names) + b"\0"
    head = b"\x76\x2f\x31\x01" + struct.pack("<I", version | flags) + extra
    head += attribute("channels", "chlist", channels)
    head += attribute("compression", "compression", bytes([compression]))
    head += attribute("dataWindow", "box2i", struct.pack("<4i", *window))
    head += attribute("displayWindow", "box2i", struct.pack("<4i", *window))
    return head + b"\0" + bytes(tail)


BIG = (0, 0, 2**31 - 2, 2**31 - 2)


@pytest.mark.parametrize(
    "data, word",
    [
        (b"", "not an OpenEXR"),
        (b"v/1", "not an OpenEXR"),
        (b"\x89PNG\r\n\x1a\n", "not an OpenEXR"),
        (exr(flags=0x200), "tiled"),
        (exr(flags=0x800), "deep"),
        (exr(flags=0x1000), "several parts"),
        (exr(version=1), "version 1"),
        (exr(window=BIG), "declares 2147483647 x 2147483647"),
        (exr(window=(-(2**31), 0, 2**31 - 1, 0)), "declares 4294967296 x 1"),
        (exr(window=(5, 0, 4, 3)), "damaged"),
        (exr(window=(0, 0, 8191, 8191)), "more pixels than it holds"),
        (exr(window=(0, 0, 999, 9), compression=0), "more pixels than it holds"),
        (exr(window=(0, 0, 0, 99999), compression=4, tail=9), "more pixels than it holds"),
        (exr(names=""), "channels none"),
        (exr(names="XYZ"), "channels X, Y, Z"),
        (exr(names="BGRZ"), "channels"),
        (exr(names="BG\n"), r"channels B, G, '\\n'"),
        (exr(kind=0), "integer"),
        (exr(kind=7), "integer"),
        (exr(step=2), "subsampled"),
        (exr(extra=attribute("comments", "string", b"x")[:-1]), "damaged"),
        (exr(extra=b"long\0string\0" + struct.pack("<i", -5)), "damaged"),
        (exr(extra=b"huge\0string\0" + struct.pack("<i", 2**31 - 1)), "damaged"),
        (exr(extra=b"n" * 300), "damaged"),
        (exr()[:60], "damaged"),
        (exr(), "damaged or missing pixels"),
        # OpenImageIO's message repeats the type, which is no UTF-8.
        (exr().replace(b"dataWindow\0box2i", b"dataWindow\0box2\xff"), "damaged or missing pixels"),
    ],
)
def test_hostile_exr_costs_one_error_and_no_memory(library: str, tmp_path: Path, data: bytes, word: str) -> None:
    path = tmp_path / "hostile.exr"
    path.write_bytes(data)
    tracemalloc.start()
    try:
        with pytest.raises(BakeError, match=word):
            image_io.read_image(path)
        assert tracemalloc.get_traced_memory()[1] < 1 << 20
    finally:
        tracemalloc.stop()


def genuine(path: Path, storage: Storage) -> tuple[bytes, np.ndarray]:
    # Few different values, so that the pixels are really compressed.
    pixels = np.random.default_rng(1).integers(0, 2 if storage == "byte" else 3, (40, 30, 3)).astype(np.float32)
    image_io.write_image(path, pixels, storage, {"a": "b"})
    return path.read_bytes(), pixels


@pytest.mark.parametrize("storage", IMAGE_STORAGES)
def test_truncated_file(library: str, tmp_path: Path, storage: Storage) -> None:
    path = tmp_path / f"cut{storage.suffix}"
    data, _ = genuine(path, storage)
    for length in [*range(0, 64, 7), *range(64, len(data), len(data) // 40), len(data) - 1]:
        path.write_bytes(data[:length])
        with pytest.raises(BakeError):
            image_io.read_image(path)


@pytest.mark.parametrize("storage", IMAGE_STORAGES)
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(edits=st.lists(st.tuples(st.floats(0, 1), st.integers(0, 255)), min_size=1, max_size=4))
def test_damaged_bytes_raise_nothing_else(
    library: str, tmp_path: Path, storage: Storage, edits: list[tuple[float, int]]
) -> None:
    path = tmp_path / f"damaged{storage.suffix}"
    data, _ = genuine(path, storage)
    damaged = bytearray(data)
    for place, byte in edits:
        damaged[int(place * (len(data) - 1))] = byte
    path.write_bytes(damaged)
    try:
        back = image_io.read_image(path, max_bytes=1 << 24)
    except BakeError as error:
        assert "\n" not in str(error)
    else:
        assert back.ndim == 3 and back.nbytes <= 1 << 24


def test_limit_is_the_callers(tmp_path: Path) -> None:
    for storage in IMAGE_STORAGES:
        path = tmp_path / f"image{storage.suffix}"
        image_io.write_image(path, np.ones((16, 16, 3)), storage)
        assert image_io.read_image(path, max_bytes=16 * 16 * 12).shape == (16, 16, 3)
        with pytest.raises(BakeError, match="more than 0 MiB"):
            image_io.read_image(path, max_bytes=16 * 16 * 12 - 1)


def test_no_file_and_a_folder(tmp_path: Path) -> None:
    (tmp_path / "folder.png").mkdir()
    for path in (tmp_path / "absent.exr", tmp_path, tmp_path / "absent.png", tmp_path / "folder.png"):
        with pytest.raises(BakeError, match="cannot be read"):
            image_io.read_image(path)
