"""Normals of maps beside plain least squares (Woodham 1980), on renders whose true normals are known."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from measured_materials.bake.maps.bake import MapSettings, all_around, maps_of
from measured_materials.bake.maps.normals import photometric_stereo
from measured_materials.bake.photographs import StackSettings, read_stack
from PIL import Image
from record import put
from rich.console import Console
from rich.table import Table

PLATES = Path(__file__).resolve().parents[3] / "shared" / "data" / "stacks" / "rendered_plate"
_NAMES = ("single1", "single3", "single5", "multi2")


def run(out: Path, quick: bool) -> int | None:
    """All plates that are here."""
    if not PLATES.is_dir():
        print("not here: stacks/rendered_plate of the shared data")
        return 1
    table = Table("plate", "plain least squares", "--no-level", "bake maps", "s", title="mean error of the normals")
    for name in _NAMES[::2] if quick else _NAMES:
        dome = PLATES / name / "Dome"
        settings = StackSettings(lights=dome / "dirs.lp", align="off")
        stack = read_stack(sorted(dome.glob("image*.jpg")), all_around(settings))
        assert stack.directions is not None
        with Image.open(dome / "normals.png") as opened:
            truth = np.array(opened, float) / 127.5 - 1
        truth /= np.linalg.norm(truth, axis=-1, keepdims=True)
        plain = photometric_stereo(stack.images, stack.directions, robust=False).normals
        started = time.process_time()
        found = maps_of(stack, MapSettings(level=False), name)[0].normal
        seconds = time.process_time() - started
        level = maps_of(stack, MapSettings(), name)[0].normal
        errors = [
            float(np.degrees(np.arccos(np.clip((normal * truth).sum(-1), -1, 1))).mean())
            for normal in (plain, found, level)
        ]
        for what, error in zip(("least squares", "maps", "level"), errors, strict=True):
            put(f"{name}, {what}", error)
        table.add_row(name, *(f"{error:.2f}°" for error in errors), f"{seconds:.1f}")
    Console(width=100).print(table)
    return None
