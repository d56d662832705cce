"""Everything hard, in the order of the tables, and the tables themselves."""

from __future__ import annotations

from functools import cache
from typing import Any

from . import angles, bakes, codes, formulas_angles, formulas_curves, lobes, lookups, maps, reflectances, storages
from .bakes import Outcome
from .case import IMPLEMENTATIONS, Case
from .formula import Formula

FORMULAS: tuple[Formula, ...] = (*formulas_angles.FORMULAS, *formulas_curves.FORMULAS)
CASE_HEAD = ("case", "error", *IMPLEMENTATIONS, "note")
OUTCOME_HEAD = ("bake or call", "promised", "found")
FORMULA_HEAD = (
    "paper",
    "formula",
    "as printed or commonly coded",
    "here",
    "where",
    "error",
    "printed",
    "here",
    "digits",
)


@cache
def cases() -> tuple[Case, ...]:
    """All cases with a truth."""
    modules = (angles, lobes, reflectances, lookups, maps, storages, codes)
    return tuple(case for module in modules for case in module.cases())


@cache
def outcomes() -> tuple[Outcome, ...]:
    """All whole bakes and refusals."""
    return tuple(bakes.outcomes())


def case_row(case: Case, worst: dict[str, float]) -> list[str]:
    """Cells of a case: worst error and bound of each implementation."""
    cells = [f"{worst[k]:.1e} / {case.bounds[k]:.1e}" if k in case.bounds else "" for k in IMPLEMENTATIONS]
    return [str(case), case.unit, *cells, str(notes().index(_note(case)) + 1)]


@cache
def notes() -> list[str]:
    """What is hard in the cases, and why their bounds are what they are; each stated once."""
    return list(dict.fromkeys(_note(case) for case in cases()))


def _note(case: Case) -> str:
    return f"{case.points}. Bound: {case.reason}."


def outcome_row(outcome: Outcome, found: float | str) -> list[str]:
    """Cells of an outcome."""
    told = found if isinstance(found, str) else f"{found:.1e}"
    promise = outcome.promise + (f", {outcome.what}" if outcome.what else "")
    return [str(outcome), promise, told]


def formula_row(formula: Formula, printed: float, stable: float, digits: float) -> list[str]:
    """Cells of a formula."""
    f = formula
    shown = "not finite" if printed == float("inf") else f"{printed:.1e}"
    own = f"{stable:.1e} / {f.bound:.0e}"
    return [f.paper, f.what, f"`{f.printed}`", f"`{f.stable}`", f.domain, f.unit, shown, own, f"{digits:.1f}"]


def markdown(head: tuple[str, ...], rows: list[list[str]]) -> str:
    """A table; a bar inside a cell would end it."""
    lines = [list(head), ["---"] * len(head), *[[cell.replace("|", "\\|") for cell in row] for row in rows]]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def committed(head: tuple[str, ...], page: str) -> list[list[str]]:
    """Cells of the page's table that has this head."""
    lines = page.splitlines()
    start = lines.index(markdown(head, []).splitlines()[0])
    rows = []
    for line in lines[start + 2 :]:
        if not line.startswith("|"):
            break
        cells = line.replace("\\|", "\0").strip("|").split("|")
        rows.append([cell.strip().replace("\0", "|") for cell in cells])
    return rows


def is_told(told: float, found: float, least: float) -> bool:
    """Whether an error is what the page says of it: within a factor of two either way, or both below a rounding."""
    return found <= 2 * told + least and told <= 2 * found + least


def promises(rows: list[list[str]]) -> list[list[str]]:
    """Rows without what was measured: names, words and bounds."""
    return [[_bound(cell) for cell in row] for row in rows]


def _bound(cell: Any) -> str:
    parts = str(cell).split(" / ")
    try:
        return f"{float(parts[1]):.0e}" if len(parts) == 2 and float(parts[0]) >= 0 else str(cell)
    except ValueError:
        return str(cell)
