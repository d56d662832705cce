"""A library baked by several processes: what fails, is killed, is there already, or is asked for twice at once."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
from measured_materials.addon.baking.hosts import hosts
from measured_materials.addon.baking.request import BakeRequest, Model
from measured_materials.addon.library import pool, run
from measured_materials.addon.library.lock import LOCK, library_lock
from measured_materials.addon.library.outcome import BAKED, FAILED, KEPT, Outcome
from measured_materials.addon.library.plan import LibraryJob
from measured_materials.addon.library.run import finished, recipe_of_request, run_task
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import MATERIAL, read_bundle
from measured_materials.bake.bundle.recipe import recipe_of
from measured_materials.bake.errors import BakeError
from measured_materials.bake.rights import Rights
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sampling.half_vector_warp import HalfVectorWarp
from measured_materials.bake.shading_maps.bake import ArcSettings
from support.clusters import command, wait_until
from support.format_files import ABC_SET, write_published
from support.library_faults import children, is_alive, kill, leftovers, marks
from support.stacks import write_stack

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks for processes in /proc")
SMALL = "--resolution 8 --basis normal --parameterization uniform --no-envelope --sampler 16".split()
SETTINGS = BakeSettings(8, "uniform", basis="normal", envelope=False, sampler=SamplerLayout(16, 16, 8))


def model(name: str, alpha: float = 0.3) -> LibraryJob:
    return LibraryJob(name, BakeRequest(Model("ggx", {"alpha": alpha}), SETTINGS))


def swatch(folder: Path, name: str) -> LibraryJob:
    """What is baked in a tenth of a second."""
    return LibraryJob(name, BakeRequest(write_stack(folder / "swatches" / name), ArcSettings()))


def bake(out: Path, *words: str | Path) -> tuple[int, dict[str, Any]]:
    done = subprocess.run(
        command("bake", "library", *words, "--out", out, *SMALL, "--json"), capture_output=True, text=True, timeout=120
    )
    assert "Traceback" not in done.stderr, done.stderr
    return done.returncode, json.loads(done.stdout)


def states(document: dict[str, Any]) -> dict[str, str]:
    return {row["name"]: row["state"] for row in document["materials"]}


def test_a_library_of_every_kind_goes_on_past_what_fails_and_is_kept(tmp_path: Path) -> None:
    """Files, formulas, photographs and fits; a second run bakes what has failed, and what has changed, alone."""
    scans, out = tmp_path / "scans", tmp_path / "L"
    for place in ("a", "b"):
        (scans / place).mkdir(parents=True)
        write_published(scans / place / "gold.json")
    (scans / "a" / "broken.binary").write_bytes(b"nothing that anybody reads")
    write_stack(scans / "denim")
    given = [scans, "--analytic", "ggx", "alpha=0.3", "--analytic", "ggx", "alpha=9e9", "--size", "16", "--jobs", "2"]
    code, told = bake(out, *given)
    assert code == 1
    bad = {"broken", "ggx-alpha-9e+09"}
    assert states(told) == {
        name: "failed" if name in bad else "baked"
        for name in ("a-gold", "broken", "b-gold", "denim", "ggx-alpha-0.3", *bad)
    }
    for row in told["materials"]:
        assert (row["failure"] is not None) == (row["name"] in bad)
        if row["name"] not in bad:
            assert row["bytes"] > 1000 and row["seconds"] > 0 and row["peak_bytes"] > 1e7 and row["format"]
            read_bundle(out / f"{row['name']}.mmat").check()
    kept = json.loads((out / "library.json").read_text())
    assert kept["materials"] == told["materials"] and kept["counts"] == {
        "baked": 4,
        "kept": 0,
        "failed": 2,
        "waiting": 0,
    }
    with open(out / "library.csv", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["name"] for row in rows] == [row["name"] for row in told["materials"]]
    assert [row["failure"] != "" for row in rows] == [row["name"] in bad for row in rows]
    assert [row["worker"] for row in rows] == [row["worker"] for row in told["materials"]] and rows[0]["worker"]
    assert leftovers(out) == []

    before = marks(out)
    write_published(scans / "a" / "broken.json")
    (scans / "a" / "broken.binary").unlink()
    (scans / "denim" / "el15.png").unlink()
    code, told = bake(out, *given[:4], "--size", "16", "--jobs", "0")
    assert code == 0
    baked = {"broken", "denim"}
    assert states(told) == {
        name: "baked" if name in baked else "kept" for name in ("a-gold", "broken", "b-gold", "denim", "ggx-alpha-0.3")
    }
    after = marks(out)
    assert {name for name in after if after[name] != before.get(name)} == baked


def test_settings_source_and_wholeness_decide_what_is_finished(tmp_path: Path) -> None:
    """One change of each makes a bundle unfinished; a name alone never makes it finished."""
    job = swatch(tmp_path, "a")
    assert finished(job, tmp_path) is None and run_task(job, tmp_path).state == BAKED
    assert finished(job, tmp_path) is not None and run_task(job, tmp_path).state == KEPT
    for settings in (ArcSettings(slices=9), ArcSettings(rights=Rights(author="me"))):
        assert finished(LibraryJob("a", BakeRequest(job.request.source, settings)), tmp_path) is None
    image = next((tmp_path / "a.mmat").glob("*_slices.exr"))
    data = bytearray(image.read_bytes())
    data[-1] ^= 1
    image.write_bytes(data)
    assert finished(job, tmp_path) is None and run_task(job, tmp_path).state == BAKED
    (tmp_path / "swatches" / "a" / "lights.csv").write_text("file,elevation,azimuth\nel15.png,20,0\nel90.png,90,0\n")
    assert finished(job, tmp_path) is None and run_task(job, tmp_path).state == BAKED
    told = json.loads((tmp_path / "a.mmat" / MATERIAL).read_text())
    (tmp_path / "a.mmat" / MATERIAL).write_text(json.dumps({**told, "recipe": "0" * 64}))
    assert finished(job, tmp_path) is None
    (tmp_path / "a.mmat" / MATERIAL).write_text(json.dumps({**told, "errors": 5}))
    assert finished(job, tmp_path) is None and run_task(job, tmp_path).state == BAKED
    assert run_task(model("a"), tmp_path).cause.endswith("is not replaced")


def test_a_defect_is_one_materials_failure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever a bake raises is told in one line, and whoever bakes the library goes on."""

    def fails(*given: Any) -> None:
        raise ZeroDivisionError("of\nzero")

    monkeypatch.setattr(run, "run_request", fails)
    told = run_task(swatch(tmp_path, "a"), tmp_path)
    assert (told.state, told.cause) == (FAILED, "was not baked: ZeroDivisionError: of zero")
    assert leftovers(tmp_path) == []


