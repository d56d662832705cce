"""Single photographs: formats, headers, decoding, and everything that is no photograph."""

from __future__ import annotations

import os
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from measured_materials.bake.errors import BakeError
from measured_materials.bake.images.image_io import write_image
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.photographs import Exposure, Photograph, PhotoInfo, StackSettings, photograph, read_stack
from measured_materials.bake.photographs.encoding import choose_encoding
from measured_materials.bake.photographs.folder import find_photographs, natural_key
from measured_materials.bake.photographs.photograph import read_info, read_photograph
from measured_materials.bake.photographs.radiometry.color_marks import ColorMarks
from measured_materials.bake.photographs.radiometry.response import SRGB, parse_rule
from support.photo_files import (
    encode_srgb,
    exr_bytes,
    jpeg_with_size,
    png_bytes,
    tiff_bytes,
    write_photo,
)


def ramp(height: int = 12, width: int = 16) -> np.ndarray:
    x, y = np.meshgrid(np.linspace(0.05, 0.8, width), np.linspace(0.3, 0.6, height))
    return np.stack([x, y, x * y], axis=-1).astype(np.float32)


def stack_of(folder: Path, suffix: str, frames: list[np.ndarray], **attributes: object) -> Path:
    for k, frame in enumerate(frames):
        write_photo(folder / f"p{k}_el{20 + 30 * k}{suffix}", frame, **attributes)
    return folder


# Half a code of 8 or 16 bits where sRGB is steepest in linear light (slope 2.3 at white); the 11 bits of half; RGBE.
@pytest.mark.parametrize(
    ("suffix", "kind", "tolerance"),
    [
        (".png", "uint8", 0.0047),
        (".png", "uint16", 2e-5),
        (".tif", "uint8", 0.0047),
        (".tiff", "uint16", 2e-5),
        (".tif", "float32", 0),
        (".exr", "float32", 0),
        (".exr", "float16", 4e-4),
        (".hdr", "float32", 4e-3),
    ],
)
def test_every_format_gives_back_linear_values(tmp_path: Path, suffix: str, kind: str, tolerance: float) -> None:
    linear = ramp()
    coded = encode_srgb(linear, np.dtype(kind).type) if kind.startswith("uint") else linear.astype(kind)
    stack = read_stack(stack_of(tmp_path, suffix, [coded, coded]))
    assert stack.images.shape == (2, 12, 16, 3) and stack.images.dtype == np.float32
    assert np.abs(stack.images[0] - linear).max() <= tolerance


def test_jpeg_is_read_and_its_response_called_an_assumption(tmp_path: Path) -> None:
    smooth = np.repeat(np.linspace(0.1, 0.6, 32, dtype=np.float32)[None, :, None], 24, 0).repeat(3, -1)
    stack = read_stack(stack_of(tmp_path, ".jpg", [encode_srgb(smooth)] * 2))
    assert np.abs(stack.images[0] - smooth).max() < 0.015  # quality 100: a code or two of quantisation
    assert stack.facts["decoding"]["used"][0]["rule"] == "srgb"
    assert "not documented" in stack.facts["decoding"]["note"]


@pytest.mark.parametrize(("channels", "alpha"), [(1, False), (2, True), (4, True)])
def test_gray_and_alpha(tmp_path: Path, channels: int, alpha: bool) -> None:
    pixels = np.full((6, 8, channels), 128, np.uint8)
    if alpha:
        pixels[..., -1] = 255
    stack = read_stack(stack_of(tmp_path, ".png", [pixels, pixels]))
    assert np.allclose(stack.images, SRGB.linear(np.array(128 / 255)), atol=1e-6)
    assert any("alpha is ignored" in warning for warning in stack.warnings) is alpha


def test_colour_is_not_multiplied_by_alpha(tmp_path: Path) -> None:
    pixels = np.full((6, 8, 4), 200, np.uint8)
    pixels[..., 3] = 100
    path = write_photo(tmp_path / "a.tif", pixels, oiio__UnassociatedAlpha=1)
    assert (read_photograph(path).pixels == 200).all()


def test_metadata_that_says_linear_is_believed(tmp_path: Path) -> None:
    pixels = np.full((4, 4, 3), 100, np.uint8)
    rows = b"".join(b"\0" + row.tobytes() for row in pixels)
    for k in range(2):
        (tmp_path / f"el{20 + k}.png").write_bytes(png_bytes(4, 4, rows, gamma=100_000))
    stack = read_stack(tmp_path)
    assert np.allclose(stack.images, 100 / 255, atol=1e-6)
    assert "metadata says linear" in stack.facts["decoding"]["used"][0]["why"]


