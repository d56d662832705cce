"""The list of planted mistakes fits the sources; that tests see them is the matter of `./run bench planted`."""

from __future__ import annotations

from pathlib import Path

import pytest
from planted import all_mistakes
from planted.harness import _seen
from planted.mistake import Mistake

ROOT = Path(__file__).resolve().parents[1]
MISTAKES = all_mistakes()


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_can_still_be_planted(name: str) -> None:
    """Whoever changes the line brings the entry in line with it, or removes it with the mistake it stood for."""
    assert MISTAKES[name].stale(ROOT) == ""
    assert MISTAKES[name].why


def test_what_cannot_be_planted_is_said(tmp_path: Path) -> None:
    (tmp_path / "code.py").write_text("a = 1\nb = 1\n")
    (tmp_path / "test_code.py").write_text("def test_x(a): ...\n")

    def stale(file: str = "code.py", find: str = "a = 1", replace: str = "a = 2", test: str = "test_code.py") -> str:
        return Mistake("name", file, find, replace, (test,) if test else (), "why").stale(tmp_path)

    assert stale() == "" and stale(test="test_code.py::test_x[a]") == ""
    assert stale(file="none.py") == "none.py is no file"
    assert "holds its text 2 times" in stale(find="= 1") and "0 times" in stale(find="c = 1")
    assert stale(test="test_code.py::test_y") == "test_code.py::test_y is no test"
    assert stale(replace="a = 1") == "it changes nothing"
    assert stale(test="test_none.py::test_x") == "test_none.py is no file" and stale(test="") == "it names no test"


def test_planting_changes_one_place(tmp_path: Path) -> None:
    (tmp_path / "code.py").write_text("a = 1\nb = 1\n")
    restore = Mistake("name", "code.py", "b = 1", "b = 2", ("code.py",), "why").plant(tmp_path)
    assert (tmp_path / "code.py").read_text() == "a = 1\nb = 2\n"
    restore()
    assert (tmp_path / "code.py").read_text() == "a = 1\nb = 1\n"


def test_how_a_run_sees_a_mistake() -> None:
    title = "_ test_x[a-b] _\n"
    assert _seen(0, "") == "" and _seen(1, title) == "by test_x[a-b]" and _seen(None, "") == "by a hang"
    assert (
        _seen(2, "_____ ERROR collecting tests/test_a.py _____") == "by tests/test_a.py"
        and _seen(-11, "") == "by signal 11"
    )
    with pytest.raises(RuntimeError, match="ended with 4"):
        _seen(4, "no such test")
