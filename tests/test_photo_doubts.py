"""What one photograph has against the others; files that hold several pictures: reported, and the right one read."""

from __future__ import annotations

import json
import math
import struct
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from measured_materials.addon.cli.main import main
from measured_materials.addon.photographs.blender_decoder import decode
from measured_materials.bake.errors import BakeError
from measured_materials.bake.photographs import StackSettings, photograph, read_stack
from support.photo_files import encode_srgb, write_photo

COLOR = np.array([0.4, 0.2, 0.1])


def even(value: np.ndarray | float, shape: tuple[int, int] = (12, 16)) -> np.ndarray:
    return np.broadcast_to(value, (*shape, 3)).astype(np.float32)


def tiff(path: Path, *pages: tuple[np.ndarray, int]) -> Path:
    """Pages of (H, W, 3) uint8 codes with their NewSubfileType, not compressed."""
    data, link = b"II*\0", 4
    for codes, kind in pages:
        height, width, _ = codes.shape
        data = data.ljust(len(data) + 4 if link == 4 else len(data), b"\0")
        pixels = len(data)
        data += codes.tobytes() + bytes(codes.nbytes % 2)
        bits = len(data)
        data += struct.pack("<3H", 8, 8, 8)
        tags = [
            (254, 4, 1, kind), (256, 4, 1, width), (257, 4, 1, height), (258, 3, 3, bits), (259, 3, 1, 1),
            (262, 3, 1, 2), (273, 4, 1, pixels), (277, 3, 1, 3), (278, 4, 1, height), (279, 4, 1, codes.nbytes),
        ]  # fmt: skip
        data = data[:link] + struct.pack("<I", len(data)) + data[link + 4 :]
        data += struct.pack("<H", len(tags)) + b"".join(struct.pack("<HHII", *tag) for tag in tags)
        link = len(data)
        data += bytes(4)
    path.write_bytes(data)
    return path


def inspected(folder: Path, capsys: pytest.CaptureFixture[str]) -> list[str]:
    """Warnings as `inspect` reports them."""
    assert main(["inspect", str(folder), "--json"]) == 0
    return json.loads(capsys.readouterr().out)["warnings"]


# --- one against the others ------------------------------------------------------------------------------


@pytest.mark.parametrize("channels", [1, 3])
def test_gray_among_coloured_photographs(tmp_path: Path, capsys: pytest.CaptureFixture[str], channels: int) -> None:
    for elevation in (20, 45, 70):
        linear = even(COLOR * math.sin(math.radians(elevation)))
        if elevation == 45:
            linear = even(float(linear[0, 0] @ [0.2126, 0.7152, 0.0722]))[..., :channels]
        write_photo(tmp_path / f"el{elevation}.png", encode_srgb(linear))
    (warning,) = (w for w in inspected(tmp_path, capsys) if "grey" in w)
    assert warning.endswith(": el45.png")


@pytest.mark.parametrize("colored", [False, True])
def test_all_gray_or_all_coloured_is_no_doubt(tmp_path: Path, colored: bool) -> None:
    for elevation in (20, 45, 70):
        value = COLOR if colored else 0.3
        write_photo(tmp_path / f"el{elevation}.jpg", encode_srgb(even(value * math.sin(math.radians(elevation)))))
    write_photo(tmp_path / "el80.jpg", encode_srgb(even(0.0)))  # black, which has no colour either
    assert not any("grey" in warning for warning in read_stack(tmp_path).warnings)


