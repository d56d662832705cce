"""The report: charts and their picks, the page, taking up a stopped run, and the command from end to end."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from measured_materials.addon.cli.main import main
from measured_materials.addon.report import pictures, run, techniques
from measured_materials.addon.report.inputs import read_inputs
from measured_materials.addon.report.render_timing import Effort
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.errors import BakeError
from measured_materials.bake.images.storage import TABLE_STORAGES, Storage
from measured_materials.bake.lobes.cosine_lobes import COSINE_LOBES
from measured_materials.bake.report import maps, tables, tabulation
from measured_materials.bake.report.chart import COLOURS, Chart, Point, number
from measured_materials.bake.report.journal import Journal
from measured_materials.bake.report.lobes import BARE_POWER, LobeCost, lobes_section, measure_lobes
from measured_materials.bake.report.page import Section, Table, write_page
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.shading_maps.bake import ArcSettings, bake_arc
from measured_materials.bake.sources.analytic import by_name
from measured_materials.bake.sources.merl import write_merl
from measured_materials.bake.tables.table import FILTERS
from support.stacks import write_stack


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
    space = "{http://www.w3.org/2000/svg}"
    circles = [c for c in picture.iter(f"{space}circle") if c.find(f"{space}title") is not None]
    assert len(circles) == 3
    for circle in circles:
        assert 84 <= float(circle.get("cx", "")) <= 624 and 40 <= float(circle.get("cy", "")) <= 384
    texts = [t.text for t in picture.iter(f"{space}text")]
    assert "a < b & c" in texts and "x & y" in texts


def test_label_of_the_pick_hides_no_point() -> None:
    """Where the usual place, above and towards the middle, is taken by another point."""
    found = points((100, 1.0), (700, 0.001), (1000, 0.5))
    usual = _label(Chart("t", "c", "e", {"a": found}, knee=False))
    crowded = _label(Chart("t", "c", "e", {"a": found, "b": points((650, 0.0012))}, knee=False))
    assert (usual["text-anchor"], crowded["text-anchor"]) == ("end", "start")


def _label(chart: Chart) -> dict[str, str]:
    picture = ElementTree.fromstring(chart.svg())
    (label,) = [text for text in picture.iter("{http://www.w3.org/2000/svg}text") if text.get("paint-order")]
    return dict(label.attrib)


def test_page_escapes_and_keeps_an_older_one_whole(tmp_path: Path) -> None:
    section = Section("A: <b>", ["x < y"], tables=[Table(("a", "b"), [("<i>", 0.123456)])])
    path = write_page(tmp_path, "T", ["words"], [section], {"n": 1})
    text = path.read_text()
    assert "<b>" not in text and "&lt;i&gt;" in text and "0.123" in text
    assert (tmp_path / "a_b.csv").read_text() == "a,b\n<i>,0.123456\n"
    assert json.loads((tmp_path / "report.json").read_text()) == {"n": 1}
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a_b.csv", "report.html", "report.json"]


@pytest.mark.parametrize("names", [("бархат", "шёлк"), ("gold-1", "gold_1"), ("ш" * 200, "x\udcff")])
def test_every_input_has_files_of_its_own(tmp_path: Path, names: tuple[str, str]) -> None:
    sections = [Section(f"Tables: {name}", tables=[Table(("a",), [(k,)])] * 2) for k, name in enumerate(names)]
    text = write_page(tmp_path, "T", [], sections, {}).read_text()
    found = [path.read_text() for path in tmp_path.glob("*.csv")]
    assert sorted(found) == ["a\n0\n", "a\n0\n", "a\n1\n", "a\n1\n"]
    anchors = re.findall('h2 id="([^"]*)"', text)
    assert len(set(anchors)) == 2 and re.findall('href="#([^"]*)"', text) == anchors


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


def test_costs_that_are_about_equal_leave_the_more_accurate_one() -> None:
    a = points((1.0, 1.0), (1.1, 0.1), (2.0, 0.05))
    chart = Chart("t", "c", "e", {"a": a}, same=1.15)
    assert chart.front() == a[1:] and Chart("t", "c", "e", {"a": a}).front() == a
    # A chain of small steps must not lose its end.
    chain = points(*((1.1**k, 2.0**-k) for k in range(6)))
    assert Chart("t", "c", "e", {"a": chain}, same=1.15).front() == chain[-1:]


def test_series_apart_are_shown_but_not_picked() -> None:
    chart = Chart("t", "c", "e", {"a": points((1, 1)), "b": points((0.5, 0.1))}, apart=("b",))
    assert chart.front() == points((1, 1)) and chart.svg().count("<title>") == 2
    assert "Pareto front of the others" in chart.svg() and "nothing beats it" not in chart.svg()


@pytest.mark.parametrize(
    "cost, axis, words",
    [
        (82944, "bytes in the file, before compression", "82.9 kB"),
        (957, "bytes in the file, before compression", "957 bytes"),
        (667, "ns per lookup, numpy", "667 ns per lookup"),
    ],
)
def test_verdict_names_the_unit(cost: float, axis: str, words: str) -> None:
    chart = Chart("t", axis, "e", {"a": points((cost, 0.5))})
    assert chart.verdict() == f"Our pick: a, {cost:g} (error 0.5 at {words})."


def test_noise_is_picked_by_accuracy() -> None:
    bent = points((1, 1), (2, 0.01), (100, 0.005))
    assert Chart("t", "c", "e", {"a": bent}, knee=False).pick() == bent[-1]


@pytest.mark.parametrize(
    ("value", "words"), [(0.01234, "0.0123"), (999.4, "999"), (1984.0, "1980"), (82944.0, "82.9 k"), (1.5e6, "1.5 M")]
)
def test_numbers_are_short(value: float, words: str) -> None:
    assert number(value) == words


def test_more_series_than_colours_differ_in_their_marks() -> None:
    chart = Chart("t", "c", "e", {str(k): points((1 + k, 1 + k)) for k in range(2 * len(COLOURS) + 1)})
    picture = ElementTree.fromstring(chart.svg())
    space = "{http://www.w3.org/2000/svg}"
    marked = [el.tag.removeprefix(space) for el in picture.iter() if el.find(f"{space}title") is not None]
    assert [marked.count(kind) for kind in ("circle", "rect", "path")] == [len(COLOURS), len(COLOURS), 1]


def test_lobes_are_measured(tmp_path: Path) -> None:
    costs = measure_lobes(Journal(tmp_path / "j", {}))
    by_name = {cost.name: cost for cost in costs}
    assert by_name["power"].whole < 1e-4 < by_name["cubic"].core < 0.0055 < by_name["schlick"].core
    assert all(cost.ns > 0 for cost in costs)


@pytest.mark.parametrize(
    ("times", "words"),
    [
        ({"schlick": 5.0, "cubic": 9.0}, "as cheap as any"),
        ({"schlick": 1.0, "cubic": 9.0}, "only schlick is cheaper"),
        ({"schlick": 1.0, "cubic": 1.0}, "still the cheaper, by a factor of 4"),
    ],
)
def test_verdict_on_pow_follows_the_times(times: dict[str, float], words: str) -> None:
    costs = [LobeCost(name, 0.1, 0.1, 1.0) for name in (*COSINE_LOBES, BARE_POWER)]
    column = {BARE_POWER: 4.0, "power": 20.0, **times}
    section = lobes_section(costs, {"nodes": column}, "Open Shading Language is not part of this Blender")
    assert words in section.words[1] and "Open Shading Language" in section.notes[0]


# --- the command ----------------------------------------------------------------------------------------


@pytest.fixture
def tiny(monkeypatch: pytest.MonkeyPatch) -> None:
    """All parts of a quick report, as small as they can be."""
    monkeypatch.setattr(tabulation, "CHOSEN_AT", 12)
    monkeypatch.setattr(tabulation, "_PAIRS", 2048)
    small = BakeSettings(12, alpha=(0.5, 0.4), sampler=SamplerLayout(16, 16, 8))
    monkeypatch.setattr(pictures, "bake_source", lambda source, out: bake_source(source, out, small))
    sizes = run.Sizes(
        tables=tables.TableSizes((8, 12), False),
        lookups=tables.TableSizes((8,), False),
        maps=maps.MapSizes((3, 4), (4,), (Storage.HALF, Storage.BYTE), 2),
        pictures=pictures.Sizes(24, (2, 4), 4, 16),
        techniques=techniques.TechniqueSizes((2, 4)),
        swatch=(16, 2),
        lookup_effort=Effort(16, 2, 1),
        lobe_effort=Effort(16, 2, 1),
        seconds=run.QUICK.seconds,
    )
    monkeypatch.setattr(run, "QUICK", sizes)


@pytest.mark.slow
def test_report_from_end_to_end(
    tiny: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A stopped run is taken up; every chart has its points; a third call measures nothing again."""
    call = ["report", "--quick", "--out", str(tmp_path), "--json"]

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as stopped:
        stopped.setattr(run, "measure_map_times", interrupted)
        assert main(call) == 130 and not (tmp_path / "report.html").exists()
    (journal,) = tmp_path.glob(".measured/*/journal.jsonl")
    before = journal.read_text()
    assert "pictures metallic-paint exact" in before and '["lobes' not in before
    capsys.readouterr()

    assert main(call) == 0
    document = json.loads(capsys.readouterr().out)
    assert journal.read_text().startswith(before)
    page = (tmp_path / "report.html").read_text()
    osl = "OSL, n varies" in document["lobes"]["rendered"]
    assert len(re.findall("<svg", page)) == 10 + osl
    # The truth, seven variants or nine and their differences; two cases of five; four renders and their differences.
    assert len(re.findall("<img", page)) == 15 + 4 * osl + 10 + 8
    _check_facts(document)

    whole = journal.read_text()
    assert main(call) == 0
    assert json.loads(capsys.readouterr().out)["tables"] == document["tables"]
    assert journal.read_text() == whole


