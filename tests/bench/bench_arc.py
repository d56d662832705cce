"""Photographs to a shading map: seconds; and noise at equal time of a map's modes, beside plain materials."""

from __future__ import annotations

import math
import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from csv_rows import write_rows
from materials import SHARED
from measured_materials.addon.lights.light_tables import lamp_image, update_scene
from measured_materials.addon.studio.studio import build_studio, remove_studio, render_linear
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.images.image_io import load_openimageio, write_image
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.photographs.photograph import read_photograph
from measured_materials.bake.photographs.stack import StackSettings
from measured_materials.bake.shading_maps.bake import ArcSettings, bake_arc
from measured_materials.bake.shading_maps.record import ShadingMapRecord
from measured_materials.nodes import compat
from measured_materials.nodes.shading_map_material import build_shading_map
from record import put, put_range

ELEVATIONS = (6, 15, 24, 33, 42, 51, 60, 70, 79, 88)
RINGS = (20, 38, 56, 74)
Make = Callable[[], bpy.types.Material]
_BESIDE = ("mirror only, not aimed", "lit texture", "Diffuse BSDF", "Principled BSDF, sheen")


def run(out: Path, quick: bool) -> None:
    """Times of the bake, then arc_noise.csv."""
    with tempfile.TemporaryDirectory() as folder:
        bundles = {"cloth": _bake_times(Path(folder), 1 if quick else 3)}
        if (SHARED / "data" / "stacks").is_dir() and load_openimageio() is not None:
            canvas = SHARED / "data" / "stacks" / "canvas"
            result = bake_arc(canvas, Path(folder) / "canvas", ArcSettings(azimuths="arc"))
            bundles["canvas"] = read_bundle(result.path)
        else:
            print("SKIPPED canvas: it needs the photographs beside the repository, and OpenImageIO")
        rows = [row for name, bundle in bundles.items() for row in noise(name, bundle, quick)]
    _print_noise(rows)
    write_rows(out / "arc_noise.csv", rows)


# --- time of the bake -----------------------------------------------------------------------------------


def cloth_photographs(size: int) -> list[np.ndarray]:
    """Photographs (size, size, 3) of a made-up plain weave, light from the right; linear, repeating."""
    slope, _, colour = _cloth(size)
    pictures = []
    for elevation in np.radians(ELEVATIONS):
        facing = np.sin(elevation) - slope * np.cos(elevation)
        shade = np.maximum(facing, 0) / np.sqrt(1 + slope**2) + 0.02 * np.sin(elevation)
        pictures.append(np.clip(colour, 0.01, 1) * shade[..., None])
    return pictures


