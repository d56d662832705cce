"""A bake in a process of its own: its result, its end in every way, and that nothing is left of it."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from measured_materials.addon.baking import hosts as hosts_of
from measured_materials.addon.baking.job import CANCELLED, DONE, FAILED, NO_HOST, RUNNING, BakeJob
from measured_materials.addon.baking.request import BakeRequest, Model, run_request
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import read_bundle, write_bundle
from measured_materials.bake.errors import BakeError
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.shading_maps.bake import ArcSettings
from support.stacks import write_stack

SETTINGS = BakeSettings(8, "squared", basis="half", envelope=False, sampler=SamplerLayout(16, 8, 8))
MODEL = Model("ggx", {"alpha": 0.3})


@pytest.fixture(autouse=True)
def one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sums of one order, for equal bytes."""
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")


def started(request: BakeRequest, target: Path) -> BakeJob:
    job = BakeJob(request, target, hosts_of.hosts(request, ""))
    job.start()
    return job


def ended(job: BakeJob, seconds: float = 60) -> str:
    until = time.monotonic() + seconds
    while job.poll() == RUNNING and time.monotonic() < until:
        time.sleep(0.02)
    return job.state


def alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


def contents(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.iterdir()}


@pytest.mark.parametrize("kind", ["model", "file", "photographs"])
def test_worker_bakes_what_this_process_bakes(kind: str, measurement: Path, tmp_path: Path) -> None:
    """Byte for byte; here in a process of its own too, for the threads of its sums."""
    source = {"model": MODEL, "file": measurement, "photographs": tmp_path / "swatch"}[kind]
    if kind == "photographs":
        write_stack(tmp_path / "swatch")
    request = BakeRequest(source, ArcSettings() if kind == "photographs" else SETTINGS, quick=kind != "model")
    job = started(request, tmp_path / "a" / "made.mmat")
    assert job.state == FAILED and job.error and "cannot be written" in str(job.error)  # there is no such folder
    (tmp_path / "a").mkdir()
    job = started(request, tmp_path / "a" / "made.mmat")
    assert ended(job) == DONE, job.error
    assert (job.preview is None) == (kind == "model")
    if job.preview:
        assert read_bundle(job.preview).has("preview_weights" if kind == "file" else "slices")
    result = job.finish()
    (tmp_path / "b").mkdir()
    here = run_request(request, tmp_path / "b" / "made.mmat")
    assert contents(result.path) == contents(here.path)
    assert [file.name for file in (tmp_path / "a").iterdir()] == ["made.mmat"]


def test_bad_input_is_the_error_of_the_bake(tmp_path: Path) -> None:
    job = started(BakeRequest(tmp_path / "absent.binary", SETTINGS), tmp_path / "x.mmat")
    assert ended(job) == FAILED and "absent.binary: does not exist" in str(job.error)
    assert not list(tmp_path.iterdir())
    (tmp_path / "x.mmat").mkdir()
    (tmp_path / "x.mmat" / "letter.txt").write_text("mine")
    job = started(BakeRequest(MODEL, SETTINGS), tmp_path / "x.mmat")  # refused before the work, not after it
    assert job.state == FAILED and "letter.txt" in str(job.error)
    assert contents(tmp_path / "x.mmat") == {"letter.txt": b"mine"}


def test_cancelled_at_random_moments_leaves_nothing(measurement: Path, tmp_path: Path) -> None:
    chance = random.Random(7)
    request = BakeRequest(measurement, replace(SETTINGS, resolution=32, envelope=True), quick=True)
    for _ in range(10):
        job = started(request, tmp_path / "made.mmat")
        assert job._process
        pid, until = job._process.pid, time.monotonic() + chance.uniform(0, 3)
        while time.monotonic() < until:
            job.poll()
            time.sleep(0.01)
        job.cancel()
        assert job.state in (CANCELLED, DONE)
        job.close()
        assert not alive(pid) and not list(tmp_path.iterdir())


