"""What `bench parallax` compares with the geometry: lights that no photograph has, in the plane of its mean height."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(1, str(Path(__file__).parent / "bench"))

from bench_parallax import _OVER, CASES, LIGHTS, WAYS, Swatch, errors_of
from measured_materials.addon.gantry import techniques
from support.gantry_maps import AROUND_CASES

SIZE, MEAN = 24, 0.03


def pattern(uv: np.ndarray, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
    return np.repeat(1 + np.sin(2 * np.pi * uv[..., :1]) * np.cos(2 * np.pi * uv[..., 1:]), 3, -1)


def test_its_lights_are_held_out() -> None:
    given = np.array([techniques.direction(*case.lights[0][:2]) for case in AROUND_CASES])
    for light in LIGHTS:
        assert np.degrees(np.arccos((given @ techniques.direction(*light)).max())) > 4


def test_what_lies_flat_at_the_mean_height_is_seen_there_by_every_way_that_is_placed() -> None:
    frames = {}
    for case in CASES:
        wo = np.array(techniques.direction(90 - case.view[0], case.view[1]))
        uv = techniques.frame_uv(SIZE, case.view_radians, _OVER) + MEAN * wo[:2] / wo[2]
        shown = techniques.pixels(pattern(uv, wo, wo), _OVER)
        frames |= dict.fromkeys(case.frames, shown)
    flat = np.zeros((SIZE, SIZE))
    swatch = Swatch(frames, pattern, {"photographs": flat, "geometry": flat}, MEAN)
    for name, way in WAYS.items():
        found = errors_of(swatch, name, SIZE)
        assert max(found.values()) < 1e-9 if way.placed else min(found.values()) > 0.02, name
