"""Jobs on the cores of this machine, each worker a process that bakes one after the other on one core."""

from __future__ import annotations

import contextlib
import json
import os
import queue
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ...bake.atomic_write import remove_leftovers
from ...bake.errors import BakeError
from ..baking.worker_process import WorkerProcess, ending_words
from .memory import free_bytes
from .outcome import Outcome
from .plan import LibraryJob
from .run import failure

# Called with a job, the stage it is in and the share of that which is done.
Watch = Callable[[LibraryJob, str, float], None]

# One thread for each worker: the cores are shared out by jobs, and sums have one order.
_ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OPENBLAS", "OMP", "MKL", "BLIS", "VECLIB_MAXIMUM", "NUMEXPR")}
_WORKER = "addon.library.worker"
_ATTEMPTS = 2
# Workers in a row that end before they can be asked, of a program that has worked before.
_STARTS = 3
_PAUSE = 0.005  # seconds between two looks at the workers
# Memory that a bake takes at most, where nothing is known of it: `./run bench library` measures it.
USUAL_BYTES = 700 << 20


def usual_count() -> int:
    """As many workers as there are cores for this process, fewer where memory would not do."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min(cores, free_bytes() // USUAL_BYTES)) if free_bytes() else cores


def bake_by_processes(
    jobs: Sequence[LibraryJob], out: Path, count: int, commands: Sequence[Sequence[str]], watch: Watch
) -> Iterator[Outcome]:
    """Bake jobs into `out`, and give what became of each as soon as it is known.

    A job whose process ends by itself is begun once more, by a process of its own, and given up after that. Leaving the
    iterator ends all processes, and nothing half-made stays.

    Parameters
    ----------
    count : of processes at once
    commands : programs that can run a worker, to be tried one after the other (`addon.baking.hosts`)

    Raises
    ------
    BakeError : no worker can be started
    """
    waiting = deque((job, 1) for job in jobs)
    workers: list[_Worker] = []
    programs = Programs(commands)
    try:
        while waiting or any(worker.job for worker in workers):
            # Unused processes take memory and time to start: no more than there is work for.
            while waiting and len(workers) < count and (command := programs.current()):
                workers.append(_Worker(command))
            if not workers:
                remedy = "use --jobs 0, which bakes in this one"
                raise BakeError("bake library", "cannot start a process that bakes", remedy)
            for worker in workers:
                if worker.job is None and waiting:
                    worker.ask(*waiting.popleft(), out)
            idle = True
            for worker in list(workers):
                for event in worker.events():
                    idle = False
                    if event["event"] == "ready":
                        programs.works(worker.command)
                    if (told := worker.taken(event, watch)) is not None:
                        yield told
                if worker.is_over():
                    workers.remove(worker)
                    worker.end(out)
                    yield from _lost(worker, waiting, programs)
            if idle:
                time.sleep(_PAUSE)
    finally:
        for worker in workers:
            worker.end(out)


class Programs:
    """Programs that can run a worker, the one to be tried first in front."""

    def __init__(self, commands: Sequence[Sequence[str]]) -> None:
        self._left = [list(command) for command in commands]
        self._working: list[list[str]] = []
        self._failed = 0

    def current(self) -> list[str]:
        """The program of the next worker; empty where none is left."""
        return self._left[0] if self._left else []

    def works(self, command: list[str]) -> None:
        """A worker of this program can be asked, whatever became of another."""
        if command not in self._working:
            self._working.append(command)
        self._failed = 0
        if command not in self._left:
            self._left.insert(0, command)

    def failed(self, command: list[str]) -> None:
        """A worker of this program ended before it could be asked: the next may do, unless this one has worked."""
        if command != self.current():
            return
        self._failed += 1
        if command not in self._working or self._failed >= _STARTS:
            self._left.pop(0)
            self._failed = 0


def _lost(worker: _Worker, waiting: deque[tuple[LibraryJob, int]], programs: Programs) -> Iterator[Outcome]:
    """Put the job of a process that ended by itself back in front, or give it up."""
    if not worker.ready:
        # It never ran: nothing is the job's fault.
        programs.failed(worker.command)
        if worker.job is not None:
            waiting.appendleft((worker.job, worker.attempt))
    elif worker.job is not None and worker.attempt < _ATTEMPTS:
        waiting.appendleft((worker.job, worker.attempt + 1))
    elif worker.job is not None:
        cause = f"was not baked: the process that baked it ended by itself twice ({worker.last_words()})"
        remedy = "check the memory of the machine and its other programs, and start again: the rest is kept"
        error = BakeError(worker.job.request.title, cause, remedy)
        yield replace(failure(worker.job, error), attempts=worker.attempt)


class _Worker:
    """A worker process and the job it is at."""

    def __init__(self, command: list[str]) -> None:
        self.command = command
        self.job: LibraryJob | None = None
        self.attempt = 0
        self.ready = False
        self._process: WorkerProcess | None = None
        self._code: int | None = None
        self._ended = False
        with contextlib.suppress(OSError):
            self._process = WorkerProcess(command, worker=_WORKER, environment=_ONE_THREAD)

    def ask(self, job: LibraryJob, attempt: int, out: Path) -> None:
        self.job, self.attempt = job, attempt
        if self._process:
            self._process.ask((job, out))

    def events(self) -> Iterator[dict[str, Any]]:
        """What the process has said since; lines that its host says of itself are left out."""
        while self._process and not self._ended:
            try:
                line = self._process.lines.get_nowait()
            except queue.Empty:
                return
            if line is None:
                self._ended = True
                return
            with contextlib.suppress(ValueError):
                event = json.loads(line)
                if isinstance(event, dict) and "event" in event:
                    yield event

    def taken(self, event: dict[str, Any], watch: Watch) -> Outcome | None:
        """Take notice of an event; the outcome of a job that is over."""
        if event["event"] == "ready":
            self.ready = True
        elif event["event"] == "stage" and self.job:
            watch(self.job, str(event["stage"]), float(event["share"]))
        elif event["event"] == "outcome" and self.job:
            self.job = None
            return replace(Outcome.of_event(event), attempts=self.attempt)
        return None

    def is_over(self) -> bool:
        """Whether the process has ended, and all that it said has been heard."""
        if self._process is None:
            return True
        self._code = self._process.exit_code()
        return self._ended and self._code is not None

    def end(self, out: Path) -> None:
        """End the process if it still runs, and remove what it had begun."""
        if self._process is not None:
            self._process.end()
        if self.job is not None:
            with contextlib.suppress(OSError):
                remove_leftovers(self.job.target(out))

    def last_words(self) -> str:
        """How it ended, and its last line of complaint."""
        said = ending_words(self._code or 0)
        last = self._process.log[-1][:200] if self._process and self._process.log else ""
        return f"{said}: {last}" if last else said