def _check_facts(document: dict[str, Any]) -> None:
    settings = document["tables"]["paint"]
    per_resolution = len(FILTERS) - 1 + len(TABLE_STORAGES)
    assert len(settings) == len(tabulation.KINDS) * 2 * per_resolution
    assert {s["storage"] for s in settings} == set(TABLE_STORAGES)
    timed = [s for s in settings if s["render_ns"] is not None]
    # Each kind at one resolution, and of one kind every filter and storage.
    assert len(timed) == len(tabulation.KINDS) - 1 + per_resolution and {s["resolution"] for s in timed} == {8}
    rendered = document["pictures"]["paint"]
    plain = {"Principled BSDF", "preview", "balanced", "exact", "reference"}
    osl = {pictures.SAMPLED, pictures.SAMPLED_DENOISED} if "OSL, n varies" in document["lobes"]["rendered"] else set()
    assert {row["variant"] for row in rendered} == plain | osl | {"preview, denoised", "exact, denoised"}
    assert {s["model"] for s in document["maps"]["cloth"]} == {model.name for model in maps.MODELS}
    lookup = {
        row["case"]: row["rms"] for row in document["techniques"]["cloth"]["cases"] if row["technique"] == "lookup"
    }
    assert lookup["light from behind"] > lookup["between two photographs"]


