"""One worker kept warm: started while an artist still looks at a dialogue, so that the bake need not wait for it.

Starting Python and importing what a bake needs takes a second, more on a machine that is busy. A spare worker writes
nothing, waits at its standard input, and ends with it.
"""

from __future__ import annotations

import atexit
import contextlib
import time

from .worker_process import WorkerProcess

# Seconds after which nobody is expected to come back to the dialogue.
LASTS = 300.0

_spare: WorkerProcess | None = None
_until = 0.0


def prepare(commands: list[list[str]]) -> None:
    """Have a worker ready for the first of these commands, as of `hosts`; nothing happens where one is."""
    global _spare, _until
    _until = time.monotonic() + LASTS
    if not commands or (_spare is not None and _is_good(_spare, commands[0])):
        return
    drop()
    atexit.register(drop)
    with contextlib.suppress(OSError):  # the bake finds the next program
        _spare = WorkerProcess(list(commands[0]))


def taken(command: list[str]) -> WorkerProcess | None:
    """The spare worker, if it was started by this command and lives; it is then the caller's."""
    global _spare
    if _spare is None or not _is_good(_spare, command):
        return None
    atexit.unregister(drop)
    process, _spare = _spare, None
    return process


def drop() -> None:
    """End the spare worker."""
    global _spare
    atexit.unregister(drop)
    process, _spare = _spare, None
    if process is not None:
        process.end()


def is_due() -> bool:
    """Whether there is a spare worker that nobody has come for in time."""
    return _spare is not None and time.monotonic() > _until


def is_there() -> bool:
    """Whether there is a spare worker."""
    return _spare is not None


def _is_good(process: WorkerProcess, command: list[str]) -> bool:
    return process.command == list(command) and process.exit_code() is None
