"""A worker kept warm while a dialogue is open: the next bake takes it, and where none comes nothing is left of it."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from measured_materials.addon.baking import hosts as hosts_of
from measured_materials.addon.baking import spare
from measured_materials.addon.baking.job import DONE, RUNNING, BakeJob
from measured_materials.addon.baking.request import BakeRequest, Model
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout

REQUEST = BakeRequest(
    Model("ggx", {"alpha": 0.3}),
    BakeSettings(8, "squared", basis="half", envelope=False, sampler=SamplerLayout(16, 8, 8)),
)


@pytest.fixture(autouse=True)
def nothing_left() -> Iterator[None]:
    yield
    spare.drop()


def is_alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def kept() -> int:
    assert spare._spare
    return spare._spare.pid


def ends(pid: int) -> bool:
    until = time.monotonic() + 30
    while is_alive(pid) and time.monotonic() < until:
        time.sleep(0.02)
    return not is_alive(pid)


def test_the_next_bake_takes_the_spare_worker(tmp_path: Path) -> None:
    commands = hosts_of.hosts(REQUEST, "")
    spare.prepare(commands)
    pid = kept()
    spare.prepare(commands)
    assert kept() == pid  # one is enough
    job = BakeJob(REQUEST, tmp_path / "made.mmat", commands)
    job.start()
    assert job._process and job._process.pid == pid and not spare.is_there()
    until = time.monotonic() + 60
    while job.poll() == RUNNING and time.monotonic() < until:
        time.sleep(0.02)
    assert job.state == DONE, job.error
    job.finish()
    assert ends(pid) and [file.name for file in tmp_path.iterdir()] == ["made.mmat"]


def test_a_spare_worker_that_nobody_wants_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    commands = hosts_of.hosts(REQUEST, "")
    spare.prepare(commands)
    pid = kept()
    assert is_alive(pid) and not spare.is_due()
    monkeypatch.setattr(spare, "LASTS", 0.0)
    spare.prepare(commands)
    time.sleep(0.01)
    assert spare.is_due()
    spare.drop()
    assert ends(pid) and not spare.is_there() and not spare.is_due()


def test_a_dead_or_another_worker_is_not_taken(tmp_path: Path) -> None:
    commands = hosts_of.hosts(REQUEST, "")
    spare.prepare(commands)
    assert spare.taken(["blender"]) is None and spare.is_there()
    process = spare._spare
    assert process
    process._process.kill()
    process._process.wait()
    assert spare.taken(commands[0]) is None
    spare.prepare([[str(tmp_path / "absent")]])
    assert not spare.is_there()


def test_a_spare_worker_ends_with_its_standard_input() -> None:
    """As it does where Blender has crashed."""
    spare.prepare(hosts_of.hosts(REQUEST, ""))
    process = spare._spare
    assert process and process.exit_code() is None
    assert b"ready" in (process.lines.get(timeout=60) or b"")
    assert process._process.stdin
    process._process.stdin.close()
    assert process._process.wait(30) == 0


_ASKED_LATER = """
import sys, types
from measured_materials.addon.baking import worker

class Nobody:
    def read(self, count):
        print(*sys.modules, file=sys.stderr, flush=True)
        return b""

sys.stdin = types.SimpleNamespace(buffer=Nobody())
worker.main()
"""


def test_all_that_a_bake_needs_is_loaded_before_it_is_asked() -> None:
    done = subprocess.run([sys.executable, "-P", "-c", _ASKED_LATER], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    loaded = set(done.stderr.splitlines()[-1].split())
    needed = {"addon.baking.request", "addon.baking.look", "bake.brdf.bake", "bake.shading_maps.bake"}
    assert {f"measured_materials.{name}" for name in needed} <= loaded