def test_cancelled_bake_leaves_the_older_bundle(measurement: Path, tmp_path: Path) -> None:
    target = run_request(BakeRequest(MODEL, SETTINGS), tmp_path / "made.mmat").path
    before = contents(target)
    job = started(BakeRequest(measurement, SETTINGS), target)
    assert ended(job) == DONE and contents(target) == before  # until it is put in its place
    job.close()
    assert contents(target) == before and [file.name for file in tmp_path.iterdir()] == ["made.mmat"]


def test_dead_worker_is_one_clear_line(tmp_path: Path) -> None:
    job = started(BakeRequest(MODEL, replace(SETTINGS, envelope=True)), tmp_path / "made.mmat")
    while job.stage == "starting":
        job.poll()
        time.sleep(0.01)
    assert job._process
    os.kill(job._process.pid, signal.SIGKILL)
    assert ended(job) == FAILED
    assert "\n" not in str(job.error) and "SIGKILL" in str(job.error) and str(job.error).startswith("ggx: ")
    assert not list(tmp_path.iterdir())


def test_worker_ends_with_the_process_that_asked(tmp_path: Path) -> None:
    """Killed, so that nothing in it can take care."""
    script = f"""
import sys, time
from pathlib import Path
from measured_materials.addon.baking.hosts import hosts
from measured_materials.addon.baking.job import BakeJob
from measured_materials.addon.baking.request import BakeRequest, Model
from measured_materials.bake.brdf.settings import BakeSettings
request = BakeRequest(Model("ggx", {{"alpha": 0.3}}), BakeSettings(48))
job = BakeJob(request, Path({str(tmp_path / "made.mmat")!r}), hosts(request, ""))
job.start()
while job.stage == "starting":
    job.poll()
    time.sleep(0.01)
print(job._process.pid, flush=True)
time.sleep(60)
"""
    asking = subprocess.Popen([sys.executable, "-P", "-c", script], stdout=subprocess.PIPE, text=True)
    assert asking.stdout
    pid = int(asking.stdout.readline())
    assert alive(pid) and list(tmp_path.iterdir())
    asking.kill()
    asking.wait()
    asking.stdout.close()
    until = time.monotonic() + 10
    while alive(pid) and time.monotonic() < until:
        time.sleep(0.05)
    assert not alive(pid) and not list(tmp_path.iterdir())


def test_hosts_that_do_not_start_are_passed_over(tmp_path: Path) -> None:
    request = BakeRequest(MODEL, SETTINGS)
    failing = [[str(tmp_path / "absent")], [sys.executable, "-c", "raise SystemExit(1)"]]
    job = BakeJob(request, tmp_path / "made.mmat", failing + hosts_of.hosts(request, ""))
    job.start()
    assert ended(job) == DONE
    job.finish()
    job = BakeJob(request, tmp_path / "other.mmat", failing)
    job.start()
    assert ended(job) == NO_HOST and [file.name for file in tmp_path.iterdir()] == ["made.mmat"]


def test_photographs_that_only_blender_reads_are_left_to_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    blender = tmp_path / "blender"
    blender.write_text("")
    arc, brdf = BakeRequest(tmp_path, ArcSettings()), BakeRequest(MODEL, SETTINGS)
    monkeypatch.setattr(hosts_of, "load_openimageio", lambda: None)
    assert {host[0] for host in hosts_of.hosts(arc, str(blender))} == {str(blender)}
    assert hosts_of.hosts(brdf, str(blender))[0][0] == sys.executable
    assert hosts_of.hosts(brdf, str(blender))[-1][0] == str(blender)
    assert str(blender) not in {host[0] for host in hosts_of.hosts(arc, "")}


def test_write_bundle_removes_the_staging_of_the_dead(tmp_path: Path) -> None:
    (tmp_path / ".made.mmat.0123456789ab.partial").mkdir()
    with pytest.raises(BakeError):
        write_bundle(tmp_path / "made.mmat", {}, {"nothing": None})  # type: ignore[dict-item]
    run_request(BakeRequest(MODEL, SETTINGS), tmp_path / "made.mmat")
    assert [file.name for file in tmp_path.iterdir()] == ["made.mmat"]
