"""What the sockets of Adjust cost: nodes, room on Cycles' stack, and time per sample beside the plain material."""

from __future__ import annotations

import statistics
import sys
import tempfile
import time
from pathlib import Path

import bpy
from csv_rows import write_rows
from engine_scenes import lit, show
from measured_materials import addon
from measured_materials.addon.lights.light_tables import lamp_image
from measured_materials.addon.studio.studio import render_linear
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.sources.analytic import MetallicPaint
from measured_materials.nodes.adjustments import GLOSS, SOCKETS
from measured_materials.nodes.material import build_material
from record import put
from rich.console import Console
from rich.table import Table

sys.path.insert(1, str(Path(__file__).resolve().parents[1]))

from support.gloss import link_socket
from support.node_count import count_nodes
from support.svm_stack import room_on_stack

EDGE, SAMPLES, FEW = 64, 64, 4
# Of each what is set, and what is linked to a mask, as for a worn edge.
CASES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "plain": ((), ()),
    "Tint set": (("Tint",), ()),
    "all but Gloss set": (tuple(SOCKETS), ()),
    "Gloss set": ((GLOSS,), ()),
    "all but Gloss linked": ((), tuple(SOCKETS)),
    "Gloss linked": ((), (GLOSS,)),
    "all linked": ((), (*SOCKETS, GLOSS)),
}


def run(out: Path, quick: bool) -> None:
    """Write adjust.csv and print the table."""
    with tempfile.TemporaryDirectory() as folder:
        settings = BakeSettings(16 if quick else 64)
        bundle = read_bundle(bake_source(MetallicPaint(), Path(folder) / "paint", settings).path)
        addon.register()
        try:
            rows = _rows(bundle, quick)
        finally:
            addon.unregister()
    write_rows(out / "adjust.csv", rows)
    for row in rows:
        put(f"{row['adjusted']}, nodes more", float(str(row["more_nodes"])))
        put(f"{row['adjusted']}, time", float(str(row["time"])))
    _print(rows)


def _rows(bundle: Bundle, quick: bool) -> list[dict[str, object]]:
    """In turn, so that whatever disturbs the clock meets all alike."""
    with lit("small lamp") as scene:
        materials = {name: _adjusted(bundle, *case) for name, case in CASES.items()}
        seconds: dict[str, list[float]] = {name: [] for name in CASES}
        for seed in range(2 if quick else 7):
            for name, material in materials.items():
                show(scene, material)
                _render(scene, 1, seed)  # compiles
                seconds[name].append((_render(scene, SAMPLES, seed) - _render(scene, FEW, seed)) / (SAMPLES - FEW))
        counted = {name: count_nodes(material.node_tree) for name, material in materials.items()}
    room = {name: room_on_stack(material) for name, material in materials.items()}
    return [
        {
            "adjusted": name,
            "nodes": counted[name],
            "more_nodes": counted[name] - counted["plain"],
            "stack_left": room[name],
            "time": round(statistics.median(a / b for a, b in zip(seconds[name], seconds["plain"])), 3),
        }
        for name in CASES
    ]


def _adjusted(bundle: Bundle, given: tuple[str, ...], linked: tuple[str, ...]) -> bpy.types.Material:
    """Mode Exact, with these sockets off their neutral values."""
    material = build_material(bundle, mode="exact", lamps=lamp_image())
    inputs = next(node.inputs for node in material.node_tree.nodes if GLOSS in node.inputs)
    for name in given:
        inputs[name].default_value = (0.9, 0.6, 0.5, 1.0) if name == "Tint" else 0.8
    for name in linked:
        link_socket(material, inputs[name], 0.6, 0.9)
    return material


def _render(scene: bpy.types.Scene, samples: int, seed: int) -> float:
    """Seconds of all processors."""
    scene.render.resolution_x = scene.render.resolution_y = EDGE
    scene.cycles.samples, scene.cycles.seed = samples, seed
    began = time.process_time()
    render_linear(scene)
    return time.process_time() - began


def _print(rows: list[dict[str, object]]) -> None:
    table = Table(title="Adjust, beside the plain material in mode Exact")
    for column in ("adjusted", "nodes", "more", "floats of stack left", "time of a sample"):
        table.add_column(column, justify="left" if column == "adjusted" else "right")
    for row in rows:
        cells = (row["adjusted"], row["nodes"], f"{row['more_nodes']:+d}", row["stack_left"], f"{row['time']:.2f}")
        table.add_row(*map(str, cells))
    Console(width=100).print(table)
    print(
        "Nodes of Adjust are in every graph; Cycles folds away what is neutral. A linked socket adds four of its mask."
    )
