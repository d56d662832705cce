"""Jobs for farms: Flamenco's job type executed as its manager does, and lines for `cuecmd` run by a shell."""

from __future__ import annotations

import errno
import json
import os
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import quickjs
from measured_materials.addon.baking.request import BakeRequest
from measured_materials.addon.cli.main import main, parser
from measured_materials.addon.exports import flamenco
from measured_materials.addon.exports.library_list import NAME, common_root
from measured_materials.addon.exports.opencue import COMMANDS
from measured_materials.addon.library import run
from measured_materials.addon.library.plan import LibraryJob
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.errors import BakeError
from measured_materials.bake.shading_maps.bake import ArcSettings
from support.flamenco_manager import KEYS, SUBTYPES, TYPES, VISIBLE, JobType, Task
from support.stacks import write_stack

SCRIPT = Path(flamenco.__file__).with_name(flamenco.SCRIPT)
QUICK = ["--resolution=8", "--parameterization=bezier", "--basis=normal", "--alpha=0.5,0.5", "--no-envelope"]
PYTHON = f"{shlex.quote(sys.executable)} -P -m measured_materials"


@pytest.fixture
def sources(tmp_path: Path) -> list[str]:
    """A file that cannot be read, and two formulas of one name; words of the command line."""
    (tmp_path / "it's bad").mkdir()
    (tmp_path / "it's bad" / "spoiled #1.binary").write_bytes(b"junk")
    return [str(tmp_path / "it's bad"), "--analytic", "lambert", "--analytic", "lambert", "diffuse=0.3", *QUICK]


def exported(tmp_path: Path, sources: list[str], *options: str) -> dict[str, Any]:
    """The job that is written for Flamenco."""
    out = tmp_path / "LIB"
    assert main(["bake", "library", *sources, "--out", str(out), "--export", "flamenco", *options]) == 0
    assert (out / flamenco.SCRIPT).read_bytes() == SCRIPT.read_bytes() and not list(out.glob("*.mmat"))
    found: dict[str, Any] = json.loads((out / flamenco.JOB).read_text(encoding="utf-8"))
    return found


def words_of(task: Task) -> list[list[str]]:
    """What its commands execute."""
    assert all(name == "exec" and set(parameters) == {"exe", "args"} for name, parameters in task.commands)
    return [[parameters["exe"], *parameters["args"]] for _, parameters in task.commands]


def test_the_settings_are_of_flamencos_schema() -> None:
    kind = JobType(SCRIPT)
    assert kind.name == flamenco.JOB_TYPE and set(kind.facts) == {"label", "description", "settings"}
    keys = [one["key"] for one in kind.facts["settings"]]
    assert len(keys) == len(set(keys))
    for one in kind.facts["settings"]:
        assert set(one) <= KEYS and one["type"] in TYPES and one["description"]
        assert one.get("subtype", "file_path") in SUBTYPES and one.get("visible", "visible") in VISIBLE
        assert one.get("required") or type(one["default"]) is TYPES[one["type"]], "a client has to fill it in"


def test_a_job_gives_each_material_a_task_and_a_table_behind_them(tmp_path: Path, sources: list[str]) -> None:
    job = exported(tmp_path, sources)
    kind = JobType(SCRIPT)
    assert job["type"] == kind.name and {"name", "type", "priority", "submitter_platform"} <= set(job)
    assert set(job["settings"]) <= {one["key"] for one in kind.facts["settings"]}
    assert {one["key"] for one in kind.facts["settings"] if one.get("required")} <= set(job["settings"])
    *materials, table = kind.compiled(job)
    assert [task.name for task in materials] == ["spoiled #1", "lambert", "lambert-diffuse-0.3"]
    assert table.name == "table" and table.waits_for == tuple(task.name for task in materials)
    assert not any(task.waits_for for task in materials) and table.priority > max(task.priority for task in materials)
    assert {task.type for task in (*materials, table)} == {"blender"}
    before = ["{blender}", "--background", "--command", "measured_materials", "bake", "library"]
    out = str(tmp_path / "LIB")
    for task in materials:
        (words,) = words_of(task)
        assert words[:6] == before and words[-4:] == ["--out", out, "--task", "--exit-zero"]
        assert parser().parse_args(words[4:]).task
    assert str(tmp_path / "it's bad" / "spoiled #1.binary") in words_of(materials[0])[0]
    assert words_of(table) == [[*before, str(tmp_path / "LIB" / NAME), "--out", out]]