def test_brightness_against_lights_that_stand_together(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As angles in radians look when they pass for degrees: 89 to 90 degrees, brightness from 36 to 100 %."""
    thetas = (1.2217, 0.7854, 0.3491)  # 70, 45 and 20 degrees from the normal
    for name, theta in zip("abc", thetas):
        write_photo(tmp_path / f"{name}.exr", even(COLOR * math.cos(theta)))
    rows = "".join(f"{name}.exr,{theta}\n" for name, theta in zip("abc", thetas))
    (tmp_path / "lights.csv").write_text("file,theta [deg]\n" + rows)  # the header insists
    told = [warning for warning in inspected(tmp_path, capsys) if "check the lights' units" in warning]
    assert len(told) == 1 and "36% to 100 %" in told[0] and "88.8 to 89.7 degrees" in told[0]
    (tmp_path / "lights.csv").write_text("file,theta [rad]\n" + rows)
    assert not any("units" in warning for warning in inspected(tmp_path, capsys))


# --- several pictures in a file --------------------------------------------------------------------------


def swatch(gain: float, shape: tuple[int, int] = (12, 16)) -> np.ndarray:
    return encode_srgb(even(COLOR * gain, shape))


def test_a_thumbnail_in_front_is_passed_over(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, gain in (("el30", 0.5), ("el70", 1.0)):
        tiff(tmp_path / f"{name}.tif", (swatch(0.1, (4, 5)), 1), (swatch(gain), 0))
    stack = read_stack(tmp_path)
    assert stack.images.shape[1:3] == (12, 16)
    assert stack.images[1].mean(axis=(0, 1)) == pytest.approx(COLOR, abs=0.004)  # half a code of 8 bits
    told = inspected(tmp_path, capsys)
    assert "files hold several pictures, the largest is read: el30.tif, el70.tif" in told


@pytest.mark.parametrize("kind", [1, 4])
def test_a_larger_copy_or_mask_is_passed_over(tmp_path: Path, kind: int) -> None:
    for name, gain in (("el30", 0.5), ("el70", 1.0)):
        tiff(tmp_path / f"{name}.tif", (swatch(gain), 0), (swatch(0.1, (24, 32)), kind))
    assert read_stack(tmp_path).images[1].mean(axis=(0, 1)) == pytest.approx(COLOR, abs=0.004)


def test_pages_of_one_size_and_lone_thumbnails_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, gain in (("el30", 0.5), ("el70", 1.0)):
        tiff(tmp_path / f"{name}.tif", (swatch(gain), 0), (swatch(0.9), 0))
    told = inspected(tmp_path, capsys)
    assert any("several pictures of one size, the first is read" in w and "el30.tif, el70.tif" in w for w in told)
    for name, gain in (("el30", 0.5), ("el70", 1.0)):
        tiff(tmp_path / f"{name}.tif", (swatch(gain), 1))
    assert any("only what is marked as a reduced copy" in w for w in inspected(tmp_path, capsys))
    for name, gain in (("el30", 0.5), ("el70", 1.0)):
        tiff(tmp_path / f"{name}.tif", (swatch(gain), 0))
    assert not any("hold" in warning for warning in inspected(tmp_path, capsys))


def test_blender_reads_the_first_page_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(photograph, "load_openimageio", lambda: None)
    for name, gain in (("el30", 0.5), ("el70", 1.0)):
        tiff(tmp_path / f"{name}.tif", (swatch(gain), 0), (swatch(0.1, (4, 5)), 1))
    assert read_stack(tmp_path, decoder=decode).images[1].mean(axis=(0, 1)) == pytest.approx(COLOR, abs=0.004)
    tiff(tmp_path / "el70.tif", (swatch(0.1, (4, 5)), 1), (swatch(1.0), 0))
    with pytest.raises(BakeError, match=r"el70\.tif: opens with a small picture, and its photograph is number 2"):
        read_stack(tmp_path, decoder=decode)


def test_parts_of_an_exr(tmp_path: Path) -> None:
    for name, gain in (("el30", 0.5), ("el70", 1.0)):
        color = even(COLOR * gain)
        depth = {channel: np.ones((12, 16), np.float32) for channel in "UV"}
        planes = {channel: np.ascontiguousarray(color[..., k]) for k, channel in enumerate("RGB")}
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        parts = [OpenEXR.Part(dict(header), depth, "depth"), OpenEXR.Part(dict(header), planes, "beauty")]
        OpenEXR.File(parts).write(str(tmp_path / f"{name}.exr"))
    stack = read_stack(tmp_path, StackSettings(align="off"))
    assert stack.images[1].mean(axis=(0, 1)) == pytest.approx(COLOR, rel=1e-5)
    assert any("several parts, the first with colours is read" in warning for warning in stack.warnings)
