"""Inside the worker process: one bake, reported as JSON lines on the standard output.

The request comes by the standard input, which the other process then keeps open for as long as it wants the bake. At
its end, also where that process has died, the worker removes what it has written and ends.
"""

from __future__ import annotations

import contextlib
import json
import os
import pickle
import shutil
import struct
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn, TextIO

from ...bake.errors import BakeError
from ..cli.console.streams import results_stream
from ..photographs.find_decoder import blender_decoder

# Of one stage's progress; more often nobody sees.
_PAUSE = 0.05
_NICENESS = 5


def main() -> None:
    """Bake what is asked for and end the process."""
    with results_stream(to_the_end=True) as stream:
        say = teller(stream)
        say(event="ready")
        _import()

        head = sys.stdin.buffer.read(8)
        if len(head) < 8:  # nobody wants it any more
            os._exit(0)
        (size,) = struct.unpack("<Q", head)
        # From the process that started this one, by a pipe that nobody else can write to.
        request, staging, name = pickle.loads(sys.stdin.buffer.read(size))
        threading.Thread(target=_end_with_parent, args=(staging,), daemon=True).start()
        with contextlib.suppress(AttributeError, OSError):
            os.nice(_NICENESS)
        code = _bake(request, staging, name, say)
        stream.flush()
    # Blender as a host, and its module, have destructors of their own.
    os._exit(code)


def _import() -> None:
    """What a bake and a look need, the slow part of the start: a spare worker has it behind it when it is asked."""
    from . import look, request  # noqa: F401


def _bake(request: Any, staging: Path, name: str, say: Callable[..., None]) -> int:
    from .look import look_at
    from .request import run_request

    def preview(path: Path) -> None:
        say(event="preview", path=str(path))

    try:
        if request.look:
            look = look_at(request.photographs(), request.settings.stack, progress_of(say), blender_decoder())
            say(event="looked", **look.as_event())
            return 0
        quick = None
        if request.quick:
            (staging / "quick").mkdir()
            quick = staging / "quick" / name, preview
        result = run_request(request, staging / name, progress_of(say), blender_decoder(), quick)
    except BakeError as error:
        say(event="error", file=error.file, cause=error.cause, remedy=error.remedy)
        return 1
    except MemoryError:
        remedy = "choose a lower resolution or close other programs"
        say(event="error", file=request.title, cause="ran out of memory", remedy=remedy)
        return 1
    say(event="done", path=str(result.path), seconds=result.seconds)
    return 0


def teller(stream: TextIO) -> Callable[..., None]:
    """A function that writes its keyword arguments as one JSON line; nothing happens where nobody listens any more."""
    alone = threading.Lock()  # a quick bake speaks beside the other

    def say(**event: Any) -> None:
        try:
            with alone:
                stream.write(json.dumps(event) + "\n")
                stream.flush()
        except (OSError, ValueError):  # nobody listens any more; the watcher ends this
            pass

    return say


def progress_of(say: Callable[..., None]) -> Callable[[str, float], None]:
    """A bake's progress as such lines, not too many."""
    last: list[Any] = ["", 0.0]

    def report(stage: str, share: float) -> None:
        now = time.monotonic()
        if stage != last[0] or now - last[1] >= _PAUSE:
            last[:] = stage, now
            say(event="stage", stage=stage, share=share)

    return report


def _end_with_parent(staging: Path) -> None:
    """Wait for the end of the standard input, then end, and leave nothing."""
    with contextlib.suppress(OSError, ValueError):
        while os.read(sys.stdin.fileno(), 1024):
            pass
    leave_nothing(staging)


def leave_nothing(staging: Path) -> NoReturn:
    """End the process and what it is doing, without the folder that its work lies in."""
    # The bake goes on meanwhile and may still write.
    for _ in range(100):
        shutil.rmtree(staging, ignore_errors=True)
        if not staging.exists():
            break
    os._exit(3)
