"""Hard cases: the 8-bit codes of storage log, decoded."""

from __future__ import annotations

from functools import partial
from typing import Any

import mpmath as mp
import numpy as np
from measured_materials.bake.tables.log_codes import LEAST_PEAK, LEAST_RANGE, MOST_PEAK, MOST_RANGE, LogCodes

from .case import Array, Case, Osl
from .truth import each

# By channel: the narrowest range, a usual one and the widest; the faintest peak, a highlight and the brightest.
_RANGES = np.array([LEAST_RANGE, 6.0, MOST_RANGE])
_SETS = {"faint": np.full(3, LEAST_PEAK), "usual": np.array([0.3, 1e4, 1.0]), "bright": np.full(3, MOST_PEAK)}


def cases() -> list[Case]:
    """Of this module."""
    return [_case(name, LogCodes.reaching(peaks, _RANGES)) for name, peaks in _SETS.items()]


def _inputs() -> tuple[Array, ...]:
    """Every byte, and what the filter makes between two."""
    codes = np.concatenate([np.arange(256) / 255, (np.arange(255) + 0.37) / 255, [1e-45, 1e-9, 1e-6, 1e-4]])
    return (np.repeat(codes[:, None], 3, -1).astype(np.float32),)


def _truth(codes: LogCodes, code: list[Any]) -> tuple[Any, ...]:
    return tuple(mp.mpf(g) * mp.expm1(mp.mpf(r) * c) for g, r, c in zip(codes.gains, codes.ranges, code, strict=True))


def _case(name: str, codes: LogCodes) -> Case:
    step = np.array(codes.gains) * np.expm1(_RANGES / 255)

    def decode(xp: Any, code: Any) -> Any:
        return codes.decode(xp, code)

    ranges, gains = ("vector({}, {}, {})".format(*values) for values in (codes.ranges, codes.gains))
    body = f"color c = mm_decode(code, {ranges}, {gains}); for (int k = 0; k < 3; ++k) y[k] = c[k];"
    return Case(
        "storages",
        f"log codes, {name}",
        "every byte, between two, 1e-45 to 1e-4; ranges 1, 6 and 24; peaks of 1e-24, 0.3 to 1e4, 1e37",
        "of the value, or of the first step",
        "exp(x) - 1 rounded beside 1 is 1.5e-5 of the first step of range 1",
        {"float64": 1e-12, "float32": 5e-5, "nodes": 5e-5, "osl": 5e-5},
        _inputs,
        each(partial(_truth, codes)),
        formula=decode,
        osl=lambda folder: Osl(body, 3, ("code",)),
        error=lambda found, true, code: np.abs(found - true) / np.maximum(true, step),
        low=0,
    )
