"""The list of tolerances: what an assertion allowed and what it needed are read right."""

from __future__ import annotations

import importlib
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.tolerances import errors_in, share_of_allclose

TESTS = Path(__file__).resolve().parent
PLANTED = """
import numpy as np
import pytest


@pytest.mark.parametrize("error", [1e-5, 3e-4])
def test_planted(error):
    np.testing.assert_allclose([1, 1 + error], 1, rtol=1e-3)
    assert 2 + error == pytest.approx(2, abs=6e-4)
    assert np.abs([0, error]).max() < 0.003
    assert error < 0.03 and 0 <= error
"""


@pytest.mark.parametrize(
    "text, pairs",
    [
        ("1e-07 < 0.001\n{1e-07 = <built-in>", [(1e-07, 0.001)]),
        ("(0.2 < 0.5 and 3 < 4)", [(0.2, 0.5), (3, 4)]),
        ("0.9 > 0.8", []),
        ("-0.5 < 0.1", []),
        ("array([1.0]) < 0.1", []),
        ("a1 < 0.1", []),
    ],
)
def test_errors_in_an_explanation(text: str, pairs: list[tuple[float, float]]) -> None:
    assert errors_in(text) == pairs


def test_share_of_a_tolerance() -> None:
    share, _ = share_of_allclose([1.001, 100.1, math.nan], [1, 100, math.nan], rtol=2e-3, atol=0)
    assert share == pytest.approx(0.5, rel=1e-6)
    assert share_of_allclose(np.zeros(0), 0, 0, 0) == (0, 1)
    assert share_of_allclose(1, 1.5, 0, 1)[0] == 0.5


def test_planted_assertions_are_listed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In a run of their own: the worst of each line, by all three ways of asserting."""
    monkeypatch.syspath_prepend(str(TESTS / "bench"))
    bench: Any = importlib.import_module("bench_tolerances")
    # What is listed lies among the tests.
    planted = TESTS / "support" / f"planted_{tmp_path.name}.py"
    try:
        planted.write_text(PLANTED)
        assert bench.watch([planted], tmp_path / "found.csv") == 0
    finally:
        planted.unlink()
        sys.modules.pop("bench_tolerances", None)
    rows = bench.read(tmp_path / "found.csv")
    shares = {place.split(":")[1]: achieved / allowed for place, achieved, allowed, _ in rows}
    assert shares == pytest.approx({"8": 0.3, "9": 0.5, "10": 0.1, "11": 0.01}, rel=1e-3)
