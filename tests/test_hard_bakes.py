"""Whole bakes of hostile sources and stacks; formulas of the papers and what stands in their place; the tables."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.hard import registry
from support.hard.bakes import Outcome, is_kept, measure
from support.hard.formula import Formula, digits_saved

pytestmark = pytest.mark.hard
TABLES = Path(__file__).parents[1] / "addon" / "docs" / "hard_cases.md"


@pytest.mark.parametrize("outcome", registry.outcomes(), ids=str)
def test_outcome(outcome: Outcome, tmp_path: Path) -> None:
    """A right result, or one line that refuses; warnings of numpy are errors here."""
    found = measure(outcome, tmp_path)
    print(found)
    assert is_kept(outcome, found), f"promised {outcome.promise}, found {found}"


@pytest.mark.parametrize("formula", registry.FORMULAS, ids=str)
def test_formula(formula: Formula) -> None:
    """Ours keeps its bound; the printed one is worse by more than two digits, else it would not be in the table."""
    printed, stable = formula.errors()
    assert stable <= formula.bound
    assert digits_saved(printed, stable) > 2


def _table(head: tuple[str, ...]) -> list[list[str]]:
    """Cells of the committed table that has this head."""
    lines = TABLES.read_text(encoding="utf-8").splitlines()
    start = lines.index(registry.markdown(head, []).splitlines()[0])
    rows = []
    for line in lines[start + 2 :]:
        if not line.startswith("|"):
            break
        rows.append([cell.strip().replace("\\|", "|") for cell in line.replace("\\|", "\0").strip("|").split("|")])
    return [[cell.replace("\0", "|") for cell in row] for row in rows]


def test_committed_table_of_cases() -> None:
    """It lists exactly the registry's cases, with their bounds; `./run bench hard` writes it."""
    now = [registry.case_row(case, dict.fromkeys(case.bounds, 0.0)) for case in registry.cases()]
    assert registry.promises(_table(registry.CASE_HEAD)) == registry.promises(now)
    page = TABLES.read_text(encoding="utf-8")
    assert all(f"{k}. {note}" in page for k, note in enumerate(registry.notes(), 1))


def test_committed_table_of_outcomes() -> None:
    now = [registry.outcome_row(outcome, "")[:2] for outcome in registry.outcomes()]
    assert [row[:2] for row in _table(registry.OUTCOME_HEAD)] == now


def test_committed_table_of_formulas() -> None:
    now = [registry.formula_row(f, 0.0, 0.0, 0.0) for f in registry.FORMULAS]
    told = [[*row[:6], registry.promises([row])[0][7]] for row in _table(registry.FORMULA_HEAD)]
    assert told == [[*row[:6], registry.promises([row])[0][7]] for row in now]
