"""Numerically hard cases: bound and worst error of each implementation, whole bakes, and the papers' formulas."""

from __future__ import annotations

import csv
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from readme_figures import page_figures
from record import put
from support.hard import bakes, case, registry
from support.hard.formula import digits_saved

TEXT = """# Hard cases

Written by `./run bench hard`; `./run test -m hard` runs the same cases and holds this page to their bounds. Blender's
CPU, one machine. A cell is *worst error / bound*; an empty one has no such implementation.

`float64` and `float32` are numpy in that precision (tables are evaluated in float64 only), `nodes` the node group and
`osl` the shader, both rendered on a card and read back as floats. Truths are computed in 40 digits (mpmath) from
definitions, not from our formulas; those of lookups are the bright texel's tent at numpy's float64 coordinates, and for
the B-spline numpy's own value. Every value must also be finite and in range: never negative where light is meant.

## Cases

{cases}

What is hard, and why this bound:

{notes}

## Whole bakes

Hostile sources, stacks and numbers: either a right result or one line that refuses.

{outcomes}

## Formulas of the papers that are unstable as printed

In float32. The papers are cited in full on the page [Method](method.md).
Digits are log10 of the ratio of the two errors; one that is not finite or above 1 counts as 1, none as half an ulp.
The two nearest photographs, the last slice, brute force and exponents below 1 are errors of method, not of rounding.

{formulas}
"""


def run(out: Path, quick: bool) -> None:
    """All cases; --quick leaves out cards and bakes."""
    with tempfile.TemporaryDirectory() as folder:
        cases = _cases(Path(folder), quick)
        outcomes = [] if quick else _outcomes(Path(folder))
    formulas = _formulas()
    tables = {
        "cases": (registry.CASE_HEAD, cases),
        "outcomes": (registry.OUTCOME_HEAD, outcomes),
        "formulas": (registry.FORMULA_HEAD, formulas),
    }
    for name, (head, rows) in tables.items():
        _write(out / f"hard_{name}.csv", head, rows)
    notes = "\n".join(f"{k}. {note}" for k, note in enumerate(registry.notes(), 1))
    page = TEXT.format(notes=notes, **{name: registry.markdown(*table) for name, table in tables.items()})
    (out / "hard_cases.md").write_text(page, encoding="utf-8")
    print(f"page {out / 'hard_cases.md'}")
    for place, figure in page_figures(page).items():
        put(place, figure)


def _cases(folder: Path, quick: bool) -> list[list[str]]:
    names = ("float64", "float32") if quick else case.IMPLEMENTATIONS
    print("worst error / bound; * is beyond it")
    print(f"{'':72s}" + "".join(f"{name:>20s}" for name in names))
    rows = []
    for one in registry.cases():
        worst = dict.fromkeys(one.bounds, float("nan"))
        cells = ""
        for name in names:
            if name not in one.bounds:
                cells += " " * 20
                continue
            found = case.measure(one, name, folder)
            worst[name] = found.worst
            bad = "*" if found.fault or found.worst > one.bounds[name] else " "
            cells += f"{found.worst:9.1e} /{one.bounds[name]:8.1e}{bad}"
        print(f"{str(one)[:71]:72s}{cells}", flush=True)
        rows.append(registry.case_row(one, worst))
    return rows


def _outcomes(folder: Path) -> list[list[str]]:
    print("whole bakes: promised, found")
    rows = []
    for one in registry.outcomes():
        found = bakes.measure(one, folder)
        rows.append(registry.outcome_row(one, found))
        kept = "" if bakes.is_kept(one, found) else " *"
        print(f"{rows[-1][0]:52s} {rows[-1][1]:36s} {rows[-1][2]}{kept}", flush=True)
    return rows


def _formulas() -> list[list[str]]:
    print("formulas: as printed, stable, digits saved")
    rows = []
    for one in registry.FORMULAS:
        printed, stable = one.errors()
        digits = digits_saved(printed, stable)
        print(f"{one!s:70s}{printed:9.1e}{stable:9.1e}{digits:6.1f}")
        rows.append(registry.formula_row(one, printed, stable, digits))
    return rows


def _write(path: Path, head: Sequence[str], rows: list[list[str]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as stream:
        csv.writer(stream).writerows([head, *rows])