@pytest.mark.parametrize("folder", ["rights", "settings", "source"])
def test_a_recipe_is_what_decides_what_is_baked(folder: str, tmp_path: Path) -> None:
    """Of formulas and files: equal ones have one recipe, and whatever changes a bundle changes it."""
    file = write_published(tmp_path / "gold.json")
    request = BakeRequest(file, SETTINGS)
    usual = recipe_of_request(request)
    assert recipe_of_request(BakeRequest(file, replace(SETTINGS))) == usual
    if folder == "source":
        write_published(file, entries={**ABC_SET, "B": 800.0})
    changed = {
        "rights": replace(SETTINGS, rights=Rights(license="CC0")),
        "settings": replace(SETTINGS, sampler=HalfVectorWarp(16, 16, 8)),
        "source": SETTINGS,
    }[folder]
    assert recipe_of_request(BakeRequest(file, changed)) != usual
    formulas = {recipe_of_request(model("a", alpha).request) for alpha in (0.3, 0.31)} | {usual}
    assert len(formulas) == 3


@dataclass(frozen=True)
class _Alias:
    cells: int
    file: Path | None = None


@dataclass(frozen=True)
class _Warp:
    cells: int
    file: Path | None = None


def test_a_recipe_tells_kinds_and_contents_apart(tmp_path: Path) -> None:
    """Of two settings with equal numbers, and of files by what is in them, wherever they lie."""
    recipes = {recipe_of(one, {"name": "a"}) for one in (_Alias(3), _Warp(3), _Alias(4))} | {recipe_of(_Alias(3), {})}
    assert len(recipes) == 4
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "lights.csv").write_text("x")
    first, second = (recipe_of(_Alias(3, tmp_path / folder / "lights.csv"), {}) for folder in "ab")
    assert first == second
    (tmp_path / "b" / "lights.csv").write_text("y")
    assert recipe_of(_Alias(3, tmp_path / "b" / "lights.csv"), {}) != first
    with pytest.raises(BakeError, match="cannot be read"):
        recipe_of(_Alias(3, tmp_path / "none.csv"), {})


