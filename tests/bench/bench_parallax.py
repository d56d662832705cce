"""Parallax under shading maps: lookups moved by the relief, beside those that are not, against oblique views.

Every swatch of the gantry is photographed all around, and baked to a map over azimuth and, as by `bake maps --repeats`,
to heights. Seen from 30, 50 and 70 degrees, as no photograph shows it, under two lights that no photograph has, what
the map shows is compared with the geometry: as it is, moved by those heights, and moved by the geometry's own. How high
the relief lies as a whole no photograph tells, and one places an object where one wants it: all of these lie in the
plane of the geometry's mean height, and some, "unplaced", in that of its height 0.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(1, str(Path(__file__).resolve().parents[1]))

import numpy as np
from measured_materials.addon.gantry import techniques
from measured_materials.addon.gantry.photograph_arc import gantry_scene
from measured_materials.addon.gantry.swatches import SWATCHES
from measured_materials.addon.gantry.techniques import Case, Frames
from measured_materials.addon.gantry.truth import truth_of
from measured_materials.bake import xp_numpy
from measured_materials.bake.images.bilinear import texels_around
from measured_materials.bake.maps.bake import MapSettings, maps_of
from measured_materials.bake.maps.parallax import LAYERS, LEAST_COSINE, seen_at
from measured_materials.bake.source import Array
from record import put
from rich.console import Console
from rich.table import Table
from support.btf.figure_4 import AROUND_MAP, Radiance, of_stack
from support.gantry_maps import AROUND_CASES, renders_of, stack_of

# Between two photographs' elevations, and between their elevations and azimuths.
VIEWS, LIGHTS = (30.0, 50.0, 70.0), ((46.5, 0.0), (40.0, 112.5))
_SIDES = (82.0, 230.0)
CASES = tuple(
    Case(f"{theta:g} degrees", ((*light, 1.0),), (theta, phi)) for theta in VIEWS for phi in _SIDES for light in LIGHTS
)
GROUPS = tuple(dict.fromkeys(case.group for case in CASES))
_OVER = 4


@dataclass(frozen=True)
class Way:
    """How heights are used: the share of them, which of them, in how many layers, and whether in the right plane."""

    share: float
    heights: str = "photographs"
    layers: int = LAYERS
    placed: bool = True


WAYS = {
    "as it is": Way(0.0),
    "moved": Way(1.0),
    "moved by half": Way(0.5),
    "moved, 32 layers": Way(1.0, layers=32),
    "moved, true heights": Way(1.0, "geometry"),
    "as it is, unplaced": Way(0.0, placed=False),
    "moved, unplaced": Way(1.0, placed=False),
}


@dataclass(frozen=True, eq=False)
class Swatch:
    """Frames of a swatch, its map over azimuth, and its heights (H, W) in tiles by where they come from.

    mean : of the geometry's heights; the others are about 0, as those of `bake maps` are
    """

    frames: Frames
    mapped: Radiance
    heights: dict[str, Array]
    mean: float


def run(out: Path, quick: bool) -> None:
    """All swatches, or two of them, smaller."""
    size, samples = (48, 8) if quick else (96, 16)
    table = Table("swatch", "heights", "way", *GROUPS, title="RMS of the difference, in parts of the geometry's")
    for name in ("cloth", "stone") if quick else SWATCHES:
        swatch = make(name, size, samples)
        alike = float(np.corrcoef(*(h.ravel() for h in swatch.heights.values()))[0, 1])
        put(f"heights, {name}", alike)
        for way in WAYS:
            found = errors_of(swatch, way, size)
            for group, error in found.items():
                put(f"RMS, {name}, {way}, {group}", error)
            table.add_row(name, f"{alike:.2f}", way, *(f"{found[group]:.1%}" for group in GROUPS))
        table.add_section()
    Console(width=110).print(table)


def make(name: str, size: int, samples: int) -> Swatch:
    """Photograph it and bake both."""
    swatch = SWATCHES[name](0)
    with gantry_scene(swatch, size=size, samples=samples) as gantry:
        frames = techniques.photograph(gantry, (*AROUND_CASES, *CASES))
        true = truth_of(gantry).height
    stack = stack_of(AROUND_CASES, frames)
    found = maps_of(stack, MapSettings(repeats=True), name)[0].height.astype(np.float64)
    mapped = of_stack(AROUND_MAP, stack, "all", renders_of(swatch, stack)["family"]).radiance
    mean = float(true.mean())
    return Swatch(frames, mapped, {"photographs": found, "geometry": true - mean}, mean)


def errors_of(swatch: Swatch, way: str, size: int) -> dict[str, float]:
    """RMS by angle of the view."""
    how = WAYS[way]
    rows: dict[str, list[dict[str, float]]] = {group: [] for group in GROUPS}
    for case in CASES:
        uv = techniques.frame_uv(size, case.view_radians, _OVER)
        (light,), (theta, phi) = case.lights, case.view
        wi, wo = np.array(techniques.direction(*light[:2])), np.array(techniques.direction(90 - theta, phi))
        if how.placed:
            uv = uv + swatch.mean * wo[:2] / wo[2]
        if how.share:
            uv = moved(uv, wo, how.share * swatch.heights[how.heights], how.layers)
        shown = techniques.pixels(swatch.mapped(uv, wi, wo), _OVER)
        rows[case.group].append(techniques.errors(shown, techniques.truth(case, swatch.frames)))
    return {group: techniques.mean_errors(each)["rms"] for group, each in rows.items()}


def moved(uv: Array, wo: Array, heights: Array, layers: int) -> Array:
    """Coordinates of what is seen there from wo."""

    def height(place: Array) -> Array:
        around = texels_around(heights.shape, place[..., :2])
        return np.sum([weight * heights[index] for index, weight in around], axis=0)

    place = np.concatenate([uv, np.zeros_like(uv[..., :1])], -1)
    step = np.array([wo[0], wo[1], 0.0]) / max(float(wo[2]), LEAST_COSINE)
    return seen_at(xp_numpy, height, place, step, float(heights.min()), float(heights.max()), layers)[..., :2]
