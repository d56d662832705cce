"""A process that can bake: started, asked once, listened to without waiting, and ended; no bpy here."""

from __future__ import annotations

import contextlib
import json
import os
import pickle
import queue
import signal
import struct
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import Any

_ROOT = Path(__file__).resolve().parents[2]
_PACKAGE = __package__.rpartition(".addon.")[0] if __package__ else ""
# Seconds that the end of a process is waited for where nothing may be left behind.
_PATIENCE = 10.0


class WorkerProcess:
    """A worker, which imports what a bake needs and then waits for its request. Raises OSError where none starts.

    Parameters
    ----------
    worker : module of the package whose `main` the process runs
    environment : variables that it has beside those of this process

    Attributes
    ----------
    command : its program, with arguments
    lines : what it says; None at its end
    log : the last lines of its complaints
    """

    def __init__(
        self, command: list[str], *, worker: str = "addon.baking.worker", environment: Mapping[str, str] | None = None
    ) -> None:
        self.command = command
        self.lines: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self.log: deque[str] = deque(maxlen=40)
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1", "PYTHONUNBUFFERED": "1", **(environment or {})},
            # A terminal's Ctrl-C is Blender's business; one group, to end a host's own children too.
            start_new_session=sys.platform != "win32",
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        )
        about = {"package": _PACKAGE, "init": str(_ROOT / "__init__.py"), "folder": str(_ROOT), "path": sys.path}
        about["worker"] = worker
        # One thread writes, as a pipe takes only so much at once, and what is asked comes after the first line.
        self._words: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._words.put(json.dumps(about).encode() + b"\n")
        for work, arguments in (
            (_write, (self._process.stdin, self._words)),
            (_read, (self._process.stdout, self.lines)),
            (_keep, (self._process.stderr, self.log)),
        ):
            threading.Thread(target=work, args=arguments, daemon=True).start()

    @property
    def pid(self) -> int:
        """The process' number."""
        return self._process.pid

    def ask(self, request: Any) -> None:
        """Hand the worker a request; that of `addon.baking.worker` is a `BakeRequest`, the folder to write to, and the
        bundle's name, and it takes no second."""
        asked = pickle.dumps(request)
        self._words.put(struct.pack("<Q", len(asked)) + asked)

    def exit_code(self) -> int | None:
        """Its exit code; None while it runs."""
        return self._process.poll()

    def end(self) -> None:
        """End it, if it still runs."""
        process = self._process
        self._words.put(None)
        with contextlib.suppress(OSError):
            if process.poll() is not None:
                pass
            elif sys.platform == "win32":
                process.kill()
            else:
                os.killpg(process.pid, signal.SIGKILL)
        with contextlib.suppress(OSError, subprocess.TimeoutExpired):
            process.wait(_PATIENCE)
        with contextlib.suppress(OSError, ValueError):
            process.stdin.close()  # type: ignore[union-attr]


def ending_words(code: int) -> str:
    """How a process ended, by its exit code: a signal's name where one ended it."""
    if code < 0:
        with contextlib.suppress(ValueError):
            return signal.Signals(-code).name
    return f"exit code {code}"


def _write(stream: Any, words: queue.SimpleQueue[bytes | None]) -> None:
    """What is asked; the stream stays open, for its end is how the process learns that nobody waits for it."""
    with contextlib.suppress(OSError, ValueError):
        while (message := words.get()) is not None:
            stream.write(message)
            stream.flush()


def _read(stream: Any, lines: queue.SimpleQueue[bytes | None]) -> None:
    with contextlib.suppress(OSError, ValueError):
        for line in stream:
            lines.put(line)
    stream.close()
    lines.put(None)


def _keep(stream: Any, log: deque[str]) -> None:
    with contextlib.suppress(OSError, ValueError):
        for line in stream:
            log.append(line.decode(errors="replace").rstrip())
    stream.close()
