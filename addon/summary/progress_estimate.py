"""How far long work has come and how long it will take: the command line's progress, and that of the status bar."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

from .bake_stages import share_done, stage_words


class ProgressEstimate:
    """Progress of one or more jobs with the same stages, as a callback (stage, share).

    Parameters
    ----------
    stages : name to typical seconds, in the order they come; their proportions carry the time estimate
    jobs : how many there will be
    clock : in seconds

    Use `start` before each job.
    """

    def __init__(self, stages: Mapping[str, float], jobs: int = 1, clock: Callable[[], float] = time.monotonic) -> None:
        self._stages, self._jobs, self._clock = dict(stages), max(jobs, 1), clock
        self._began = clock()
        self._job, self._title = -1, ""
        self._stage, self._share = "", 0.0

    def start(self, title: str) -> None:
        """The next job begins."""
        self._job += 1
        self._title, self._stage, self._share = title, "", 0.0

    def __call__(self, stage: str, share: float) -> None:
        """The job is in this stage, and that share of the stage is done."""
        self._stage, self._share = stage, min(max(share, 0.0), 1.0)

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

    def words(self) -> str:
        """Which job, its stage, the share of all that is done, and the time left."""
        counter = f"{self._job + 1}/{self._jobs} " if self._jobs > 1 else ""
        title = f"{self._title}: " if self._title else ""
        left = self.seconds_left()
        estimate = "" if left is None else f", {readable_time(left)} left"
        return f"{counter}{title}{stage_words(self._stage)}, {100 * self.overall():.0f} %{estimate}"


def readable_time(seconds: float) -> str:
    """A duration as people say it, rounded up: "8 s", "2 min 10 s", "1 h 5 min"."""
    whole = max(1, int(seconds + 0.999))
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"