def test_inputs_of_the_user(tiny: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A folder of photographs, the map baked from it, and one without lights: no word of what cannot be known."""
    folder = write_stack(tmp_path / "denim", tuple(range(8, 88, 8)), size=(20, 16))
    nameless = tmp_path / "felt"
    nameless.mkdir()
    for k, file in enumerate(sorted(folder.iterdir())):
        (nameless / f"{chr(97 + k)}.png").write_bytes(file.read_bytes())
    result = bake_arc(folder, tmp_path / "baked.mmat", ArcSettings(slices=6))
    inputs = [str(path) for path in (folder, nameless, result.path)]
    assert main(["report", *inputs, "--quick", "--json", "--out", str(tmp_path / "out")]) == 0
    document = json.loads(capsys.readouterr().out)
    assert set(document["maps"]) == {"denim", "felt", "baked"} and "tables" not in document
    assert [row["case"] for row in document["techniques"]["denim"]["cases"]] == ["photographs left out"] * 12
    assert document["techniques"]["felt"] == document["techniques"]["baked"] == {"cases": [], "rendered": []}
    # These photographs are power laws of the light: the map predicts those left out, the lit texture does not.
    errors = {r["technique"]: r["rms"] for r in document["techniques"]["denim"]["cases"]}
    assert errors["lookup"] < 0.5 * errors["lit_texture"]


def test_other_inputs_of_the_same_name_are_measured_anew(tmp_path: Path) -> None:
    for k, model in enumerate(("metallic-paint", "oren-nayar")):
        (tmp_path / str(k)).mkdir()
        write_merl(tmp_path / str(k) / "same.binary", by_name(model))
    origins = [read_inputs([tmp_path / str(k) / "same.binary"]).origin for k in range(2)]
    assert origins[0] != origins[1]
    with pytest.raises(BakeError, match="is the name of two inputs"):
        read_inputs([tmp_path / str(k) / "same.binary" for k in range(2)])


def test_bad_inputs_are_one_clear_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "bad.binary").write_bytes(b"no")
    (tmp_path / "empty").mkdir()
    write_stack(tmp_path / "few", (20, 60))
    brdf = bake_source(by_name("oren-nayar"), tmp_path / "brdf", BakeSettings(8, envelope=False)).path
    for path, words in (
        (tmp_path / "bad.binary", "bad.binary: truncated"),
        (tmp_path / "empty", "empty: holds no photograph"),
        (tmp_path / "few", "few: holds 2 photographs"),
        (brdf, "is a baked BRDF; give the measurement"),
        (tmp_path / "none.bsdf", "does not exist"),
    ):
        assert main(["report", str(path), "--out", str(tmp_path / "out"), "--quick"]) == 1
        told = capsys.readouterr().err.splitlines()
        assert len(told) == 1 and words in told[0], told
    (tmp_path / "file").write_text("")
    assert main(["report", "--quick", "--out", str(tmp_path / "file" / "in")]) == 1
    assert "choose another folder by --out" in capsys.readouterr().err
