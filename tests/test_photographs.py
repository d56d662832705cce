"""Whole stacks: calibration, flat fields, clipping, what cannot be used, memory, and the account that is given."""

from __future__ import annotations

import json
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from measured_materials.bake.errors import BakeError
from measured_materials.bake.images.image_io import read_image
from measured_materials.bake.photographs import StackSettings, plan, read_stack
from support.photo_files import encode_srgb, gray_frames, write_photo

ELEVATIONS = (15, 40, 65, 90)


def lambert_scene(folder: Path, albedo: np.ndarray, lamps: list[float], named: bool = True) -> np.ndarray:
    """A diffuse swatch (8, 8, 3) left of a card of reflectance 0.8, one photograph per elevation, each with its own
    lamp. Returns f cos of the swatch, (n, 8, 8, 3)."""
    truth = []
    for k, (elevation, lamp) in enumerate(zip(ELEVATIONS, lamps)):
        cosine = np.sin(np.radians(elevation))
        frame = np.zeros((8, 14, 3), np.float32)
        truth.append(albedo / np.pi * cosine)
        frame[:, :8] = truth[-1] * lamp
        frame[:, 10:] = 0.8 / np.pi * cosine * lamp
        frame *= [1.0, 0.9, 0.6]  # the lamp's colour
        write_photo(folder / (f"el{elevation}.exr" if named else f"p{k}.exr"), frame)
    return np.array(truth)


def swatch() -> np.ndarray:
    return np.random.default_rng(2).uniform(0.1, 0.7, (8, 8, 3)).astype(np.float32)


# --- calibration -----------------------------------------------------------------------------------------


def test_white_card_gives_f_cos_whatever_the_lamp(tmp_path: Path) -> None:
    truth = lambert_scene(tmp_path, swatch(), [1.0, 3.0, 0.4, 2.0])
    settings = StackSettings(crop=(0, 0, 8, 8), white_card=(10, 0, 4, 8), white_reflectance=0.8)
    stack = read_stack(tmp_path, settings)
    assert stack.calibrated
    assert np.allclose(stack.images, truth, rtol=1e-5)  # float32


def test_card_lit_from_the_normal_reads_reflectance_over_pi(tmp_path: Path) -> None:
    lambert_scene(tmp_path, swatch(), [1.0, 3.0, 0.4, 2.0])
    settings = StackSettings(crop=(10, 0, 4, 8), white_card=(10, 0, 4, 8), white_reflectance=0.8)
    stack = read_stack(tmp_path, settings)
    assert np.allclose(stack.images[3], 0.8 / np.pi, rtol=1e-5)
    assert np.allclose(stack.images[0], 0.8 / np.pi * np.sin(np.radians(15)), rtol=1e-5)


def test_white_card_without_elevations_takes_the_brightest(tmp_path: Path) -> None:
    truth = lambert_scene(tmp_path, swatch(), [2.0] * 4, named=False)
    settings = StackSettings(crop=(0, 0, 8, 8), white_card=(10, 0, 4, 8), white_reflectance=0.8)
    stack = read_stack(tmp_path, settings)
    assert stack.directions is None
    assert np.allclose(stack.images, truth, rtol=1e-5)  # one lamp for all, and the last is overhead
    assert "brightest in p3.exr" in stack.facts["calibration"]["how"]


def test_stated_albedo_with_elevations(tmp_path: Path) -> None:
    truth = lambert_scene(tmp_path, np.full((8, 8, 3), 0.35, np.float32), [2.5] * 4)
    stack = read_stack(tmp_path, StackSettings(crop=(0, 0, 8, 8), albedo=0.35))
    averages = stack.images.mean(axis=(1, 2, 3))
    assert stack.calibrated and averages == pytest.approx(truth.mean(axis=(1, 2, 3)), rel=1e-5)
    assert stack.facts["calibration"]["relative_misfit"] == pytest.approx(0, abs=1e-3)


