"""Noise of aimed mirrors under lamps of four sizes, whose width decides how often they aim, and before.

A wide lamp is found by a glossy material's own draws too, and by better weights: aimed at in nine of ten draws, as a
small lamp is, its highlights are the noisier the narrower they are. In the scene of `bench engine`, of nodes.
"""

from __future__ import annotations

import statistics
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

import bpy
from engine_materials import KINDS, QUICK, bake_all, bundle_path
from engine_scenes import Noise, Sizes, compare, lit, square_lamp
from measured_materials.addon.material.build_brdf import build_brdf
from measured_materials.addon.material.choices import AUTO, Choices
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.nodes import table_groups
from record import put
from rich.console import Console
from rich.table import Table

EDGES = (0.1, 0.3, 1.0, 2.5)
MODES = ("exact", "reference")
MATERIALS = ("felt", "satin", "bronze", "flake paint", "phenolic", "chrome")


def run(out: Path, quick: bool) -> None:
    """Rows of materials and modes; --quick takes one material and two lamps."""
    kinds = [kind for kind in KINDS if kind.name in (QUICK[-1:] if quick else MATERIALS)]
    edges, sizes = (EDGES[::2], Sizes(seeds=2)) if quick else (EDGES, Sizes(seeds=4))
    table = Table(
        "material", "mode", *(f"{edge:g}: {what}" for edge in edges for what in ("before", "now", "by pixel"))
    )
    table.title = f"RMS noise at {sizes.samples} samples over the mean, lamps of these edges at a distance of 2"
    gains: dict[float, list[float]] = {edge: [] for edge in edges}
    by_pixel: dict[float, list[float]] = {edge: [] for edge in edges}
    with TemporaryDirectory() as folder:
        bake_all(kinds, Path(folder), BakeSettings())
        for kind in kinds:
            bundle = read_bundle(bundle_path(kind, Path(folder)))
            cells: dict[str, list[str]] = {mode: [] for mode in MODES}
            for edge in edges:
                for mode, (before, now) in _under(bundle, edge, sizes).items():
                    gains[edge].append(before.rms / now.rms)
                    by_pixel[edge].append(before.local / now.local)
                    cells[mode] += [f"{before.rms:.1%}", f"{now.rms:.1%}", f"{before.local / now.local:.2f}"]
            for mode in MODES:
                table.add_row(kind.name, mode, *cells[mode])
    Console(width=170).print(table)
    for name, found in (("noise", gains), ("by pixel", by_pixel)):
        for what, of in (("median", statistics.median), ("least", min), ("most", max)):
            print(f"{name}, before over now, {what}: {', '.join(f'{of(found[edge]):.2f}' for edge in edges)}")
            for edge in edges:
                put(f"{edge:g}, {name}, {what}", of(found[edge]))


def _under(bundle: Bundle, edge: float, sizes: Sizes) -> dict[str, tuple[Noise, Noise]]:
    """By mode, aimed as often whatever the lamp's size, and as it is."""
    with lit(partial(square_lamp, edge=edge)) as scene:
        materials = {}
        for mode in MODES:
            choices = Choices(mode=mode, aim=AUTO)
            with patch.object(table_groups, "concentration_of", lambda _: 0.0):
                materials[f"{mode}, before"] = build_brdf(bundle, choices=choices, scene=scene)[0]
            materials[mode] = build_brdf(bundle, choices=choices, scene=scene)[0]
        found = compare(scene, materials, sizes)
    for material in materials.values():
        bpy.data.materials.remove(material)
    return {mode: (found[f"{mode}, before"], found[mode]) for mode in MODES}
