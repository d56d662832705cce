"""What accuracy costs: error of a paint's table against its size, for every parameterisation and filter."""

from __future__ import annotations

import time
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from measured_materials.addon.demo.paint import PAINT
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.tables.accuracy import direction_pairs, table_errors
from measured_materials.bake.tables.atlas import AtlasLayout
from measured_materials.bake.tables.bspline_fit import fit_coefficients
from measured_materials.bake.tables.grids.normal_vector_grid import NormalVectorGrid
from measured_materials.bake.tables.search.alpha_search import search_alpha, with_alpha
from measured_materials.bake.tables.stored_table import store_table
from measured_materials.bake.tables.table import Table, tabulate
from record import put


def run(out: Path, quick: bool) -> None:
    """Print the figures and plot them; --quick stops at 48."""
    pairs = direction_pairs(16384)
    truth = PAINT.evaluate(pairs.wi, pairs.wo)
    lines: dict[str, list[tuple[float, float]]] = {}
    print(f"{'table':24s} {'size':>15s} {'memory MB':>10s} {'RMS 1/sr':>9s} {'energy off':>10s} {'bake s':>7s}")
    for n in (16, 24, 32, 48) if quick else (16, 24, 32, 48, 64, 96, 128):
        width, height = AtlasLayout((n, n, 2 * n)).size
        memory = {storage: width * height * storage.render_bytes(3) / 1e6 for storage in (Storage.HALF, Storage.LOG)}
        started = time.perf_counter()
        bezier = with_alpha(NormalVectorGrid(n, "bezier"), search_alpha(PAINT, n).by_error)
        search_seconds = time.perf_counter() - started
        for kind, grid in {"identity": None, "uniform": None, "bezier": bezier}.items():
            started = time.perf_counter()
            table = tabulate(PAINT, grid or NormalVectorGrid(n, kind))  # type: ignore[arg-type]
            seconds = time.perf_counter() - started + (search_seconds if grid else 0)
            variants = {f"{kind}, trilinear": (table, "trilinear", Storage.HALF)}
            if grid:
                variants[f"{kind}, nearest"] = (table, "nearest", Storage.HALF)
                fitted = Table(grid, fit_coefficients(table.grid, table.values))
                variants[f"{kind}, B-spline fitted"] = (fitted, "bspline", Storage.HALF)
                codes = store_table(table, Storage.LOG, pairs, truth).table
                variants[f"{kind}, trilinear, log"] = (codes, "trilinear", Storage.LOG)
            for label, (values, filter, storage) in variants.items():
                errors = table_errors(values, filter, pairs, truth)
                lines.setdefault(label, []).append((memory[storage], errors["relative"]))
                size = f"{n} x {n} x {2 * n}"
                row = f"{label:24s} {size:>15s} {memory[storage]:10.2f} {errors['rms']:9.4f} {errors['relative']:10.2%}"
                print(row + f" {seconds:7.2f}")
                put(f"RMS, {label}, {n}", errors["rms"])
                put(f"energy off, {label}, {n}", errors["relative"])
                put(f"MB, {label}, {n}", memory[storage])
    _plot(out / "cost.png", lines)


def _plot(path: Path, lines: dict[str, list[tuple[float, float]]]) -> None:
    figure, axes = plt.subplots(figsize=(7, 4), dpi=110)
    for label, points in lines.items():
        axes.loglog(*zip(*points), marker="o", markersize=4, label=label)
    axes.set_xlabel("texture memory while rendering, MB (half but for log)")
    axes.set_ylabel("reflected energy that is off")
    axes.set_title("Metallic paint: error against size of the table")
    axes.grid(True, which="both", alpha=0.25)
    axes.legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(path)
    print(f"plot {path}")
