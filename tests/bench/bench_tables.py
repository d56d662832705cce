"""How well the three parameterisations of Mallett & Yuksel 2016 hold real materials at 64 x 64 x 128."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
from csv_rows import write_rows
from materials import merl_sources, rgl_files
from measured_materials.bake.source import BrdfSource
from measured_materials.bake.sources import read_source
from measured_materials.bake.tables.accuracy import direction_pairs, linear_estimate
from measured_materials.bake.tables.grids.normal_vector_grid import NormalVectorGrid
from measured_materials.bake.tables.search.alpha_search import search_alpha, with_alpha
from measured_materials.bake.tables.table import tabulate
from measured_materials.bake.tables.treated_source import TreatedSource
from record import put
from rich.progress import track

N = 64
COLUMNS = ("identity", "uniform", "by intensity", "by error")


def measure(source: BrdfSource) -> dict[str, Any]:
    """RMS at directions that chose nothing, total intensity, and both choices of alpha."""
    treated = TreatedSource(source)
    pairs = direction_pairs(32768)
    truth = treated.evaluate(pairs.wi, pairs.wo)
    search = search_alpha(treated, N, direction_pairs(8192, offset=0.25), intensity_n=N)
    bezier = NormalVectorGrid(N, "bezier")
    grids = {
        "identity": NormalVectorGrid(N, "identity"),
        "uniform": NormalVectorGrid(N, "uniform"),
        "by intensity": with_alpha(bezier, search.by_intensity),
        "by error": with_alpha(bezier, search.by_error),
    }
    row: dict[str, Any] = {"material": source.name, "signal": pairs.rms(truth)}
    # How much the value varies over the cosine-weighted directions says glossy or matte, without any table.
    row["peakedness"] = row["signal"] / max(float((pairs.weight * truth.mean(-1) * pairs.wi[:, 2]).mean()), 1e-30)
    for name, grid in grids.items():
        row[f"rms {name}"] = pairs.rms(linear_estimate(treated, grid, pairs) - truth)
        row[f"intensity {name}"] = tabulate(treated, grid).total_intensity
        if name.startswith("by"):
            row[f"alpha {name}"] = f"{grid.alpha_theta:.3f} {grid.alpha_phi:.3f}"
    return row


def show(title: str, rows: list[dict[str, Any]], out: Path) -> None:
    """Print the table, its summary, and write it as CSV."""
    print(f"\n{title}, {N} x {N} x {2 * N}; cosine-weighted RMS in 1/sr, then total intensity")
    print(f"{'':30s}" + "".join(f"{c:>13s}" for c in COLUMNS) + f"{'gain':>7s}" + "".join(f"{c:>13s}" for c in COLUMNS))
    for row in rows:
        rms = "".join(f"{row[f'rms {c}']:13.4g}" for c in COLUMNS)
        intensity = "".join(f"{row[f'intensity {c}']:13.3g}" for c in COLUMNS)
        print(f"{row['material']:30s}{rms}{row['rms uniform'] / row['rms by error']:7.2f}{intensity}")
    gains = np.array([row["rms uniform"] / row["rms by error"] for row in rows])
    glossy = np.argsort([-row["peakedness"] for row in rows])[: len(rows) // 2]
    agree = sum(row["alpha by error"] == row["alpha by intensity"] for row in rows)
    loss = np.median([row["rms by intensity"] / row["rms by error"] for row in rows])
    put(f"{title}, intensity found the best", agree)
    put(f"{title}, count", len(rows))
    print(f"Bezier by error no worse than uniform: {int((gains >= 1).sum())} of {len(rows)}")
    print(f"median gain on uniform: all {np.median(gains):.2f}, glossy half {np.median(gains[glossy]):.2f}")
    worst = ", ".join(f"{rows[i]['material']} {gains[i]:.3f}" for i in np.argsort(gains)[:4])
    print(f"least gains: {worst}")
    print(
        f"intensity metric chose the alpha of least error: {agree} of {len(rows)}; its median RMS is {loss:.2f} times"
    )
    write_rows(out / f"tables-{title.split()[0].lower()}.csv", rows)


def run(out: Path, quick: bool) -> None:
    """All 70 MERL reconstructions and the twelve RGL files; with --quick every tenth and three."""
    sources = merl_sources(10 if quick else 1)
    rows = [measure(source) for source in track(sources, "MERL", total=7 if quick else 70)]
    show("MERL reconstructions", rows, out)
    files = itertools.islice(rgl_files(), 3 if quick else None)
    rows = [measure(read_source(path)) for path in track(list(files), "RGL")]
    show("RGL measurements", rows, out)
