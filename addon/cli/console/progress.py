"""Progress of long work, reported on the error stream: one rewritten line on a terminal, plain lines elsewhere."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Callable, Mapping
from typing import TextIO

from ...summary.bake_stages import share_done

_PLAIN_PAUSE = 10.0  # seconds between two plain lines of one stage
_REDRAW_PAUSE = 0.1
_BAR = 24


class Progress:
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
        self._stages, self._jobs, self._clock = dict(stages), max(jobs, 1), clock
        self._stream = sys.stderr if stream is None else stream
        self._live = _is_terminal(self._stream)
        self._began = clock()
        self._job, self._title = -1, ""
        self._stage, self._share = "", 0.0
        self._said: tuple[int, str] = (-1, "")
        self._said_at = -_PLAIN_PAUSE
        self._shown = False

    def start(self, title: str) -> None:
        """The next job begins."""
        self._job += 1
        self._title, self._stage, self._share = title, "", 0.0

    def __call__(self, stage: str, share: float) -> None:
        """The job is in this stage, and that share of the stage is done."""
        self._stage, self._share = stage, min(max(share, 0.0), 1.0)
        now = self._clock()
        if self._live:
            if now - self._said_at >= _REDRAW_PAUSE or self._said != (self._job, stage):
                self._draw()
                self._said_at, self._said = now, (self._job, stage)
        elif self._said != (self._job, stage) or now - self._said_at >= _PLAIN_PAUSE:
            self._write(f"{self._words()}\n")
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

    def overall(self) -> float:
        """Share of all jobs that is done."""
        within = share_done(self._stages, self._stage, self._share)
        return min((max(self._job, 0) + within) / self._jobs, 1.0)

    def seconds_left(self) -> float | None:
        """Estimate from the time taken so far; None while there is too little to go by."""
        elapsed, done = self._clock() - self._began, self.overall()
        if elapsed < 0.5 or done < 0.03:
            return None
        return elapsed * (1 - done) / done

    def _words(self) -> str:
        counter = f"{self._job + 1}/{self._jobs} " if self._jobs > 1 else ""
        title = f"{self._title}: " if self._title else ""
        left = self.seconds_left()
        estimate = "" if left is None else f", {readable_time(left)} left"
        return f"{counter}{title}{self._stage}, {100 * self.overall():.0f} %{estimate}"

    def _draw(self) -> None:
        filled = round(_BAR * self.overall())
        line = f"[{'#' * filled}{'.' * (_BAR - filled)}] {self._words()}"
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


def readable_time(seconds: float) -> str:
    """A duration as people say it, rounded up: "8 s", "2 min 10 s", "1 h 5 min"."""
    whole = max(1, int(seconds + 0.999))
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"


def _is_terminal(stream: TextIO) -> bool:
    try:
        return stream.isatty()
    except (AttributeError, ValueError):
        return False
