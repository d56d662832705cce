"""Kills, files that cannot grow, races, hostile bundles: what a library has lost, what is half-written, what escaped.

Every fault is done on purpose to a library of six swatches with an older bundle in it (`support.library_faults`), and
the library is baked again afterwards: that counts too. As tried counts a fault that did happen, a kill only if it met a
living process.
"""

from __future__ import annotations

import random
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from record import put
from rich.console import Console
from rich.table import Table

sys.path.insert(1, str(Path(__file__).resolve().parents[1]))

from support.library_faults import EDITS, Damage, all_of, disk_full, hostile, killed, raced

_TIMES = {
    "client killed": 30,
    "worker killed": 30,
    "all killed at once": 30,
    "files cannot grow": 20,
    "bakes at once": 15,
}


def run(out: Path, quick: bool) -> int:
    """Print the table of faults; the exit status is not 0 where anything was lost, half-written or touched."""
    draw = random.Random(18)
    kinds: dict[str, Callable[[Path, int], Damage]] = {
        "client killed": lambda folder, k: killed(folder, draw, "client"),
        "worker killed": lambda folder, k: killed(folder, draw, "worker"),
        "all killed at once": lambda folder, k: killed(folder, draw, "all"),
        "files cannot grow": lambda folder, k: disk_full(folder, draw.randrange(500, 9000)),
        "bakes at once": lambda folder, k: raced(folder),
        "hostile bundles": lambda folder, k: hostile(folder, list(EDITS.values())[k]),
    }
    found: dict[str, Damage] = {}
    for kind, fault in kinds.items():
        times = len(EDITS) if kind == "hostile bundles" else 2 if quick else _TIMES[kind]
        done = []
        for k in range(times):
            with tempfile.TemporaryDirectory() as name:
                done.append(fault(Path(name) / "scene", k))
        found[kind] = all_of(done)
    found["all"] = all_of(list(found.values()))
    table = Table(title="Faults of a library")
    for column in ("", "tried", "lost", "half-written", "touched outside"):
        table.add_column(column, justify="left" if not column else "right")
    for kind, damage in found.items():
        table.add_row(kind, *(str(count) for count in vars(damage).values()))
        for name, count in vars(damage).items():
            put(f"{kind}, {name.replace('_', '-')}", count)
    Console(width=100).print(table)
    total = found["all"]
    return 1 if total.lost or total.half_written or total.escaped else 0
