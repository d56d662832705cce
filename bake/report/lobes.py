"""Cosine lobes: error against time per evaluation (Romanyuk 2007, and the approximations it is measured by)."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from .. import xp_numpy
from ..cosine_lobes import COSINE_LOBES, cosine_lobe
from ..source import Array
from .chart import Chart, Point
from .journal import Journal
from .page import Section, Table

_EXPONENTS = (1, 2, 4, 8, 16, 32, 64, 128, 256)
_TIMED_EXPONENT = 60.0
_COUNT, _RUNS = 1 << 19, 5


@dataclass(frozen=True)
class LobeCost:
    """A lobe's largest errors for n in [1, 256], of a peak of 1, and nanoseconds of one value in numpy, float32.

    core : down to half of the peak, where the cubic is fitted
    whole : over all angles
    """

    name: str
    core: float
    whole: float
    ns: float


def measure_lobes(journal: Journal) -> list[LobeCost]:
    """All lobes, and numpy's bare power."""
    names = [*COSINE_LOBES, "numpy power"]
    return [LobeCost(name, **journal.measure(f"lobes {name}", partial(_measured, name))) for name in names]


def _measured(name: str) -> dict[str, float]:
    core, whole = 0.0, 0.0
    for n in _EXPONENTS:
        half = -math.expm1(-math.log(2) / n)
        u = np.concatenate([np.linspace(0, half, 2001), np.geomspace(half, 1, 4001)])
        with np.errstate(divide="ignore"):
            exact = np.exp(n * np.log1p(-np.minimum(u, 1)))
        off = np.abs(_evaluate(name, u.astype(np.float32), float(n)) - exact)
        core, whole = max(core, float(off[:2001].max())), max(whole, float(off.max()))
    u = (np.random.default_rng(0).random(_COUNT) ** 2 * 0.2).astype(np.float32)
    return {"core": core, "whole": whole, "ns": _seconds(lambda: _evaluate(name, u, _TIMED_EXPONENT)) / _COUNT * 1e9}


def _evaluate(name: str, u: Array, n: float) -> Array:
    exponent = np.full(1, n, np.float32)
    if name == "numpy power":
        return np.power(1 - u, exponent)
    return np.asarray(cosine_lobe(xp_numpy, name, u, exponent))


def _seconds(function: Callable[[], object]) -> float:
    function()
    runs = []
    for _ in range(_RUNS):
        started = time.perf_counter()
        function()
        runs.append(time.perf_counter() - started)
    return min(runs)


def lobes_section(costs: list[LobeCost]) -> Section:
    """Chart, table, and whether the approximation still pays on this machine."""
    by_name = {cost.name: cost for cost in costs}
    power, cubic = by_name["numpy power"], by_name["cubic"]
    faster = power.ns / cubic.ns
    verdict = (
        f"Here the cubic takes {1 / faster:.2g} times as long as numpy's power: modern hardware makes pow the cheaper."
        if faster < 1
        else f"Here the cubic is {faster:.2g} times faster than numpy's power."
    )
    words = [
        "Error of lobes that stand for cos^n, the largest for n from 1 to 256, in parts of the peak, in float32. "
        f"{verdict}"
    ]
    section = Section("Lobes", words)
    series = {cost.name: [Point(cost.ns, cost.whole, "all angles")] for cost in costs}
    section.charts = [Chart("Lobes: error against time", "ns per value (numpy, float32)", "largest error", series)]
    section.tables = [
        Table(("lobe", "error, core", "error, all angles", "ns"), [list(vars(c).values()) for c in costs])
    ]
    section.notes = ["In shader nodes and OSL the times lie closer together: `bench lobes` measures them."]
    return section
