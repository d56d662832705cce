"""Progress of long work, reported on the error stream: one rewritten line on a terminal, plain lines elsewhere."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Callable, Mapping
from typing import TextIO

from ...summary.progress_estimate import ProgressEstimate

_PLAIN_PAUSE = 10.0  # seconds between two plain lines of one stage
_REDRAW_PAUSE = 0.1
_BAR = 24


class Progress(ProgressEstimate):
    """Progress of one or more jobs with the same stages, as a callback (stage, share).

    Parameters
    ----------
    stages : name to typical seconds, in the order they come; their proportions carry the time estimate
    jobs : how many there will be
    stream : by default the error stream
    clock : in seconds

    Use `start` before each job and `close` at the end, or the object as a context manager.
    """

    def __init__(
        self,
        stages: Mapping[str, float],
        jobs: int = 1,
        stream: TextIO | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(stages, jobs, clock)
        self._stream = sys.stderr if stream is None else stream
        self._live = _is_terminal(self._stream)
        self._said: tuple[int, str] = (-1, "")
        self._said_at = -_PLAIN_PAUSE
        self._shown = False

    def __call__(self, stage: str, share: float) -> None:
        """The job is in this stage, and that share of the stage is done."""
        super().__call__(stage, share)
        now = self._clock()
        if self._live:
            if now - self._said_at >= _REDRAW_PAUSE or self._said != (self._job, stage):
                self._draw()
                self._said_at, self._said = now, (self._job, stage)
        elif self._said != (self._job, stage) or now - self._said_at >= _PLAIN_PAUSE:
            self._write(f"{self.words()}\n")
            self._said_at, self._said = now, (self._job, stage)

    def close(self) -> None:
        """Wipe the line, so that what follows starts on a clean one."""
        if self._shown:
            self._write("\r\x1b[K")
            self._shown = False

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _draw(self) -> None:
        filled = round(_BAR * self.overall())
        line = f"[{'#' * filled}{'.' * (_BAR - filled)}] {self.words()}"
        self._write(f"\r{line[: shutil.get_terminal_size().columns - 1]}\x1b[K")
        self._shown = True

    def _write(self, text: str) -> None:
        # Nobody may be listening, and a title may hold what the stream's encoding has no sign for.
        try:
            encoding = getattr(self._stream, "encoding", None) or "utf-8"
            self._stream.write(text.encode(encoding, "backslashreplace").decode(encoding))
            self._stream.flush()
        except (OSError, ValueError):
            pass


def _is_terminal(stream: TextIO) -> bool:
    try:
        return stream.isatty()
    except (AttributeError, ValueError):
        return False
