"""The report: charts and their picks, the page, taking up a stopped run, and the command from end to end."""

from __future__ import annotations

import json
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
from measured_materials.addon import report_pictures
from measured_materials.addon.cli import main
from measured_materials.bake.report import tables
from measured_materials.bake.report.chart import Chart, Point
from measured_materials.bake.report.journal import Journal
from measured_materials.bake.report.lobes import lobes_section, measure_lobes
from measured_materials.bake.report.page import Section, Table, write_page


def points(*pairs: tuple[float, float]) -> list[Point]:
    return [Point(cost, error, f"{cost:g}") for cost, error in pairs]


def test_front_holds_what_nothing_beats() -> None:
    chart = Chart("t", "c", "e", {"a": points((1, 1), (2, 0.5), (3, 0.6)), "b": points((2, 0.4), (4, 0.39))})
    assert [(p.cost, p.error) for p in chart.front()] == [(1, 1), (2, 0.4), (4, 0.39)]


def test_pick_is_the_knee_or_the_most_accurate() -> None:
    assert Chart("t", "c", "e", {"a": points((1, 1), (2, 0.01), (100, 0.005))}).pick() == Point(2, 0.01, "2")
    # Noise that falls with the root of time has no knee.
    noise = points(*((4.0**k, 2.0**-k) for k in range(5)))
    assert Chart("t", "c", "e", {"a": noise}).pick() == noise[-1]
    assert Chart("t", "c", "e").pick() is None


def test_chart_is_well_formed_and_inside_its_frame() -> None:
    chart = Chart("a < b & c", "bytes", "RMS", {"x & y": points((1e3, 1e-2), (1e6, 0.0)), "z": points((5e4, 3e-5))})
    picture = ElementTree.fromstring(chart.svg())
    circles = [c for c in picture.iter("circle") if c.find("title") is not None]
    assert len(circles) == 3
    for circle in circles:
        assert 76 <= float(circle.get("cx", "")) <= 560 and 34 <= float(circle.get("cy", "")) <= 370
    texts = [t.text for t in picture.iter("text")]
    assert "a < b & c" in texts and "x & y" in texts


def test_page_escapes_and_keeps_an_older_one_whole(tmp_path: Path) -> None:
    section = Section("A: <b>", ["x < y"], tables=[Table(("a", "b"), [("<i>", 0.123456)])])
    path = write_page(tmp_path, "T", ["words"], [section], {"n": 1})
    text = path.read_text()
    assert "<b>" not in text and "&lt;i&gt;" in text and "0.123" in text
    assert (tmp_path / "a_b.csv").read_text() == "a,b\n<i>,0.123456\n"
    assert json.loads((tmp_path / "report.json").read_text()) == {"n": 1}
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a_b.csv", "report.html", "report.json"]


def test_journal_takes_up_a_stopped_run(tmp_path: Path) -> None:
    path, calls = tmp_path / "deep" / "j.jsonl", []

    def measured() -> int:
        calls.append(1)
        return len(calls)

    first = Journal(path, {"v": 1})
    assert first.measure("a", measured) == 1 and first.measure("b", measured) == 2
    path.write_text(path.read_text() + '["c", 3')  # cut short by a killed process
    again = Journal(path, {"v": 1})
    assert (again.measure("a", measured), again.measure("b", measured)) == (1, 2) and len(calls) == 2
    assert again.measure("c", measured) == 3
    assert Journal(path, {"v": 1}).found == {"a": 1, "b": 2, "c": 3}
    assert Journal(path, {"v": 2}).found == {}


def test_lobes_are_measured(tmp_path: Path) -> None:
    costs = {cost.name: cost for cost in measure_lobes(Journal(tmp_path / "j", {}))}
    assert costs["power"].whole < 1e-4 < costs["cubic"].core < 0.0055 < costs["schlick"].core
    assert all(cost.ns > 0 for cost in costs.values())
    assert "power" in lobes_section(list(costs.values())).words[0]


def test_report_from_end_to_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every chart has its points; a second call measures nothing again."""
    monkeypatch.setattr(tables, "QUICK_RESOLUTIONS", (8, 12))
    monkeypatch.setattr(tables, "_CHOSEN_AT", 12)
    monkeypatch.setattr(report_pictures, "QUICK", report_pictures.Sizes(24, (1, 4), 4, 16))
    assert main(["report", "--quick", "--out", str(tmp_path), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    page = (tmp_path / "report.html").read_text()
    assert len(re.findall("<svg", page)) == 5 and len(re.findall("<img", page)) == 11
    settings = document["tables"]["metallic-paint"]
    assert len(settings) == len(tables.KINDS) * 2 * 6
    best = min(settings, key=lambda s: s["rms"])
    assert (best["basis"], best["parameterization"]) == ("half", "fitted")
    rendered = document["pictures"]["metallic-paint"]
    assert {row["variant"] for row in rendered} == {"Principled BSDF", "preview", "balanced", "exact", "reference"}

    before = (tmp_path / ".measured" / "journal.jsonl").read_text()
    assert main(["report", "--quick", "--out", str(tmp_path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["tables"] == document["tables"]
    assert (tmp_path / ".measured" / "journal.jsonl").read_text() == before


def test_report_names_a_bad_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "bad.binary").write_bytes(b"no")
    assert main(["report", str(tmp_path / "bad.binary"), "--out", str(tmp_path / "out")]) == 1
    assert "bad.binary" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
