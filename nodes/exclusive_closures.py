"""Mirrors and native closures of a sheet: exclusive, so that every sample is worth about the same, or all of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from . import expr
from .drawn_direction import DrawnDirection
from .native_closure import add_closures, choose_closure


def one_of(drawn: Sequence[tuple[DrawnDirection, Any, Any]], native: Sequence[Callable[[Any], Any]]) -> Any:
    """One of the mirrors, each with its probability, or else all native closures."""
    if not drawn:
        return add_closures([closure(1.0) for closure in native])
    random, upto = drawn[0][0].random[1], [drawn[0][1]]
    for _, chance, _ in drawn[1:]:
        upto.append(upto[-1] + chance)
    if native:
        left = expr.divide(1.0, 1 - upto[-1])
        chosen = add_closures([closure(left) for closure in native])
    else:
        chosen, drawn, upto = drawn[-1][2], drawn[:-1], upto[:-1]
    for (_, _, mirror), limit in reversed(list(zip(drawn, upto, strict=True))):
        chosen = choose_closure(random < limit, chosen, mirror)
    return chosen


def all_of(drawn: Sequence[tuple[DrawnDirection, Any, Any]], native: Sequence[Callable[[Any], Any]]) -> Any:
    """All mirrors, each drawn with probability 1, and all native closures, between which Cycles chooses.

    It does so by numbers that are spread more evenly than White Noise, for the time of all mirrors. That pays where
    what a sheet reflects and what it lets through are lit as differently as by sky and ground. Not where mirrors are
    aimed at lamps: the smaller the lamp, the smaller the weight of its mirror, by which Cycles chooses.
    """
    return add_closures([*(mirror for _, _, mirror in drawn), *(closure(1.0) for closure in native)])