def test_stated_albedo_without_elevations(tmp_path: Path) -> None:
    for name, frame in zip("abc", gray_frames([0.2, 0.7, 0.4])):
        write_photo(tmp_path / f"{name}.exr", frame)
    stack = read_stack(tmp_path, StackSettings(albedo=0.6))
    assert stack.images.mean(axis=(1, 2, 3)) == pytest.approx(np.array([0.2, 0.7, 0.4]) / 0.7 * 0.6 / np.pi)


def test_uncalibrated_is_relative(tmp_path: Path) -> None:
    lambert_scene(tmp_path, swatch(), [1.0] * 4)
    assert not read_stack(tmp_path).calibrated


def test_black_or_clipped_card(tmp_path: Path) -> None:
    frames = gray_frames([0.2, 0.3])
    for k, frame in enumerate(frames):
        frame[:, 6:] = 0
        write_photo(tmp_path / f"el{30 + k}.exr", frame)
    with pytest.raises(BakeError, match=r"el30\.exr: shows the white card black"):
        read_stack(tmp_path, StackSettings(white_card=(6, 0, 2, 6)))
    with pytest.raises(BakeError, match="white card reaches to x 9"):
        read_stack(tmp_path, StackSettings(white_card=(6, 0, 3, 6)))
    for k, frame in enumerate(frames):
        (tmp_path / f"el{30 + k}.exr").unlink()
        frame[:, 6:] = 1
        write_photo(tmp_path / f"el{30 + k}.png", encode_srgb(frame))
    stack = read_stack(tmp_path, StackSettings(white_card=(6, 0, 2, 6)))
    assert any("white card is clipped" in warning and "el31.png" in warning for warning in stack.warnings)


# --- flat field ------------------------------------------------------------------------------------------


def uneven(strength: float) -> np.ndarray:
    x, y = np.meshgrid(np.linspace(-1, 1, 14), np.linspace(-1, 1, 8))
    return (1 + strength * x + 0.2 * y * y)[..., None].astype(np.float32)


@pytest.mark.parametrize("each", [False, True])
def test_flat_field_takes_a_near_lamp_out_of_swatch_and_card(tmp_path: Path, each: bool) -> None:
    plain, lit, boards = tmp_path / "plain", tmp_path / "lit", tmp_path / "boards"
    for folder in (plain, lit, boards):
        folder.mkdir()
    truth = lambert_scene(plain, swatch(), [1.0] * 4)
    for k, elevation in enumerate(ELEVATIONS):
        falloff = uneven(0.3 - 0.1 * k if each else 0.3)
        write_photo(lit / f"el{elevation}.exr", read_image(plain / f"el{elevation}.exr") * falloff)
        write_photo(boards / f"el{elevation}.exr", np.repeat(falloff, 3, -1) * np.float32(0.7 - 0.1 * k))
    settings = StackSettings(
        crop=(0, 0, 8, 8),
        white_card=(10, 0, 4, 8),
        white_reflectance=0.8,
        flat_field=boards if each else boards / "el15.exr",
    )
    stack = read_stack(lit, settings)
    # The card's mean and the board's mean are taken apart, exact where either is even: float32 rounding remains.
    assert np.allclose(stack.images, truth, rtol=1e-5)
    assert stack.facts["flat_field"]["per_photograph"] is each


def test_unusable_flat_fields(tmp_path: Path) -> None:
    stack, board = tmp_path / "stack", tmp_path / "board"
    stack.mkdir()
    board.mkdir()
    for k, frame in enumerate(gray_frames([0.2, 0.3])):
        write_photo(stack / f"el{30 + k}.exr", frame)
    hole = gray_frames([0.5])[0]
    hole[0, 0] = 0
    cases = {
        "is black": gray_frames([0.0])[0],
        "is black in places": hole,
        "is 4 x 6, the photographs are 8 x 6": gray_frames([0.5], (6, 4))[0],
    }
    for cause, frame in cases.items():
        write_photo(tmp_path / "flat.exr", frame)
        with pytest.raises(BakeError, match=rf"flat\.exr: {cause}"):
            read_stack(stack, StackSettings(flat_field=tmp_path / "flat.exr"))
    write_photo(board / "el30.exr", gray_frames([0.5])[0])
    with pytest.raises(BakeError, match=r"board: holds no board for el31\.exr"):
        read_stack(stack, StackSettings(flat_field=board))
    with pytest.raises(BakeError, match=r"gone\.exr: cannot be read"):
        read_stack(stack, StackSettings(flat_field=tmp_path / "gone.exr"))


