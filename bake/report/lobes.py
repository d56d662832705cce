"""Cosine lobes: error against time per evaluation (Romanyuk 2007, and the approximations it is measured by)."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from .. import xp_numpy
from ..lobes.cosine_lobes import COSINE_LOBES, cosine_lobe
from ..source import Array
from .chart import SAME_TIME, Chart, Point
from .journal import Journal
from .page import Section, Table

_EXPONENTS = (1, 2, 4, 8, 16, 32, 64, 128, 256)
_TIMED_EXPONENT = 60.0
_COUNT, _RUNS = 1 << 19, 5
# The machine's own pow of the cosine: a narrow lobe loses its digits, for the cosine was rounded near 1.
BARE_POWER = "bare pow"


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
    """Measure all lobes, and the bare power of a cosine that was rounded before."""
    names = [*COSINE_LOBES, BARE_POWER]
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
    if name == BARE_POWER:
        return np.power(1 - u, exponent)
    return np.asarray(cosine_lobe(xp_numpy, name, u, exponent))


def _seconds(function: Callable[[], object]) -> float:
    function()
    runs = []
    for _ in range(_RUNS):
        started = time.process_time()
        function()
        runs.append(time.process_time() - started)
    return min(runs)


# --- report ---------------------------------------------------------------------------------------------


def lobes_section(
    costs: Sequence[LobeCost], rendered: Mapping[str, Mapping[str, float]], missing: str | None
) -> Section:
    """Charts, a table, and whether an approximation still pays on this machine.

    Parameters
    ----------
    rendered : nanoseconds per evaluation, by column ("nodes, n varies" and its like) and lobe
    missing : why a column is not there
    """
    columns = {"numpy": {cost.name: cost.ns for cost in costs}, **rendered}
    words = [
        "Lobes that stand for a highlight cos^n, as in Phong's model: “power” is cos^n to its last digits, “bare pow” "
        "the machine's own power of a cosine that was rounded before, the others are approximations that were made to "
        "be cheaper. Error is the largest for n from 1 to 256, in parts of the highlight's peak.",
        " ".join(_verdict(column, times) for column, times in columns.items()),
    ]
    section = Section("Lobes", words)
    for column, times in columns.items():
        series = {cost.name: [Point(times[cost.name], cost.whole, cost.name)] for cost in costs if cost.name in times}
        title = f"Lobes: error against time, {column}"
        section.charts.append(
            Chart(title, "ns per evaluation, processor time", "largest error, of the peak", series, same=SAME_TIME)
        )
    head = ("lobe", "error to half of the peak", "error, all angles", *(f"ns, {column}" for column in columns))
    rows = [(c.name, c.core, c.whole, *(times.get(c.name) for times in columns.values())) for c in costs]
    section.tables = [Table(head, rows)]
    section.notes = [f"Not measured: {missing}."] if missing else []
    return section


def _verdict(column: str, times: Mapping[str, float]) -> str:
    """Whether pow is as cheap as what was made to replace it."""
    pow, cubic = times[BARE_POWER], times["cubic"]
    rivals = {name: ns for name, ns in times.items() if name not in (BARE_POWER, "power")}
    fastest = min(rivals, key=rivals.__getitem__)
    cheap = pow <= SAME_TIME * rivals[fastest]
    words = f"In {column}, pow takes {pow:.3g} ns and the cubic {cubic:.3g} ns:"
    if cheap:
        return f"{words} pow is as cheap as any of them."
    if pow <= SAME_TIME * cubic:
        return f"{words} pow is as cheap as the cubic; only {fastest} is cheaper ({rivals[fastest]:.3g} ns)."
    return f"{words} here the cubic is still the cheaper, by a factor of {pow / cubic:.2g}."
