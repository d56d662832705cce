"""What a library remembers in its table: names of sources, and which bundles are its own to bake again."""

from __future__ import annotations

import csv
import json
import os
from pathlib import Path
from typing import Any

import pytest
from measured_materials.addon.baking.request import BakeRequest, Model
from measured_materials.addon.cli.main import main
from measured_materials.addon.library.names import Earlier
from measured_materials.addon.library.outcome import BAKED, FAILED, Outcome, State
from measured_materials.addon.library.plan import LibraryJob, Plan
from measured_materials.addon.library.table import DOCUMENT, SHEET, names_kept, write_table
from measured_materials.bake.brdf.settings import BakeSettings
from support.stacks import write_stack

REQUEST = BakeRequest(Model("lambert", {}), BakeSettings())


def baked(out: Path, *words: str | Path) -> dict[str, str]:
    """State of each material, in their order."""
    main(["bake", "library", *map(str, words), "--out", str(out), "--jobs", "0"])
    return {row["name"]: row["state"] for row in document(out)["materials"]}


def document(out: Path) -> Any:
    return json.loads((out / DOCUMENT).read_text(encoding="utf-8"))


def told(out: Path, states: dict[str, tuple[str, State | None]]) -> dict[str, Earlier]:
    """A run in which each identity has this name and comes to that, and what the next one knows."""
    jobs = tuple(LibraryJob(name, REQUEST, identity=identity) for identity, (name, _) in states.items())
    write_table(
        Plan(out, jobs, names_kept(out)), {name: Outcome(name, state) for name, state in states.values() if state}
    )
    return names_kept(out)


def test_a_bundle_of_another_source_is_refused_however_often(tmp_path: Path) -> None:
    """That it failed under this name does not make it the library's own."""
    out = tmp_path / "L"
    assert (
        main(["bake", "photographs", str(write_stack(tmp_path / "old" / "cloth", (20, 50, 80))), "--out", str(out)])
        == 0
    )
    source = write_stack(tmp_path / "new" / "cloth")
    assert [baked(out, source) for _ in range(2)] == [{"cloth": "failed"}] * 2
    assert document(out)["materials"][0]["failure"]["cause"].endswith("is not replaced")
    assert baked(out, source, "--replace") == {"cloth": "baked"}
    (source / "el15.png").unlink()
    assert baked(out, source) == {"cloth": "baked"}, "of this very source, which has changed"


def test_what_is_the_librarys_own_stays_so(tmp_path: Path) -> None:
    """Through runs that wait, fail, or do not name it; under another name it is not, nor when another has taken it."""
    assert told(tmp_path, {"1": ("gold", BAKED)}) == {"1": Earlier("gold", True)}
    assert told(tmp_path, {"1": ("gold", None)}) == {"1": Earlier("gold", True)}
    assert told(tmp_path, {"1": ("gold", FAILED), "2": ("steel", None)})["1"] == Earlier("gold", True)
    known = told(tmp_path, {"3": ("Gold", FAILED)})
    assert known == {"1": Earlier("gold", True), "2": Earlier("steel", False)}, "the third gets a name of its own"
    known = told(tmp_path, {"3": ("Gold", BAKED)})
    assert known == {"3": Earlier("Gold", True), "2": Earlier("steel", False)}, "its bundle is there now"
    assert told(tmp_path, {"3": ("brass", FAILED)})["3"] == Earlier("brass", False)


def test_a_part_of_the_sources_does_not_make_the_others_names_forgotten(tmp_path: Path) -> None:
    """Nor does a task of a farm, which gives the name."""
    out, first = tmp_path / "L", write_stack(tmp_path / "a" / "cloth")
    assert baked(out, first) == {"cloth": "baked"}
    second = write_stack(tmp_path / "b" / "cloth", (20, 40, 60, 80))
    assert baked(out, second, first) == {"b-cloth": "baked", "cloth": "kept"}
    assert baked(out, first, "--name=cloth") == {"cloth": "kept"}
    assert baked(out, second) == {"b-cloth": "kept"}, "though no other is called so this time"
    (second / "el80.png").unlink()
    assert baked(out, second, "--name=b-cloth") == {"b-cloth": "baked"}
    assert baked(out, second, first) == {"b-cloth": "kept", "cloth": "kept"}


def test_a_source_that_comes_twice_is_told_apart_by_the_names_given(tmp_path: Path) -> None:
    """Each stays its own, also where only one of the two is baked again."""
    out = tmp_path / "L"
    write_stack(tmp_path / "cloth")
    (tmp_path / "all.list").write_text("cloth --name fine\ncloth --name coarse --slices 5\n")
    assert baked(out, tmp_path / "all.list") == {"fine": "baked", "coarse": "baked"}
    (tmp_path / "cloth" / "el15.png").unlink()
    assert baked(out, tmp_path / "cloth", "--name", "coarse", "--slices", "5") == {"coarse": "baked"}
    assert baked(out, tmp_path / "all.list") == {"fine": "baked", "coarse": "kept"}


def test_a_name_that_is_no_text_is_escaped(tmp_path: Path) -> None:
    """A file system may hold any bytes in it."""
    (tmp_path / "scans").mkdir()
    file = os.fsencode(tmp_path / "scans") + b"/\xff.binary"
    try:
        Path(os.fsdecode(file)).write_bytes(b"nothing that anybody reads")
    except (OSError, ValueError):
        pytest.skip("names of files are text here")
    write_stack(tmp_path / "scans" / "cloth")
    states = baked(tmp_path / "L", os.fsdecode(file), tmp_path / "scans" / "cloth")
    assert list(states.values()) == ["failed", "baked"]
    assert document(tmp_path / "L")["materials"][0]["source"] == "\\udcff.binary"
    with open(tmp_path / "L" / SHEET, encoding="utf-8", newline="") as stream:
        assert next(csv.DictReader(stream))["source"] == "\\udcff.binary"


def test_a_table_of_anything_is_read(tmp_path: Path) -> None:
    """What is no row is left out."""
    told(tmp_path, {"1": ("gold", BAKED)})
    found = document(tmp_path)
    for spoiled in ({**found, "earlier": [5, {"identity": "2"}, {"identity": "3", "name": "x", "ours": 1}]}, [found]):
        (tmp_path / DOCUMENT).write_text(json.dumps(spoiled))
        assert set(names_kept(tmp_path)) == ({"1", "3"} if spoiled != [found] else set())
        assert not any(one.ours for key, one in names_kept(tmp_path).items() if key == "3")
