"""Shadows of relief that move with the light are not a moved camera."""

from __future__ import annotations

import numpy as np
import pytest
from measured_materials.bake.photographs.light_drift import light_drift

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
