"""Colours of photographs: whatever a file says of its primaries and curve, linear Rec.709 comes out.

Each file is made from a known linear Rec.709 colour with matrices and curves that standards print, not with ours.
"""

from __future__ import annotations

import json
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from measured_materials.addon.cli.main import main
from measured_materials.bake.errors import BakeError
from measured_materials.bake.photographs import StackSettings, read_stack
from measured_materials.bake.photographs.radiometry.color_marks import read_color_marks
from support import color_files as files
from support.color_cases import (
    ADOBE,
    AP1,
    BT2020,
    DISPLAY_P3,
    FROM_XYZ,
    FROM_XYZ_D50,
    PRIMARIES,
    SWATCH,
    codes,
    exrs,
    pngs,
    read,
    within,
)  # fmt: skip
from support.photo_files import write_photo

# --- Exif ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize(
    ("space", "index", "adobe", "warned"),
    [(65535, b"R03\0", True, False), (65535, None, True, True), (2, None, True, False), (65535, b"R98\0", False, False),
     (1, b"R98\0", False, False)],
)  # fmt: skip
def test_adobe_rgb_known_by_exif_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], order: str, space: int, index: bytes, adobe: bool, warned: bool
) -> None:
    for name, gain in (("el30", 0.5), ("el70", 1.0)):
        values = within(ADOBE, SWATCH * gain) if adobe else SWATCH * gain
        path = write_photo(tmp_path / f"{name}.jpg", codes(values, 563 / 256 if adobe else None, np.uint8))
        files.mark_jpeg(path, (0xE1, b"Exif\0\0" + files.exif(space, index, order)))
    found, used, warnings = read(tmp_path, capsys)
    assert found == pytest.approx(SWATCH, abs=0.004)  # 8 bits and JPEG
    assert used.get("converted") == ("Adobe RGB (1998) to linear Rec.709" if adobe else None)
    assert any("taken as Adobe RGB" in warning for warning in warnings) is warned


def test_exif_of_png_and_tiff(tmp_path: Path) -> None:
    (tmp_path / "png").mkdir()
    (tmp_path / "tiff").mkdir()
    values = within(ADOBE)
    pngs(tmp_path / "png", values, 563 / 256, files.chunk(b"eXIf", files.exif(65535, b"R03\0")))
    assert read(tmp_path / "png")[0] == pytest.approx(SWATCH, rel=2e-3)
    for name, gain in (("el30", 0.5), ("el70", 1.0)):
        write_photo(tmp_path / "tiff" / f"{name}.tif", codes(values * gain, 563 / 256), Exif__ColorSpace=65535)
    assert read(tmp_path / "tiff")[0] == pytest.approx(SWATCH, rel=2e-3)


# --- ICC profiles ----------------------------------------------------------------------------------------

PROFILES = {
    "Adobe RGB (1998)": (files.ADOBE_ICC, "gamma:2.19921875", 563 / 256, ADOBE),
    "Display P3": (files.DISPLAY_P3_ICC, "srgb formula", None, DISPLAY_P3),
    "Display P3 by samples": (files.DISPLAY_P3_ICC, "srgb", None, DISPLAY_P3),
    "ProPhoto RGB": (files.PROPHOTO_ICC, "gamma:1.80078125", 1.80078125, FROM_XYZ_D50 @ np.array(files.PROPHOTO_ICC).T),
    "Linear P3": (files.DISPLAY_P3_ICC, "linear", 1.0, DISPLAY_P3),
}


