"""Shadows of relief that move with the light are not a moved camera."""

from __future__ import annotations

import numpy as np
import pytest
from measured_materials.bake.photographs import shifts
from measured_materials.bake.photographs.held_out import helpful_moves
from measured_materials.bake.photographs.radiometry.light_drift import light_drift
from support.photo_files import weave

ELEVATIONS = np.radians([8, 17, 26, 35, 44, 53, 62, 71, 80, 88])


def arc(azimuth: float = 0.4) -> np.ndarray:
    flat = np.cos(ELEVATIONS)
    return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(ELEVATIONS)], -1)


def drift_of(directions: np.ndarray) -> np.ndarray:
    """As the cloth of the virtual gantry shows it: up to 2 texels along the light, most at grazing."""
    theta = np.arccos(directions[:, 2])
    towards = directions[:, :2] * [1, -1] / np.hypot(*directions[:, :2].T)[:, None]
    return towards * (1.1 * theta**2 - 0.4 * theta)[:, None]


@pytest.mark.parametrize("planted", [None, 0, 4, 9])
def test_what_follows_the_light_is_taken_off_and_movement_stays(planted: int | None) -> None:
    rng = np.random.default_rng(1)
    directions = arc()
    displacement = drift_of(directions) + 0.03 * rng.standard_normal((10, 2))
    movement = np.zeros((10, 2))
    if planted is not None:
        movement[planted] = (-1.0, 2.0)
    sigma, bounds = np.full(10, 0.05), np.full(10, 0.5)
    rest = displacement + movement - light_drift(displacement + movement, sigma, directions, bounds)
    moved = np.hypot(*rest.T) > 0.5
    assert list(np.flatnonzero(moved)) == ([] if planted is None else [planted])


def test_a_bumped_tripod_is_not_explained_away() -> None:
    directions = arc()
    displacement = np.zeros((10, 2))
    displacement[5:] = (0.3, -1.8)
    assert not light_drift(displacement, np.full(10, 0.05), directions, np.full(10, 0.5)).any()
    assert not light_drift(displacement, np.full(10, 0.05), None, np.full(10, 0.5)).any()


# --- too few lights to fit a drift: what is moved back must fit its neighbours better ---------------------

FEW = np.radians([10, 20, 35, 55, 80])


def rough(seed: int, margin: int = 8, size: int = 160) -> tuple[np.ndarray, np.ndarray]:
    """Five photographs (5, size, size, 3) of rough relief from a fixed camera, lit from the right, with shadows."""
    whole = size + 2 * margin
    rng = np.random.default_rng(seed)
    fy, fx = np.fft.fftfreq(whole)[:, None], np.fft.rfftfreq(whole)
    smooth = np.exp(-2 * np.pi**2 * 0.7**2 * (fx * fx + fy * fy))
    height = np.fft.irfft2(np.fft.rfft2(weave(whole, whole, seed + 8) * 20) * smooth, s=(whole, whole))
    slope_y, slope_x = np.gradient(height)
    normal = np.stack([-slope_x, slope_y, np.ones_like(height)], -1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    directions = np.stack([np.cos(FEW), np.zeros(5), np.sin(FEW)], -1)
    frames = []
    for direction, slope in zip(directions, np.tan(FEW)):
        lit = np.ones_like(height)
        for step in range(1, 12):  # a neighbour towards the light that stands higher than the ray throws a shadow
            lit = np.minimum(lit, np.clip(1 - 4 * (np.roll(height, -step, 1) - height - step * slope), 0, 1))
        shade = np.maximum(normal @ direction, 0) * lit * (0.3 + 0.4 * weave(whole, whole, seed))
        frames.append(np.maximum(shade + 0.002 * rng.standard_normal(height.shape), 0))
    return np.array(frames, np.float32)[..., None].repeat(3, -1), directions


def window(frames: np.ndarray, moved: int | None = None, by: tuple[int, int] = (0, 0), margin: int = 8) -> np.ndarray:
    """The middle of each frame, one of them displaced by whole pixels (x, y)."""
    size = frames.shape[1] - 2 * margin
    places = [by if k == moved else (0, 0) for k in range(len(frames))]
    cut = [f[margin - y : margin - y + size, margin - x : margin - x + size] for f, (x, y) in zip(frames, places)]
    return np.ascontiguousarray(cut)


@pytest.mark.parametrize("seed", [4, 5])
def test_few_photographs_whose_light_alone_moved_stay(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    frames, directions = rough(seed)
    images = window(frames)
    found = shifts.measure(images, directions)
    assert not found.moved.any()
    assert shifts.correct(images, found)[0] is images
    # Significant by itself: it takes the two together, the drift of few and that moving back does not help.
    monkeypatch.setattr(shifts, "light_drift", lambda displacement, *_: np.zeros_like(displacement))
    monkeypatch.setattr(shifts, "helpful_moves", lambda gray, moves, *_: moves)
    assert shifts.measure(images, directions).moved.any()


def test_what_is_significant_stays_where_moving_back_does_not_help(monkeypatch: pytest.MonkeyPatch) -> None:
    frames, directions = rough(1)
    monkeypatch.setattr(shifts, "light_drift", lambda displacement, *_: np.zeros_like(displacement))
    found = shifts.measure(window(frames), directions)
    assert np.nanmax(np.hypot(*found.displacement.T)) > 1.2 * shifts.SMALLEST_PIXELS and not found.moved.any()
    monkeypatch.setattr(shifts, "helpful_moves", lambda gray, moves, *_: moves)
    assert shifts.measure(window(frames), directions).moved.any()


@pytest.mark.parametrize("moved", [1, 3])
def test_few_photographs_of_which_one_moved_are_mended(moved: int) -> None:
    frames, directions = rough(2)
    images = window(frames, moved, (2, -3))
    found = shifts.measure(images, directions)
    assert found.moved.tolist() == [k == moved for k in range(5)]
    assert found.displacement[moved] == pytest.approx([2, -3], abs=0.5)


def test_lines_are_moved_along_one_axis_only() -> None:
    """Across fine lines an error of a fifth of a pixel spoils more than two pixels along them repair."""
    y, x = np.mgrid[:96, :96].astype(float)
    lines = 0.5 + 0.3 * np.sin(2 * np.pi * y / 6) + 0.02 * np.sin(2 * np.pi * x / 23)
    other = 0.5 + 0.3 * np.sin(2 * np.pi * y / 6) + 0.02 * np.sin(2 * np.pi * (x - 2) / 23)
    gray = np.array([lines, other, lines])
    chosen, apart = np.array([False, True, False]), np.abs(np.subtract.outer(np.arange(3.0), np.arange(3.0)))
    moves = helpful_moves(gray, np.array([[0, 0], [2, 0.2], [0, 0]]), chosen, apart)
    assert moves.tolist() == [[0, 0], [2, 0], [0, 0]]
    assert not helpful_moves(gray, np.array([[0, 0], [0, 0.6], [0, 0]]), chosen, apart).any()
