"""A hard case: inputs, what is computed of them, the truth, and what each implementation may be off by."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from measured_materials.bake import xp_numpy
from measured_materials.nodes import expr

from ..cards import card
from ..osl import header_card
from .formula import xp_float32

Array = np.ndarray
IMPLEMENTATIONS = ("float64", "float32", "nodes", "osl")
# Beyond this a float32 counts as infinite: what is compared on cards has no comparison with infinity.
_HUGE = 3e38


@dataclass(frozen=True)
class Osl:
    """Statements that set `y[0]` to `y[count - 1]` from inputs of these names."""

    body: str
    count: int
    names: tuple[str, ...]
    header: str = "measured_materials.h"


def _difference(found: Array, truth: Array, *inputs: Array) -> Array:
    return np.abs(found - truth)


@dataclass(frozen=True)
class Case:
    """One row of the table.

    Parameters
    ----------
    group, name : of the row
    points : in words, what makes the inputs hard
    unit : of error and bound
    reason : of the bounds
    bounds : largest error allowed, by implementation; one that has none does not exist
    inputs : float32 arrays (P,) or (P, 3)
    truth : float64 (P, K) of the inputs as float64; where it is NaN, a finite value in range is all that is asked for
    formula : (xp, *inputs) to a scalar, vector or tuple of them, in numpy and nodes
    numpy, nodes : (folder, *inputs) to the same, where the two are not one formula
    osl : of a folder for files
    error : (found, truth, *inputs) to errors (P, K), >= 0
    low, high : every value lies between, ends included
    """

    group: str
    name: str
    points: str
    unit: str
    reason: str
    bounds: Mapping[str, float]
    inputs: Callable[[], tuple[Array, ...]]
    truth: Callable[..., Array]
    formula: Callable[..., Any] | None = None
    numpy: Callable[..., Any] | None = None
    nodes: Callable[..., Any] | None = None
    osl: Callable[[Path], Osl] | None = None
    error: Callable[..., Array] = _difference
    low: float = -np.inf
    high: float = np.inf

    def __str__(self) -> str:
        return f"{self.group}: {self.name}"


@dataclass(frozen=True)
class Result:
    """What one implementation made of a case: `worst` error, number of values, and what is wrong at once, or ""."""

    worst: float
    values: int
    fault: str


def measure(case: Case, implementation: str, folder: Path) -> Result:
    """Run one implementation of a case; `folder` takes files that it needs."""
    inputs = case.inputs()
    wide = tuple(i.astype(np.float64) for i in inputs)
    truth = _truth(case, wide)
    found, finite = _found(case, implementation, folder, inputs)
    assert found.shape == truth.shape, (found.shape, truth.shape)
    known = ~np.isnan(truth)
    with np.errstate(invalid="ignore", over="ignore"):
        errors = case.error(found, np.where(known, truth, found), *wide)[known]
    faults = []
    if not finite:
        faults.append("not finite")
    elif (found < case.low).any() or (found > case.high).any():
        faults.append(f"outside [{case.low:g}, {case.high:g}]: {found.min():g} to {found.max():g}")
    worst = float(np.max(errors, initial=0))
    return Result(worst if np.isfinite(worst) else np.inf, found.size, ", ".join(faults))


_truths: dict[str, Array] = {}


def _truth(case: Case, wide: tuple[Array, ...]) -> Array:
    """Forty digits take longer than all implementations together: once for a case."""
    if str(case) not in _truths:
        _truths[str(case)] = np.asarray(case.truth(*wide), np.float64)
    return _truths[str(case)]


def _found(case: Case, implementation: str, folder: Path, inputs: tuple[Array, ...]) -> tuple[Array, bool]:
    """Values (P, K) float64, and whether all are finite."""
    if implementation == "osl":
        assert case.osl
        return _from_osl(case.osl(folder), inputs)
    if implementation == "nodes":
        function = case.nodes or (lambda folder, *values: _formula(case)(expr, *values))
        return _from_nodes(lambda *values: function(folder, *values), inputs)
    dtype = np.float64 if implementation == "float64" else np.float32
    given = tuple(i.astype(dtype) for i in inputs)
    with np.errstate(under="ignore"):
        xp = xp_float32 if implementation == "float32" else xp_numpy
        result = case.numpy(folder, *given) if case.numpy else _formula(case)(xp, *given)
    parts = result if isinstance(result, tuple) else (result,)
    count = len(inputs[0])
    assert all(np.asarray(p).dtype == dtype for p in parts) or case.numpy, "not computed in this precision"
    columns = [np.reshape(np.broadcast_to(p, (count, *np.shape(p)[1:])), (count, -1)) for p in parts]
    found = np.concatenate(columns, -1).astype(np.float64)
    return found, bool(np.isfinite(found).all())


def _formula(case: Case) -> Callable[..., Any]:
    assert case.formula
    return case.formula


def _from_nodes(function: Callable[..., Any], inputs: tuple[Array, ...]) -> tuple[Array, bool]:
    """Scalars travel in threes, and one says whether all are finite: a picture alone might hide what is not."""
    count = 0

    def packed(*values: Any) -> tuple[Any, ...]:
        nonlocal count
        result = function(*values)
        scalars: list[Any] = []
        for part in result if isinstance(result, tuple) else (result,):
            scalars += expr.components(part) if isinstance(part, expr.Vector) else (part,)
        count = len(scalars)
        good: Any = 1.0
        for scalar in scalars:
            good = ((scalar < _HUGE) * (scalar > -_HUGE)) * good
        return _threes([*scalars, good])

    return _unpacked(card(packed, *inputs), count)


def _threes(scalars: list[Any]) -> tuple[Any, ...]:
    padded = scalars + [0.0] * (-len(scalars) % 3)
    return tuple(expr.vec(*padded[k : k + 3]) for k in range(0, len(padded), 3))


def _from_osl(shader: Osl, inputs: tuple[Array, ...]) -> tuple[Array, bool]:
    size = shader.count + 1 + (-(shader.count + 1) % 3)
    vectors = [f"o{k}" for k in range(size // 3)]
    body = f"float y[{size}];\nfor (int k = 0; k < {size}; ++k) y[k] = 0;\n{shader.body}\ny[{shader.count}] = 1;\n"
    body += f"for (int k = 0; k < {shader.count}; ++k) if (!isfinite(y[k])) y[{shader.count}] = 0;\n"
    body += "\n".join(f"{o} = vector(y[{3 * k}], y[{3 * k + 1}], y[{3 * k + 2}]);" for k, o in enumerate(vectors))
    parts = header_card(
        body, dict.fromkeys(vectors, "vector"), shader.header, **dict(zip(shader.names, inputs, strict=True))
    )
    return _unpacked(parts, shader.count)


def _unpacked(parts: list[Array], count: int) -> tuple[Array, bool]:
    values = np.concatenate(parts, -1).astype(np.float64)
    return values[:, :count], bool((values[:, count] == 1).all())