def test_tasks_hold_as_many_materials_as_are_asked_for(tmp_path: Path, sources: list[str]) -> None:
    job = exported(tmp_path, sources, "--assets", str(tmp_path / "assets"), "--farm-program", PYTHON)
    job["settings"]["chunk_size"] = 2
    first, second, table = JobType(SCRIPT).compiled(job)
    assert [first.name, second.name] == ["spoiled #1 to lambert", "lambert-diffuse-0.3"]
    assert [len(task.commands) for task in (first, second, table)] == [2, 1, 1]
    assert all(words[:4] == [sys.executable, "-P", "-m", "measured_materials"] for words in words_of(first))
    assert words_of(table)[0][-2:] == ["--assets", str(tmp_path / "assets")]


def test_a_two_way_variable_of_the_manager_reaches_all_paths(tmp_path: Path, sources: list[str]) -> None:
    """Which replaces what settings begin with; the manager fills it in again for the platform of each worker."""
    job = exported(tmp_path, sources)
    settings = job["settings"]
    assert settings["root"] == str(tmp_path)
    for key, value in settings.items():
        if isinstance(value, str) and value.startswith(str(tmp_path)):
            settings[key] = "{shared}" + value[len(str(tmp_path)) :]
    words = [word for task in JobType(SCRIPT).compiled(job) for command in words_of(task) for word in command]
    assert not [word for word in words if str(tmp_path) in word] and "{shared}/it's bad/spoiled #1.binary" in words


@pytest.mark.parametrize(
    "changed",
    [{"materials": "no"}, {"materials": "[]"}, {"materials": '[{"name": "a", "arguments": [1]}]'}, {"chunk_size": -1}],
)
def test_a_job_written_by_hand_is_refused_in_words(
    tmp_path: Path, sources: list[str], changed: dict[str, object]
) -> None:
    job = exported(tmp_path, sources)
    job["settings"] |= changed
    with pytest.raises(quickjs.JSException, match=next(iter(changed))):
        JobType(SCRIPT).compiled(job)


def test_the_tasks_bake_the_library(tmp_path: Path, sources: list[str], capsys: Any) -> None:
    """All of one job, as a worker runs them: what fails stops nothing, and is told at the end."""
    job = exported(tmp_path, sources, "--farm-program", PYTHON)
    *materials, table = JobType(SCRIPT).compiled(job)
    for task in materials:
        for words in words_of(task):
            assert main(words[4:]) == 0
    assert "spoiled #1.binary" in capsys.readouterr().out, "told, though it is no failure of the task"
    baked = {folder.name: folder.stat().st_mtime_ns for folder in (tmp_path / "LIB").glob("*.mmat")}
    assert set(baked) == {"lambert.mmat", "lambert-diffuse-0.3.mmat"}
    assert main([*words_of(table)[0][4:], "--jobs", "0"]) == 1
    assert {folder.name: folder.stat().st_mtime_ns for folder in (tmp_path / "LIB").glob("*.mmat")} == baked
    assert (tmp_path / "LIB" / "library.json").exists()


