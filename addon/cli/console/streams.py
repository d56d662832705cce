"""The output stream kept for results alone, inside Blender and outside."""

from __future__ import annotations

import contextlib
import ctypes
import io
import os
import sys
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
    with contextlib.suppress(OSError, ValueError):
        sys.stdout.flush()
    with os.fdopen(os.dup(1), "w", encoding=sys.stdout.encoding, errors="backslashreplace") as stream:
        os.dup2(2, 1)
        _flush()  # Blender's greeting, which a pipe has kept back so far, is no result either
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


def _flush() -> None:
    """Python's buffer and C's, which would otherwise empty after the descriptor has been turned."""
    with contextlib.suppress(OSError, ValueError):
        sys.stdout.flush()
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL("ucrtbase" if sys.platform == "win32" else None).fflush(None)
