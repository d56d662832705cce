"""A plugin for pytest that writes down how much of its tolerance each numeric assertion used: `./run bench tolerances`.

Seen are `np.testing.assert_allclose`, `pytest.approx`, and plain assertions of the form `error < bound` whose sides are
numbers (conjunctions too). An assertion is known by its line; of all times it ran, the one nearest to its
bound counts.
"""

from __future__ import annotations

import csv
import math
import os
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from _pytest.assertion import rewrite

TESTS = Path(__file__).resolve().parents[1]
# Python's cache of rewritten tests does not know of the hook: these get one of their own.
rewrite.PYC_TAIL = f"-watched{rewrite.PYC_TAIL}"
ApproxScalar: Any = type(pytest.approx(1.0))
FILE = "MM_TOLERANCES"  # environment variable: where to write
NUMBER = r"[-+]?(?:\d+\.?\d*(?:[eE][-+]?\d+)?|\.\d+)"
# "1e-07 < 0.001" in pytest's explanation; a bound below which something lies is not an error but a claim of its own.
COMPARISON = re.compile(rf"(?<![-\w.])({NUMBER}) <=? ({NUMBER})(?![\w.])")


class Used:
    """Allowed and achieved of assertions by place."""

    def __init__(self) -> None:
        self.found: dict[str, tuple[float, float, str]] = {}

    def note(self, achieved: float, allowed: float, words: str) -> None:
        """Of the line of a test that is running."""
        if not (math.isfinite(achieved) and math.isfinite(allowed)) or allowed <= 0:
            return
        place = _place()
        before = self.found.get(place)
        if before is None or achieved / allowed > before[0] / before[1]:
            self.found[place] = (achieved, allowed, " ".join(words.split())[:160])


_USED = Used()


def _place() -> str:
    # Strings, not paths: properties are checked many thousand times.
    frame, folder = sys._getframe(1), f"{TESTS}{os.sep}"
    while frame is not None:
        name = frame.f_code.co_filename
        if name.startswith(folder) and name != __file__:
            return f"{name.removeprefix(folder)}:{frame.f_lineno}"
        frame = frame.f_back  # type: ignore[assignment]
    return "elsewhere"


def share_of_allclose(actual: Any, desired: Any, rtol: float, atol: float) -> tuple[float, float]:
    """Largest difference in parts of its own tolerance, and 1; 0 and 1 where there is no tolerance or no difference."""
    actual, desired = (np.asarray(a, float) for a in (actual, desired))
    with np.errstate(all="ignore"):
        share = np.abs(actual - desired) / (atol + rtol * np.abs(desired))
    share = share[np.isfinite(share)]
    return float(share.max(initial=0.0)), 1.0


def errors_in(explanation: str) -> list[tuple[float, float]]:
    """Achieved and allowed of each "a < b" in a passed assertion's explanation; neither with a negative side."""
    pairs = [(float(a), float(b)) for a, b in COMPARISON.findall(explanation.split("\n")[0])]
    return [(a, b) for a, b in pairs if a >= 0 and b > 0]


def pytest_assertion_pass(item: pytest.Item, lineno: int, orig: str, expl: str) -> None:
    """Called by rewritten assertions where the option `enable_assertion_pass_hook` is set."""
    if "approx" in orig:
        return
    for achieved, allowed in errors_in(expl):
        _USED.note(achieved, allowed, orig)


def pytest_configure(config: pytest.Config) -> None:
    """Watch the two helpers."""
    allclose, equal = np.testing.assert_allclose, ApproxScalar.__eq__

    def watched(actual: Any, desired: Any, rtol: float = 1e-7, atol: float = 0, *rest: Any, **named: Any) -> None:
        allclose(actual, desired, rtol, atol, *rest, **named)
        _USED.note(*share_of_allclose(actual, desired, rtol, atol), f"assert_allclose, rtol {rtol:g}, atol {atol:g}")

    def watched_equal(self: Any, actual: Any) -> bool:
        result = equal(self, actual)
        try:
            if result and math.isfinite(self.expected):
                _USED.note(abs(actual - self.expected), self.tolerance, repr(self))
        except TypeError:
            pass
        return result

    np.testing.assert_allclose = watched
    ApproxScalar.__eq__ = watched_equal


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Write what was seen."""
    with open(os.environ[FILE], "w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(("place", "achieved", "allowed", "assertion"))
        writer.writerows((place, *values) for place, values in sorted(_USED.found.items()))
