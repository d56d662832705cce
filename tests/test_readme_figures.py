"""Figures of the README and of the page of hard cases: each registered with its bench, and as recorded."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

import pytest

TESTS = Path(__file__).resolve().parent


@pytest.fixture(scope="module")
def bench() -> Any:
    """`tests/bench/bench_readme.py`, whose neighbours it imports by their names."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(TESTS / "bench"))
        import bench_readme

        yield bench_readme
        for name in ("bench_readme", "readme_figures", "record"):
            sys.modules.pop(name, None)


@pytest.fixture(scope="module")
def figures(bench: Any) -> Any:
    return sys.modules["readme_figures"]


def test_every_number_of_the_readme_has_its_bench(figures: Any) -> None:
    assert figures.unregistered((figures.ROOT / "README.md").read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    "text, left",
    [
        ("It takes 12 s.", ["It takes 12 s."]),
        ("In 2016, `code 7` and\n\n    ./run 9\n\n1. Select [this](a3.png).", []),
        ("| nearest | 1.03 | slow |", []),
        ("| nearest | 1.03 | of 1.5 |", ["of 1.5 |"]),
    ],
)
def test_what_counts_as_a_number(figures: Any, text: str, left: list[str]) -> None:
    assert [part.lstrip("| ") for part in figures.unregistered(text)] == left


def test_every_registered_text_stands_once(figures: Any) -> None:
    for stated in figures.STATED:
        assert len(stated.pattern().findall(figures.words(stated.file))) == 1, stated.template
    text = figures.words()
    assert [words for words in figures.NO_FIGURES if words not in text] == []


RECORDS = sorted({path.stem for path in (TESTS / "bench" / "recorded").glob("*.json")})


def recorded(name: str) -> dict[str, float]:
    if name not in RECORDS:
        pytest.skip(f"nothing recorded: ./run bench {name} --record")
    return json.loads((TESTS / "bench" / "recorded" / f"{name}.json").read_text(encoding="utf-8"))["values"]


BENCHES = (
    "azimuth",
    "fig4",
    "parallax",
    "normals",
    "softbox",
    "mitsuba",
    "engine",
    "arc",
    "techniques",
    "lobes",
    "cost",
    "speed",
    "bases",
    "tables",
    "bytes",
    "within",
    "anisotropic",
    "formats",
    "readings",
    "behind",
    "sheets",
    "maps",
    "detail",
    "library",
    "thousand",
    "faults",
)


def test_the_benches_are_all_that_are_named(figures: Any) -> None:
    assert {stated.bench for stated in figures.STATED} == set(BENCHES)
    assert set(RECORDS) <= {*BENCHES, "hard"}


@pytest.mark.parametrize("name", BENCHES)
def test_the_readme_states_what_the_bench_wrote(bench: Any, figures: Any, name: str) -> None:
    """To the printed digits, and whatever words claim."""
    values = recorded(name)
    lines = [line for stated in figures.STATED if stated.bench == name for line in bench.compare(stated, values)]
    assert [line for line in lines if not line.startswith("ok")] == []


def test_the_page_of_hard_cases_states_what_the_bench_wrote(bench: Any) -> None:
    assert [line for line in bench.compare_page(recorded("hard")) if not line.startswith("ok")] == []


def test_the_page_of_hard_cases_has_its_numbers(bench: Any) -> None:
    """What the comparison reads of it: as many worst errors as it has cells with a bound."""
    page = (bench.ROOT / bench.PAGE).read_text(encoding="utf-8")
    bounded = len(re.findall(r"\| \d[^|]*e[+-]\d+ / \d", page))
    assert len(bench.page_figures(page)) >= bounded > 100


@pytest.mark.parametrize(
    "value, form, text",
    [
        (0.01559, "4", "0.0156"),
        (304, "2s", "300"),
        (2160, "2s", "2200"),
        (0.996, "2s", "1.0"),
        (9.96, "2s", "10"),
        (0.0047, "1%", "0.5"),
        (0.0903, "2s%", "9.0"),
        (0.767, "2s%", "77"),
        (0, "2s", "0"),
        (7.6149, "1", "7.6"),
    ],
)
def test_figures_as_they_are_printed(figures: Any, value: float, form: str, text: str) -> None:
    assert figures.printed(value, form) == text


def test_recorded_figures_are_written_in_place(figures: Any) -> None:
    """Whatever lines they are broken over, and nothing else with them."""
    one = figures.Stated("cost", "RMS {a|4} and {b ÷ a|1} times")
    assert one.filled("1 RMS\n  0.1 and 22\ntimes 3", {"a": 0.5, "b": 1}) == "1 RMS\n  0.5000 and 2.0\ntimes 3"
    text = (figures.ROOT / "README.md").read_text(encoding="utf-8")
    for stated in (stated for stated in figures.STATED if stated.file == "README.md"):
        shown = dict(zip((name for name, _ in stated.fields), stated.pattern().search(text).groups()))
        plain = {name: float(value) for name, value in shown.items() if "÷" not in name}
        if len(plain) == len(shown) and not any(form.endswith("%") for _, form in stated.fields):
            assert stated.filled(text, plain) == text


def test_a_disagreement_is_marked(bench: Any, figures: Any) -> None:
    one = next(stated for stated in figures.STATED if stated.template.startswith("| nearest"))
    (shown,) = one.pattern().search(figures.words()).groups()
    assert bench.compare(one, {"time, nearest": float(shown)})[0].startswith("ok")
    assert bench.compare(one, {"time, nearest": float(shown) + 0.02})[0].startswith("WRONG")
    assert bench.compare(one, {})[0].startswith("?")
    claim = figures.Stated("cost", one.template, claims=("a < b", "2 < a ÷ b"))
    assert [line[:5] for line in bench.compare(claim, {"a": 1, "b": 2})[1:]] == ["ok   ", "WRONG"]