@pytest.mark.parametrize(("rule", "expected"), [("linear", 0.5), ("gamma:2.2", 0.5**2.2), ("srgb", 0.21404114)])
def test_the_user_may_state_the_rule(tmp_path: Path, rule: str, expected: float) -> None:
    pixels = np.full((4, 4, 3), 0x8000, np.uint16)
    stack = read_stack(stack_of(tmp_path, ".tif", [pixels, pixels]), StackSettings(decode=rule))
    assert stack.images == pytest.approx(expected, rel=1e-4)
    assert stack.facts["decoding"]["used"] == [{"rule": rule, "why": "as the user said", "photographs": 2}]


def test_plain_tiff_is_taken_as_srgb_with_a_warning(tmp_path: Path) -> None:
    pixels = np.full((4, 4, 3), 0x8000, np.uint16)
    stack = read_stack(stack_of(tmp_path, ".tif", [pixels, pixels]))
    assert stack.images == pytest.approx(0.21404, rel=1e-3)
    assert any("decode linear" in warning for warning in stack.warnings)


@pytest.mark.parametrize(
    ("info", "rule"),
    [
        (PhotoInfo("png", 4, 4, color=ColorMarks(gamma=1e5 / 45455)), "gamma:2.2"),
        (PhotoInfo("png", 4, 4, color=ColorMarks(gamma=1.8)), "gamma:1.8"),
        (PhotoInfo("png", 4, 4, color=ColorMarks(gamma=2.2, srgb=True)), "srgb"),
        (PhotoInfo("tiff", 4, 4, is_float=True), "linear"),
        (PhotoInfo("jpeg", 4, 4, color=ColorMarks(exif_color_space=1)), "srgb"),
        (PhotoInfo("jpeg", 4, 4), "srgb"),
        (PhotoInfo("tiff", 4, 4), "srgb"),
    ],
)
def test_rule_from_metadata(info: PhotoInfo, rule: str) -> None:
    assert choose_encoding(Path("a"), info, "auto").name == rule


@pytest.mark.parametrize("rule", ["", "gamma", "gamma:0", "gamma:99", "rec709", None, 2.2])
def test_unknown_rule_is_refused(rule: object) -> None:
    with pytest.raises(BakeError, match="decode"):
        parse_rule(rule)  # type: ignore[arg-type]


def test_exif_and_orientation_are_read(tmp_path: Path) -> None:
    path = write_photo(
        tmp_path / "a.jpg",
        np.full((6, 8, 3), 90, np.uint8),
        ExposureTime=0.02, FNumber=8.0, Exif__PhotographicSensitivity=400, Orientation=6, Exif__WhiteBalance=0,
    )  # fmt: skip
    info = read_info(path)
    assert info.exposure.seconds == pytest.approx(0.02, rel=1e-3)
    assert (info.exposure.f_number, info.exposure.iso) == (8, 400)
    assert info.orientation == 6 and info.automatic_white


# --- no photograph ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".png", ".exr", ".tif", ".jpg"])
def test_boastful_header_is_refused_before_memory_is_taken(tmp_path: Path, suffix: str) -> None:
    width, height = (25_000, 20_000)
    path = tmp_path / f"huge{suffix}"
    if suffix == ".jpg":
        small = write_photo(tmp_path / "small.jpeg", np.zeros((8, 8, 3), np.uint8)).read_bytes()
        data = jpeg_with_size(small, width, height)
    else:
        data = {".png": lambda w, h: png_bytes(w, h, b"\0" * 90), ".exr": exr_bytes, ".tif": tiff_bytes}[suffix](
            width, height
        )
    path.write_bytes(data)
    tracemalloc.start()
    before = _resident()
    with pytest.raises(BakeError, match=r"huge.*(25000 x 20000|not an image|cannot be read)") as caught:
        read_photograph(path)
    assert tracemalloc.get_traced_memory()[1] < 1 << 22
    tracemalloc.stop()
    assert _resident() - before < 100 << 20  # the pixels would be 1.5 GB
    if suffix in (".png", ".tif", ".jpg"):
        assert "120 megapixels" in str(caught.value)


