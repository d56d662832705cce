"""The output stream kept for results alone, and interruption by Ctrl-C, inside Blender and outside."""

from __future__ import annotations

import contextlib
import ctypes
import io
import os
import signal
import sys
import threading
from collections.abc import Iterator
from typing import TextIO


@contextlib.contextmanager
def results_stream(to_the_end: bool) -> Iterator[TextIO]:
    """The output stream, while whatever else prints, Blender's own code included, lands on the error stream.

    Cycles writes to the file descriptor, past Python. With `to_the_end` the descriptor stays turned away, so
    that nothing can follow the result.
    """
    try:
        diverted = sys.stdout.fileno() == 1 and sys.stderr.fileno() == 2
    except (AttributeError, ValueError, io.UnsupportedOperation):
        diverted = False
    if not diverted:  # a test or a notebook has taken the streams
        yield sys.stdout
        return
    _flush()
    with os.fdopen(os.dup(1), "w", encoding=sys.stdout.encoding, errors="backslashreplace") as stream:
        os.dup2(2, 1)
        try:
            yield stream
        finally:
            if not to_the_end:
                _flush()
                os.dup2(stream.fileno(), 1)


def silence_output(stream: TextIO) -> None:
    """Send what Python and Blender still hold for a reader that has gone nowhere, or they would complain."""
    with contextlib.suppress(OSError, ValueError, io.UnsupportedOperation):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


@contextlib.contextmanager
def keyboard_interrupts() -> Iterator[None]:
    """Have Ctrl-C raise KeyboardInterrupt, which Blender's own handler in the background does not."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        # None: the handler was not set from Python, and cannot be set back by it.
        if before is not None:
            signal.signal(signal.SIGINT, before)


def _flush() -> None:
    """Python's buffer and C's, which would otherwise empty after the descriptor has been turned."""
    with contextlib.suppress(OSError, ValueError):
        sys.stdout.flush()
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL("ucrtbase" if sys.platform == "win32" else None).fflush(None)