def _cloth(size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Slopes of the weave along u and v, (size, size) both, and its colour (size, size, 3)."""
    rng = np.random.default_rng(2)
    u, v = np.meshgrid(*[2 * np.pi * 12 * np.arange(size) / size] * 2)
    over = np.sign(np.sin(u / 2) * np.sin(v / 2))
    height = 0.5 * np.where(over > 0, np.abs(np.sin(v / 2)), np.abs(np.sin(u / 2)))
    height += 0.03 * rng.standard_normal((size, size))
    slopes = [8 * (np.roll(height, -1, axis) - np.roll(height, 1, axis)) for axis in (1, 0)]
    colour = np.array((0.46, 0.09, 0.08)) * (1 + 0.1 * rng.standard_normal((size, size, 1)))
    return slopes[0], -slopes[1], colour


def dome_directions() -> np.ndarray:
    """49 lights as the domes of RTI have them, (49, 3): four rings of twelve, and one overhead."""
    elevation, azimuth = np.meshgrid(np.radians(RINGS), 2 * np.pi * np.arange(12) / 12, indexing="ij")
    around = [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    return np.concatenate([np.stack(around, -1).reshape(-1, 3), [[0.0, 0.0, 1.0]]])


def _bake_times(folder: Path, repeats: int) -> Bundle:
    """Ten photographs of an arc to 8 slices, then 49 of a dome to a map over azimuth; of 1024 x 1024 to 512 x 512."""
    arc, dome = folder / "cloth", folder / "dome"
    arc.mkdir()
    for elevation, picture in zip(ELEVATIONS, cloth_photographs(1024)):
        write_image(arc / f"el{elevation:02d}.exr", picture.astype(np.float32), Storage.FLOAT32)
    _bake_time("10 photographs of an arc", arc, folder / "cloth.mmat", repeats)
    dome.mkdir()
    slope_u, slope_v, colour = _cloth(1024)
    lines = []
    for k, (x, y, z) in enumerate(dome_directions()):
        facing = (z - slope_u * x - slope_v * y) / np.sqrt(1 + slope_u**2 + slope_v**2)
        shade = np.maximum(facing, 0) + 0.02 * z
        picture = np.clip(colour, 0.01, 1) * shade[..., None]
        write_image(dome / f"light{k:02d}.exr", picture.astype(np.float32), Storage.HALF)
        lines.append(f"light{k:02d}.exr {x:.6f} {y:.6f} {z:.6f}")
    (dome / "dome.lp").write_text("\n".join([str(len(lines)), *lines]) + "\n", encoding="utf-8")
    _bake_time("49 photographs of a dome", dome, folder / "dome.mmat", repeats)
    assert ShadingMapRecord.read(read_bundle(folder / "dome.mmat")).map.model == "azimuth"
    return read_bundle(folder / "cloth.mmat")


def _bake_time(name: str, source: Path, out: Path, repeats: int) -> None:
    files = sorted(source.glob("*.exr"))
    settings = ArcSettings(stack=StackSettings(size=512))
    seconds: dict[str, list[tuple[float, float]]] = {"decoding": [], "all of it": [], "all but decoding": []}
    for _ in range(repeats):
        decoding = _timed(lambda: [read_photograph(file) for file in files])
        whole = _timed(lambda: bake_arc(source, out, settings))
        seconds["decoding"].append(decoding)
        seconds["all of it"].append(whole)
        seconds["all but decoding"].append((whole[0] - decoding[0], whole[1] - decoding[1]))
    print(f"{name}, 1024 x 1024, to a map of 512 x 512; median of {repeats}")
    for part, times in seconds.items():
        wall, cpu = (statistics.median(column) for column in zip(*times))
        print(f"  {part:18s}{wall:7.2f} s of the clock {cpu:7.2f} s of processor")
        put(f"{name}, {part}, seconds", wall)
        put(f"{name}, {part}, seconds of processor", cpu)


def _timed(work: Callable[[], Any]) -> tuple[float, float]:
    """Seconds of the clock and of all processors."""
    began, worked = time.perf_counter(), time.process_time()
    work()
    return time.perf_counter() - began, time.process_time() - worked


# --- noise at equal time --------------------------------------------------------------------------------


@dataclass(frozen=True)
class Measured:
    """Relative noise of a pixel, seconds of processor per picture, mean brightness."""

    noise: float
    seconds: float
    mean: float


def materials(bundle: Bundle) -> dict[str, Make]:
    """The modes of a map, and what an artist would use in its place."""
    usual = ShadingMapRecord.read(bundle).render
    made: dict[str, Make] = {}
    for mode, words in (("exact", "envelope + residual"), ("reference", "mirror only")):
        for aimed in (True, False):
            settings = replace(usual, mode=mode)
            label = f"{words}, {'aimed at lamps' if aimed else 'not aimed'}"
            made[label] = lambda settings=settings, aimed=aimed: build_shading_map(
                bundle, settings=settings, lamps=lamp_image() if aimed else None
            )
    made["lit texture"] = lambda: build_shading_map(bundle, settings=replace(usual, technique="lit_texture"))
    albedo = tuple(bundle.material["albedo"]["directional"][0])
    made["Diffuse BSDF"] = lambda: compat.shader_material("plain", "ShaderNodeBsdfDiffuse", {"Color": (*albedo, 1)})
    cloth = {"Base Color": (*albedo, 1), "Roughness": 0.8, "Sheen Weight": 0.3}
    made["Principled BSDF, sheen"] = lambda: compat.shader_material("plain", "ShaderNodeBsdfPrincipled", cloth)
    return made


def noise(name: str, bundle: Bundle, quick: bool) -> list[dict[str, Any]]:
    """Rows of all materials under both lights."""
    rows = []
    for light in ("studio light", "small lamp"):
        found = {label: measure(make, light, quick) for label, make in materials(bundle).items()}
        base, texture, plain, principled = (found[k] for k in _BESIDE)
        for label, m in found.items():
            rows.append(
                {
                    "map": name,
                    "light": light,
                    "material": label,
                    "noise": m.noise,
                    "seconds": m.seconds,
                    "mean": m.mean,
                    "against_mirror": _at_equal_time(m) / _at_equal_time(base),
                    "against_texture": _at_equal_time(m) / _at_equal_time(texture),
                    "against_diffuse": _at_equal_time(m) / _at_equal_time(plain),
                    "against_principled": _at_equal_time(m) / _at_equal_time(principled),
                    "slower_than_diffuse": m.seconds / plain.seconds,
                }
            )
    return rows


def _at_equal_time(measured: Measured) -> float:
    """Noise of a second of processor."""
    return measured.noise * math.sqrt(measured.seconds)


def measure(make: Make, light: str, quick: bool) -> Measured:
    """Several seeds of a plain sphere; the middle of the picture counts, which it fills."""
    size, samples, seeds = (96, 16, 4) if quick else (160, 32, 8)
    material = make()
    scene = build_studio(material, resolution=(size, size), samples=samples, shape="sphere")
    try:
        if light == "small lamp":
            lamp = next(obj.data for obj in scene.objects if obj.type == "LIGHT")
            lamp.size = lamp.size_y = 0.2
            for node in scene.world.node_tree.nodes:
                if node.type == "BACKGROUND":
                    for link in list(node.inputs["Strength"].links):
                        scene.world.node_tree.links.remove(link)
                    node.inputs["Strength"].default_value = 0
        update_scene(scene)
        pictures, times = [], []
        for seed in range(seeds + 1):
            scene.cycles.seed = seed
            worked = time.process_time()
            pictures.append(render_linear(scene)[..., 1])
            times.append(time.process_time() - worked)
    finally:
        remove_studio(scene)
        bpy.data.materials.remove(material)
    margin = int(0.36 * size)
    middle = np.stack(pictures)[1:, margin:-margin, margin:-margin]  # the first picture warms up
    mean = float(middle.mean())
    return Measured(float(np.sqrt(middle.var(0, ddof=1).mean())) / mean, statistics.median(times[1:]), mean)


def _print_noise(rows: list[dict[str, Any]]) -> None:
    print(
        "\nnoise of a pixel relative to the mean (of a texture also what varies inside a pixel), processor seconds of a"
    )
    print("picture, and noise at equal time as a multiple of that of three others")
    for light, label in {(r["light"], r["material"]) for r in rows}:
        own = [r["against_principled"] for r in rows if (r["light"], r["material"]) == (light, label)]
        put_range(f"noise at equal time, {label}, {light}", own)
    heading = f"{'map':8s} {'light':13s} {'material':36s} {'noise':>8s} {'CPU s':>6s} {'time':>6s} {'mean':>7s}"
    print(heading + f" {'/ mirror only':>14s} {'/ lit texture':>14s} {'/ Diffuse':>10s} {'/ Principled':>13s}")
    for r in rows:
        words = f"{r['map']:8s} {r['light']:13s} {r['material']:36s} {r['noise']:8.1%} {r['seconds']:6.2f}"
        ratios = f"{r['against_mirror']:14.4f} {r['against_texture']:14.2f} {r['against_diffuse']:10.2f}"
        ratios += f" {r['against_principled']:13.2f}"
        print(f"{words} {r['slower_than_diffuse']:5.2f}x {r['mean']:7.4f} {ratios}")
