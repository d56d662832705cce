"""Which filter a table is read with where that is left to the bake: error, bytes and time of a sample, weighed.

A B-spline of fitted coefficients errs less than straight lines between samples, and takes a tenth more time for a
sample (`./run bench speed`). Linear interpolation reaches the same error with more samples: it falls with the square of
their number along an axis, and bytes grow with the cube. So 1.6 times less error is half the bytes, which is what a
tenth of the time is taken to be worth here, and only where the error can be seen at all.

As logarithms (storage "log") coefficients are fitted to the material itself and not to samples, of the same table a
B-spline's error is 0.6 to 1.1 times that of straight lines, whose codes are fitted too, and who stores logarithms asks
for small files: there 1.1 times less error, an eighth of the bytes, is worth that tenth of the time.

With Cycles' own shaders under the measurement it is the rest that is read, and the rest is stored as samples: a
B-spline through them smooths its edges. On metallic paint, a metal and two RGL files it erred 1.01 to 1.7 times as much
as straight lines do, so that those are taken there, and nothing is measured.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ..bundle.checked_json import Fields
from ..source import Facts
from .table import Filter

LEAST_GAIN, LEAST_GAIN_OF_CODES = 1.6, 1.1
# Of the reflected light: less than that is off in no picture.
LEAST_SEEN = 1e-3
_TIME = 1.1


@dataclass(frozen=True)
class FilterChoice:
    """A filter, the RMS in 1/sr of each that was weighed, and why it is taken, in words."""

    filter: Filter
    rms: Mapping[str, float]
    why: str

    def facts(self) -> Facts:
        """JSON-ready."""
        return {"filter": self.filter, "rms": dict(self.rms), "why": self.why}


def weighed(rms: Mapping[str, float], relative: float, least_gain: float = LEAST_GAIN) -> FilterChoice:
    """The filter of a table that is read as a whole.

    Parameters
    ----------
    rms : with "trilinear" and with "bspline"
    relative : error of the former as a share of the reflected light
    least_gain : so many times less has a B-spline to err
    """
    ratio = rms["bspline"] / max(rms["trilinear"], 1e-300)
    found = f"a B-spline errs {ratio:.2g} times as much, at {_TIME:g} times the time of a sample"
    if ratio * least_gain > 1:
        return FilterChoice("trilinear", rms, f"{found}: trilinear")
    if relative < LEAST_SEEN:
        return FilterChoice(
            "trilinear", rms, f"{found}, but only {100 * relative:.2g} % of the light is off: trilinear"
        )
    return FilterChoice("bspline", rms, f"{found}: B-spline")


def unweighed(why: str) -> FilterChoice:
    """Trilinear, for a reason that needs no measurement."""
    return FilterChoice("trilinear", {}, f"{why}: trilinear")


def filter_why_of(document: Fields) -> str:
    """Of a bundle's "filter_choice", why; empty where the filter was named. Raises BakeError."""
    return document.part("filter_choice").text("why") if document.has("filter_choice") else ""
