"""Photographed and rendered stacks as shading maps: pictures, held-out photographs, envelope, compression."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from bench_compression import PAPER, STACKS, read_srgb
from csv_rows import write_rows
from materials import SHARED
from measured_materials.addon.lights.light_tables import lamp_image, update_scene
from measured_materials.addon.material.bake_photographs import set_repeat
from measured_materials.addon.rendering.contact_sheet import Cell, write_sheet
from measured_materials.addon.studio.studio import build_studio, remove_studio, render_linear
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.bundle.result import BakeResult
from measured_materials.bake.images.image_io import load_openimageio
from measured_materials.bake.photographs.stack import StackSettings
from measured_materials.bake.shading_maps.bake import ArcSettings, bake_arc
from measured_materials.bake.shading_maps.power_law import fit
from measured_materials.bake.shading_maps.record import ShadingMapRecord
from measured_materials.bake.shading_maps.shading_map import ShadingMap, at_level
from measured_materials.nodes.shading_map_material import build_shading_map

# Lights this far from the arc's plane still count as near it, as the reader takes them.
SPREAD = StackSettings().spread
SIDES = {"one": "one side", "both": "over the top"}


@dataclass(frozen=True, eq=False)
class Baked:
    """A stack, the azimuth (degrees) of its arc's plane, and its map."""

    name: str
    lights: str
    azimuth: float
    result: BakeResult
    bundle: Bundle
    map: ShadingMap


def run(out: Path, quick: bool) -> None:
    """Tables, stacks.csv, stacks_held_out.csv and stacks.png; one line where the photographs are not at hand."""
    if not (SHARED / "data" / "stacks").is_dir() or load_openimageio() is None:
        print("SKIPPED stacks: they need the photographs beside the repository, and OpenImageIO")
        return
    names = ("canvas", "rendered_plate/single3") if quick else STACKS
    with tempfile.TemporaryDirectory() as folder:
        baked = [bake(name, sides, Path(folder)) for name in names for sides in SIDES]
        rows = [_row(stack) for stack in baked]
        _print_rows(rows)
        plates = [stack for stack in baked if _is_plate(stack.name)]
        tests = [row for stack in plates for row in predict(stack)]
        _print_tests(tests)
        shown = [stack for stack in baked if stack.lights == SIDES["one"]]
        write_sheet(out / "stacks.png", [_cell(stack, quick) for stack in shown], 4, _TITLE)
    for file, lines in (("stacks.csv", rows), ("stacks_held_out.csv", tests)):
        write_rows(out / file, lines)


_TITLE = "Shading maps in the studio, f_r Lambertian, photographs with the light on one side; path-traced"


def bake(name: str, sides: str, folder: Path) -> Baked:
    """A whole stack as it lies there: the reader chooses the arc."""
    plate = _is_plate(name)
    source = SHARED / "data" / "stacks" / name / ("Dome" if plate else "")
    settings = ArcSettings(stack=StackSettings(sides=sides), azimuths="arc")
    result = bake_arc(source, folder / f"{name.replace('/', '_')}_{sides}", settings)
    bundle = read_bundle(result.path)
    azimuth = float(result.facts["source"]["facts"]["lights"]["arc"]["azimuth_deg"])
    return Baked(name, SIDES[sides], azimuth, result, bundle, ShadingMapRecord.read(bundle).load_map())


def _is_plate(name: str) -> bool:
    return name.startswith("rendered_plate")


# --- the map itself -------------------------------------------------------------------------------------


def _row(stack: Baked) -> dict[str, Any]:
    facts = stack.result.facts
    rms = fit(stack.map.slices).rms(stack.map.slices)
    return {
        "stack": stack.name,
        "lights": stack.lights,
        "azimuth": stack.azimuth,
        "photographs": len(facts["averages"]["photographs"]),
        "width": facts["map"]["width"],
        "height": facts["map"]["height"],
        "envelope_energy": facts["map"]["envelope_energy"],
        "held_out_rms": facts["errors"]["held_out_rms"],
        "held_out_relative": facts["errors"]["held_out_relative"],
        "power_rms": rms,
        "power_display": rms / float(stack.map.slices.max()),
        "storage_rms": facts["errors"]["storage_rms"],
        "seconds": stack.result.seconds,
        "warnings": len(facts["warnings"]),
    }


