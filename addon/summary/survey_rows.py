"""What `inspect` tells of a measurement's symmetry, gaps, and of how well it predicts itself, in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...bake.inspection.readings import READINGS
from ...bake.inspection.survey import RECIPROCAL
from ...bake.reading import Reading
from .brdf_rows import Rows

_UNKNOWN = "not told by this format"
_LIGHT = {
    "measured": "measured, the light is the file's incident direction",
    "exchanged": "exchanged, the light is the file's outgoing direction",
    "mean": "mean of both directions",
}


def survey_rows(survey: Mapping[str, Any], held_out: Mapping[str, Any] | None, reading: Reading) -> Rows:
    """Rows of `bake.inspection.survey.survey` and of `bake.inspection.readings.held_out`.

    Parameters
    ----------
    reading : that the measurement was read by
    """
    reciprocity = survey["reciprocity"]
    symmetric = reciprocity["rms"] <= RECIPROCAL
    words = f"{_percent(reciprocity['rms'])} RMS and {_percent(reciprocity['median'])} in the median"
    rows = [
        (
            "Reciprocity",
            "light and viewer may change places" if symmetric else f"exchanging light and viewer changes {words}",
        ),
        ("Negative", _percent(survey["negative_share"])),
        ("Invalid", _known(survey["invalid_share"])),
        ("Extrapolated", _known(survey["extrapolated_share"])),
    ]
    return rows + _held_out_rows(held_out, reading)


def _held_out_rows(held_out: Mapping[str, Any] | None, reading: Reading) -> Rows:
    """The error at what was left out, of each reading where they differ, and why the usual one is taken."""
    if held_out is None:
        return [("Left-out error", _UNKNOWN)]
    errors = {name: float(held_out[name]) for name in READINGS}
    if len(set(errors.values())) == 1:
        return [("Left-out error", f"{_percent(errors['measured'])}, {held_out['how']}; all readings are one")]
    told = ", ".join(f"{name} {_percent(error)}" for name, error in errors.items())
    best = min(errors, key=errors.__getitem__)
    verdict = _LIGHT[reading.reciprocity] + ("" if reading.reciprocity == best else f"; {best} errs least")
    return [("Left-out error", f"{told}, {held_out['how']}"), ("Read as", verdict)]


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %"


def _known(share: float | None) -> str:
    return _UNKNOWN if share is None else _percent(share)