def pooled(jobs: list[LibraryJob], out: Path, watch: pool.Watch, count: int = 2) -> dict[str, Outcome]:
    found = pool.bake_by_processes(jobs, out, count, hosts(jobs[0].request, ""), watch)
    return {told.name: told for told in found}


def test_the_job_of_a_killed_process_is_begun_once_more(tmp_path: Path) -> None:
    """The others never notice, and nothing half-made stays."""
    killed: list[int] = []

    def watch(job: LibraryJob, stage: str, share: float) -> None:
        if job.name == "a" and not killed:
            killed.extend(children(os.getpid()))
            kill(killed[0])

    told = pooled([swatch(tmp_path, "a")], tmp_path, watch, 1)
    assert len(killed) == 1 and (told["a"].state, told["a"].attempts) == (BAKED, 2)
    assert leftovers(tmp_path) == []


def test_a_job_that_ends_two_processes_is_given_up_alone(tmp_path: Path) -> None:
    seen: set[int] = set()

    def watch(job: LibraryJob, stage: str, share: float) -> None:
        if job.name == "a":
            for pid in children(os.getpid()):
                seen.add(pid)
                kill(pid)

    told = pooled([swatch(tmp_path, "a"), swatch(tmp_path, "b")], tmp_path, watch, 1)
    assert len(seen) == 2 and told["a"].state == FAILED and told["a"].attempts == 2
    assert "ended by itself twice (SIGKILL" in told["a"].cause
    assert told["b"].state == BAKED and leftovers(tmp_path) == []
    assert not any(map(is_alive, seen))


@pytest.mark.parametrize("how", [signal.SIGINT, pytest.param(signal.SIGKILL, marks=pytest.mark.slow)])
def test_an_interrupted_library_leaves_whole_bundles_and_goes_on(how: signal.Signals, tmp_path: Path) -> None:
    """Whether it is asked to end or killed; workers end with it, and what they had begun is removed."""
    out, count = tmp_path / "L", 12
    for k in range(count):
        write_stack(tmp_path / "swatches" / f"cloth{k:02}")
    words = command("bake", "library", tmp_path / "swatches", "--out", out, "--jobs", "2")
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    wait_until(lambda: len(marks(out)) >= 1, 60)
    workers = children(process.pid)
    process.send_signal(how)
    said = process.communicate(timeout=60)[1]
    assert process.returncode == (130 if how == signal.SIGINT else -signal.SIGKILL)
    assert how == signal.SIGKILL or said.rstrip().endswith("interrupted; nothing was left half-made")
    wait_until(lambda: not any(map(is_alive, workers)), 60)
    # Of the table, which is small, a killed process may leave one that is not whole.
    assert workers and [name for name in leftovers(out) if how == signal.SIGINT or not name.endswith(".json")] == []
    before = marks(out)
    for name in before:
        read_bundle(out / f"{name}.mmat").check()
    assert json.loads((out / "library.json").read_text())["counts"]["waiting"] > 0
    code, told = bake(out, tmp_path / "swatches", "--jobs", "1")
    assert code == 0 and told["counts"]["kept"] == len(before) and told["counts"]["baked"] == count - len(before)
    after = marks(out)
    assert len(after) == count and all(after[name] == mark for name, mark in before.items()) and leftovers(out) == []


