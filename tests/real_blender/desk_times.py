"""Inside a real Blender window, for desk_steps.py: how long an import takes beside the window, and in its own process.

Both by the clock and by processor time, which other programs on a busy machine do not count in.
"""

import os
import resource
import time
from pathlib import Path

import bpy

# How often either is done, in turn: the quickest of each is looked at.
_ROUNDS = 2
_TICKS = os.sysconf("SC_CLK_TCK")


def of_workers(desk):
    """Processor seconds of all processes that Blender has started, those that have ended included."""
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    total = ended.ru_utime + ended.ru_stime
    for pid in desk.children():
        try:
            fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        total += (int(fields[11]) + int(fields[12])) / _TICKS
    return total


class Stopwatch:
    """Seconds since it was made: by the clock, and of processors, in the workers and in our own steps in the window."""

    def __init__(self, desk):
        self._desk, self._steps = desk, len(desk.steps_taken)
        self._clock, self._workers = time.monotonic(), of_workers(desk)

    def read(self):
        """Both."""
        ours = sum(step[0] for step in self._desk.steps_taken[self._steps :] if step[3])
        spent = of_workers(self._desk) - self._workers + ours
        return {"clock": round(time.monotonic() - self._clock, 2), "processor": round(spent, 2)}


def steps(desk):
    """The same import in turn beside the window and in process, as a script has it."""
    desk.found["final"] = {"beside": [], "in process": []}
    for _ in range(_ROUNDS):
        dropped = desk.drop()
        yield next(dropped)  # the dialogue is open, for as long as an artist likes
        watch = Stopwatch(desk)
        yield from dropped
        yield from desk.idle()
        desk.found["final"]["beside"].append(watch.read())
        yield 0.5
        desk.felt("import again")
        clock, spent = time.monotonic(), time.process_time()
        bpy.ops.measured_materials.import_brdf(
            directory=str(desk.SOURCE.parent), files=[{"name": desk.SOURCE.name}], bundles=str(desk.SOURCE.parent)
        )
        took = {"clock": round(time.monotonic() - clock, 2), "processor": round(time.process_time() - spent, 2)}
        desk.found["final"]["in process"].append(took)
        yield 0.5
        desk.felt("in process, which waits")
