"""A library baked by a real Flamenco: `python tests/real_farm/flamenco.py FOLDER [--kill]`, by `.venv`'s Python.

FOLDER holds the programs `flamenco-manager` and `flamenco-worker`. They run on this machine alone, by the loopback
interface, in a folder that goes. A job with a file that cannot be read is submitted: its materials must all be baked,
its last task must tell of the file, and an asset library must be there. Submitted again without the file, all is kept.
`--kill` ends one of two workers in the middle of a task; Flamenco takes some minutes to notice.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

_PYTHON = f"{shlex.quote(sys.executable)} -P -m measured_materials"
_QUICK = ["--resolution", "8", "--no-envelope"]
_MATERIALS = ("lambert", "lambert-diffuse-0.3", "ggx", "oren-nayar")
_MANAGER = """
_meta: {{version: 3}}
manager_name: loopback
database: manager.sqlite
listen: 127.0.0.1:{port}
autodiscoverable: false
local_manager_storage_path: storage
shared_storage_path: {shared}
shaman: {{enabled: false}}
worker_timeout: 1m0s
variables: {{}}
"""


class Farm:
    """A manager with its workers, until `close`."""

    def __init__(self, programs: Path, folder: Path, workers: int) -> None:
        self.folder, self.running = folder, []
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        # A manager looks for job types beside itself.
        for name in ("flamenco-manager", "flamenco-worker"):
            shutil.copy(programs / name, folder)
        (folder / "scripts").mkdir()
        (folder / "shared").mkdir()
        (folder / "flamenco-manager.yaml").write_text(_MANAGER.format(port=self.port, shared=folder / "shared"))
        self._start("flamenco-manager", folder)
        self.ask("/api/v3/version")  # workers that find no manager end
        self.workers = [self._worker(number) for number in range(workers)]

    def _worker(self, number: int) -> subprocess.Popen[bytes]:
        home = self.folder / f"worker{number}"
        home.mkdir()
        settings = f"manager_url: http://127.0.0.1:{self.port}/\ntask_types: [blender]\nworker_name: worker{number}\n"
        (home / "flamenco-worker.yaml").write_text(settings)
        return self._start("flamenco-worker", home)

    def _start(self, name: str, home: Path) -> subprocess.Popen[bytes]:
        log = (home / f"{name}.log").open("wb")
        environment = {**os.environ, "HOME": str(home), "NO_PROXY": "*", "no_proxy": "*"}
        process = subprocess.Popen(
            [self.folder / name], cwd=home, env=environment, stdout=log, stderr=log, start_new_session=True
        )
        self.running.append(process)
        return process

    def ask(self, path: str, document: Any = None) -> Any:
        """The manager's answer; asked again until it listens."""
        data = None if document is None else json.dumps(document).encode()
        request = urllib.request.Request(f"http://127.0.0.1:{self.port}{path}", data)
        request.add_header("Content-Type", "application/json")
        for _ in range(100):
            with contextlib.suppress(ConnectionError, urllib.error.URLError):
                with urllib.request.build_opener(urllib.request.ProxyHandler({})).open(request, timeout=20) as answer:
                    return json.load(answer)
            time.sleep(0.3)
        raise SystemExit(f"flamenco: FAIL the manager does not answer at {path}")

    def job(self, file: Path, seconds: float, *, kill: bool = False) -> tuple[str, dict[str, str]]:
        """Submit a job and wait for its end: its status and those of its tasks."""
        number = self.ask("/api/v3/jobs", json.loads(file.read_text()))["id"]
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            status = self.ask(f"/api/v3/jobs/{number}")["status"]
            tasks = self.ask(f"/api/v3/jobs/{number}/tasks")["tasks"]
            if kill:
                kill = not self._kill_who_works(tasks)
            if status in ("completed", "failed", "canceled"):
                return status, {task["name"]: task["status"] for task in tasks}
            time.sleep(1)
        for log in self.folder.rglob("flamenco-worker.log"):
            print("\n".join(log.read_text().splitlines()[-5:]))
        raise SystemExit(f"flamenco: FAIL not done in {seconds:.0f} s: {[(t['name'], t['status']) for t in tasks]}")

    def _kill_who_works(self, tasks: list[dict[str, Any]]) -> bool:
        """Kill a worker, and what it runs, in the middle of a task; False where none is at work yet."""
        active = next((task for task in tasks if task["status"] == "active" and task.get("worker")), None)
        if active is None:
            return False
        worker = self.workers[int(active["worker"]["name"].removeprefix("worker"))]
        children = Path(f"/proc/{worker.pid}/task/{worker.pid}/children").read_text().split()
        for process in (worker.pid, *map(int, children)):
            with contextlib.suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
        print(f"flamenco: ok   killed {active['worker']['name']} while it baked {active['name']}", flush=True)
        return True

    def close(self) -> None:
        """End all programs."""
        for process in self.running:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