def _resident() -> int:
    try:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError, AttributeError):
        return 0


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".tif", ".exr", ".hdr"])
@pytest.mark.parametrize("kept", [0.0, 0.02, 0.6, 0.95])
def test_file_cut_short_in_the_middle_of_a_stack(tmp_path: Path, suffix: str, kept: float) -> None:
    noise = np.random.default_rng(0).random((40, 50, 3))
    frame = noise.astype(np.float32) if suffix in (".exr", ".hdr") else (noise * 255).astype(np.uint8)
    stack_of(tmp_path, suffix, [frame] * 3)
    bad = tmp_path / f"p1_el50{suffix}"
    data = bad.read_bytes()
    bad.write_bytes(data[: int(len(data) * kept)])
    with pytest.raises(BakeError, match="p1_el50"):
        read_stack(tmp_path)


def test_damage_never_raises_anything_else(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    for suffix in (".jpg", ".png", ".tif", ".exr", ".hdr"):
        floats = suffix in (".exr", ".hdr")
        frame = rng.random((10, 12, 3)).astype(np.float32)
        path = write_photo(tmp_path / f"a{suffix}", frame if floats else (frame * 255).astype(np.uint8))
        good = path.read_bytes()
        for _ in range(40):
            data = bytearray(good)
            for place in rng.integers(0, len(data), 3):
                data[place] = rng.integers(256)
            path.write_bytes(bytes(data))
            try:
                assert read_photograph(path).pixels.ndim == 3
            except BakeError as error:
                assert error.file.endswith(path.name) and "\n" not in str(error)


def test_text_under_an_image_suffix(tmp_path: Path) -> None:
    stack_of(tmp_path, ".png", [np.zeros((4, 4, 3), np.uint8)] * 2)
    (tmp_path / "note.jpg").write_text("these are my photographs")
    with pytest.raises(BakeError, match=r"note\.jpg: is not an image"):
        read_stack(tmp_path)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite(tmp_path: Path, value: float) -> None:
    bad = ramp()
    bad[3, 4, 1] = value
    stack_of(tmp_path, ".exr", [ramp(), bad])
    with pytest.raises(BakeError, match=r"p1_el50.*not finite"):
        read_stack(tmp_path)


def test_values_near_the_end_of_float32(tmp_path: Path) -> None:
    stack_of(tmp_path, ".exr", [ramp(), ramp() * np.float32(1e38)])
    with pytest.raises(BakeError, match="above 1e"):
        read_stack(tmp_path)


def test_negative_values_are_clipped_and_counted(tmp_path: Path) -> None:
    bad = ramp()
    bad[:2, :, 0] = -0.5
    stack = read_stack(stack_of(tmp_path, ".exr", [ramp(), bad]))
    assert stack.images.min() == 0
    assert stack.facts["negative_values"] == {"p1_el50.exr": 32}
    assert any("32 negative values" in warning for warning in stack.warnings)


def test_layered_exr_of_blender_and_luminance(tmp_path: Path) -> None:
    pixels = np.random.default_rng(1).random((4, 5, 4)).astype(np.float32)
    names = tuple(f"ViewLayer.Combined.{c}" for c in "RGBA")
    path = write_photo(tmp_path / "a.exr", pixels, channels=names)
    assert np.array_equal(read_photograph(path).pixels, pixels[..., :3])
    assert photograph._color_channels(path, "openexr", ("V.C.A", "V.C.B", "V.C.G", "V.C.R", "V.Z")) == [3, 2, 1]
    assert photograph._color_channels(path, "openexr", ("A", "Y")) == [1]
    with pytest.raises(BakeError, match="not R, G and B"):
        photograph._color_channels(path, "openexr", ("U", "V"))


# --- without OpenImageIO ---------------------------------------------------------------------------------


def test_without_openimageio(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "floats").mkdir()
    (tmp_path / "bytes").mkdir()
    for k in range(2):
        write_image(tmp_path / "floats" / f"el{30 + k}.exr", ramp(), Storage.FLOAT32)
        write_photo(tmp_path / "bytes" / f"el{30 + k}.png", np.full((4, 5, 3), 128, np.uint8))
    monkeypatch.setattr(photograph, "load_openimageio", lambda: None)
    assert np.array_equal(read_stack(tmp_path / "floats").images[0], ramp())
    with pytest.raises(BakeError, match=r"el30\.png: cannot be read without OpenImageIO"):
        read_stack(tmp_path / "bytes")

    def decoder(path: Path) -> Photograph:
        pixels = np.full((4, 5, 4), 64, np.uint8)
        return Photograph(PhotoInfo("png", 5, 4, 4, exposure=Exposure(0.1)), pixels)

    stack = read_stack(tmp_path / "bytes", decoder=decoder)
    assert stack.images == pytest.approx(float(SRGB.linear(np.array(64 / 255))), rel=1e-5)

    def failing(path: Path) -> Photograph:
        raise RuntimeError("cannot load")

    with pytest.raises(BakeError, match=r"el30\.png: cannot be read \(cannot load\)"):
        read_stack(tmp_path / "bytes", decoder=failing)


# --- folders ---------------------------------------------------------------------------------------------


def test_natural_order() -> None:
    names = ["image10.jpg", "image2.jpg", "Image1.jpg", "image2b.jpg"]
    assert sorted(names, key=natural_key) == ["Image1.jpg", "image2.jpg", "image2b.jpg", "image10.jpg"]


def test_companions_are_silent_and_foreign_files_are_reported(tmp_path: Path) -> None:
    stack_of(tmp_path, ".png", [np.full((4, 4, 3), 99, np.uint8)] * 2)
    for name in ("LICENSE", "README", "notes.txt", "dirs.json", ".hidden.jpg", "Thumbs.db"):
        (tmp_path / name).write_text("x")
    (tmp_path / "inside").mkdir()
    (tmp_path / "inside" / "x.png").write_text("not entered")
    assert find_photographs(tmp_path, ())[1] == []
    for name in ("a.blend", "b.nef"):
        (tmp_path / name).write_text("x")
    (warning,) = find_photographs(tmp_path, ())[1]
    assert "a.blend, b.nef" in warning


def test_unusable_folders(tmp_path: Path) -> None:
    with pytest.raises(BakeError, match="does not exist"):
        read_stack(tmp_path / "absent")
    (tmp_path / "stack").mkdir()
    with pytest.raises(BakeError, match=r"holds no photograph; folders inside are not entered: give stack"):
        read_stack(tmp_path)
    (tmp_path / "stack" / "a.cr2").write_text("raw")
    with pytest.raises(BakeError, match="RAW files only"):
        read_stack(tmp_path / "stack")
    with pytest.raises(BakeError, match="is a file, not a folder"):
        read_stack(tmp_path / "stack" / "a.cr2")
    with pytest.raises(BakeError, match="holds no photograph"):
        read_stack([])


def test_one_photograph_in_two_formats(tmp_path: Path) -> None:
    for name in ("el10.jpg", "el10.tif", "el40.jpg"):
        write_photo(tmp_path / name, np.full((4, 4, 3), 99, np.uint8))
    with pytest.raises(BakeError, match=r"el10\.jpg and el10\.tif"):
        read_stack(tmp_path)


def test_given_files(tmp_path: Path) -> None:
    stack_of(tmp_path, ".png", [np.full((4, 4, 3), 40 * k + 40, np.uint8) for k in range(3)])
    stack = read_stack([tmp_path / "p2_el80.png", tmp_path / "p0_el20.png"])
    assert stack.names == ("p0_el20.png", "p2_el80.png")
    with pytest.raises(BakeError, match="given twice"):
        read_stack([tmp_path / "p0_el20.png", tmp_path / "p0_el20.png"])
    with pytest.raises(BakeError, match=r"absent\.png: cannot be read"):
        read_stack([tmp_path / "p0_el20.png", tmp_path / "absent.png"])


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="the super-user may read everything")
def test_no_permission(tmp_path: Path) -> None:
    stack_of(tmp_path, ".png", [np.full((4, 4, 3), 99, np.uint8)] * 2)
    (tmp_path / "p1_el50.png").chmod(0)
    with pytest.raises(BakeError, match=r"p1_el50\.png: cannot be read \(Permission denied\)"):
        read_stack(tmp_path)


def test_no_permission_as_the_system_reports_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stack_of(tmp_path, ".png", [np.full((4, 4, 3), 99, np.uint8)] * 2)

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(photograph, "open", refuse, raising=False)
    with pytest.raises(BakeError, match=r"p0_el20\.png: cannot be read \(Permission denied\)"):
        read_stack(tmp_path)
    monkeypatch.setattr(Path, "iterdir", refuse)
    with pytest.raises(BakeError, match=r"cannot be read \(Permission denied\)"):
        read_stack(tmp_path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes on this system")
def test_a_pipe_does_not_block(tmp_path: Path) -> None:
    stack_of(tmp_path, ".png", [np.full((4, 4, 3), 99, np.uint8)] * 2)
    os.mkfifo(tmp_path / "p9_el9.png")
    with pytest.raises(BakeError, match="is not a file"):
        read_stack(tmp_path)
