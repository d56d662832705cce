"""A Dask scheduler and workers on this machine's loopback, as processes of their own, which can be killed."""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

_COMMON = ("--no-dashboard",)
_WORKER = ("--nthreads", "1", "--no-nanny", "--memory-limit", "0")
_ENVIRONMENT = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


class Cluster:
    """A scheduler and its workers.

    Attributes
    ----------
    address : of the scheduler
    workers : the processes, killed ones too
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.workers: list[subprocess.Popen[bytes]] = []
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{port}"
        self.scheduler = self._started("scheduler", "--host", "127.0.0.1", "--port", str(port))

    def add_worker(self, environment: Mapping[str, str] | None = None) -> subprocess.Popen[bytes]:
        """Start one more worker, on one core."""
        place = str(self.folder / f"worker{len(self.workers)}")
        started = self._started("worker", self.address, *_WORKER, "--local-directory", place, more=environment)
        self.workers.append(started)
        return started

    def wait_for(self, count: int, seconds: float = 60) -> None:
        """Wait until so many workers are there."""
        from distributed import Client

        with contextlib.closing(Client(self.address, timeout=seconds, set_as_default=False)) as client:
            client.wait_for_workers(count, timeout=seconds)

    def close(self) -> None:
        """End all."""
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()

    def _started(self, kind: str, *words: str, more: Mapping[str, str] | None = None) -> subprocess.Popen[bytes]:
        log = open(self.folder / f"{kind}{len(self.workers)}.log", "wb")
        command = [sys.executable, "-P", "-m", f"distributed.cli.dask_{kind}", *words, *_COMMON]
        with log:
            return subprocess.Popen(
                command, stdout=log, stderr=log, env={**os.environ, **_ENVIRONMENT, **(more or {})}, cwd=self.folder
            )


@contextlib.contextmanager
def cluster(folder: Path, workers: int) -> Iterator[Cluster]:
    """A cluster for the block, whose logs lie in the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    made = Cluster(folder)
    try:
        for _ in range(workers):
            made.add_worker()
        made.wait_for(workers)
        yield made
    finally:
        made.close()


def command(*words: str | Path) -> list[str]:
    """The command line as a process of its own."""
    return [sys.executable, "-P", "-m", "measured_materials", *map(str, words)]


def wait_until(happened: Callable[[], object], seconds: float, pause: float = 0.02) -> None:
    """Call a function until it returns something true. AssertionError: it did not in that time."""
    until = time.monotonic() + seconds
    while not happened():
        assert time.monotonic() < until, "waited in vain"
        time.sleep(pause)
