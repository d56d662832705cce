"""One bake in a process of its own, followed without ever waiting for it; no bpy here."""

from __future__ import annotations

import atexit
import contextlib
import json
import queue
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...bake.bundle.bundle import staging
from ...bake.bundle.result import BakeResult
from ...bake.errors import BakeError
from . import spare
from .look import Look
from .request import BakeRequest, publish
from .worker_process import WorkerProcess, ending_words

WAITING, RUNNING, DONE, FAILED, CANCELLED, NO_HOST = "waiting", "running", "done", "failed", "cancelled", "no host"


class BakeJob:
    """A bake that another process does; `poll` it now and then, from one thread.

    Attributes
    ----------
    state : one of the names above; the last four are final. NO_HOST: no program could be started, nothing was done
    stage, share : where the bake is
    preview : bundle of the quick bake, once it is there, until the job is closed
    look : of a job that only looks at photographs, once it is done
    error : of a failed job
    """

    def __init__(self, request: BakeRequest, target: Path, hosts: Sequence[Sequence[str]]) -> None:
        self.request, self.target = request, target
        self.state, self.stage, self.share = WAITING, "starting", 0.0
        self.preview: Path | None = None
        self.look: Look | None = None
        self.error: BakeError | None = None
        self._hosts = [list(host) for host in hosts]
        self._stack = contextlib.ExitStack()
        self._staging = Path()
        self._process: WorkerProcess | None = None
        self._baked: tuple[Path, float] | None = None
        self._ready = self._ended = False

    def start(self) -> None:
        """Start the process. A target that cannot be written fails the job."""
        atexit.register(self.close)
        try:
            self._staging = self._stack.enter_context(staging(self.target))
        except BakeError as error:
            self._fail(error)
            return
        self.state = RUNNING
        self._start_next()

    def poll(self) -> str:
        """Take notice of what the process has said so far; returns the state."""
        while self.state == RUNNING and self._process:
            try:
                line = self._process.lines.get_nowait()
            except queue.Empty:
                break
            if line is None:
                self._ended = True
            else:
                self._take(line)
        if self.state == RUNNING and self._ended and self._process:
            code = self._process.exit_code()
            if code is not None:
                self._died(code)
        return self.state

    def cancel(self) -> None:
        """End the process and remove what it has written; nothing happens to a job that is over."""
        if self.state in (WAITING, RUNNING):
            self.state = CANCELLED
            self.close()

    def finish(self, target: Path | None = None) -> BakeResult:
        """Put the bundle of a job that is done in its place, or in another, and close the job. Raises BakeError."""
        assert self._baked
        path, seconds = self._baked
        try:
            target = target or self.target
            return BakeResult(target, publish(self.request, path, target), seconds)
        finally:
            self.close()

    def close(self) -> None:
        """End what still runs, and remove what is still there."""
        atexit.unregister(self.close)
        self._kill()
        self._stack.close()

    def _start_next(self) -> None:
        """Start the next program that may serve as a host."""
        self._kill()
        while self._hosts:
            self._ended = self._ready = False
            with contextlib.suppress(OSError):
                self._launch(self._hosts.pop(0))
                return
        self.state = NO_HOST
        self.close()

    def _launch(self, command: list[str]) -> None:
        self._process = spare.taken(command) or WorkerProcess(command)
        self._process.ask((self.request, self._staging, self.target.name))

    def _take(self, line: bytes) -> None:
        """One line of the process, which may also be something that its host says of itself."""
        try:
            event: Any = json.loads(line)
        except ValueError:
            return
        kind = event.get("event") if isinstance(event, dict) else None
        if kind == "ready":
            self._ready = True
        elif kind == "stage":
            self.stage, self.share = str(event["stage"]), float(event["share"])
        elif kind == "preview":
            self.preview = Path(event["path"])
        elif kind == "done":
            self.state, self._baked = DONE, (Path(event["path"]), float(event["seconds"]))
        elif kind == "looked":
            self.state, self.look = DONE, Look.of_event(event)
        elif kind == "error":
            self._fail(BakeError(event["file"], event["cause"], event["remedy"]))

    def _died(self, code: int) -> None:
        if not self._ready:
            self._start_next()
            return
        if self._process:
            print("\n".join(self._process.log), file=sys.stderr)
        cause = f"was not baked: the process that baked it ended by itself ({ending_words(code)})"
        self._fail(BakeError(self.request.title, cause, "try again; what it said last stands in the terminal"))

    def _fail(self, error: BakeError) -> None:
        self.state, self.error = FAILED, error
        self.close()

    def _kill(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            process.end()