@contextlib.contextmanager
def farm(programs: Path, workers: int) -> Iterator[Farm]:
    """In a temporary folder."""
    with tempfile.TemporaryDirectory() as folder:
        made = Farm(programs, Path(folder), workers)
        try:
            yield made
        finally:
            made.close()


def export(shared: Path, sources: list[str]) -> Path:
    """The files for Flamenco, of a command as a user gives it; the job."""
    models = [word for model in _MATERIALS for word in ("--analytic", *_words(model))]
    command = ["bake", "library", *sources, *models, *_QUICK, "--out", "library", "--assets", "assets"]
    more = ["--export", "flamenco", "--farm-program", _PYTHON]
    subprocess.run([sys.executable, "-P", "-m", "measured_materials", *command, *more], cwd=shared, check=True)
    return shared / "library" / "measured_library.flamenco.json"


def _words(model: str) -> list[str]:
    name, _, value = model.partition("-diffuse-")
    return [name, f"diffuse={value}"] if value else [name]


def check(name: str, good: bool, words: object) -> None:
    """Say it, and end where it is not so."""
    print(f"flamenco: {'ok  ' if good else 'FAIL'} {name}: {words}", flush=True)
    if not good:
        sys.exit(1)


def main() -> None:
    """Both jobs."""
    parser = argparse.ArgumentParser()
    parser.add_argument("programs", type=Path, help="folder with flamenco-manager and flamenco-worker")
    parser.add_argument("--kill", action="store_true", help="kill one of two workers in the middle of a task")
    options = parser.parse_args()
    with farm(options.programs, 2) as made:
        shared = made.folder / "shared"
        (shared / "measured").mkdir()
        (shared / "measured" / "spoiled.binary").write_bytes(b"junk")
        job = export(shared, ["measured"])
        shutil.copy(shared / "library" / "measured_library.js", made.folder / "scripts")
        kind = made.ask("/api/v3/jobs/type/measured-library")
        check("job type", kind["label"] == "Measured Library", f"{len(kind['settings'])} settings, accepted")
        status, tasks = made.job(job, 1500 if options.kill else 240, kill=options.kill)
        table = tasks.pop("table")
        check("tasks", set(tasks.values()) == {"completed"} and set(tasks) == {"spoiled", *_MATERIALS}, tasks)
        check("the file that cannot be read", (table, status) == ("failed", "failed"), f"told by the table: {table}")
        listed = json.loads((shared / "library" / "library.json").read_text())["materials"]
        states = {one["name"]: one["state"] for one in listed}
        check("table", states == dict.fromkeys(_MATERIALS, "kept") | {"spoiled": "failed"}, states)
        assets = sorted(file.stem for file in (shared / "assets").glob("*.blend"))
        check("asset library", assets == sorted(_MATERIALS), assets)
        times = {folder: folder.stat().st_mtime_ns for folder in (shared / "library").glob("*.mmat")}
        status, tasks = made.job(export(shared, []), 600)
        check("again, without it", status == "completed" and set(tasks.values()) == {"completed"}, tasks)
        now = {folder: folder.stat().st_mtime_ns for folder in (shared / "library").glob("*.mmat")}
        check("nothing baked twice", now == times and len(now) == len(_MATERIALS), f"{len(now)} bundles kept")


if __name__ == "__main__":
    main()
