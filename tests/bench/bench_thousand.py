"""A thousand formulas through a Dask scheduler with two workers: what is killed on the way costs nothing.

The first run is killed (kill -9) when two fifths are there; the second one goes on, loses a worker on its way and is
given another. Nothing may be baked twice and nothing missing.
"""

from __future__ import annotations

import csv
import json
import random
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from figure_table import print_figures
from measured_materials.bake.bundle.bundle import MATERIAL, read_bundle

sys.path.insert(1, str(Path(__file__).resolve().parents[1]))

from support.clusters import Cluster, cluster, command, wait_until

SMALL = "--resolution 8 --basis normal --parameterization uniform --no-envelope --sampler 16".split()
_MOST_SECONDS = 7200.0
_MODELS = ("ggx", "ward", "oren-nayar", "ashikhmin-shirley", "phong")


def formulas(count: int, seed: int = 18) -> list[str]:
    """Lines of a list: as many formulas, no two alike."""
    draw = random.Random(seed)
    lines = []
    for k in range(count):
        model, colour = _MODELS[k % len(_MODELS)], ",".join(f"{draw.uniform(0.05, 0.9):.3f}" for _ in range(3))
        parameters = {
            "ggx": f"alpha={draw.uniform(0.15, 0.8):.4f} f0={colour}",
            "ward": f"alpha={draw.uniform(0.15, 0.5):.4f} diffuse={colour}",
            "oren-nayar": f"sigma={draw.uniform(0.1, 0.9):.4f} diffuse={colour}",
            "ashikhmin-shirley": f"exponent={draw.uniform(5, 60):.3f} diffuse={colour}",
            "phong": f"exponent={draw.uniform(5, 60):.3f} diffuse={colour}",
        }
        lines.append(f"--analytic {model} {parameters[model]} --name {model}-{k:04d}")
    return lines


def bundles(library: Path) -> dict[str, tuple[int, int]]:
    """Of each finished bundle the inode and the time of its document: both change when it is baked again."""
    found = {}
    for document in library.glob(f"*.mmat/{MATERIAL}"):
        told = document.stat()
        found[document.parent.name] = told.st_ino, told.st_mtime_ns
    return found


def run(out: Path, quick: bool) -> int:
    """Print what it cost, and write the memory over time; the exit status is not 0 where anything is lost."""
    count = 60 if quick else 1000
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        library, listed = folder / "library", folder / "formulas.list"
        listed.write_text("\n".join(formulas(count)) + "\n")
        with cluster(folder / "cluster", 2) as dask:
            words = command("bake", "library", listed, "--out", library, "--dask", dask.address, "--json", *SMALL)
            before, first = _killed(words, library, 2 * count // 5)
            baked, document = _finished(words, library, dask, 7 * count // 10)
        lost = sorted({line.split()[-1] + ".mmat" for line in formulas(count)} - set(baked))
        again = [name for name, mark in before.items() if baked.get(name) != mark]
        for name in baked:
            read_bundle(library / name).check()
        left = [path.name for path in library.iterdir() if path.name.startswith(".") and path.suffix != ".lock"]
    _report(out, document, first, len(before), lost, again, left)
    return 1 if lost or again or left else 0


def _killed(words: list[str], library: Path, at: int) -> tuple[dict[str, tuple[int, int]], float]:
    """Start, kill when so many bundles are there, and return those and the seconds that they took."""
    started = time.monotonic()
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    wait_until(lambda: len(bundles(library)) >= at or process.poll() is not None, _MOST_SECONDS, 0.5)
    process.kill()
    process.wait()
    return bundles(library), time.monotonic() - started


def _finished(
    words: list[str], library: Path, dask: Cluster, at: int
) -> tuple[dict[str, tuple[int, int]], dict[str, Any]]:
    """Go on to the end, with a worker killed and another in its place on the way."""
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    wait_until(lambda: len(bundles(library)) >= at, _MOST_SECONDS, 0.5)
    dask.workers[0].kill()
    dask.add_worker()
    told, _ = process.communicate(timeout=_MOST_SECONDS)
    return bundles(library), json.loads(told)


def _report(
    out: Path,
    document: dict[str, Any],
    first: float,
    before: int,
    lost: list[str],
    again: list[str],
    left: list[str],
) -> None:
    rows = document["materials"]
    baked = sorted((row for row in rows if row["state"] == "baked"), key=lambda row: row["ended"])
    seconds = [row["seconds"] for row in baked]
    # Two workers: what they did not spend on materials is the scheduler's, the client's, and one worker's absence.
    overhead = (2 * document["seconds"] - sum(row["seconds"] for row in rows)) / len(rows)
    growth, peak = _memory(out, baked)
    figures = {
        "materials": len(rows),
        "finished when killed": before,
        "kept by the second run": document["counts"]["kept"],
        "baked by the second run": document["counts"]["baked"],
        "seconds, first run": first,
        "seconds, second run": document["seconds"],
        "seconds of a material": statistics.median(seconds),
        "seconds beside baking, for each": overhead,
        "MB at most": peak,
        "MB gained over 1000": growth,
        "baked twice": len(again),
        "missing": len(lost),
        "left half-made": len(left),
    }
    print_figures("A thousand formulas through Dask, two workers", figures)


def _memory(out: Path, baked: list[dict[str, Any]]) -> tuple[float, float]:
    """Megabytes that a worker gains over a thousand materials, by the line through the worker's that baked most of
    them, and the most that any took; thousand.csv has all."""
    with open(out / "thousand.csv", "w", newline="") as stream:
        lines = csv.writer(stream)
        lines.writerow(["ended", "worker", "seconds", "memory MB"])
        for row in baked:
            lines.writerow([row["ended"], row["worker"], row["seconds"], f"{row['memory_bytes'] / 1e6:.1f}"])
    workers = [row["worker"] for row in baked]
    most = max(set(workers), key=workers.count)
    taken = [row["memory_bytes"] / 1e6 for row in baked if row["worker"] == most]
    # The first few fill caches.
    steady = np.array(taken[len(taken) // 10 :])
    slope = float(np.polyfit(np.arange(len(steady)), steady, 1)[0])
    return 1000 * slope, max(row["peak_bytes"] for row in baked) / 1e6
