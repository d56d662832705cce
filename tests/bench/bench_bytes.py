"""The smallest table that looks the same: error against the bytes of its file, in every storage; and whole bundles."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from bench_within import NETWORK_BYTES, RGL_BYTES
from csv_rows import write_rows
from materials import merl_sources, rgl_files
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.directions import spherical
from measured_materials.bake.images.image_io import write_image
from measured_materials.bake.images.storage import TABLE_STORAGES, Storage
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.source import Array, BrdfSource
from measured_materials.bake.sources import read_source
from measured_materials.bake.tables.accuracy import DirectionPairs, direction_pairs, estimator_variance
from measured_materials.bake.tables.search.coded_grid import coded_grid
from measured_materials.bake.tables.search.grid_search import choose_grid
from measured_materials.bake.tables.stored_table import store_table
from measured_materials.bake.tables.table import tabulate
from measured_materials.bake.tables.treated_source import TreatedSource
from record import put, put_range
from rich.progress import track

FULL, RESOLUTIONS, QUICK = 64, (4, 6, 8, 12, 16, 24, 32, 64), (4, 8, 16, 32, 64)
MARKS = {"RGL 48 KiB": RGL_BYTES, "neural 2.7 kB": NETWORK_BYTES}
SIZES, LIMITS = (2700, 10 * 1024, 48 * 1024, 256 * 1024), (0.05, 0.02, 0.01)
SAMPLERS = (SamplerLayout(), SamplerLayout(32, 32, 16), SamplerLayout(16, 16, 8))


def size_curve(source: BrdfSource, pairs: DirectionPairs, resolutions: tuple[int, ...]) -> Iterator[dict[str, Any]]:
    """Bytes of the file and error of the table that "auto" makes, at every resolution and storage."""
    treated = TreatedSource(source)
    truth = treated.evaluate(pairs.wi, pairs.wo)
    signal = pairs.rms(truth)
    for n in resolutions:
        grid = choose_grid(treated, n).grid
        table, coded = tabulate(treated, grid), tabulate(treated, coded_grid(treated, grid, n))
        for storage in map(Storage, TABLE_STORAGES):
            kept = store_table(coded if storage is Storage.LOG else table, storage, pairs, truth, treated)
            image = kept.image()
            with tempfile.TemporaryDirectory() as folder:
                file = Path(folder) / f"table{storage.suffix}"
                write_image(file, image.pixels, image.storage)
                size = file.stat().st_size
            difference = kept.table.evaluate(pairs.wi, pairs.wo) - truth
            yield {
                "material": source.name,
                "storage": str(storage),
                "n": n,
                "shape": " ".join(map(str, kept.table.grid.shape)),
                "bytes": size,
                "rms": pairs.rms(difference),
                "rms share": pairs.rms(difference) / signal,
                "relative": pairs.relative_error(difference, truth),
            }


def of(rows: list[dict[str, Any]], **wanted: Any) -> list[dict[str, Any]]:
    """Those with these values."""
    return [row for row in rows if all(row[key] == value for key, value in wanted.items())]


def show(rows: list[dict[str, Any]]) -> None:
    """Per material the smallest files within an error, the least error within two sizes, and the full table."""
    print("\nSmallest file in KiB (storage, N) whose relative error is at most, and least relative error within")
    print(f"{'':26s}" + "".join(f"{100 * limit:15.0f} %" for limit in LIMITS), end="")
    print("".join(f"{words:>19s}" for words in MARKS) + f"{f'half {FULL}':>23s}")
    for name in dict.fromkeys(row["material"] for row in rows):
        mine = of(rows, material=name)
        (full,) = of(mine, storage="half", n=FULL)

        def least(limit: float, mine: list[dict[str, Any]] = mine) -> str:
            row = min((r for r in mine if r["relative"] <= limit), key=lambda r: r["bytes"], default=None)
            return f"{row['bytes'] / 1024:.3g} {row['storage']} {row['n']}" if row else "-"

        def best(limit: float, mine: list[dict[str, Any]] = mine) -> str:
            row = min((r for r in mine if r["bytes"] <= limit), key=lambda r: r["relative"], default=None)
            return f"{100 * row['relative']:.2f} % {row['storage']} {row['n']}" if row else "-"

        words = "".join(f"{least(limit):>17s}" for limit in LIMITS)
        words += "".join(f"{best(size):>19s}" for size in MARKS.values())
        print(f"{name:26s}{words}{100 * full['relative']:9.2f} % {full['bytes'] / 1024:7.0f} KiB")


def show_storages(rows: list[dict[str, Any]]) -> None:
    """Medians over the materials: bytes of each storage, and its RMS over that of float32."""
    names = list(dict.fromkeys(row["material"] for row in rows))
    print("\nMedian KiB, and median (least to most) RMS as a multiple of float32's")
    print(f"{'N':>4s}" + "".join(f"{storage:>28s}" for storage in TABLE_STORAGES))
    for n in dict.fromkeys(row["n"] for row in rows):
        exact = {row["material"]: row["rms"] for row in of(rows, n=n, storage="float32")}
        cells = []
        for storage in TABLE_STORAGES:
            mine = of(rows, n=n, storage=storage)
            ratio = [row["rms"] / exact[row["material"]] for row in mine]
            size = np.median([row["bytes"] for row in mine]) / 1024
            cells.append(f"{size:9.3g} {np.median(ratio):6.3f} ({min(ratio):.2f} to {max(ratio):.2f})")
        print(f"{n:4d}" + "".join(f"{cell:>28s}" for cell in cells))
    _compare_log(rows, names)
    print("\nMedian over the materials of the least RMS within bytes, as a share of the signal's")
    for limit in SIZES:
        shares = {
            storage: [
                min((r["rms share"] for r in of(rows, material=m, storage=storage) if r["bytes"] <= limit), default=1.0)
                for m in names
            ]
            for storage in TABLE_STORAGES
        }
        for storage, found in shares.items():
            put(f"RMS share, {storage}, {limit}", float(np.median(found)))
        words = ", ".join(f"{storage} {100 * np.median(found):.2f} %" for storage, found in shares.items())
        print(f"{limit:8d} bytes: {words}")


def _compare_log(rows: list[dict[str, Any]], names: list[str]) -> None:
    """Files of 8-bit logarithms over those of half floats, and up to which N their error is the smaller one."""

    def each(storage: str, key: str, n: int) -> np.ndarray:
        return np.array([of(rows, material=name, storage=storage, n=n)[0][key] for name in names])

    numbers = sorted({row["n"] for row in rows})
    ratios = np.concatenate([each("log", "bytes", n) / each("half", "bytes", n) for n in numbers])
    better = [n for n in numbers if np.median(each("log", "rms", n) / each("half", "rms", n)) < 1]
    print(f"\nlog over half: {ratios.min():.2f} to {ratios.max():.2f} of the bytes; less error at N of {better}")
    put_range("bytes, log over half", ratios)
    put("N, log better up to", max(better, default=0))


def plot(rows: list[dict[str, Any]], file: Path) -> None:
    """RMS as a share of the signal's against bytes, one panel per material."""
    names = list(dict.fromkeys(row["material"] for row in rows))
    columns = min(len(names), 4)
    lines = -(-len(names) // columns)
    figure, axes = plt.subplots(lines, columns, figsize=(3.8 * columns, 3.6 * lines), squeeze=False, sharex=True)
    for axis, name in zip(axes.flat, names):
        for storage in TABLE_STORAGES:
            points = [(row["bytes"] / 1024, 100 * row["rms share"]) for row in of(rows, material=name, storage=storage)]
            axis.loglog(*zip(*points, strict=True), ".-", label=storage)
        for words, limit in MARKS.items():
            axis.axvline(limit / 1024, color="grey", linewidth=0.6)
            axis.text(limit / 1024, 0.02, words, rotation=90, fontsize=7, transform=axis.get_xaxis_transform())
        axis.grid(True, which="major", alpha=0.25)
        axis.set_title(name, fontsize=10)
    for axis in axes[-1]:
        axis.set_xlabel("KiB of the table's file")
    for axis in axes[:, 0]:
        axis.set_ylabel("RMS error, % of the signal's")
    for axis in axes.flat[len(names) :]:
        axis.remove()
    axes.flat[0].legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(file, dpi=100)
    plt.close(figure)
    print(f"plot {file}")


def noise(bundle: Bundle) -> float:
    """Of one direction drawn for the residual under an even sky, over its mean, from four elevations."""
    residual, sampler = BrdfRecord.read(bundle).load_table("residual"), BrdfRecord.read(bundle).load_sampler("residual")
    random = np.random.default_rng(0).random((8192, 4))
    found = []
    for theta in (0.1, 0.6, 1.1, 1.4):
        wo = np.broadcast_to(spherical(theta, 0.0), (len(random), 3))

        def integrand(wi: Array, wo: Array = wo) -> Array:
            return residual.evaluate(wi, wo) * np.maximum(wi[:, 2:], 0)

        mean, variance = estimator_variance(integrand, lambda u, wo=wo: sampler.sample(wo, u), random)
        found.append(variance / max(mean, 1e-30) ** 2)
    return float(np.sqrt(np.mean(found)))


def show_bundles(source: BrdfSource, quick: bool) -> None:
    """What the files of whole bundles take, all modes in them, and what smaller alias tables cost in noise."""
    print(f"\n{source.name}: KiB of the bundle's files; noise of one drawn direction under an even sky")
    head = ("N", "storage", "alias tables", "table", "residual", "samplers", "rest", "all", "error", "noise")
    print("".join(f"{word:>14s}" if k < 3 else f"{word:>10s}" for k, word in enumerate(head)))
    cases = [(FULL, "half", SAMPLERS[0]), (24, "log", SAMPLERS[0]), *((12, "log", sampler) for sampler in SAMPLERS)]
    for n, storage, sampler in cases[:1] + cases[-1:] if quick else cases:
        with tempfile.TemporaryDirectory() as folder:
            settings = BakeSettings(resolution=n, storage=Storage(storage), sampler=sampler)
            bundle = read_bundle(bake_source(source, Path(folder) / "bundle", settings).path)
            whole = sum(file.stat().st_size for file in bundle.path.iterdir()) / 1024
            images = ("table", "residual", "sampler", "residual_sampler")
            sizes = {image: bundle.image_path(image).stat().st_size / 1024 for image in images}
            parts = [sizes["table"], sizes["residual"], sizes["sampler"] + sizes["residual_sampler"]]
            cells = f"{sampler.n_o} x {sampler.n_h} x {sampler.n_phi}"
            numbers = "".join(f"{part:10.1f}" for part in (*parts, whole - sum(parts), whole))
            put(f"bundle KiB, {n} {storage} {sampler.n_h}", whole)
            put(f"bundle MiB, {n} {storage} {sampler.n_h}", whole / 1024)
            put(f"bundle noise, {n} {storage} {sampler.n_h}", noise(bundle))
            errors = bundle.material["residual"]["errors"]["envelope_and_residual"]
            print(f"{n:14d}{storage:>14s}{cells:>14s}{numbers}{100 * errors['relative']:8.2f} %{noise(bundle):10.2f}")


def run(out: Path, quick: bool) -> None:
    """Five MERL reconstructions and three RGL files; with --quick two and one, at fewer resolutions."""
    pairs = direction_pairs(16384)
    files = rgl_files()
    sources = [*merl_sources(35 if quick else 14), *map(read_source, files[:1] if quick else files[::4])]
    resolutions = QUICK if quick else RESOLUTIONS
    rows = [row for source in track(sources, "bytes") for row in size_curve(source, pairs, resolutions)]
    show(rows)
    show_storages(rows)
    write_rows(out / "bytes.csv", rows)
    plot(rows, out / "bytes.png")
    show_bundles(sources[0], quick)
