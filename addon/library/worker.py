"""Inside a worker process of a library: one job after the other, reported as JSON lines on the standard output.

Jobs come by the standard input. At its end, also where the process that asks has died, the worker removes what it has
begun and ends.
"""

from __future__ import annotations

import os
import pickle
import queue
import struct
import sys
import threading
from pathlib import Path
from typing import Any

from ..baking.worker import leave_nothing, progress_of, teller
from ..cli.console.streams import results_stream


def main() -> None:
    """Bake what is asked for until nothing more is, and end the process."""
    with results_stream(to_the_end=True) as stream:
        say = teller(stream)
        say(event="ready")
        from .run import run_task  # the slow part of the start

        asked = _Asked()
        threading.Thread(target=asked.listen, daemon=True).start()
        while (given := asked.next()) is not None:
            job, out = given
            outcome = run_task(job, out, progress_of(say), asked.lies_in)
            say(event="outcome", **outcome.as_event())
        stream.flush()
    # Blender as a host, and its module, have destructors of their own.
    os._exit(0)


class _Asked:
    """Jobs from the standard input, read by a thread of its own, which also knows what is to be removed at its end."""

    def __init__(self) -> None:
        self._jobs: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._alone = threading.Lock()
        self._over = False
        self._folder: Path | None = None

    def listen(self) -> None:
        """Read jobs until the end of the standard input, then end the process; a bundle on its way into its place
        arrives."""
        while (job := _read()) is not None:
            self._jobs.put(job)
        with self._alone:
            self._over = True
            if self._folder is not None:
                leave_nothing(self._folder)
        self._jobs.put(None)

    def next(self) -> Any:
        """The next job; None at the end."""
        job = self._jobs.get()
        return None if self._over else job

    def lies_in(self, folder: Path | None) -> None:
        """The work lies in this folder, from now on, or until now."""
        with self._alone:
            if self._over and folder is not None:
                leave_nothing(folder)
            self._folder = folder


def _read() -> Any:
    head = sys.stdin.buffer.read(8)
    if len(head) < 8:
        return None
    (size,) = struct.unpack("<Q", head)
    body = sys.stdin.buffer.read(size)
    # From the process that started this one, by a pipe that nobody else can write to.
    return pickle.loads(body) if len(body) == size else None
