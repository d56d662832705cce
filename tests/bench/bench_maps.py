"""Maps beside plain least squares (Woodham 1980): on renders of another program, and on the gantry's swatches."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
from measured_materials.addon.gantry.photograph_arc import gantry_scene
from measured_materials.addon.gantry.swatches import SWATCHES
from measured_materials.addon.gantry.truth import photographed_around, truth_of
from measured_materials.bake.color_difference import ciede2000, lab_of
from measured_materials.bake.maps.bake import MapSettings, maps_of
from measured_materials.bake.maps.height import height_of
from measured_materials.bake.maps.normals import photometric_stereo
from measured_materials.bake.photographs import PhotoStack, StackSettings, read_stack
from PIL import Image
from record import put
from rich.console import Console
from rich.table import Table

PLATES = Path(__file__).resolve().parents[3] / "shared" / "data" / "stacks" / "rendered_plate"
_NAMES = ("single1", "single3", "single5", "multi2")
# Pixels and samples of the gantry's photographs.
_SIZE, _SAMPLES = 96, 16


def run(out: Path, quick: bool) -> int | None:
    """All plates that are here, and all swatches."""
    if PLATES.is_dir():
        _plates(quick)
    else:
        print("not here: stacks/rendered_plate of the shared data")
    _swatches(quick)
    return None if PLATES.is_dir() else 1


def _plates(quick: bool) -> None:
    table = Table("plate", "plain least squares", "--no-level", "bake maps", "s", title="mean error of the normals")
    for name in _NAMES[::2] if quick else _NAMES:
        dome = PLATES / name / "Dome"
        settings = StackSettings(lights=dome / "dirs.lp", align="off")
        stack = read_stack(sorted(dome.glob("image*.jpg")), settings.all_around())
        assert stack.directions is not None
        with Image.open(dome / "normals.png") as opened:
            truth = np.array(opened, float) / 127.5 - 1
        truth /= np.linalg.norm(truth, axis=-1, keepdims=True)
        plain = photometric_stereo(stack.images, stack.directions, robust=False).normals
        started = time.process_time()
        found = maps_of(stack, MapSettings(level=False), name)[0].normal
        seconds = time.process_time() - started
        level = maps_of(stack, MapSettings(), name)[0].normal
        errors = [_degrees(normal, truth) for normal in (plain, found, level)]
        for what, error in zip(("least squares", "maps", "level"), errors, strict=True):
            put(f"{name}, {what}", error)
        table.add_row(name, *(f"{error:.2f}°" for error in errors), f"{seconds:.1f}")
    Console(width=100).print(table)


def _swatches(quick: bool) -> None:
    """Geometry of the gantry under twenty lights on three rings."""
    title = "maps of swatches of known geometry: plain least squares -> bake maps"
    table = Table("swatch", "normals", "albedo (CIEDE2000)", "height (correlation)", "s", title=title)
    for name in ("suede", "plastic_5") if quick else SWATCHES:
        size = _SIZE // 2 if quick else _SIZE
        with gantry_scene(SWATCHES[name](0), size=size, samples=_SAMPLES) as gantry:
            images, directions = photographed_around(gantry)
            truth = truth_of(gantry)
        stack = PhotoStack(images, tuple(f"light {k}" for k in range(len(images))), directions, True, ())
        plain = photometric_stereo(images, directions, robust=False)
        started = time.process_time()
        # The gantry's sun is far away: a mean slope is the swatch's own.
        maps = maps_of(stack, MapSettings(level=False, repeats=True), name)[0]
        seconds = time.process_time() - started
        rows = [
            _scores(plain.normals, plain.albedo, height_of(plain.normals, repeats=True), truth),
            _scores(maps.normal, maps.albedo, maps.height, truth),
        ]
        for which, row in zip(("least squares", "maps"), rows, strict=True):
            for what, value in row.items():
                put(f"{name}, {what}, {which}", value)
        both: list[tuple[Any, Any]] = list(zip(rows[0].values(), rows[1].values(), strict=True))
        cells = (f"{a:.2f} -> {b:.2f}" for a, b in both)
        table.add_row(name, *cells, f"{seconds:.1f}")
    Console(width=100).print(table)


def _scores(normals: Any, albedo: Any, height: Any, truth: Any) -> dict[str, float]:
    """Mean error of normals in degrees, mean colour difference, correlation of heights."""
    difference = ciede2000(lab_of(albedo), lab_of(truth.albedo))
    return {
        "normals": _degrees(normals, truth.normals),
        "albedo": float(difference.mean()),
        "height": float(np.corrcoef(height.ravel(), truth.height.ravel())[0, 1]),
    }


def _degrees(a: Any, b: Any) -> float:
    return float(np.degrees(np.arccos(np.clip((a * b).sum(-1), -1, 1))).mean())
