"""Both bases and every parameterisation at equal bytes, what `auto` chooses, and error against bytes."""

from __future__ import annotations

import csv
import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from materials import merl_sources, rgl_files
from measured_materials.bake.accuracy import DirectionPairs, direction_pairs, trilinear_estimate
from measured_materials.bake.atlas import AtlasLayout
from measured_materials.bake.grid_search import choose_grid
from measured_materials.bake.parameterization import PARAMETERIZATIONS
from measured_materials.bake.source import Array, BrdfSource
from measured_materials.bake.sources import read_source
from measured_materials.bake.storage import Storage, quantize, scale_for
from measured_materials.bake.table import BrdfTable, Grid, TreatedSource, tabulate
from rich.progress import track

N = 64
BASES = ("normal", "half")
COLUMNS = [f"{basis} {kind}" for basis in BASES for kind in PARAMETERIZATIONS if (basis, kind) != ("normal", "squared")]
# Bytes of a texel in the file, before lossless compression; "log" is a logarithm of 8 bits per channel, in numpy only.
STORAGES = {"half": 6, "rgbe": 4, "log": 3}
RESOLUTIONS = (6, 8, 10, 12, 14, 16, 20, 24, 32, 40, 48, 64)
RGL_BYTES = 48 * 1024
# Of matte materials 16384 leave 5 to 10 % of doubt, more than lies between the better tables.
PAIRS = 1 << 17


def measure(source: BrdfSource, pairs: DirectionPairs) -> dict[str, Any]:
    """RMS of every table, and of the one that "auto" makes, at directions that chose nothing."""
    treated = TreatedSource(source)
    truth = treated.evaluate(pairs.wi, pairs.wo)
    row: dict[str, Any] = {"material": source.name, "signal": pairs.rms(truth)}
    row["peakedness"] = row["signal"] / max(float((pairs.weight * truth.mean(-1) * pairs.wi[:, 2]).mean()), 1e-30)

    def rms(grid: Grid) -> float:
        return pairs.rms(trilinear_estimate(treated, grid, pairs) - truth)

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
    worst = ", ".join(f"{rows[i]['material']} {better[i]:.3f}" for i in np.argsort(-better)[:3])
    print(f"auto over the best of all columns, so of both bases: most {better.max():.3f} ({worst})")
    best = [min(COLUMNS, key=row.__getitem__) for row in rows]
    print("best column of all: " + ", ".join(f"{c} {best.count(c)}" for c in COLUMNS if c in best))
    fitted = [np.median([row[f"{b} bezier"] / row[f"{b} fitted"] for row in rows]) for b in BASES]
    print(f"fitted below Bezier in the same basis, median: normal {fitted[0]:.2f} times, half {fitted[1]:.2f} times")
    with (out / f"bases-{title.split()[0].lower()}.csv").open("w", newline="") as stream:
        writer = csv.DictWriter(stream, rows[0])
        writer.writeheader()
        writer.writerows(rows)


def log_bytes(values: Array) -> Array:
    """Values after storage as 8 bits of their logarithm, each channel over its own range down to 1e-4 of its peak."""
    peak = values.reshape(-1, 3).max(0)
    low, high = np.log(np.maximum(peak * 1e-4, 1e-30)), np.log(np.maximum(peak, 1e-29))
    code = np.rint((np.log(np.maximum(values, 1e-30)) - low) / (high - low) * 255).clip(0, 255)
    stored: Array = np.exp(low + code * ((high - low) / 255)).astype(np.float32)
    return stored


def stored(values: Array, storage: str) -> Array:
    """Values as they come back from a file."""
    if storage == "log":
        return log_bytes(values)
    scale = scale_for(values, Storage(storage))
    return quantize(values * np.float32(scale), Storage(storage)) / np.float32(scale)


def size_curve(source: BrdfSource, pairs: DirectionPairs, resolutions: tuple[int, ...]) -> Iterator[dict[str, Any]]:
    """Bytes and RMS of the table that "auto" makes, at every resolution and storage."""
    treated = TreatedSource(source)
    truth = treated.evaluate(pairs.wi, pairs.wo)
    bezier = choose_grid(treated, N, ("normal",), "bezier").grid
    yield row_of(source.name, "normal bezier, half", tabulate(treated, bezier), 6, pairs, truth)
    for n in resolutions:
        table = tabulate(treated, choose_grid(treated, n).grid)
        for storage, size in STORAGES.items():
            yield row_of(source.name, storage, BrdfTable(table.grid, stored(table.values, storage)), size, pairs, truth)


