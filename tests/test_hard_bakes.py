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
    told = next(row[2] for row in _table(registry.OUTCOME_HEAD) if row[0] == str(outcome))
    if isinstance(found, str):
        assert told == registry.outcome_row(outcome, found)[2]
    else:
        # Sums of float32 round in another order on another machine.
        assert registry.is_told(float(told), found, 1e-7), f"the page says {told}, found {found:.1e}"


@pytest.mark.parametrize("formula", registry.FORMULAS, ids=str)
def test_formula(formula: Formula) -> None:
    """Ours keeps its bound; the printed one is worse by more than two digits, else it would not be in the table."""
    printed, stable = formula.errors()
    assert stable <= formula.bound
    assert digits_saved(printed, stable) > 2
    row = next(
        row
        for row in _table(registry.FORMULA_HEAD)
        if (row[0], row[1], row[4]) == (formula.paper, formula.what, formula.domain)
    )
    told = float("inf") if row[6] == "not finite" else float(row[6])
    assert registry.is_told(told, printed, 1e-8), f"the page says {row[6]} as printed, found {printed:.1e}"
    assert registry.is_told(float(row[7].split(" / ")[0]), stable, 3e-8), f"the page says {row[7]}, found {stable:.1e}"
    assert abs(float(row[8]) - digits_saved(printed, stable)) < 0.5


def _table(head: tuple[str, ...]) -> list[list[str]]:
    """Cells of the committed table that has this head."""
    return registry.committed(head, TABLES.read_text(encoding="utf-8"))


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