@pytest.mark.parametrize("name", PROFILES)
def test_profiles_of_primaries_and_curves(tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    colorants, curve, gamma, matrix = PROFILES[name]
    pngs(tmp_path, within(matrix), gamma, files.icc_chunk(files.icc(name, colorants, curve)))
    found, used, warnings = read(tmp_path, capsys)
    assert found == pytest.approx(SWATCH, abs=6e-4)  # printed matrices and s15Fixed16 numbers
    assert used["converted"] == f"{name} to linear Rec.709" and name in used["why"] and not warnings
    assert used["rule"] == ("srgb" if gamma is None else "linear" if gamma == 1 else f"gamma:{gamma:g}")


def test_profile_in_a_jpeg_goes_before_exif(tmp_path: Path) -> None:
    profile = files.icc("Display P3", files.DISPLAY_P3_ICC, "srgb")
    for name, gain in (("el30", 0.5), ("el70", 1.0)):
        path = write_photo(tmp_path / f"{name}.jpg", codes(within(DISPLAY_P3, SWATCH * gain), None, np.uint8))
        files.mark_jpeg(path, (0xE1, b"Exif\0\0" + files.exif(65535, None)), *files.icc_segments(profile))
    found, used, warnings = read(tmp_path)
    assert found == pytest.approx(SWATCH, abs=0.007)  # two codes of JPEG
    assert used["converted"].startswith("Display P3") and not warnings


def test_srgb_profile_converts_nothing(tmp_path: Path) -> None:
    pngs(tmp_path, SWATCH, None, files.icc_chunk(files.icc("sRGB IEC61966-2.1", files.SRGB_ICC, "srgb")))
    found, used, warnings = read(tmp_path)
    assert found == pytest.approx(SWATCH, rel=1e-3)
    assert used["rule"] == "srgb" and "converted" not in used and not warnings


def test_three_different_curves(tmp_path: Path) -> None:
    profile = files.icc("scanner", files.SRGB_ICC, "gamma:1.5", "gamma:2", "linear")
    for name, gain in (("el30", 0.5), ("el70", 1.0)):
        values = (SWATCH * gain) ** [1 / 1.5, 0.5, 1.0]
        files.write_png(tmp_path / f"{name}.png", codes(values, 1.0), files.icc_chunk(profile))
    assert read(tmp_path)[0] == pytest.approx(SWATCH, rel=1e-3)


@pytest.mark.parametrize(
    ("profile", "told"),
    [
        (files.icc("Lab printer", (), A2B0=b"mft2" + bytes(60)), "Lab printer of el30.png, el70.png works by tables"),
        (files.icc("Coated inks", (), space=b"CMYK", A2B0=bytes(64)), "Coated inks of el30.png, el70.png is for CMYK"),
        (b"not a profile", "el30.png, el70.png is damaged"),
        (files.icc("cut", files.ADOBE_ICC, "gamma:2.2")[:200], "el30.png, el70.png"),
    ],
)
def test_profiles_that_cannot_be_applied_are_named(tmp_path: Path, profile: bytes, told: str) -> None:
    pngs(tmp_path, SWATCH, None, files.icc_chunk(profile))
    found, _, warnings = read(tmp_path)
    assert found == pytest.approx(SWATCH, rel=1e-3)
    (warning,) = warnings
    assert told in warning and "taken as sRGB" in warning and "export it" in warning


def test_any_damage_to_a_profile_ends_well(tmp_path: Path) -> None:
    profile = files.icc("P3", files.DISPLAY_P3_ICC, "srgb formula")
    rng = np.random.default_rng(1)
    for _ in range(60):
        data = bytearray(profile)
        for place in rng.integers(0, len(data), 6):
            data[place] = rng.integers(256)
        pngs(tmp_path, SWATCH, None, files.icc_chunk(bytes(data)))
        try:
            assert np.isfinite(read_stack(tmp_path).images).all()
        except BakeError as error:
            assert "\n" not in str(error)


def test_decode_states_the_curve_and_leaves_the_primaries(tmp_path: Path) -> None:
    pngs(tmp_path, within(ADOBE), 1.0, files.icc_chunk(files.icc("Adobe RGB (1998)", files.ADOBE_ICC, "gamma:2.2")))
    stack = read_stack(tmp_path, StackSettings(decode="linear"))
    assert stack.images[1].mean(axis=(0, 1)) == pytest.approx(SWATCH, abs=6e-4)
    assert stack.facts["decoding"]["used"][0]["why"] == "as the user said"


# --- PNG chunks ------------------------------------------------------------------------------------------


def chrm(space: tuple[float, ...]) -> bytes:
    return files.chunk(b"cHRM", struct.pack(">8I", *(max(0, round(v * 1e5)) for v in (*space[6:], *space[:6]))))


@pytest.mark.parametrize("name", ["Adobe RGB (1998)", "BT.2020", "Display P3"])
def test_chromaticities_and_gamma_of_a_png(tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    space, matrix = PRIMARIES[name]
    pngs(tmp_path, within(matrix), 2.2, files.chunk(b"gAMA", struct.pack(">I", 45455)), chrm(space))
    found, used, _ = read(tmp_path, capsys)
    assert found == pytest.approx(SWATCH, abs=6e-4)
    assert (used["rule"], used["converted"]) == ("gamma:2.2", f"{name} to linear Rec.709")


def test_srgb_chunk_goes_before_its_approximation(tmp_path: Path) -> None:
    marks = files.chunk(b"gAMA", struct.pack(">I", 45455)), files.chunk(b"sRGB", b"\0")
    pngs(tmp_path, SWATCH, None, *marks)
    found, used, _ = read(tmp_path)
    assert found == pytest.approx(SWATCH, rel=1e-3) and used["rule"] == "srgb"


def pq(luminance: np.ndarray) -> np.ndarray:
    """Signal of SMPTE ST 2084 for cd/m^2."""
    y = (luminance / 10_000) ** 0.1593017578125
    return ((0.8359375 + 18.8515625 * y) / (1 + 18.6875 * y)) ** 78.84375


def hlg(light: np.ndarray) -> np.ndarray:
    """Signal of ARIB STD-B67 for light of the scene."""
    return np.where(
        light <= 1 / 12, np.sqrt(3 * light), 0.17883277 * np.log(np.maximum(12 * light - 0.28466892, 1e-9)) + 0.55991073
    )


CODED = {
    (9, 16, 0, 1): (BT2020, lambda x: pq(203 * x), "pq", "BT.2020"),
    (12, 13, 0, 1): (DISPLAY_P3, None, "srgb", "Display P3"),
    (9, 18, 0, 1): (BT2020, hlg, "hlg", "BT.2020"),
    (1, 8, 0, 1): (np.eye(3), lambda x: x, "linear", ""),
    (9, 1, 0, 1): (BT2020, lambda x: np.where(x < 0.018, 4.5 * x, 1.099 * x**0.45 - 0.099), "bt709", "BT.2020"),
    (10, 8, 0, 1): (FROM_XYZ, lambda x: x, "linear", "CIE XYZ"),
}


@pytest.mark.parametrize("numbers", CODED)
def test_code_points_of_a_png(tmp_path: Path, capsys: pytest.CaptureFixture[str], numbers: tuple[int, ...]) -> None:
    matrix, encode, rule, space = CODED[numbers]
    for name, gain in (("el30", 0.5), ("el70", 1.0)):
        values = within(matrix, SWATCH * gain)
        coded = codes(values) if encode is None else codes(encode(values), 1.0)
        files.write_png(tmp_path / f"{name}.png", coded, files.chunk(b"cICP", bytes(numbers)))
    found, used, _ = read(tmp_path, capsys)
    assert found == pytest.approx(SWATCH, abs=6e-4)
    assert used["rule"] == rule and used.get("converted", "").startswith(space)


def test_signals_that_standards_print(tmp_path: Path) -> None:
    # ITU-R BT.2408, table 1: diffuse white is 203 cd/m^2, 58 % of PQ and 75 % of HLG (0.265 of the scene's peak).
    for transfer, signal, expected in ((16, 0.5807, 1.0), (18, 0.75, 0.265), (18, 0.5, 1 / 12)):
        mark = files.chunk(b"cICP", bytes((9, transfer, 0, 1)))
        for name in ("el30", "el70"):
            files.write_png(tmp_path / f"{name}.png", codes(np.full(3, signal), 1.0), mark)
        assert read_stack(tmp_path).images == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize("numbers", [(9, 16, 0, 0), (9, 9, 0, 1), (200, 13, 0, 1)])
def test_code_points_that_are_not_known_are_refused(tmp_path: Path, numbers: tuple[int, ...]) -> None:
    pngs(tmp_path, SWATCH, None, files.chunk(b"cICP", bytes(numbers)))
    with pytest.raises(BakeError, match=r"el30\.png: states an encoding that is not known here .*H\.273") as caught:
        read_stack(tmp_path)
    # Only an unknown curve can be said in the file's place.
    assert ("decode" in caught.value.remedy) == (numbers == (9, 9, 0, 1))
    if numbers == (9, 9, 0, 1):
        assert read_stack(tmp_path, StackSettings(decode="srgb")).images.min() > 0
    else:
        with pytest.raises(BakeError, match=r"H\.273"):
            read_stack(tmp_path, StackSettings(decode="srgb"))


# --- EXR and HDR -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", PRIMARIES)
def test_chromaticities_of_an_exr(tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    space, matrix = PRIMARIES[name]
    for path in exrs(tmp_path, within(matrix)):
        files.mark_exr(path, "chromaticities", "chromaticities", struct.pack("<8f", *space))
    found, used, _ = read(tmp_path, capsys)
    assert found == pytest.approx(SWATCH, abs=3e-4)
    if name.startswith("AP"):
        name = {"AP0": "ACES2065-1 (AP0)", "AP1": "ACEScg (AP1)"}[name]
    assert used["converted"] == f"{name} to linear Rec.709"


def test_neutral_stays_neutral(tmp_path: Path) -> None:
    for path in exrs(tmp_path, np.full(3, 0.4)):
        files.mark_exr(path, "chromaticities", "chromaticities", struct.pack("<8f", *PRIMARIES["AP0"][0]))
    assert read(tmp_path)[0] == pytest.approx(0.4, rel=1e-5)


def test_color_interop_id_of_an_exr(tmp_path: Path) -> None:
    for path in exrs(tmp_path, within(AP1)):
        files.mark_exr(path, "colorInteropID", "string", b"lin_ap1_scene")
    assert read(tmp_path)[0] == pytest.approx(SWATCH, abs=3e-4)
    for path in exrs(tmp_path, SWATCH):
        files.mark_exr(path, "colorInteropID", "string", b"lin_klingon_scene")
    found, _, (warning,) = read(tmp_path)
    assert found == pytest.approx(SWATCH, rel=1e-5) and "lin_klingon_scene" in warning


def test_exr_of_xyz(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    exrs(tmp_path, within(FROM_XYZ), ("X", "Y", "Z"))
    found, used, _ = read(tmp_path, capsys)
    assert found == pytest.approx(SWATCH, abs=3e-4) and used["converted"] == "CIE XYZ to linear Rec.709"


def test_primaries_of_an_hdr(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, gain in (("el30", 0.5), ("el70", 1.0)):
        even = np.broadcast_to(within(BT2020, SWATCH * gain), (8, 10, 3)).astype(np.float32)
        path = write_photo(tmp_path / f"{name}.hdr", even)
        head, _, body = path.read_bytes().partition(b"\n\n")
        primaries = " ".join(str(value) for value in PRIMARIES["BT.2020"][0])
        path.write_bytes(head + b"\nPRIMARIES= " + primaries.encode() + b"\n\n" + body)
    found, used, _ = read(tmp_path, capsys)
    assert found == pytest.approx(SWATCH, abs=0.003)  # RGBE: 8 bits of the largest channel
    assert used["converted"] == "BT.2020 to linear Rec.709"


@pytest.mark.parametrize("with_bpy", [False, True])
def test_luminance_chroma_is_read_with_and_without_blender(tmp_path: Path, with_bpy: bool) -> None:
    for name, gain in (("el30", 0.5), ("el70", 1.0)):
        red, green, blue = (SWATCH * gain).tolist()
        (tmp_path / f"{name}.exr").write_bytes(files.luminance_chroma_exr(16, 12, (red, green, blue)))
    # A process of its own: that of the suite may have imported bpy already, which cannot be undone.
    script = ("import bpy\n" if with_bpy else "") + (
        "import os, sys\n"
        "from measured_materials.bake.photographs import read_stack\n"
        "print(*read_stack(sys.argv[1]).images[1].mean(axis=(0, 1)), flush=True)\n"
        "os._exit(0)\n"
    )
    run = subprocess.run([sys.executable, "-c", script, str(tmp_path)], capture_output=True, text=True, timeout=120)
    assert run.returncode == 0, run.stderr
    assert [float(word) for word in run.stdout.split()[-3:]] == pytest.approx(SWATCH, rel=2e-3)


def test_bake_tells_what_was_converted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "photos").mkdir()
    profile = files.icc_chunk(files.icc("Display P3", files.DISPLAY_P3_ICC, "srgb"))
    pngs(tmp_path / "photos", within(DISPLAY_P3), None, profile)
    assert main(["bake", "arc", str(tmp_path / "photos"), "--out", str(tmp_path)]) == 0
    assert "colours converted from Display P3 to linear Rec.709" in capsys.readouterr().out
    assert main(["inspect", str(tmp_path / "photos.mmat"), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)["source"]["facts"]["decoding"]["used"][0]
    assert facts["converted"] == "Display P3 to linear Rec.709"
    # CSS Color 4, display-p3 to linear sRGB.
    expected = [[1.2249, -0.2249, 0.0], [-0.0420, 1.0420, 0.0], [-0.0196, -0.0786, 1.0983]]
    assert np.array(facts["matrix"]) == pytest.approx(np.array(expected), abs=5e-4)


# --- all kinds -------------------------------------------------------------------------------------------


def test_colours_outside_rec709_are_told(tmp_path: Path) -> None:
    pngs(tmp_path, np.array([0.02, 0.5, 0.02]), None, files.icc_chunk(files.icc("P3", files.DISPLAY_P3_ICC, "srgb")))
    stack = read_stack(tmp_path)
    assert stack.images.min() == 0
    assert any("outside Rec.709's colours" in warning for warning in stack.warnings)
    assert stack.facts["outside_rec709_share"]["el70.png"] > 0.3


def test_different_encodings_in_one_stack(tmp_path: Path) -> None:
    files.write_png(tmp_path / "el30.png", codes(SWATCH))
    profile = files.icc_chunk(files.icc("Adobe RGB (1998)", files.ADOBE_ICC, "gamma:2.19921875"))
    files.write_png(tmp_path / "el70.png", codes(within(ADOBE), 563 / 256), profile)
    stack = read_stack(tmp_path)
    assert stack.images[0].mean(axis=(0, 1)) == pytest.approx(stack.images[1].mean(axis=(0, 1)), abs=6e-4)
    assert [use["photographs"] for use in stack.facts["decoding"]["used"]] == [1, 1]


def test_marks_of_damaged_files_are_as_good_as_none(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    path = write_photo(tmp_path / "a.jpg", codes(SWATCH, None, np.uint8))
    files.mark_jpeg(path, (0xE1, b"Exif\0\0" + files.exif(65535, b"R03\0")))
    pngs(tmp_path, SWATCH, None, chrm(PRIMARIES["BT.2020"][0]), files.chunk(b"eXIf", files.exif(65535, None)))
    exr = exrs(tmp_path, SWATCH)[0]
    files.mark_exr(exr, "chromaticities", "chromaticities", struct.pack("<8f", *PRIMARIES["AP0"][0]))
    tiff = write_photo(tmp_path / "a.tif", codes(SWATCH), Exif__ColorSpace=65535)
    for original in (path, tmp_path / "el30.png", exr, tiff):
        good = original.read_bytes()
        for _ in range(100):
            data = bytearray(good[: rng.integers(8, len(good))])
            for place in rng.integers(0, len(data), 3):
                data[place] = rng.integers(256)
            original.write_bytes(bytes(data))
            read_color_marks(original)