def row_of(name: str, storage: str, table: BrdfTable, size: int, pairs: DirectionPairs, truth: Array) -> dict[str, Any]:
    """One point of a curve."""
    difference = table.evaluate(pairs.wi, pairs.wo) - truth
    return {
        "material": name,
        "storage": storage,
        "shape": " ".join(map(str, table.grid.shape)),
        "bytes": int(np.prod(AtlasLayout(table.grid.shape).size)) * size,
        "rms": pairs.rms(difference),
        "relative": pairs.relative_error(difference, truth),
    }


def show_sizes(rows: list[dict[str, Any]], out: Path) -> None:
    """The smallest table that is as good as the full one or nearly, and the error in 48 KiB; CSV and plot."""
    print("\nSmallest table in KiB of texels (storage) within a multiple of the RMS of the full one, half floats")
    print(f"{'':26s}{'full':>9s}{'1.1 x':>14s}{'2 x':>14s}{'as Bezier':>14s}{'error in 48 KiB':>17s}{'in full':>9s}")
    for name in dict.fromkeys(row["material"] for row in rows):
        mine = [row for row in rows if row["material"] == name]
        before, *mine = mine
        full = max((row for row in mine if row["storage"] == "half"), key=lambda row: row["bytes"])

        def least(limit: float, mine: list[dict[str, Any]] = mine) -> str:
            row = min((row for row in mine if row["rms"] <= limit), key=lambda row: row["bytes"], default=None)
            return f"{row['bytes'] / 1024:.3g} {row['storage']}" if row else "-"

        small = min((r for r in mine if r["bytes"] <= RGL_BYTES), key=lambda r: r["relative"])
        words = "".join(f"{least(x):>14s}" for x in (1.1 * full["rms"], 2 * full["rms"], before["rms"]))
        print(
            f"{name:26s}{full['bytes'] / 1024:9.0f}{words}"
            f"{100 * small['relative']:15.2f} %{100 * full['relative']:7.2f} %"
        )
    with (out / "bases-bytes.csv").open("w", newline="") as stream:
        writer = csv.DictWriter(stream, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    plot(rows, out / "bases-bytes.png")


def plot(rows: list[dict[str, Any]], file: Path) -> None:
    """Energy-relative error against bytes, one panel per material."""
    names = list(dict.fromkeys(row["material"] for row in rows))
    columns = min(len(names), 4)
    figure, axes = plt.subplots(-(-len(names) // columns), columns, figsize=(4 * columns, 7), squeeze=False)
    for axis, name in zip(axes.flat, names):
        for storage in dict.fromkeys(row["storage"] for row in rows):
            points = [
                (r["bytes"] / 1024, r["relative"]) for r in rows if (r["material"], r["storage"]) == (name, storage)
            ]
            axis.loglog(*zip(*points, strict=True), "x" if "bezier" in storage else ".-", label=storage)
        axis.axvline(RGL_BYTES / 1024, color="grey", linewidth=0.5)
        axis.set(title=name, xlabel="KiB of texels", ylabel="relative error")
    axes.flat[0].legend()
    figure.tight_layout()
    figure.savefig(file, dpi=90)
    plt.close(figure)


def run(out: Path, quick: bool) -> None:
    """All 70 MERL reconstructions and the twelve RGL files; with --quick every tenth and three."""
    pairs = direction_pairs(PAIRS // 8 if quick else PAIRS)
    sources = merl_sources(10 if quick else 1)
    rows = [measure(source, pairs) for source in track(sources, "MERL", total=7 if quick else 70)]
    show("MERL reconstructions", rows, out)
    files = list(itertools.islice(rgl_files(), 3 if quick else None))
    show("RGL measurements", [measure(read_source(path), pairs) for path in track(files, "RGL")], out)
    pairs = direction_pairs(16384)
    resolutions = (8, 12, 16, 24, 32, 64) if quick else RESOLUTIONS
    chosen = [*merl_sources(35 if quick else 14), *map(read_source, files[:1] if quick else files[::4])]
    points = [row for source in track(chosen, "bytes") for row in size_curve(source, pairs, resolutions)]
    show_sizes(points, out)
