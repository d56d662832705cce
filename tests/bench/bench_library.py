"""24 materials by one process, by two, and through a Dask scheduler with two workers, one of which is killed half way.

Wall clock on a machine that others use too tells little: the processor's time is beside it, and one and two processes
take turns.
"""

from __future__ import annotations

import json
import random
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from figure_table import print_figures
from measured_materials.bake.bundle.bundle import read_bundle

sys.path.insert(1, str(Path(__file__).resolve().parents[1]))

from support.clusters import cluster, command, wait_until
from support.library_faults import leftovers, marks

COUNT, ROUNDS = 24, 3
_TIMEOUT = 3600
_DRAFT = ("--quality", "draft")
_QUICK = ("--resolution", "8", "--basis", "normal", "--parameterization", "uniform", "--no-envelope", "--sampler", "16")


def run(out: Path, quick: bool) -> int:
    """Print time, ratio and memory; the exit status is not 0 where anything is lost."""
    draw = random.Random(18)
    formulas = [f"--analytic ggx alpha={draw.uniform(0.1, 0.6):.3f} --name metal{k:02}" for k in range(COUNT)]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        listed = folder / "all.list"
        listed.write_text("\n".join(formulas) + "\n")
        rounds, usual = (1, _QUICK) if quick else (ROUNDS, _DRAFT)
        # One after the other in turns, each a part of the list, so that what else the machine does meets both alike.
        parts = [folder / f"part{k}.list" for k in range(rounds)]
        for k, part in enumerate(parts):
            part.write_text("\n".join(formulas[k::rounds]) + "\n")
        seconds = dict.fromkeys((1, 2), 0.0)
        rows: dict[int, list[dict[str, Any]]] = {1: [], 2: []}
        for part in parts:
            for count in seconds:
                told = _baked(part, folder / f"by{count}", *usual, "--jobs", str(count))
                seconds[count] += told["seconds"]
                rows[count] += told["materials"]
        kept = _baked(listed, folder / "by2", *usual, "--jobs", "2")
        through, lost = _by_dask(listed, folder, usual)
    figures = {
        "materials": COUNT,
        "seconds, one process": seconds[1],
        "seconds, two processes": seconds[2],
        "times as fast": seconds[1] / seconds[2],
        "MB of a worker at most": max(row["peak_bytes"] for row in rows[2]) / 1e6,
        "seconds of a material, one process": statistics.median(row["seconds"] for row in rows[1]),
        "seconds of a material, two processes": statistics.median(row["seconds"] for row in rows[2]),
        "seconds, nothing to do": kept["seconds"],
        "kept": kept["counts"]["kept"],
        "seconds, Dask, one of two workers killed": through["seconds"],
        "MB of a Dask worker at most": max(row["peak_bytes"] for row in through["materials"]) / 1e6,
        "missing, baked twice or half-made": lost,
    }
    print_figures(f"{COUNT} materials" + ("" if quick else ", draft quality"), figures)
    return 1 if lost or kept["counts"]["kept"] != COUNT else 0


def _baked(listed: Path, library: Path, *more: str) -> dict[str, Any]:
    words = command("bake", "library", listed, "--out", library, "--json", *more)
    done = subprocess.run(words, capture_output=True, text=True, timeout=_TIMEOUT)
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def _by_dask(listed: Path, folder: Path, usual: tuple[str, ...]) -> tuple[dict[str, Any], int]:
    """The account, and how many are missing, baked twice or half-made."""
    library = folder / "dask"
    with cluster(folder / "cluster", 2) as dask:
        words = command("bake", "library", listed, "--out", library, "--json", *usual, "--dask", dask.address)
        process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        wait_until(lambda: len(marks(library)) >= COUNT // 2, _TIMEOUT, 0.1)
        dask.workers[0].kill()
        before = marks(library)
        told = json.loads(process.communicate(timeout=_TIMEOUT)[0])
    after = marks(library)
    for bundle in library.glob("*.mmat"):
        read_bundle(bundle).check()
    twice = sum(after.get(name) != mark for name, mark in before.items())
    return told, twice + COUNT - len(after) + len(leftovers(library))
