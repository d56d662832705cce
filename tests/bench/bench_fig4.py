"""Figure 4 of Kautz et al. 2004: a bidirectional texture function, compressed, beside shading maps of few photographs.

The gantry photographs wool and cloth from 21 views under 21 lights, on the arc of the paper and all around. What each
kind then shows is compared with the rendered geometry, seen and lit as in the photographs and otherwise. Archives of
UBO2003 that are named are compared with maps of their own pictures from above.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

sys.path.insert(1, str(Path(__file__).resolve().parents[1]))

from measured_materials.addon.gantry import techniques
from measured_materials.addon.gantry.techniques import Frames
from measured_materials.bake.errors import BakeError
from record import put
from rich.console import Console
from rich.table import Table
from support.btf import archives
from support.btf.figure_4 import CASES, GROUPS, Rival, geometry, photographed
from support.btf.ubo import read_ubo2003

NAMES = ("wool", "cloth")


def run(out: Path, quick: bool, files: Sequence[str]) -> int | None:
    """Both swatches, or of the cloth alone less; or these archives. `out` keeps the photographs for the page."""
    size, samples, true_samples = (24, 4, 16) if quick else (64, 16, 128)
    for name in () if files else NAMES[1:] if quick else NAMES:
        started = time.perf_counter()
        rivals = photographed(name, size, samples, out, _Tenths(name), anew=True)
        frames, noise = geometry(name, size, true_samples)
        report(name, {rival: errors_of(rival, frames, size) for rival in rivals})
        print(f"  {time.perf_counter() - started:.0f} s; noise of the geometry's picture {noise:.1%}", flush=True)
    for file in map(Path, files):
        try:
            btf = read_ubo2003(file, size)
            rivals = archives.rivals_of_archive(btf)
        except BakeError as error:
            print(f"bench fig4: {error}")
            return 1
        report(file.stem, {rival: archives.errors_of(rival, btf) for rival in rivals})
    return None


class _Tenths:
    """Prints each tenth of a swatch's pictures."""

    def __init__(self, name: str) -> None:
        self.name, self.done = name, 0

    def __call__(self, share: float) -> None:
        if share * 10 >= self.done + 1:
            self.done = int(share * 10)
            print(f"  {self.name}: {share:.0%} photographed", flush=True)


def errors_of(rival: Rival, frames: Frames, size: int) -> dict[str, float]:
    """RMS of the difference from the geometry in parts of its RMS, by group of directions."""
    found = {}
    for group in GROUPS:
        cases = [case for case in CASES if case.group == group]
        rows = [techniques.errors(rival.picture(case, size), techniques.truth(case, frames)) for case in cases]
        found[group] = techniques.mean_errors(rows)["rms"]
    return found


def report(name: str, errors: Mapping[Rival, Mapping[str, float]]) -> None:
    """A table, and what a text may state."""
    groups = list(next(iter(errors.values())))
    table = Table(name, "photographs", "KB", *groups)
    for rival, found in errors.items():
        put(f"KB, {name}, {rival.name}", rival.bytes / 1000)
        put(f"photographs, {name}, {rival.name}", rival.photographs)
        for group, error in found.items():
            put(f"RMS, {name}, {rival.name}, {group}", error)
        cells = [f"{found[group]:.1%}" for group in groups]
        table.add_row(rival.name, str(rival.photographs), f"{rival.bytes / 1000:.0f}", *cells)
    Console(width=130).print(table)
