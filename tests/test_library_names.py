"""What a library is made of: which sources, under which names, and the words by which each is baked alone."""

from __future__ import annotations

import argparse
import itertools
import json
import os
import pickle
from pathlib import Path
from typing import Any

import pytest
from measured_materials.addon.baking.request import Model
from measured_materials.addon.cli import library, main
from measured_materials.addon.cli.console.option_words import words_of
from measured_materials.addon.library.names import Earlier, Wanted, unique_names
from measured_materials.addon.library.plan import Plan
from measured_materials.addon.library.run import run_task
from measured_materials.bake.errors import BakeError
from support.format_files import ABC_SET
from support.stacks import write_stack

FIT = json.dumps(ABC_SET)
FITS = json.dumps({"materials": {"gold": ABC_SET, "Old Brass": ABC_SET}})


def parsed(*words: str | Path) -> argparse.Namespace:
    return main.parser().parse_args(["bake", "library", *map(str, words)])


def planned(*words: str | Path, out: Path) -> Plan:
    return library.plan_of(parsed(*words, "--out", out))


def wanted(stem: str, folder: str = "", digits: str = "", given: str = "") -> Wanted:
    return Wanted(stem, f"{folder}-{stem}", digits or f"{hash((stem, folder)) % 16**8:08x}", given, f"{folder}/{stem}")


def test_a_name_that_nobody_else_wants_is_the_sources_own() -> None:
    assert unique_names([wanted("gold"), wanted("steel")]) == ["gold", "steel"]


def test_files_of_one_stem_are_told_apart_by_their_folders_in_any_order() -> None:
    """Of three with one name, also where only capitals or the writing of an accent differ."""
    for sources in itertools.permutations([("gold", "old"), ("Gold", "new"), ("g\u00f4", "a"), ("go\u0302", "b")]):
        names = unique_names([wanted(*one) for one in sources])
        assert sorted(names) == sorted(["old-gold", "new-Gold", "a-g\u00f4", "b-go\u0302"])


def test_digits_tell_apart_what_folders_do_not() -> None:
    sources = [wanted("gold", "a", "1111aa22"), wanted("gold", "a", "1111ab22"), wanted("a-gold", "b", "22222222")]
    assert unique_names(sources) == ["gold-1111aa", "gold-1111ab", "a-gold"]


def test_a_source_keeps_the_name_it_had() -> None:
    """However many others of its stem come later; what an attacker wrote there is no name."""
    first, second = wanted("gold", "a", "11111111"), wanted("gold", "b", "22222222")
    assert unique_names([second, first], {"11111111": Earlier("gold", False)}) == ["b-gold", "gold"]
    assert unique_names([first], {"11111111": Earlier("../../gold", True)}) == ["gold"]


def test_names_that_were_asked_for_are_kept_or_refused() -> None:
    assert unique_names([wanted("gold", given="brass"), wanted("brass", "a")]) == ["brass", "a-brass"]
    with pytest.raises(BakeError, match=r"is to be called Brass, as .*; give each its own --name"):
        unique_names([wanted("gold", given="brass"), wanted("steel", given="Brass")])
    with pytest.raises(BakeError, match="no plain name of a file"):
        unique_names([wanted("gold", given="../brass")])
    with pytest.raises(BakeError, match="given twice with different settings"):
        unique_names([wanted("gold", digits="11"), wanted("gold", digits="11")])


@pytest.mark.parametrize("name", ["CON", "nul", "Aux.v2", "com1", "lpt²", "prn .old"])
def test_a_device_of_windows_is_no_name(name: str) -> None:
    """Whatever stands behind its dot; a file of that name is baked under another."""
    assert unique_names([wanted(name), wanted("console"), wanted("com12")]) == [f"material-{name}", "console", "com12"]
    with pytest.raises(BakeError, match="no device of Windows"):
        unique_names([wanted("gold", given=name)])
    assert unique_names([wanted("gold", digits="11")], {"11": Earlier(name, True)}) == ["gold"]


