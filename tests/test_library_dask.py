"""A library on a Dask cluster: a scheduler and workers on the loopback, one of which is killed half way."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from measured_materials.addon.baking.request import BakeRequest
from measured_materials.addon.library import dask_cluster
from measured_materials.addon.library.outcome import FAILED
from measured_materials.addon.library.plan import LibraryJob
from measured_materials.bake import VERSION
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.errors import BakeError
from measured_materials.bake.shading_maps.bake import ArcSettings
from support.clusters import cluster, command, wait_until
from support.library_faults import leftovers, marks
from support.stacks import ELEVATIONS, write_stack

pytest.importorskip("distributed", reason="dask.distributed is not installed")
COUNT = 16


def asked(swatches: Path, out: Path, address: str) -> list[str]:
    """Lights are named as they lie in the folder that this is called in, where no worker is."""
    return command("bake", "library", swatches, "--out", out, "--lights", "lights.csv", "--dask", address, "--json")


def test_a_worker_killed_half_way_costs_nothing(tmp_path: Path) -> None:
    """All is there, nothing is baked twice, and the same again bakes nothing."""
    swatches, out = tmp_path / "swatches", tmp_path / "L"
    for k in range(COUNT):
        write_stack(swatches / f"cloth{k:02}")
    lights = [f"el{k:02}.png,{k},0" for k in ELEVATIONS]
    (tmp_path / "lights.csv").write_text("\n".join(["file,elevation,azimuth", *lights]))
    with cluster(tmp_path / "cluster", 2) as dask:
        words, pipes = asked(swatches, out, dask.address), {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        process = subprocess.Popen(words, cwd=tmp_path, **pipes)
        wait_until(lambda: len(list(out.glob("*.mmat"))) >= COUNT // 2, 120)
        dask.workers[0].kill()
        before = marks(out)
        said, errors = process.communicate(timeout=120)
        assert process.returncode == 0, errors
        told = json.loads(said)
        # Kept: what the killed worker had finished and did not come to tell.
        assert {row["state"] for row in told["materials"]} <= {"baked", "kept"} and len(told["materials"]) == COUNT
        after = marks(out)
        assert len(after) == COUNT and all(after[name] == mark for name, mark in before.items())
        for bundle in out.glob("*.mmat"):
            read_bundle(bundle).check()
        assert leftovers(out) == []
        again = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=120)
        assert json.loads(again.stdout)["counts"]["kept"] == COUNT


class Asked:
    """A client of a cluster whose workers answer so."""

    def __init__(self, *answers: Any) -> None:
        self.answers = answers

    def wait_for_workers(self, count: int, timeout: float) -> None:
        if not self.answers:
            raise TimeoutError

    def run(self, function: Any, *arguments: Any, on_error: str) -> dict[str, Any]:
        assert on_error == "return"
        return {f"tcp://w{k}": a(function, *arguments) if callable(a) else a for k, a in enumerate(self.answers)}


def true(function: Any, *arguments: Any) -> Any:
    """A worker that is like this process."""
    return function(*arguments)


@pytest.mark.parametrize(
    "answers, words",
    [
        (
            (true, "import ModuleNotFoundError: no"),
            "cannot import measured_materials .*; install the package on",
        ),
        ((true, "version 0.0.1"), f"has version 0.0.1 of measured_materials, here it is {VERSION}"),
        ((true, "folder"), "does not see the folder"),
        ((true, OSError("gone")), "does not answer"),
        ((), "has no worker; start one: dask worker"),
    ],
)
def test_a_worker_that_cannot_do_it_is_named(answers: tuple[Any, ...], words: str, tmp_path: Path) -> None:
    with pytest.raises(BakeError, match=words):
        dask_cluster._check_workers(Asked(*answers), None, tmp_path, "tcp://here")
    dask_cluster._check_workers(Asked(true, true), None, tmp_path, "tcp://here")
    assert list(tmp_path.iterdir()) == [], "the mark is gone"


def test_a_probe_finds_what_is_missing(tmp_path: Path) -> None:
    probe, file = dask_cluster._probe(), tmp_path / "mark"
    file.write_text("mark")
    assert probe("measured_materials", str(file), "mark") == f"version {VERSION}"
    assert probe("measured_materials", str(file), "another") == "folder"
    assert probe("measured_materials", str(tmp_path / "none"), "mark") == "folder"
    assert probe("no_such_package_here", str(file), "mark").startswith("import ModuleNotFoundError")


def test_a_worker_of_another_version_does_not_bake(tmp_path: Path) -> None:
    """One that has come after the others were asked."""
    job = LibraryJob("a", BakeRequest(write_stack(tmp_path / "a"), ArcSettings()))
    told = dask_cluster.dask_task(job, str(tmp_path), "0.0.1")
    assert told.state == FAILED and f"has version {VERSION}" in told.cause and not (tmp_path / "a.mmat").exists()


def test_what_is_missing_is_said_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(BakeError, match=r"needs dask.distributed.*pip install distributed"):
        next(dask_cluster.bake_by_dask([], tmp_path, "tcp://here"))
    monkeypatch.setattr(dask_cluster, "__name__", "bl_ext.user_default.measured_materials.addon.library.dask_cluster")
    with pytest.raises(BakeError, match="does not work inside Blender"):
        next(dask_cluster.bake_by_dask([], tmp_path, "tcp://here"))


def test_nobody_at_the_address_is_said_in_one_line(tmp_path: Path) -> None:
    code = (
        "import sys\nfrom measured_materials.addon.library import dask_cluster as d\nd._PATIENCE = 0.5\n"
        "from measured_materials.addon.cli.main import main\nsys.exit(main(sys.argv[1:]))"
    )
    words = ["bake", "library", str(write_stack(tmp_path / "a")), "--out", str(tmp_path / "L")]
    done = subprocess.run(
        [sys.executable, "-P", "-c", code, *words, "--dask", "tcp://127.0.0.1:9"],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 1
    said = [line for line in done.stderr.splitlines() if line.startswith("measured_materials: ")]
    assert said == [
        "measured_materials: tcp://127.0.0.1:9: does not answer as a Dask scheduler; start a scheduler "
        "(dask scheduler) and give its address, such as tcp://host:8786"
    ]
    assert "Traceback" not in done.stderr