def test_board_in_the_folder_is_no_part_of_the_stack(tmp_path: Path) -> None:
    for name, frame in zip(("a", "b", "flat"), gray_frames([0.2, 0.3, 0.9])):
        write_photo(tmp_path / f"{name}.exr", frame)
    assert read_stack(tmp_path, StackSettings(flat_field=tmp_path / "flat.exr")).names == ("a.exr", "b.exr")


# --- what cannot be used ---------------------------------------------------------------------------------


def test_one_photograph_only(tmp_path: Path) -> None:
    write_photo(tmp_path / "a.png", np.full((6, 8, 3), 90, np.uint8))
    with pytest.raises(BakeError, match="holds one photograph only"):
        read_stack(tmp_path)
    write_photo(tmp_path / "a_ev-2.png", np.full((6, 8, 3), 90, np.uint8))
    with pytest.raises(BakeError, match="2 photographs of one light only"):
        read_stack(tmp_path)


def test_two_sizes_name_both(tmp_path: Path) -> None:
    write_photo(tmp_path / "a.png", np.full((6, 8, 3), 90, np.uint8))
    write_photo(tmp_path / "b.png", np.full((8, 6, 3), 90, np.uint8))
    with pytest.raises(BakeError, match=r"b\.png: is 6 x 8, but a\.png is 8 x 6"):
        read_stack(tmp_path)


def test_black(tmp_path: Path) -> None:
    for k in range(3):
        write_photo(tmp_path / f"p{k}.png", np.zeros((6, 8, 3), np.uint8))
    with pytest.raises(BakeError, match="entirely black"):
        read_stack(tmp_path)
    write_photo(tmp_path / "p1.png", np.full((6, 8, 3), 90, np.uint8))
    assert "entirely black: p0.png, p2.png" in read_stack(tmp_path).warnings


def test_clipped(tmp_path: Path) -> None:
    for k in range(3):
        pixels = np.full((10, 10, 3), 120, np.uint8)
        pixels[: 4 * k] = 255
        write_photo(tmp_path / f"p{k}.png", pixels)
    stack = read_stack(tmp_path)
    told = [warning for warning in stack.warnings if "clipped" in warning]
    assert [warning[:6] for warning in told] == ["p1.png", "p2.png"]
    assert stack.facts["clipped_share"] == [0, 0.4, 0.8]
    assert read_stack(tmp_path, StackSettings(crop=(0, 8, 10, 2))).facts["clipped_share"] == [0, 0, 0]
    for k in range(3):
        write_photo(tmp_path / f"p{k}.png", np.full((10, 10, 3), 255, np.uint8))
    with pytest.raises(BakeError, match="is clipped in 100%"):
        read_stack(tmp_path)


def test_stack_beyond_memory_is_refused_from_the_headers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for k in range(4):
        write_photo(tmp_path / f"p{k}.png", np.full((60, 80, 3), 90, np.uint8))
    monkeypatch.setattr(plan, "MAX_STACK_BYTES", 4 * 60 * 80 * 12 - 1)
    with pytest.raises(BakeError, match="give a smaller size or crop"):
        read_stack(tmp_path)
    assert read_stack(tmp_path, StackSettings(size=40)).images.shape == (4, 30, 40, 3)


def test_memory_is_that_of_one_photograph_not_of_the_stack(tmp_path: Path) -> None:
    """Eight photographs of 3 megapixels, 36 MB each as float32."""
    pixels = np.random.default_rng(0).integers(0, 256, (75, 100, 3), np.uint8).repeat(20, axis=0).repeat(20, axis=1)
    for k in range(8):
        write_photo(tmp_path / f"p{k}.png", pixels - np.uint8(k), png__compressionLevel=1)
    tracemalloc.start()
    stack = read_stack(tmp_path, StackSettings(size=200))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert stack.images.shape == (8, 150, 200, 3)
    # The codes (9 MB), a strip decoded (8 MB) with its cumulated sums in float64 (2 x 17 MB), the narrow frame.
    assert peak < 80 << 20


