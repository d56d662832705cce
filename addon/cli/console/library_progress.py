"""Progress of many jobs, several of which run at once: how many are done, what is being done, and the time left."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import TextIO

from ...summary.bake_stages import share_done, stage_words
from ...summary.progress_estimate import readable_time
from .progress import Progress

_SHOWN = 3


class LibraryProgress(Progress):
    """As `Progress`, of jobs that begin and end in any order, by their names."""

    def __init__(self, jobs: int, stream: TextIO | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__({}, jobs, stream, clock)
        self._running: dict[str, tuple[str, float]] = {}
        self._done = self._baked = 0

    def at(self, name: str, stages: Mapping[str, float], stage: str, share: float) -> None:
        """A job is in this stage, and that share of the stage is done."""
        self._running[name] = stage, share_done(stages, stage, min(max(share, 0.0), 1.0))
        self._show()

    def ended(self, name: str, baked: bool) -> None:
        """A job is over; one that was there already tells nothing of the time that others take."""
        self._running.pop(name, None)
        self._done += 1
        self._baked += baked
        self._show()

    def overall(self) -> float:
        """Share of all jobs that is done."""
        return min((self._done + sum(share for _, share in self._running.values())) / self._jobs, 1.0)

    def seconds_left(self) -> float | None:
        """Estimate from the jobs that were baked so far; None while there is too little to go by."""
        begun = sum(share for _, share in self._running.values())
        elapsed, baked = self._clock() - self._began, self._baked + begun
        if elapsed < 0.5 or baked < 0.3:
            return None
        return elapsed * (self._jobs - self._done - begun) / baked

    def words(self) -> str:
        """How many are done, what is being done, and the time left."""
        running = [f"{name} ({stage_words(stage)})" for name, (stage, _) in list(self._running.items())[:_SHOWN]]
        more = f" and {len(self._running) - _SHOWN} more" if len(self._running) > _SHOWN else ""
        now = f", {', '.join(running)}{more}" if running else ""
        left = self.seconds_left()
        estimate = "" if left is None else f", {readable_time(left)} left"
        return f"{self._done}/{self._jobs} done, {100 * self.overall():.0f} %{estimate}{now}"

    def _show(self) -> None:
        super().__call__("baking", 0.0)