def _print_rows(rows: list[dict[str, Any]]) -> None:
    print("8 slices, half floats. Left out: each photograph predicted from the others at its own average, RMS relative")
    print("to a_max and, median, to its own RMS. Power law: RMS relative to a_max, and to the largest value, as the")
    print(f"paper, whose table 1 states {PAPER}.")
    heading = f"{'stack':24s} {'lights':13s} {'azimuth':>8s} {'photographs':>11s} {'size':>10s}"
    print(
        heading
        + "".join(f"{word:>10s}" for word in ("envelope", "left out", "relative", "power law", "display", "bake s"))
    )
    for r in rows:
        size = f"{r['width']} x {r['height']}"
        words = f"{r['stack']:24s} {r['lights']:13s} {r['azimuth']:8.0f} {r['photographs']:11d} {size:>10s}"
        errors = (
            f"{r['held_out_rms']:10.4f}{r['held_out_relative']:10.1%}{r['power_rms']:10.4f}{r['power_display']:10.4f}"
        )
        print(f"{words}{r['envelope_energy']:10.1%}{errors}{r['seconds']:10.1f}")


# --- photographs it has not seen ------------------------------------------------------------------------


def predict(stack: Baked) -> list[dict[str, Any]]:
    """Errors at the Test photographs near the arc's plane, the map looked up at each one's own average."""
    folder = SHARED / "data" / "stacks" / stack.name / "Test"
    plane = np.array([np.cos(np.radians(stack.azimuth)), np.sin(np.radians(stack.azimuth))])
    rows = []
    for line in (folder / "dirs.lp").read_text().splitlines()[1:]:
        file, *numbers = line.split()
        direction = np.array([float(n) for n in numbers])
        off = float(np.degrees(np.arcsin(abs(direction[0] * plane[1] - direction[1] * plane[0]))))
        if off > SPREAD:
            continue
        photograph = read_srgb(folder / file)
        along = float(direction[:2] @ plane)
        rows.append(
            {
                "stack": stack.name,
                "lights": stack.lights,
                "file": file,
                "elevation": round(float(np.degrees(np.arcsin(direction[2]))), 1),
                "side": "photographed" if along > 0 else "other",
                "off_plane": round(off, 1),
                **_prediction(stack.map, photograph, stack.result.facts["averages"]["before"][-1]),
            }
        )
    return rows


def _prediction(shading_map: ShadingMap, photograph: np.ndarray, a_max: float) -> dict[str, float]:
    """RMS in parts of the photograph's own: the lookup, and the brightest photograph dimmed (the lit texture)."""
    x = float(photograph.mean(dtype=np.float64)) / a_max
    target = photograph / np.float32(a_max)
    own = float(np.sqrt(np.square(target).mean(dtype=np.float64)))

    def rms(picture: np.ndarray) -> float:
        return float(np.sqrt(np.square(picture - target).mean(dtype=np.float64))) / own

    tones = np.sort(at_level(shading_map, x).reshape(-1, 3), 0) - np.sort(target.reshape(-1, 3), 0)
    return {
        "level": x,
        "lookup": rms(at_level(shading_map, x)),
        "lookup_tones": float(np.sqrt(np.square(tones).mean(dtype=np.float64))) / own,
        "lit_texture": rms(np.float32(x) * shading_map.slices[-1]),
    }


def _print_tests(rows: list[dict[str, Any]]) -> None:
    print("\nTest photographs within 20 degrees of the arc's plane, in parts of their own RMS, by the light's side")
    heading = (
        f"{'plate':24s} {'map of lights':13s} {'light from':14s} {'photographs':>11s} {'lookup':>8s} {'its tones':>10s}"
    )
    print(heading + f" {'lit texture':>12s}")
    for stack, lights, side in dict.fromkeys((r["stack"], r["lights"], r["side"]) for r in rows):
        found = [r for r in rows if (r["stack"], r["lights"], r["side"]) == (stack, lights, side)]
        lookup, tones, texture = (
            float(np.sqrt(np.mean([r[k] ** 2 for r in found]))) for k in ("lookup", "lookup_tones", "lit_texture")
        )
        words = f"{stack:24s} {lights:13s} {side + ' side':14s} {len(found):11d}"
        print(words + f" {lookup:8.1%} {tones:10.1%} {texture:12.1%}")


# --- pictures -------------------------------------------------------------------------------------------


def _cell(stack: Baked, quick: bool) -> Cell:
    material = build_shading_map(stack.bundle, lamps=lamp_image())
    set_repeat(material, 2.0, ShadingMapRecord.read(stack.bundle).map.layout)
    size, samples = (200, 16) if quick else (320, 64)
    scene = build_studio(material, resolution=(size, size), samples=samples, seed=1)
    try:
        update_scene(scene)
        picture = render_linear(scene)
    finally:
        remove_studio(scene)
        bpy.data.materials.remove(material)
    energy = stack.result.facts["map"]["envelope_energy"]
    count = len(stack.result.facts["averages"]["photographs"])
    return Cell(picture, stack.name, f"{count} photographs, envelope {energy:.0%} of the energy")
