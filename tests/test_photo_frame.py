"""Crop, homography, area average, orientation, and the camera's movements."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from measured_materials.bake.errors import BakeError
from measured_materials.bake.photographs import StackSettings, read_stack, shifts
from measured_materials.bake.photographs.frame import area_average, homography, place, resample, upright
from support.photo_files import weave, write_photo


def place_and_resample(image: np.ndarray, settings: StackSettings) -> np.ndarray:
    height, width = image.shape[:2]
    placement = place(Path("a.png"), width, height, settings)
    x, y, w, h = placement.region
    region = image[y : y + h, x : x + w].astype(np.float32)
    return resample(lambda start, stop: region[start:stop], placement)


def gradient(height: int, width: int) -> np.ndarray:
    """Red is x, green is y, in pixels, at pixel centres."""
    y, x = np.mgrid[:height, :width] + 0.5
    return np.stack([x, y, np.ones_like(x)], -1).astype(np.float32)


@pytest.mark.parametrize(("n", "count"), [(12, 12), (12, 4), (13, 5), (7, 6), (100, 1)])
def test_area_average_is_the_integral_over_each_share(n: int, count: int) -> None:
    values = np.random.default_rng(n).random((n, 2, 3)).astype(np.float32)
    fine = np.repeat(values, count, axis=0).reshape(count, n, 2, 3).mean(axis=1)
    assert np.allclose(area_average(values, count, 0), fine, atol=1e-6)
    assert np.allclose(area_average(values.swapaxes(0, 1), count, 1), fine.swapaxes(0, 1), atol=1e-6)


def test_size_reduces_the_longer_side_and_never_enlarges() -> None:
    image = np.random.default_rng(0).random((30, 50, 3)).astype(np.float32)
    assert place_and_resample(image, StackSettings(size=20)).shape == (12, 20, 3)
    assert place_and_resample(image, StackSettings(size=80)).shape == (30, 50, 3)
    assert place_and_resample(image, StackSettings(size=20)).mean() == pytest.approx(image.mean(), abs=1e-6)


def test_crop() -> None:
    image = gradient(20, 30)
    assert np.array_equal(place_and_resample(image, StackSettings(crop=(3, 5, 10, 8))), image[5:13, 3:13])


def test_corners_on_pixel_borders_are_a_crop() -> None:
    image = np.random.default_rng(0).random((20, 30, 3)).astype(np.float32)
    corners = ((3, 5), (13, 5), (13, 13), (3, 13))
    assert np.allclose(place_and_resample(image, StackSettings(corners=corners)), image[5:13, 3:13], atol=1e-6)


@pytest.mark.parametrize("size", [None, 24])
def test_homography_makes_an_oblique_square_straight(size: int | None) -> None:
    """A picture of coordinates comes back as the homography's own coordinates."""
    corners = ((12.0, 9.0), (88.0, 14.0), (95.0, 71.0), (6.0, 66.0))
    result = place_and_resample(gradient(80, 100), StackSettings(corners=corners, size=size))
    height, width = result.shape[:2]
    y, x = np.mgrid[:height, :width] + 0.5
    u, v, w = np.einsum("ij,jyx->iyx", homography(np.array(corners), width, height), [x, y, np.ones_like(x)])
    # Bilinear taps are exact for coordinates; the mean over a texel bends with the perspective: below 0.02 pixels.
    assert np.abs(result[..., 0] - u / w).max() < 0.02
    assert np.abs(result[..., 1] - v / w).max() < 0.02


def test_rectified_detail_is_averaged_not_aliased() -> None:
    checker = (np.indices((240, 240)).sum(0) % 2).astype(np.float32)[..., None].repeat(3, -1)
    corners = ((10.0, 12.0), (230.0, 8.0), (226.0, 231.0), (7.0, 228.0))
    result = place_and_resample(checker, StackSettings(corners=corners, size=30))
    # Nearest taps would give 0 and 1; the area holds 54 pixels, a mean off 0.5 by a few border pixels.
    assert np.abs(result - 0.5).max() < 0.1


@pytest.mark.parametrize(
    "settings",
    [
        StackSettings(crop=(0, 0, 31, 5)),
        StackSettings(crop=(0, 20, 5, 1)),
        StackSettings(crop=(0, 0, 1, 9)),
        StackSettings(corners=((0, 0), (31, 0), (31, 20), (0, 20))),
        StackSettings(crop=(0, 0, 30, 3), size=4),
    ],
)
def test_crop_outside_or_too_small(settings: StackSettings) -> None:
    with pytest.raises(BakeError):
        place(Path("a.png"), 30, 20, settings)


@pytest.mark.parametrize("code", range(1, 9))
def test_orientation_codes(code: int) -> None:
    """Row 0 and column 0 of the stored picture lie where Exif says (Exif 2.3, table on Orientation)."""
    stored = np.arange(6).reshape(2, 3, 1)
    row0 = {1: "top", 2: "top", 3: "bottom", 4: "bottom", 5: "left", 6: "right", 7: "right", 8: "left"}
    column0 = {1: "left", 2: "right", 3: "right", 4: "left", 5: "top", 6: "top", 7: "bottom", 8: "bottom"}
    shown = upright(stored, code)[..., 0]
    side = {"top": shown[0], "bottom": shown[-1], "left": shown[:, 0], "right": shown[:, -1]}
    assert set(side[row0[code]]) == {0, 1, 2}
    assert set(side[column0[code]]) == {0, 3}


