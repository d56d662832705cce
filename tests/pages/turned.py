"""Suede and cloth of the gantry, turned under a lamp that stays: the geometry, a map over azimuth, a map of one arc."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from commands import save
from mathutils import Matrix, Vector
from measured_materials.addon.gantry import techniques
from measured_materials.addon.gantry.photograph_arc import gantry_scene
from measured_materials.addon.gantry.scene import Gantry
from measured_materials.addon.gantry.swatches import SWATCHES
from measured_materials.addon.lights.light_tables import lamp_image, update_scene
from measured_materials.addon.rendering.contact_sheet import Cell, write_sheet
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.photographs.stack import PhotoStack
from measured_materials.bake.shading_maps.bake import ArcSettings, Azimuths, bake_stack
from measured_materials.bake.shading_maps.render_settings import RenderSettings
from measured_materials.bake.source import Array
from measured_materials.nodes.shading_map_material import build_shading_map
from PIL import Image

NAMES = ("suede", "cloth")
# Of the lights of the photographs, in degrees: one arc, and seven azimuths more.
ARC = [(float(elevation), 0.0) for elevation in np.linspace(5, 88, 10)]
AROUND = ARC + [(e, a) for a in range(45, 360, 45) for e in (10.0, 30.0, 50.0, 70.0)]
# Of the lamp, whose elevation and, once turned, azimuths lie between those of the photographs.
ELEVATION, TURNS = 37.0, tuple(range(0, 360, 60))
_PHOTOGRAPH, _SAMPLES, _EDGE = 160, 48, 144
# A wide lamp, in every picture: mirrors find the sun's own half degree with ten times the noise.
_SUN = math.radians(5)


def make(out: Path, folder: Path) -> None:
    """turned.jpg, and the errors and the noise beneath each picture."""
    cells: list[Cell] = []
    for name in NAMES:
        cells += row_of_cells(name, folder)
    write_sheet(folder / "turned.png", cells, len(TURNS))
    save(Image.open(folder / "turned.png"), out / "turned.jpg", width=680)


def row_of_cells(name: str, folder: Path) -> list[Cell]:
    """Three rows of one swatch."""
    swatch = SWATCHES[name](0)
    bundles = {"over azimuth": baked(name, folder, AROUND, "all"), "of one arc": baked(name, folder, ARC, "arc")}
    with turntable(swatch, 32) as gantry:
        truth = [turned(gantry, turn) for turn in TURNS]
    bright = 0.7 / max(float(np.percentile(picture, 98)) for picture in truth)
    cells = [Cell(p * bright, f"{name.capitalize()}, geometry", f"turned by {t}°") for p, t in zip(truth, TURNS)]
    for words, bundle in bundles.items():
        material = build_shading_map(bundle, lamps=lamp_image())
        with turntable(material, 32) as gantry:
            began = time.process_time()
            pictures = [turned(gantry, turn) for turn in TURNS]
            took = time.process_time() - began
            again = [turned(gantry, turn, seed=1) for turn in TURNS[:2]]
        noise = [np.sqrt(((a - b) ** 2).mean() / 2) / a.mean() for a, b in zip(pictures, again)]
        print(f"  {name}, map {words}: noise {np.mean(noise):.1%}, {took / len(TURNS):.1f} s a picture", flush=True)
        for picture, wanted, turn in zip(pictures, truth, TURNS):
            error = techniques.errors(picture, wanted)["rms"]
            print(f"  {name}, map {words}, turned by {turn}: {error:.0%} RMS", flush=True)
            cells.append(Cell(picture * bright, f"Map {words}", f"{error:.0%} off"))
    return cells


def baked(name: str, folder: Path, lights: list[tuple[float, float]], azimuths: Azimuths) -> Bundle:
    """The map of a swatch that is photographed from above under these lights; taken from `folder` if it is there."""
    path = folder / f"{name}_{azimuths}.mmat"
    if not path.exists():
        swatch = SWATCHES[name](0)
        with gantry_scene(swatch, size=_PHOTOGRAPH, samples=_SAMPLES) as gantry:
            gantry.set_view(0, 0)
            pictures = []
            for elevation, azimuth in lights:
                gantry.set_light(math.radians(90 - elevation), math.radians(azimuth))
                pictures.append(gantry.render())
        directions = np.array([techniques.direction(*light) for light in lights])
        stack = PhotoStack(np.stack(pictures), tuple(map(str, lights)), directions, True, ())
        averages = stack.images.mean((1, 2, 3), dtype=np.float64)
        render: RenderSettings = techniques.fitted_render(swatch.lobe, np.arcsin(directions[:, 2]), averages)
        bake_stack(stack, path, ArcSettings(azimuths=azimuths, render=render), name=f"{name}_{azimuths}")
    return read_bundle(path)


@contextmanager
def turntable(target: Any, samples: int) -> Iterator[Gantry]:
    """The gantry under a wide lamp."""
    with gantry_scene(target, size=_EDGE, samples=samples, sun_angle=_SUN) as gantry:
        gantry.set_light(math.radians(90 - ELEVATION), 0)
        # Else Cycles would keep the table of lamps as it was for the first picture, and aim where none is any more.
        gantry.scene.render.use_persistent_data = False
        yield gantry


def turned(gantry: Gantry, turn: float, seed: int = 0) -> Array:
    """From above, the target turned counter-clockwise by degrees: lamp and camera are turned the other way."""
    angle = math.radians(turn)
    gantry.set_light(math.radians(90 - ELEVATION), -angle)
    gantry.set_view(0, 0)
    camera: bpy.types.Object = gantry.scene.camera
    middle = Matrix.Translation(Vector((gantry.tile / 2, gantry.tile / 2, 0)))
    camera.matrix_world = middle @ Matrix.Rotation(-angle, 4, "Z") @ middle.inverted() @ camera.matrix_world
    update_scene(gantry.scene)
    return gantry.render(seed)
