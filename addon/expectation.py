"""What a mode and a filter will cost, and how far they are from the measurement, before anything is rendered."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

# Processor time of a camera sample, Principled BSDF = 1: median over 12 materials in 4 lightings
# (`./run bench engine`), and of the filters beside trilinear (`./run bench speed`).
MODE_TIME = {"preview": 1.1, "balanced": 1.5, "exact": 1.5, "reference": 2.2}
FILTER_TIME = {"nearest": 0.97, "trilinear": 1.0, "bspline": 1.05}


def expectation(facts: Mapping[str, Any], mode: str, filter: str) -> str:
    """Words on time and error of a measured BRDF's material; without the error where the bundle does not tell it.

    Parameters
    ----------
    facts : the bundle's, as kept with the material; may come from anywhere
    mode : of `bake.modes.MODES`
    filter : of `bake.tables.table.FILTERS`
    """
    traced = mode != "preview"
    factor = MODE_TIME.get(mode, 1.0) * (FILTER_TIME.get(filter, 1.0) if traced else 1.0)
    words = f"About {factor:.1f} times the render time of a Principled BSDF"
    error = _error(facts, mode, filter)
    if error is None:
        return words
    kind = "off from the measurement, relative" if mode == "preview" else "of the reflected light off"
    return f"{words}; {100 * error:.2g} % {kind}"


def _error(facts: Mapping[str, Any], mode: str, filter: str) -> float | None:
    """Energy-relative error that the bake measured for this mode, scaled to the filter by its RMS."""
    if mode == "preview":
        return _number(facts, "preview", "error")
    path = (
        ("errors", "relative") if mode == "reference" else ("residual", "errors", "envelope_and_residual", "relative")
    )
    found = _number(facts, *path)
    baked, other = (_number(facts, "rms_by_filter", name) for name in (_filter(facts), filter))
    if found is None or not baked or other is None or mode != "reference":
        return found
    return found * other / baked


def _filter(facts: Mapping[str, Any]) -> str:
    table = facts.get("table")
    return str(table.get("filter")) if isinstance(table, Mapping) else ""


def _number(facts: Mapping[str, Any], *path: str) -> float | None:
    found: Any = facts
    for key in path:
        if not isinstance(found, Mapping):
            return None
        found = found.get(key)
    return float(found) if isinstance(found, int | float) and not isinstance(found, bool) else None
