"""Radiance .hdr: every scheme is read, the nearest value is written, damage is one error."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from measured_materials.bake.errors import BakeError
from measured_materials.bake.images import image_io, radiance_hdr
from measured_materials.bake.images.storage import Storage, quantize


def hdr(rows: bytes, size: str = "-Y 3 +X 16", header: str = "") -> bytes:
    return f"#?RADIANCE\n{header}FORMAT=32-bit_rle_rgbe\n\n{size}\n".encode() + rows


def rgbe_block() -> np.ndarray:
    block = np.random.default_rng(2).integers(2, 200, (3, 16, 4), np.uint8)
    block[1, 4:12] = block[1, 4]
    block[2, :, :3] = 0
    return block


def flat_rows(block: np.ndarray) -> bytes:
    return block.tobytes()


def run_rows(block: np.ndarray) -> bytes:
    copied = [bytes([16]) + row[:, c].tobytes() for row in block for c in range(4)]
    return b"".join(b"\2\2\0\x10" + b"".join(copied[k : k + 4]) for k in range(0, len(copied), 4))


def repeat_rows(block: np.ndarray) -> bytes:
    """The first scheme: (1, 1, 1, n) repeats the pixel before; here the second row holds such a run."""
    rows = block[0].tobytes()
    rows += block[1, :5].tobytes() + b"\1\1\1\7" + block[1, 12:].tobytes()
    return rows + block[2].tobytes()


@pytest.mark.parametrize("scheme", [flat_rows, run_rows, repeat_rows])
def test_all_three_hdr_schemes(tmp_path: Path, scheme: Callable[[np.ndarray], bytes]) -> None:
    block = rgbe_block()
    (tmp_path / "a.hdr").write_bytes(hdr(scheme(block)))
    np.testing.assert_array_equal(image_io.read_image(tmp_path / "a.hdr"), radiance_hdr.decode(block))


def test_long_repeat_counts_in_bytes(tmp_path: Path) -> None:
    pixel = bytes([200, 100, 50, 129])
    (tmp_path / "a.hdr").write_bytes(hdr(pixel + b"\1\1\1\x2b" + b"\1\1\1\1", "-Y 1 +X 300"))
    back = image_io.read_image(tmp_path / "a.hdr")
    assert back.shape == (1, 300, 3) and (back == [200 / 128, 100 / 128, 50 / 128]).all()


@pytest.mark.parametrize("size, turn", [("+Y 3 +X 16", np.s_[::-1]), ("-Y 3 -X 16", np.s_[:, ::-1])])
def test_hdr_orientation(tmp_path: Path, size: str, turn: Any) -> None:
    block = rgbe_block()
    (tmp_path / "a.hdr").write_bytes(hdr(flat_rows(block), size))
    np.testing.assert_array_equal(image_io.read_image(tmp_path / "a.hdr"), radiance_hdr.decode(block)[turn])


def test_hdr_exposures_are_divided_out(tmp_path: Path) -> None:
    block = rgbe_block()
    (tmp_path / "a.hdr").write_bytes(hdr(flat_rows(block), header="EXPOSURE=2\nEXPOSURE= 4\n"))
    np.testing.assert_array_equal(image_io.read_image(tmp_path / "a.hdr"), radiance_hdr.decode(block) / 8)


@pytest.mark.parametrize(
    "data, word",
    [
        (b"#?", "header is damaged"),
        (hdr(b"", "-Y 99999999999 +X 1"), "header is damaged"),
        (hdr(b"", "-Y 0 +X 5"), "no pixels"),
        (hdr(b"", "-Y 999999999 +X 999999999"), "declares"),
        (hdr(b"", "-Y 9000 +X 9000"), "cut short"),
        (hdr(bytes(300), "+X 3 -Y 16"), "columns"),
        (hdr(bytes(300)).replace(b"rgbe", b"xyze"), "XYZ"),
        (hdr(bytes(300), header="EXPOSURE=nan\n"), "EXPOSURE"),
        (hdr(bytes(300), header="EXPOSURE=0\n"), "EXPOSURE"),
        (hdr(bytes(300), header="COLORCORR=1 2 1\n"), "colour correction"),
        (hdr(b"\2\2\0\x11" * 50), "pixels are damaged"),
        (hdr(b"\2\2\0\x10\0" * 50), "pixels are damaged"),
        (hdr(b"\2\2\0\x10\xff\1" * 50), "pixels are damaged"),
        (hdr(b"\1\1\1\1" * 48), "pixels are damaged"),
        (hdr(b"\5\5\5\5" + b"\1\1\1\xff" * 48), "pixels are damaged"),
        (hdr(bytes(4 * 47)), "pixels are damaged"),
    ],
)
def test_hostile_hdr(tmp_path: Path, data: bytes, word: str) -> None:
    (tmp_path / "a.hdr").write_bytes(data)
    with pytest.raises(BakeError, match=word):
        image_io.read_image(tmp_path / "a.hdr")


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(rows=st.binary(max_size=400), width=st.integers(1, 40))
def test_any_bytes_as_hdr_rows(tmp_path: Path, rows: bytes, width: int) -> None:
    (tmp_path / "a.hdr").write_bytes(hdr(rows, f"-Y 2 +X {width}"))
    try:
        assert image_io.read_image(tmp_path / "a.hdr").shape == (2, width, 3)
    except BakeError:
        pass


@pytest.mark.parametrize("width", [1, 7, 8, 9, 127, 128, 129, 300, 33000])
def test_openimageio_reads_our_hdr(tmp_path: Path, width: int) -> None:
    oiio = image_io.load_openimageio()
    if oiio is None:
        pytest.skip("OpenImageIO is not installed")
    rng = np.random.default_rng(width)
    pixels = rng.random((3, width, 3)).astype(np.float32)
    pixels[1] = 0
    pixels[2, width // 3 :] = 0.5  # runs longer than one code holds
    image_io.write_image(tmp_path / "a.hdr", pixels, Storage.RGBE)
    stream = oiio.ImageInput.open(str(tmp_path / "a.hdr"))
    seen = stream.read_image()
    stream.close()
    np.testing.assert_array_equal(seen, quantize(pixels, Storage.RGBE))
    np.testing.assert_array_equal(image_io.read_image(tmp_path / "a.hdr"), seen)


def test_runs_shrink_an_hdr(tmp_path: Path) -> None:
    image_io.write_image(tmp_path / "a.hdr", np.zeros((64, 512, 3)), Storage.RGBE)
    assert os.path.getsize(tmp_path / "a.hdr") < 64 * 512 * 4 / 40
