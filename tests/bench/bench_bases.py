"""Both bases and every parameterisation at equal bytes, and what `auto` chooses."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
from csv_rows import write_rows
from materials import merl_sources, rgl_files
from measured_materials.bake.source import BrdfSource
from measured_materials.bake.sources import read_source
from measured_materials.bake.tables.accuracy import DirectionPairs, direction_pairs, linear_estimate
from measured_materials.bake.tables.grids.grid import Grid
from measured_materials.bake.tables.grids.parameterization import PARAMETERIZATIONS
from measured_materials.bake.tables.search.grid_search import choose_grid
from measured_materials.bake.tables.treated_source import TreatedSource
from record import put
from rich.progress import track

N = 64
BASES = ("normal", "half")
COLUMNS = [f"{basis} {kind}" for basis in BASES for kind in PARAMETERIZATIONS if (basis, kind) != ("normal", "squared")]
# Of matte materials 16384 leave 5 to 10 % of doubt, more than lies between the better tables.
PAIRS = 1 << 17


def measure(source: BrdfSource, pairs: DirectionPairs) -> dict[str, Any]:
    """RMS of every table, and of the one that "auto" makes, at directions that chose nothing."""
    treated = TreatedSource(source)
    truth = treated.evaluate(pairs.wi, pairs.wo)
    row: dict[str, Any] = {"material": source.name, "signal": pairs.rms(truth)}
    row["peakedness"] = row["signal"] / max(float((pairs.weight * truth.mean(-1) * pairs.wi[:, 2]).mean()), 1e-30)

    def rms(grid: Grid) -> float:
        return pairs.rms(linear_estimate(treated, grid, pairs) - truth)

    choice = choose_grid(treated, N)
    found = {_column(c.grid): c.grid for c in sorted(choice.candidates, key=lambda c: -c.rms)}
    for column in COLUMNS:
        basis, kind = column.split()
        # The search for one column alone finds the same grid.
        grid = found.get(column) or choose_grid(treated, N, (basis,), kind).grid  # type: ignore[arg-type]
        row[column] = rms(grid)
    row["auto"], row["chosen"] = row[_column(choice.grid)], " ".join(map(str, choice.grid.shape))
    row["chosen kind"] = _column(choice.grid)
    row["reciprocity error"] = choice.reciprocity_error
    return row


def _column(grid: Grid) -> str:
    return f"{grid.facts()['basis']} {grid.parameterization}"


def show(title: str, rows: list[dict[str, Any]], out: Path) -> None:
    """Print the table and its summary, and write it as CSV."""
    names = [*COLUMNS, "auto"]
    print(f"\n{title}, at the bytes of {N} x {N} x {2 * N}; cosine-weighted RMS in 1/sr")
    print(f"{'':26s}" + "".join(f"{c.replace('normal', 'n').replace('half', 'h'):>11s}" for c in names) + "  chosen")
    for row in rows:
        values = "".join(f"{row[c]:11.3g}" for c in names)
        print(f"{row['material']:26s}{values}  {row['chosen kind']} {row['chosen']}")
    gain = np.array([row["normal bezier"] / max(row["auto"], 1e-30) for row in rows])
    better = np.array([row["auto"] / max(min(row[c] for c in COLUMNS), 1e-30) for row in rows])
    glossy = np.argsort([-row["peakedness"] for row in rows])[: max(len(rows) // 2, 1)]
    print(f"auto below the best Bezier in the normal basis, median: all {np.median(gain):.1f} times", end=", ")
    print(f"glossy half {np.median(gain[glossy]):.1f} times; least {gain.min():.2f}")
    put(f"{title}, gain, median", float(np.median(gain)))
    put(f"{title}, gain, glossy half", float(np.median(gain[glossy])))
    put(f"{title}, gain, least", gain.min())
    put(f"{title}, auto over best, excess", better.max() - 1)
    put(f"{title}, count", len(rows))
    worst = ", ".join(f"{rows[i]['material']} {better[i]:.3f}" for i in np.argsort(-better)[:3])
    print(f"auto over the best of all columns, so of both bases: most {better.max():.3f} ({worst})")
    best = [min(COLUMNS, key=row.__getitem__) for row in rows]
    print("best column of all: " + ", ".join(f"{c} {best.count(c)}" for c in COLUMNS if c in best))
    fitted = [np.median([row[f"{b} bezier"] / row[f"{b} fitted"] for row in rows]) for b in BASES]
    print(f"fitted below Bezier in the same basis, median: normal {fitted[0]:.2f} times, half {fitted[1]:.2f} times")
    write_rows(out / f"bases-{title.split()[0].lower()}.csv", rows)


def run(out: Path, quick: bool) -> None:
    """All 70 MERL reconstructions and the twelve RGL files; with --quick every tenth and three."""
    pairs = direction_pairs(PAIRS // 8 if quick else PAIRS)
    sources = merl_sources(10 if quick else 1)
    rows = [measure(source, pairs) for source in track(sources, "MERL", total=7 if quick else 70)]
    show("MERL reconstructions", rows, out)
    files = list(itertools.islice(rgl_files(), 3 if quick else None))
    show("RGL measurements", [measure(read_source(path), pairs) for path in track(files, "RGL")], out)