def test_orientation_counts_where_all_agree(tmp_path: Path) -> None:
    pixels = np.arange(6 * 8 * 3, dtype=np.uint8).reshape(6, 8, 3)
    for k in range(2):
        write_photo(tmp_path / f"el{20 + k}.png", pixels, Orientation=6)
    assert read_stack(tmp_path).images.shape == (2, 8, 6, 3)
    write_photo(tmp_path / "el21.png", pixels, Orientation=8)
    stack = read_stack(tmp_path)
    assert stack.images.shape == (2, 6, 8, 3)
    assert any("orientation tags differ" in warning for warning in stack.warnings)


def test_directions_follow_a_swatch_turned_in_the_frame(tmp_path: Path) -> None:
    """The swatch's upper side lies at the photograph's right: its x axis points down, its y axis right."""
    for k in range(2):
        write_photo(tmp_path / f"el{20 + 30 * k}.png", np.full((20, 20, 3), 90 + k, np.uint8))
    corners = ((18.0, 2.0), (18.0, 18.0), (2.0, 18.0), (2.0, 2.0))
    stack = read_stack(tmp_path, StackSettings(corners=corners))
    assert stack.directions is not None
    assert stack.directions[0] == pytest.approx([0, np.cos(np.radians(20)), np.sin(np.radians(20))])
    assert stack.facts["frame"]["turned_deg"] == pytest.approx(-90)


# --- movements of the camera -----------------------------------------------------------------------------