def test_two_formulas_of_one_model_have_two_names(tmp_path: Path) -> None:
    """They would have replaced each other; the same one twice is baked once."""
    formulas = ["ggx alpha=0.1 f0=0.9,0.6,0.3", "ggx alpha=0.2", "lambert", "ggx alpha=0.1 f0=0.9,0.6,0.3"]
    words = [word for formula in formulas for word in ("--analytic", *formula.split())]
    jobs = planned(*words, out=tmp_path).jobs
    assert [job.name for job in jobs] == ["ggx-alpha-0.1-f0-0.9-0.6-0.3", "ggx-alpha-0.2", "lambert"]
    assert jobs[0].request.source == Model("ggx", {"alpha": 0.1, "f0": (0.9, 0.6, 0.3)})


def test_a_folder_is_searched_for_what_can_be_baked(tmp_path: Path) -> None:
    """Measurements by content, all materials of a file of several, photographs; neither bundles nor pictures."""
    top = tmp_path / "scans"
    for place in ("a", "b", "swatches/denim", "pictures", "old.mmat", ".hidden"):
        (top / place).mkdir(parents=True)
    (top / "a" / "gold.json").write_text(FIT)
    (top / "b" / "fits.json").write_text(FITS)
    (top / "b" / "notes.json").write_text("{}")
    write_stack(top / "swatches" / "denim")
    (top / "pictures" / "me.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    (top / "old.mmat" / "fits.json").write_text(FIT)
    (top / ".hidden" / "fits.json").write_text(FIT)
    found = {job.name: job for job in planned(top, out=top / "library").jobs}
    assert set(found) == {"a-gold", "b-gold", "Old Brass", "denim"}
    assert found["a-gold"].request.settings.reading.material == ""
    assert found["b-gold"].request.settings.reading.material == "gold"
    assert found["denim"].request.source == top / "swatches" / "denim"
    jobs = planned(top / "pictures", top / "a", out=tmp_path / "library").jobs
    told = [job.refused.cause if job.refused else "" for job in jobs]
    assert [job.name for job in jobs] == ["pictures", "gold"] and told == ["holds nothing to bake", ""]


def test_every_option_comes_back_from_its_words(tmp_path: Path) -> None:
    """The words that a farm runs make the same settings, whatever was given."""
    given = (
        "--quality fine --resolution 24 --basis normal --parameterization bezier --alpha 0.5,0.25 --storage log "
        "--table-bytes 4096 --filter bspline --spline fitted --sampler 32 --sampler-kind warp --no-envelope "
        "--illuminant A --merl nodes "
        "--reciprocity mean --side back --utia sRGB --author=-me- --license CC0 --source-url x --replace --size 256 "
        "--decode gamma:2.2 --azimuth -30 --spread 10 --sides both --crop 1,2,30,40 --corners 0,0 9,0 9,9 0,9 "
        "--white-reflectance 0.8 --albedo 0.3 --align off --slices 9 --map-storage byte --compression power --rank 3 "
        "--tileable quilt --sigma 0.5 --above scale --technique lit_texture --mode preview --tiling extend --a-max 0.2 "
        "--azimuths all --azimuth-rank 6 --lobe phong exponent=30"
    )
    usual = "--out L --jobs 3".split()
    options = parsed("a.binary", *given.split(" --lobe")[0].split(), *usual, "--lobe", "phong", "exponent=30")
    again = parsed("a.binary", *words_of(library._parser(), options, library._OF_ALL), *usual)
    assert vars(again) == vars(options)
    told = {name for name, value in vars(options).items() if value != getattr(parsed("a.binary", *usual), name)}
    left = set(vars(options)) - told - {"sources", "run", "command", *library._OF_ALL}
    # Of one swatch or one file alone.
    assert left == {"material", "lights", "flat_field", "white_card", "through", "through_lights", "transmittance"} | {
        "sphere", "diffuser", "diffuser_transmittance", "transmission", "transmission_sigma",
    }  # fmt: skip


def test_a_task_of_a_farm_makes_the_very_same_job(tmp_path: Path) -> None:
    (tmp_path / "fits.json").write_text(FITS)
    write_stack(tmp_path / "denim")
    plan = planned(tmp_path, "--analytic", "ggx", "alpha=0.1", "--resolution", "16", "--size", "32", out=tmp_path / "L")
    assert len(plan.jobs) == 4
    for job in plan.jobs:
        words = plan.command(job)
        assert words[:2] == ("bake", "library") and words[-1] == "--task"
        (again,) = library.plan_of(main.parser().parse_args(words)).jobs
        assert (again.name, again.request) == (job.name, job.request)


def test_a_list_names_sources_with_options_of_their_own(tmp_path: Path) -> None:
    folder = tmp_path / "lists"
    folder.mkdir()
    (folder / "all.list").write_text(
        "# gold\n\n'my gold.binary' --name gold --resolution 8\n--analytic ggx alpha=0.2  # brushed\nC:\\steel.binary\n"
    )
    jobs = planned(folder / "all.list", "--resolution", "16", out=tmp_path / "L").jobs
    assert [job.name for job in jobs] == ["gold", "ggx", "C__steel"]
    assert jobs[0].request.source == folder / "my gold.binary"
    assert [job.request.settings.resolution for job in jobs] == [8, 16, 16]


def test_files_of_options_are_named_by_whole_paths(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of a list from its folder, all others from the current one: what bakes them may run in another."""
    lists, here = tmp_path / "lists", tmp_path / "here"
    here.mkdir()
    write_stack(lists / "denim")
    write_stack(lists / "wool")
    monkeypatch.chdir(here)
    (lists / "all.list").write_text("denim --lobe base/gold.mmat --flat-field white.png\nwool\n")
    given = ["../lists/all.list", "--lights", "lights.csv", "--lobe", "steel.MMAT"]
    denim, wool = planned(*given, out=tmp_path / "L").jobs
    assert denim.request.settings.brdf == lists / "base" / "gold.mmat"
    assert wool.request.settings.brdf == here / "steel.MMAT"
    for job in (denim, wool):
        assert job.request.settings.stack.lights == here / "lights.csv"
    assert {str(lists / "base" / "gold.mmat"), f"--flat-field={lists / 'white.png'}"} < set(denim.arguments)
    (single,) = planned("../lists/denim", "--through", "../lists/wool", out=tmp_path / "L").jobs
    assert single.request.settings.through.source == lists / "wool"


def test_a_folder_that_cannot_be_listed_is_a_row_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Below or given; the others are baked."""
    for name in ("a", "b", "c"):
        (tmp_path / "scans" / name).mkdir(parents=True)
        (tmp_path / "scans" / name / f"{name}.json").write_text(FIT)
    scandir, listed = os.scandir, Path.iterdir

    def refusing(path: str | Path) -> Any:
        if Path(path).name == "b":
            raise PermissionError(13, "Permission denied", str(path))
        return scandir(path)

    def closed(path: Path) -> Any:
        if path.name == "c":
            raise PermissionError(13, "Permission denied", str(path))
        return listed(path)

    monkeypatch.setattr(os, "scandir", refusing)
    monkeypatch.setattr(Path, "iterdir", closed)
    jobs = planned(tmp_path / "scans", out=tmp_path / "L").jobs
    assert {job.name: bool(job.refused) for job in jobs} == {"a": False, "b": True, "c": True}
    for job in jobs[1:]:
        told = run_task(pickle.loads(pickle.dumps(job)), tmp_path)
        assert told.state == "failed" and told.cause == "cannot be read (Permission denied)"
        assert told.file == str(tmp_path / "scans" / job.name)


@pytest.mark.parametrize(
    "line, words",
    [
        ("a.binary --resolution", "line 2: argument --resolution: expected one argument"),
        ("a.binary --resolution 1", "line 2.*resolution"),
        ("a.binary --jobs 3", "line 2: --jobs is the whole library's"),
        ("other.list", "line 2: a list cannot name another list"),
        ("a.binary b.binary --name c", "line 2: --name c is one bundle's"),
    ],
)
def test_a_wrong_line_is_named(line: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "all.list").write_text(f"gold.binary\n{line}\n")
    with pytest.raises(argparse.ArgumentTypeError, match=words):
        planned(tmp_path / "all.list", out=tmp_path / "L")


def test_an_open_quotation_mark_is_named(tmp_path: Path) -> None:
    (tmp_path / "all.list").write_text("gold.binary\n'steel.binary\n")
    with pytest.raises(BakeError, match="line 2 has an open quotation mark"):
        planned(tmp_path / "all.list", out=tmp_path / "L")