@pytest.mark.parametrize(
    "raised",
    [
        MemoryError(),
        OSError(errno.ENOSPC, "No space left on device"),
        PermissionError(errno.EACCES, "Permission denied"),
        ModuleNotFoundError("No module named 'OpenImageIO'"),
    ],
)
def test_a_workers_own_fault_fails_its_task(raised: Exception, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether it comes as it is or as a line for people: another worker is to do it."""
    call = ["bake", "library", "--analytic", "lambert", "--out", str(tmp_path), "--task", "--exit-zero"]

    def bare(*given: object) -> None:
        raise raised

    def in_words(*given: object) -> None:
        try:
            raise raised
        except Exception as error:
            raise BakeError("lambert", "cannot be baked", "wait") from error

    for fault in (bare, in_words) if not isinstance(raised, ImportError) else (in_words,):
        monkeypatch.setattr(run, "run_request", fault)
        assert main(call) == 1
    monkeypatch.setattr(run, "run_request", lambda *given: (_ for _ in ()).throw(BakeError("a", "is damaged", "b")))
    assert main(call) == 0


def test_a_task_makes_no_library_and_misses_no_measurement(tmp_path: Path, capsys: Any) -> None:
    """A worker without the shared folder would otherwise bake into one of its own, or complete whatever it is given."""
    task = ["bake", "library", "--analytic", "lambert", "--out", str(tmp_path / "LIB"), "--task", "--exit-zero"]
    assert main(task) == 1 and not (tmp_path / "LIB").exists()
    assert "is no folder that this machine sees" in capsys.readouterr().err
    (tmp_path / "LIB").mkdir()
    assert main(["bake", "library", str(tmp_path / "gold.binary"), *task[4:]]) == 1
    job = LibraryJob("gold", BakeRequest(tmp_path / "gold.binary", BakeSettings()))
    assert run.run_task(job, tmp_path / "LIB").of_machine, "it was there when the task began"


def test_a_photograph_that_a_worker_may_not_read_is_its_own_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Which a library of images tells in words alone, as of one that is damaged."""
    cloth = write_stack(tmp_path / "cloth")
    photograph = next(cloth.glob("*.png"))
    photograph.write_bytes(b"junk")
    job = LibraryJob("cloth", BakeRequest(cloth, ArcSettings()))
    assert not run.run_task(job, tmp_path).of_machine
    may = os.access
    monkeypatch.setattr(run.os, "access", lambda path, how: path != photograph and may(path, how))
    assert run.run_task(job, tmp_path).of_machine


def test_without_blender_assets_are_refused_before_the_bake(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.setitem(sys.modules, "bpy", None)
    call = ["bake", "library", "--analytic", "lambert", *QUICK, "--out", str(tmp_path / "LIB"), "--assets", "A"]
    assert main(call) == 1 and not (tmp_path / "LIB").exists()
    assert "needs Blender" in capsys.readouterr().err
    assert main([*call, "--export", "flamenco"]) == 0, "which another machine has"


def test_cuecmd_gets_lines_that_a_shell_runs(tmp_path: Path, sources: list[str]) -> None:
    out = tmp_path / "LI'B"
    call = ["bake", "library", *sources, "--out", str(out), "--export", "opencue", "--farm-program", PYTHON]
    assert main(call) == 0
    lines = (out / COMMANDS).read_text(encoding="utf-8").splitlines()
    assert len(lines) == len((out / NAME).read_text(encoding="utf-8").splitlines()) == 3
    codes = [subprocess.run(["sh", "-c", line], capture_output=True, timeout=120).returncode for line in lines[:2]]
    assert codes == [1, 0], "OpenCue tries a failed frame again, and goes on with the others"
    assert read_bundle(out / "lambert.mmat").material["source"]["name"] == "lambert"


def test_what_does_not_go_together_is_wrong_usage(tmp_path: Path) -> None:
    call = ["bake", "library", "--analytic", "lambert", "--out", str(tmp_path / "LIB")]
    assert main([*call, "--exit-zero"]) == 2
    assert main([*call, "--export", "flamenco", "--task"]) == 2
    assert main([*call, "--export", "opencue", "--assets", "A"]) == 2
    assert main([*call, "--farm-program", "x"]) == 2
    assert main([*call, "--dask", "tcp://127.0.0.1:1", "--jobs", "2"]) == 2
    assert not (tmp_path / "LIB").exists()


def test_the_folder_of_all_is_none_where_there_is_only_the_root() -> None:
    class Job:
        arguments = ("/b/x.binary", "--lights=/c/lights.csv", "--alpha=0.5,0.5")

    class Plan:
        out, jobs = Path("/a"), (Job,)

    assert common_root(Plan) == ""  # type: ignore[arg-type]
    Plan.out, Job.arguments = Path("/b/LIB"), ("/b/x.binary",)
    assert common_root(Plan) == "/b"  # type: ignore[arg-type]