def lit_weave(n: int = 8, size: int = 160) -> tuple[np.ndarray, np.ndarray]:
    """A coloured, bumpy surface lit along an arc, (n, size, size, 3), with margins of 16; noise as of a camera."""
    rng = np.random.default_rng(1)
    albedo, height = weave(size + 32, size + 32), weave(size + 32, size + 32, seed=9) * 6
    slope_y, slope_x = np.gradient(height)
    elevation = np.radians(np.linspace(15, 165, n))
    directions = np.stack([np.cos(elevation), np.zeros(n), np.sin(elevation)], -1)
    normal = np.stack([-slope_x, slope_y, np.ones_like(slope_x)], -1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    shade = np.maximum(normal @ directions.T, 0).transpose(2, 0, 1) * albedo
    shade += 0.003 * rng.standard_normal(shade.shape)
    return np.maximum(shade, 0)[..., None].repeat(3, -1).astype(np.float32), directions


def cut(frames: np.ndarray, moves: dict[int, tuple[int, int]]) -> np.ndarray:
    """The middle of each frame, its content displaced by whole pixels (x, y) where asked: nothing is interpolated."""
    size = frames.shape[1] - 32
    out = []
    for k, frame in enumerate(frames):
        x, y = moves.get(k, (0, 0))
        out.append(frame[16 - y : 16 - y + size, 16 - x : 16 - x + size])
    return np.ascontiguousarray(out)


def test_fixed_camera_under_changing_light_is_left_alone() -> None:
    frames, directions = lit_weave()
    found = shifts.measure(cut(frames, {}), directions)
    assert not found.moved.any()
    assert np.nanmax(np.abs(found.displacement)) < shifts.SMALLEST_PIXELS


def test_moved_photograph_is_found_and_moved_back() -> None:
    frames, directions = lit_weave()
    still, moved = cut(frames, {}), cut(frames, {2: (3, -2)})
    before = np.abs(moved[2] - still[2]).mean()
    found = shifts.measure(moved, directions)
    assert found.moved.tolist() == [k == 2 for k in range(8)]
    assert found.displacement[2] == pytest.approx([3, -2], abs=0.3)
    aligned, border = shifts.correct(moved, found)
    left, top, right, bottom = border
    assert aligned.shape[1:3] == (160 - top - bottom, 160 - left - right)
    expected = still[:, top : 160 - bottom, left : 160 - right]
    assert np.array_equal(np.delete(aligned, 2, 0), np.delete(expected, 2, 0))
    # Off by the fraction of a texel that the measurement missed; before, it was off by whole ones.
    assert np.abs(aligned[2] - expected[2]).mean() < 0.2 * before


def test_half_texels_are_found() -> None:
    frames, directions = lit_weave(size=320)
    fine = cut(frames, {3: (3, 1)})
    coarse = area_average(area_average(fine[:, :320, :320], 160, 1), 160, 2)
    found = shifts.measure(coarse, directions)
    assert found.displacement[3] == pytest.approx([1.5, 0.5], abs=0.3)
    assert found.moved.tolist() == [k == 3 for k in range(8)]


def test_camera_bumped_half_way(tmp_path: Path) -> None:
    frames, directions = lit_weave()
    found = shifts.measure(cut(frames, dict.fromkeys((5, 6, 7), (0, 4))), directions)
    assert found.moved.tolist() == [False] * 5 + [True] * 3
    assert found.displacement[5:] == pytest.approx(np.tile([0, 4], (3, 1)), abs=0.3)


def test_too_far_is_told_and_left() -> None:
    frames, directions = lit_weave()
    moved = cut(frames, {4: (12, 0)})
    found = shifts.measure(moved, directions)
    assert found.too_far.tolist() == [k == 4 for k in range(8)]
    assert found.displacement[4] == pytest.approx([12, 0], abs=0.3)
    assert shifts.correct(moved, found)[0] is moved


@pytest.mark.parametrize("frames", [np.zeros((3, 70, 70, 3)), np.ones((3, 70, 70, 3)), np.ones((3, 20, 90, 3))])
def test_nothing_to_see_is_no_movement(frames: np.ndarray) -> None:
    found = shifts.measure(frames.astype(np.float32), None)
    assert np.isnan(found.displacement).all() and not found.moved.any()


def test_unrelated_noise_is_no_movement() -> None:
    frames = np.random.default_rng(0).random((5, 96, 96, 3)).astype(np.float32)
    assert not shifts.measure(frames, None).moved.any()


def test_a_weave_that_repeats_is_taken_by_its_nearest_peak() -> None:
    """Period 12, moved by 4: 8 to the left looks nearly the same, save for the irregularity that every cloth has."""
    rng = np.random.default_rng(3)
    tile = np.tile(weave(12, 12), (12, 12)) + 0.1 * (weave(144, 144) - 0.5)
    frames = np.stack(
        [np.roll(tile, 4 if k == 2 else 0, 1) + 0.002 * rng.standard_normal(tile.shape) for k in range(5)]
    )
    found = shifts.measure(frames[..., None].repeat(3, -1).astype(np.float32), None)
    assert found.displacement[2] == pytest.approx([4, 0], abs=0.3)


@pytest.mark.parametrize("mode", ["auto", "warn", "off"])
def test_modes(tmp_path: Path, mode: str) -> None:
    frames, directions = lit_weave(6)
    lines = ["file,x,y,z"]
    for k, frame in enumerate(cut(frames, {1: (3, 0)})):
        write_photo(tmp_path / f"p{k}.exr", frame)
        lines.append(f"p{k}.exr," + ",".join(f"{v:.6f}" for v in directions[k]))
    (tmp_path / "lights.csv").write_text("\n".join(lines))
    stack = read_stack(tmp_path, StackSettings(align=mode, sides="both"))
    told = [warning for warning in stack.warnings if "camera moved" in warning]
    assert len(told) == (mode != "off")
    assert stack.images.shape[2] in ((156, 157) if mode == "auto" else (160,))
    facts = stack.facts["alignment"]
    assert facts.get("corrected", []) == ([] if mode == "off" else [mode == "auto" and k == 1 for k in range(6)])


@pytest.mark.parametrize(
    ("name", "limit"),
    [
        ("gold_icon", 0.3),  # a dome with a fixed camera
        ("rendered_plate/single3/Dome", 0.2),  # renders: nothing moves
        ("rendered_plate/multi2/Dome", 0.25),
    ],
)
def test_genuine_stacks_with_a_fixed_camera(shared_data: Path, name: str, limit: float) -> None:
    stack = read_stack(shared_data / "stacks" / name, StackSettings(azimuth=90, spread=8, sides="both", align="off"))
    found = shifts.measure(stack.images, stack.directions)
    assert not found.moved.any()
    assert np.nanmax(np.hypot(*found.displacement.T)) < limit
    # A movement planted into the photograph whose place is known best, by whole pixels and by halves.
    k = int(np.nanargmin(np.where(np.arange(len(found.moved)) > 0, found.uncertain + (found.uncertain == 0), np.nan)))
    for move in ((3.0, 0.0), (1.5, -1.5)):
        images = stack.images.copy()
        shifted = shifts._shift_axis(shifts._shift_axis(images[k], -move[0], 1), -move[1], 0)
        images[k] = np.maximum(shifted, 0)
        again = shifts.measure(images, stack.directions)
        assert again.displacement[k] - found.displacement[k] == pytest.approx(move, abs=0.3)
        assert again.moved.tolist() == [j == k for j in range(len(again.moved))]


def test_hand_held_stack_did_move(shared_data: Path) -> None:
    """The canvas was taken in two sittings: the same displacement is found from any choice of the lights."""
    folder = shared_data / "stacks" / "canvas"
    positions = []
    for azimuth in (20, 40):
        stack = read_stack(folder, StackSettings(azimuth=azimuth, spread=15, sides="both", align="off"))
        found = shifts.measure(stack.images, stack.directions)
        assert found.moved.sum() >= 5
        positions.append(dict(zip(stack.names, found.displacement)))
    common = [name for name in positions[0] if name in positions[1]]
    difference = np.array([positions[0][name] - positions[1][name] for name in common])
    # Each set has its own origin; about it both agree to 0.3 texels while the movement spans two.
    assert np.abs(difference - np.median(difference, axis=0)).max() < 0.3
    assert np.ptp([positions[0][name][0] for name in common]) > 1
