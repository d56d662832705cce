"""Time of a cosine lobe in rendered nodes and in OSL, beside the bare power of either."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from ...bake.errors import BakeError
from ...bake.lobes.cosine_lobes import cosine_lobe
from ...bake.report.lobes import BARE_POWER
from ...nodes import expr
from ...nodes.osl_script import output, require_osl, script_node, with_headers
from .render_timing import Build, Effort, evaluation_ns

EVALUATIONS = 24  # at a shading point
_ONE_EXPONENT = 60.0
# OSL compiles to machine code, a tenth of the nodes' time: too little to measure in as few samples.
_MORE_OF_OSL = 8
_OSL = """
#include "measured_lobes.h"
shader lobes(string Lobe = "", float X = 0, float Exponent = 1, output float Sum = 0)
{
  for (int k = 0; k < 24; ++k) {
    float at = X * (0.01 + 0.005 * k);
    Sum += Lobe == "" ? at : Lobe == "bare pow" ? pow(1 - at, Exponent) : mm_cosine_lobe(Lobe, at, Exponent);
  }
}
"""


@dataclass(frozen=True)
class RenderedLobes:
    """Nanoseconds of processor per evaluation, by column ("nodes, one n" and its like) and lobe.

    missing : why a column is not there, or None
    """

    ns: dict[str, dict[str, float]]
    missing: str | None


def measure_rendered(
    lobes: Sequence[str], effort: Effort, progress: Callable[[float], None] | None = None, *, thorough: bool = True
) -> RenderedLobes:
    """Time the lobes and `BARE_POWER` with an exponent that varies from pixel to pixel; `thorough`, also with one."""
    names = (*lobes, BARE_POWER)
    columns: dict[str, tuple[Callable[..., Any], bool]] = {"nodes, one n": (_nodes, False)} if thorough else {}
    columns["nodes, n varies"] = (_nodes, True)
    missing = None
    try:
        require_osl()
        columns["OSL, n varies"] = (_osl, True)
    except BakeError as error:
        missing = f"{error.file} {error.cause}"
    found = {}
    for k, (column, (build, varies)) in enumerate(columns.items()):
        say = partial(_part, progress, k, len(columns))
        planes: dict[str, Build] = {name: partial(_emitted, build, name, varies) for name in names}
        bare = partial(_emitted, build, "", varies)
        osl = build is _osl
        enough = replace(effort, samples=_MORE_OF_OSL * effort.samples) if osl else effort
        found[column] = evaluation_ns(planes, bare, EVALUATIONS, enough, osl=osl, progress=say)
    return RenderedLobes(found, missing)


def _part(progress: Callable[[float], None] | None, k: int, count: int, share: float) -> None:
    if progress:
        progress((k + share) / count)


def _emitted(build: Callable[..., Any], name: str, varies: bool, place: Any) -> Any:
    x, y, _ = expr.components(place)
    return build(name, x, y * 100 + 1 if varies else _ONE_EXPONENT)


def _nodes(name: str, x: Any, n: Any) -> Any:
    total = x
    for k in range(EVALUATIONS):
        total = total + _lobe(name, x * (0.01 + 0.005 * k), n)
    return total


def _lobe(name: str, u: Any, n: Any) -> Any:
    if name == BARE_POWER:
        return expr.power(1 - u, n)
    return cosine_lobe(expr, name, u, n) if name else u


def _osl(name: str, x: Any, n: Any) -> Any:
    source = with_headers("lobes.osl", _OSL)
    return output(script_node("lobes.osl", source, {"Lobe": name, "X": x, "Exponent": n}), "Sum")
