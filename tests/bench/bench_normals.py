"""What photographs can tell of the normals of cloth: `bake maps`, and what keeps any such fit from them.

Swatches of the gantry under the twenty lights of `bench maps`, smaller. Beside the fit stand one that is told the
shadows, by the geometry's own, and fits of photographs that no camera takes: without shadows and light between texels,
and of geometry that is white and matte too. The truth is the geometry's mean normal in a texel.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(1, str(Path(__file__).resolve().parents[1]))

import bpy
import numpy as np
from measured_materials.addon.gantry.photograph_arc import gantry_scene
from measured_materials.addon.gantry.scene import Gantry
from measured_materials.addon.gantry.swatches import SWATCHES
from measured_materials.addon.gantry.truth import all_of, photographed_around, truth_of
from measured_materials.bake.maps.bake import MapSettings, maps_of
from measured_materials.bake.photographs.stack import PhotoStack
from measured_materials.nodes import compat
from record import put
from rich.console import Console
from rich.table import Table
from support.known_shadows import normals_of

NAMES = ("suede", "cloth", "jeans", "wool", "stone")
WAYS = ("bake maps", "known shadows", "no shadows", "white, no shadows")
_SIZE, _SAMPLES = 48, 16


def run(out: Path, quick: bool) -> None:
    """A table of mean errors in degrees, of two swatches or all."""
    table = Table("swatch", *WAYS, title="mean error of the normals, degrees")
    for name in NAMES[1:3] if quick else NAMES:
        errors = errors_of(name, _SIZE // 2 if quick else _SIZE, _SAMPLES)
        for way, error in errors.items():
            put(f"{name}, {way}", error)
        table.add_row(name, *(f"{errors[way]:.1f}" for way in WAYS))
    Console(width=100).print(table)


def errors_of(name: str, size: int, samples: int) -> dict[str, float]:
    """Mean angle between found and true normals, in degrees, by `WAYS`."""
    with gantry_scene(SWATCHES[name](0), size=size, samples=samples) as gantry:
        truth = truth_of(gantry).normals
        images, directions = photographed_around(gantry)
        gantry.scene.cycles.max_bounces = 0
        with all_of(gantry, _white()):
            matte, _ = photographed_around(gantry)
            _cast_no_shadows(gantry)
            unhidden, _ = photographed_around(gantry)
        alone, _ = photographed_around(gantry)
    visibility = np.clip(matte.mean(-1) / np.maximum(unhidden.mean(-1), 1e-4), 0, 1)

    def baked(photographs: np.ndarray) -> np.ndarray:
        stack = PhotoStack(photographs, tuple(map(str, range(len(photographs)))), directions, True, ())
        return maps_of(stack, MapSettings(level=False, repeats=True), name)[0].normal

    found = (
        baked(images),
        normals_of(images, visibility, directions),
        baked(alone),
        normals_of(matte, visibility, directions),
    )
    off = (np.degrees(np.arccos(np.clip((one * truth).sum(-1), -1, 1))).mean() for one in found)
    return dict(zip(WAYS, map(float, off), strict=True))


def _cast_no_shadows(gantry: Gantry) -> None:
    for obj in gantry.tile_objects:
        obj.visible_shadow = False


def _white() -> bpy.types.Material:
    """White and matte."""
    return compat.shader_material("White", "ShaderNodeBsdfDiffuse", {"Color": (1, 1, 1, 1)})
