"""After figure 6 of Mallett & Yuksel 2016: error and time against resolution, for every parameterisation and basis.

Errors are cosine-weighted RMS at directions that no table holds. Times are of Cycles, per camera sample of a sphere in
the studio that is drawn by a mirror alone: processor time, which other work on the machine hardly changes, in
interleaved repetitions.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from bench_anisotropic import SOURCES as ANISOTROPIC
from csv_rows import write_rows
from engine_materials import KINDS
from figure_turning import grids
from measured_materials.addon.studio.studio import build_studio, remove_studio, render_linear
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.source import BrdfSource
from measured_materials.bake.tables.accuracy import direction_pairs, linear_estimate
from measured_materials.bake.tables.bspline_fit import fit_coefficients
from measured_materials.bake.tables.grids.parameterization import PARAMETERIZATIONS
from measured_materials.bake.tables.search.grid_search import BASES, choose_grid
from measured_materials.bake.tables.table import FILTERS, Table, tabulate
from measured_materials.bake.tables.treated_source import TreatedSource
from measured_materials.nodes.material import build_material
from rich.progress import track

GLOSSY, MIDDLE, MATTE = "phenolic", "bronze", "felt"
RESOLUTIONS, QUICK_RESOLUTIONS = (16, 24, 32, 48, 64, 96, 128), (16, 32, 64)
TIMED, QUICK_TIMED = (16, 32, 64, 128), (16, 32)
BRUSHED = ("brushed metal", "satin")
# Of the timed tables: the paper's, and the one that "auto" takes for most materials.
_TIMED_TABLES = (("normal", "uniform"), ("normal", "bezier"), ("half", "fitted"))
_COLORS = {"identity": "tab:gray", "uniform": "tab:blue", "bezier": "tab:red", "squared": "tab:purple"}
_COLORS |= {"fitted": "tab:green", "half vectors": "tab:green"}
_MARKERS = {"nearest": "v", "trilinear": "o", "bspline": "s"}


def run(out: Path, quick: bool) -> None:
    """Write figure-6.csv and figure-6-times.csv, plot figure-6.png; --quick fewer resolutions and shorter renders."""
    errors: list[dict[str, Any]] = []
    times: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for kind in (k for k in KINDS if k.name in (GLOSSY, MIDDLE, MATTE)):
            source = kind.source(folder)
            errors += _errors(kind.name, source, QUICK_RESOLUTIONS if quick else RESOLUTIONS)
            if kind.name == MIDDLE or not quick:
                times += _times(kind.name, source, folder, _TIMED_TABLES, quick)
            _write(out, errors, times)
        for label in BRUSHED:
            source = ANISOTROPIC[label]
            errors += _anisotropic_errors(label, source, QUICK_RESOLUTIONS[:2] if quick else RESOLUTIONS[:-1])
            if label == BRUSHED[0] or not quick:
                times += _times(label, source, folder, (("normal", "auto"), ("half", "auto")), quick)
            _write(out, errors, times)
    _print(errors, times)
    _plot(errors, times, out / "figure-6.png")


def _write(out: Path, errors: list[dict[str, Any]], times: list[dict[str, Any]]) -> None:
    """What there is so far: a whole run takes an hour, and one that is stopped should leave something."""
    for stem, rows in (("figure-6", errors), ("figure-6-times", times)):
        if rows:
            write_rows(out / f"{stem}.csv", rows)


def _errors(name: str, source: BrdfSource, resolutions: tuple[int, ...]) -> Iterator[dict[str, Any]]:
    """Every basis and parameterisation, linear; nearest and spline of the "fitted" ones too."""
    treated, pairs = TreatedSource(source), direction_pairs(32768)
    truth = treated.evaluate(pairs.wi, pairs.wo)
    for n in track(resolutions, f"{name}, errors"):
        for basis in BASES:
            for kind in PARAMETERIZATIONS:
                grid = choose_grid(treated, n, (basis,), kind).grid  # type: ignore[arg-type]
                row = {"material": name, "basis": basis, "table": kind, "n": n, "shape": " ".join(map(str, grid.shape))}
                row["entries"] = int(np.prod(grid.shape))
                rms = pairs.rms(linear_estimate(treated, grid, pairs) - truth)
                yield {**row, "filter": "trilinear", "rms": rms}
                if kind != "fitted":
                    continue
                table = tabulate(treated, grid)
                spline = Table(grid, fit_coefficients(table.grid, table.values))
                for filter, stored in (("nearest", table), ("bspline", spline)):
                    difference = stored.evaluate(pairs.wi, pairs.wo, filter) - truth  # type: ignore[arg-type]
                    yield {**row, "filter": filter, "rms": pairs.rms(difference)}


def _anisotropic_errors(name: str, source: BrdfSource, resolutions: tuple[int, ...]) -> Iterator[dict[str, Any]]:
    pairs = direction_pairs(16384, turned=True)
    truth = source.evaluate(pairs.wi, pairs.wo)
    for n in track(resolutions, f"{name}, errors"):
        for kind, grid in grids(source, n).items():
            row = {"material": name, "basis": grid.basis, "table": kind, "n": n}
            row |= {"shape": " ".join(map(str, grid.shape)), "entries": int(np.prod(grid.shape))}
            rms = pairs.rms(linear_estimate(source, grid, pairs) - truth)
            yield {**row, "filter": "trilinear", "rms": rms}


def _times(
    name: str, source: BrdfSource, folder: Path, tables: tuple[tuple[str, str], ...], quick: bool
) -> list[dict[str, Any]]:
    """Nanoseconds of processor time of a camera sample for every table, resolution and filter."""
    size, samples, repeats = (96, 16, 1) if quick else (160, 16, 4)
    resolutions = QUICK_TIMED if quick else TIMED
    # A table of four dimensions takes more memory at the same number.
    resolutions = resolutions if source.isotropic else tuple(n for n in resolutions if n <= 64)
    materials: dict[tuple[str, str, int, str], bpy.types.Material] = {}
    for basis, kind in tables:
        for n in track(resolutions, f"{name}, {basis} {kind}, baking"):
            settings = BakeSettings(n, kind, basis=basis, envelope=False, storage="half")  # type: ignore[arg-type]
            bundle = read_bundle(bake_source(source, folder / f"{name} {basis} {kind} {n}", settings).path)
            for filter in FILTERS:
                materials[basis, kind, n, filter] = build_material(bundle, filter=filter, mode="reference")
    seconds: dict[tuple[str, str, int, str], list[float]] = {key: [] for key in materials}
    for repeat in track(range(repeats + 1), f"{name}, rendering"):
        for key, material in materials.items():
            scene = build_studio(material, resolution=(size, size), samples=samples, seed=repeat, shape="sphere")
            started = time.process_time()
            render_linear(scene)
            seconds[key].append(time.process_time() - started)
            remove_studio(scene)
    for material in materials.values():
        bpy.data.materials.remove(material)
    # The first round warms up.
    each = {key: float(np.median(found[1:])) / (size * size * samples) * 1e9 for key, found in seconds.items()}
    fields = ("basis", "table", "n", "filter")
    return [{"material": name, **dict(zip(fields, key)), "ns per sample": ns} for key, ns in each.items()]


def _print(errors: list[dict[str, Any]], times: list[dict[str, Any]]) -> None:
    resolutions = sorted({row["n"] for row in errors})
    print("\nFigure 6: cosine-weighted RMS in 1/sr against N (linear where not said)")
    print(f"{'':46s}" + "".join(f"{n:>10d}" for n in resolutions))
    lines = dict.fromkeys((row["material"], row["basis"], row["table"], row["filter"]) for row in errors)
    for key in lines:
        found = {r["n"]: r["rms"] for r in errors if (r["material"], r["basis"], r["table"], r["filter"]) == key}
        label = " ".join(key[:3]) + ("" if key[3] == "trilinear" else f", {key[3]}")
        print(f"{label:46s}" + "".join(f"{found[n]:10.3g}" if n in found else f"{'':10s}" for n in resolutions))
    print("Nanoseconds of processor time per camera sample, mirror alone: medians over materials")
    for basis, table in dict.fromkeys((row["basis"], row["table"]) for row in times):
        mine = [row for row in times if (row["basis"], row["table"]) == (basis, table)]
        what = "4D" if table == "auto" else "3D"
        for filter in FILTERS:
            words = [
                f"N {n}: {np.median([r['ns per sample'] for r in mine if (r['n'], r['filter']) == (n, filter)]):.0f}"
                for n in sorted({row["n"] for row in mine})
            ]
            print(f"  {what} {basis} {table:8s} {filter:10s} " + "  ".join(words))


def _plot(errors: list[dict[str, Any]], times: list[dict[str, Any]], path: Path) -> None:
    """One column per material: error above, time below."""
    names = list(dict.fromkeys(row["material"] for row in errors))
    figure, axes = plt.subplots(2, len(names), figsize=(4.2 * len(names), 8), sharey="row", constrained_layout=True)
    for column, name in enumerate(names):
        _curves(axes[0, column], [r for r in errors if r["material"] == name], "rms")
        _curves(axes[1, column], [r for r in times if r["material"] == name], "ns per sample")
        axes[0, column].set_title(name)
        axes[1, column].set_xlabel("N")
    axes[0, 0].set_ylabel("cosine-weighted RMS, 1/sr")
    axes[1, 0].set_ylabel("processor time per camera sample, ns")
    for axis in axes.flat:
        axis.set_xscale("log", base=2)
        axis.set_xlim(14, 146)
        axis.set_xticks(RESOLUTIONS, [str(n) for n in RESOLUTIONS], fontsize=8)
        axis.minorticks_off()
        axis.grid(True, alpha=0.25)
    slowest = max(row["ns per sample"] for row in times)
    axes[1, 0].set_ylim(slowest / 16, slowest * 2)
    for row in range(2):
        drawn = [axis for axis in axes[row] if axis.lines]
        for axis in (drawn[0], drawn[-1]):
            axis.legend(fontsize=6, loc="lower left" if row else "best")
    figure.savefig(path, dpi=75)
    plt.close(figure)
    print(f"plot {path}")


def _curves(axis: Any, rows: list[dict[str, Any]], key: str) -> None:
    """Dashed is the normal-vector basis, solid the half-vector basis; markers show the filter."""
    for basis, table, filter in dict.fromkeys((row["basis"], row["table"], row["filter"]) for row in rows):
        mine = [row for row in rows if (row["basis"], row["table"], row["filter"]) == (basis, table, filter)]
        axis.loglog(
            [row["n"] for row in mine],
            [max(row[key], 1e-9) for row in mine],
            _MARKERS[filter] + ("--" if basis == "normal" else "-"),
            color=_COLORS.get(table, "tab:green" if basis == "half" else "tab:red"),
            markersize=4,
            linewidth=1,
            label=(table if basis in table else f"{basis} {table}") + ("" if filter == "trilinear" else f", {filter}"),
        )