def test_a_library_is_baked_by_one_at_a_time_but_by_many_tasks(tmp_path: Path) -> None:
    out, cloth = tmp_path / "L", write_stack(tmp_path / "cloth")
    out.mkdir()
    with library_lock(out):
        done = subprocess.run(
            command("bake", "library", cloth, "--out", out), capture_output=True, text=True, timeout=60
        )
        assert done.returncode == 1
        assert f"is in use by process {os.getpid()} on " in done.stderr and len(done.stderr.splitlines()) == 1
    assert (out / LOCK).read_text() == "", "nobody holds it any more"
    (out / LOCK).write_text("process 1 on a machine that was switched off\n")
    with library_lock(out, shared=True):
        code, told = bake(out, cloth, "--name", "grey", "--task")
        assert code == 0 and states(told) == {"grey": "baked"} and not (out / "library.json").exists()
        with (
            pytest.raises(BakeError, match="is in use by another bake, or by tasks of a farm; wait"),
            library_lock(out),
        ):
            pass
    code, told = bake(out, cloth, "--name", "grey", "--jobs", "0")
    assert code == 0 and states(told) == {"grey": "kept"}


def test_a_lock_that_is_a_link_leads_nowhere(tmp_path: Path) -> None:
    """Somebody has put it there: what it points to is not written to, and the library is baked all the same."""
    (tmp_path / "L").mkdir()
    (tmp_path / "diary.txt").write_text("nobody's business")
    (tmp_path / "L" / LOCK).symlink_to(tmp_path / "diary.txt")
    with library_lock(tmp_path / "L"):
        assert not (tmp_path / "L" / LOCK).is_symlink()
        assert (tmp_path / "L" / LOCK).read_text().startswith(f"process {os.getpid()} on ")
    assert (tmp_path / "diary.txt").read_text() == "nobody's business"


def test_a_program_that_starts_no_worker_is_passed_over(tmp_path: Path) -> None:
    (tmp_path / "L").mkdir()
    commands = [
        [str(tmp_path / "missing")],
        [sys.executable, "-c", "raise SystemExit(5)"],
        *hosts(model("a").request, ""),
    ]
    (told,) = pool.bake_by_processes([model("a")], tmp_path / "L", 1, commands, lambda *event: None)
    assert (told.state, told.attempts) == (BAKED, 1)


def test_a_worker_that_does_not_start_costs_no_other_its_job(tmp_path: Path) -> None:
    """Of one program, the first process that begins ends at once, and there is no other program."""
    program = ["sh", "-c", f'mkdir "{tmp_path}/first" 2>/dev/null && exit 5; exec "$@"', "sh"]
    commands = [[*program, *words] for words in hosts(swatch(tmp_path, "a").request, "")][:1]
    (tmp_path / "L").mkdir()
    jobs = [swatch(tmp_path, "a"), swatch(tmp_path, "b")]
    found = list(pool.bake_by_processes(jobs, tmp_path / "L", 2, commands, lambda *event: None))
    assert {told.name: (told.state, told.attempts) for told in found} == {"a": (BAKED, 1), "b": (BAKED, 1)}


def test_a_program_that_has_worked_is_given_up_late() -> None:
    """After three starts in a row that came to nothing; one that never worked after the first."""
    programs = pool.Programs([["a"], ["b"]])
    for fails in (2, 2, 3):
        programs.works(["a"])
        for _ in range(fails):
            assert programs.current() == ["a"]
            programs.failed(["a"])
    assert programs.current() == ["b"]
    programs.failed(["b"])
    assert programs.current() == []
    programs.works(["a"])
    assert programs.current() == ["a"], "it works after all"


def test_workers_share_the_cores_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As many as memory allows, one thread each; as many at once as were asked for."""
    monkeypatch.setattr(pool, "free_bytes", lambda: 3 * pool.USUAL_BYTES + 5)
    monkeypatch.setattr(pool.os, "sched_getaffinity", lambda pid: range(16), raising=False)
    assert pool.usual_count() == 3
    most = 0

    def watch(job: LibraryJob, stage: str, share: float) -> None:
        nonlocal most
        workers = children(os.getpid())
        most = max(most, len(workers))
        for pid in workers:
            said = Path(f"/proc/{pid}/environ").read_bytes().split(b"\0")
            assert not said[0] or {b"OPENBLAS_NUM_THREADS=1", b"OMP_NUM_THREADS=1"} <= set(said)

    pooled([swatch(tmp_path, "a"), swatch(tmp_path, "b")], tmp_path, watch, 2)
    assert most == 2