@pytest.mark.parametrize(
    "wrong",
    [
        {"size": 1},
        {"size": 1.5},
        {"size": "big"},
        {"size": 10**9},
        {"decode": "log"},
        {"azimuth": float("nan")},
        {"azimuth": 500},
        {"spread": 0},
        {"spread": 91},
        {"crop": (0, 0, 0, 5)},
        {"crop": (0, 0, 5)},
        {"crop": (-1, 0, 5, 5)},
        {"crop": "0,0,5,5"},
        {"crop": (0, 0, 5.5, 5)},
        {"corners": ((0, 0), (0, 9), (9, 9), (9, 0))},
        {"corners": ((0, 0), (9, 0), (1, 1), (0, 9))},
        {"corners": ((0, 0), (9, 0), (9, 9))},
        {"corners": ((0, 0), (4, 0), (9, 0), (0, 9))},
        {"corners": ((0, 0), (9, 0), (9, float("inf")), (0, 9))},
        {"corners": (1, 2, 3, 4)},
        {"white_card": (0, 0, -1, 5)},
        {"white_reflectance": 0},
        {"white_reflectance": 1.1},
        {"albedo": 0},
        {"albedo": 1.01},
        {"albedo": "grey"},
        {"align": "always"},
        {"lights": 3},
        {"flat_field": object()},
        {"crop": (0, 0, 5, 5), "corners": ((0, 0), (9, 0), (9, 9), (0, 9))},
        {"white_card": (0, 0, 5, 5), "albedo": 0.5},
    ],
)
def test_settings_that_make_no_sense(wrong: dict[str, object]) -> None:
    with pytest.raises(BakeError, match="photograph settings"):
        StackSettings(**wrong)  # type: ignore[arg-type]


def test_settings_take_what_json_gives() -> None:
    settings = StackSettings(size=64.0, crop=[1, 2, 3, 4], lights="a.lp", albedo="0.5")  # type: ignore[arg-type]
    assert settings == StackSettings(size=64, crop=(1, 2, 3, 4), lights=Path("a.lp"), albedo=0.5)


# --- the account -----------------------------------------------------------------------------------------


def test_progress_and_facts(tmp_path: Path) -> None:
    lambert_scene(tmp_path, swatch(), [1.0] * 4)
    seen: list[tuple[str, float]] = []
    stack = read_stack(tmp_path, progress=lambda stage, share: seen.append((stage, share)))
    assert seen == [("reading", 0), *(("reading", (k + 1) / 4) for k in range(4)), ("aligning", 0), ("aligning", 1)]
    assert json.loads(json.dumps(stack.facts)) == stack.facts
    assert stack.facts["frame"]["size"] == [14, 8]
    assert stack.facts["lights"]["source"] == "file names"
    assert all("\n" not in warning for warning in stack.warnings)
    assert stack.directions is not None
    assert np.linalg.norm(stack.directions, axis=1) == pytest.approx(1)


def test_genuine_photographs(shared_data: Path) -> None:
    """Tiny relief: the light file names a subfolder, lights cover the dome, one plane is chosen and reported."""
    stack = read_stack(shared_data / "stacks" / "tiny_relief" / "jpg", StackSettings(spread=10))
    assert stack.directions is not None and 8 <= len(stack.names) < 240
    assert any("lights cover many azimuths" in warning for warning in stack.warnings)
    plane = np.radians(stack.facts["lights"]["arc"]["azimuth_deg"])
    across = stack.directions @ [-np.sin(plane), np.cos(plane), 0]
    assert np.abs(np.degrees(np.arcsin(across))).max() <= 10
    averages, cosines = stack.images.mean(axis=(1, 2, 3)), stack.directions[:, 2]
    assert np.corrcoef(averages, cosines)[0, 1] > 0.9  # a diffuse relief
    with pytest.raises(BakeError, match="folders inside are not entered: give jpg"):
        read_stack(shared_data / "stacks" / "tiny_relief")
