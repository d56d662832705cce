"""Time, memory and bake time of every kind of measured material beside Principled BSDF, in one run."""

from __future__ import annotations

import csv
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import bpy
import numpy as np
from bench_anisotropic import BRUSHED, anisotropic_principled
from measured_materials.addon.material.build_brdf import build_brdf
from measured_materials.addon.material.choices import Choices
from measured_materials.addon.studio.studio import build_studio, remove_studio, render_linear
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.source import BrdfSource
from measured_materials.bake.sources.analytic import MetallicPaint
from measured_materials.nodes.group import trees_below
from record import put

PAINT = MetallicPaint()
# The table of the paper first, then the one that "auto" takes for most materials.
TABLES: dict[str, tuple[BrdfSource, BakeSettings]] = {
    "paint, normal, Bezier": (PAINT, BakeSettings(basis="normal", parameterization="bezier")),
    "paint, half, fitted": (PAINT, BakeSettings(basis="half", parameterization="fitted")),
    "brushed metal, normal": (BRUSHED, BakeSettings(basis="normal")),
    "brushed metal, half": (BRUSHED, BakeSettings(basis="half")),
}
MODES = {"Exact": "exact", "mirror only": "reference"}
BASES = ("Principled", "Principled, anisotropic")


@dataclass
class Measured:
    """A material, what it takes, and the processor seconds of its renders; memory in MB."""

    material: bpy.types.Material
    file: float = 0.0
    textures: float = 0.0
    bake: float = 0.0
    seconds: list[float] = field(default_factory=list)


def compare_kinds(out: Path, principled: bpy.types.Material, quick: bool) -> None:
    """Print and write speed.csv: medians over interleaved renders of a sphere in the studio."""
    size, samples, repeats = (96, 8, 2) if quick else (256, 32, 9)
    found = {BASES[0]: Measured(principled), BASES[1]: Measured(anisotropic_principled())}
    with tempfile.TemporaryDirectory() as folder:
        probe = build_studio(principled, shape="sphere")
        for k, (name, (source, settings)) in enumerate(TABLES.items()):
            result = bake_source(source, Path(folder) / f"{k}", settings)
            bundle = read_bundle(result.path)
            file = sum(path.stat().st_size for path in bundle.path.iterdir()) / 1e6
            for label, mode in MODES.items():
                material, _ = build_brdf(bundle, choices=Choices(mode=mode), scene=probe)
                memory = _texture_bytes(bundle, material) / 1e6
                found[f"{name}, {label}"] = Measured(material, file, memory, result.seconds)
        remove_studio(probe)
        # Interleaved, so that whatever else the machine does meets all alike; the first round warms up.
        for repeat in range(repeats + 1):
            for one in found.values():
                scene = build_studio(
                    one.material, resolution=(size, size), samples=samples, seed=repeat, shape="sphere"
                )
                started = time.process_time()
                render_linear(scene)
                one.seconds.append(time.process_time() - started)
                remove_studio(scene)
    _report(out / "speed.csv", found, size * size * samples)


def _texture_bytes(bundle: Bundle, material: bpy.types.Material) -> int:
    """Of the bundle's images that the material's graph holds, as Cycles holds them."""
    trees = trees_below(material.node_tree)
    images = {node.image for tree in trees for node in tree.nodes if node.type == "TEX_IMAGE" and node.image}
    total = 0
    for name in bundle.material["images"]:
        for image in images:
            if Path(bpy.path.abspath(image.filepath)) == bundle.image_path(name):
                storage = Storage(bundle.material["images"][name]["storage"])
                total += image.size[0] * image.size[1] * storage.render_bytes(image.channels)
    return total


def _report(path: Path, found: dict[str, Measured], samples: int) -> None:
    # Processor time: other work on the machine hardly changes it. Ratios are of renders of one round.
    seconds = {name: np.array(one.seconds[1:]) for name, one in found.items()}
    print("a sphere in the studio, aimed at its lamp: processor time, medians over interleaved rounds; memory in MB")
    print(f"  {'':36s}{'ns/sample':>10s}{'x Principled':>14s}{'x anisotropic':>15s}", end="")
    print(f"{'file':>8s}{'textures':>10s}{'bake s':>8s}")
    rows = []
    for name, one in found.items():
        ns = float(np.median(seconds[name])) / samples * 1e9
        ratios = [float(np.median(seconds[name] / seconds[base])) for base in BASES]
        put(f"kind, {name}, time", ratios["brushed" in name])
        put(f"kind, {name}, textures", one.textures)
        put(f"kind, {name}, bake", one.bake)
        print(f"  {name:36s}{ns:10.0f}{ratios[0]:14.2f}{ratios[1]:15.2f}", end="")
        print(f"{one.file:8.2f}{one.textures:10.2f}{one.bake:8.1f}" if one.bake else "")
        rows.append([name, round(ns, 1), *(round(r, 3) for r in ratios), one.file, one.textures, one.bake])
    head = ["material", "ns per sample", "x Principled", "x anisotropic Principled", "file MB", "texture MB", "bake s"]
    with path.open("w", newline="") as stream:
        csv.writer(stream).writerows([head, *rows])
