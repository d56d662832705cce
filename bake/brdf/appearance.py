"""How different a bundle looks from its measurement: the sphere of its preview picture, drawn from both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..bundle.checked_json import Fields
from ..color_difference import ciede2000, lab_of
from ..source import Array, BrdfSource, Facts
from .preview_sphere import Reflects, exposure, lit_sphere

# Sixteen hundred pixels know a median to a hundredth of what anyone sees; four-dimensional tables take longer each.
_SIZE, _ANISOTROPIC_SIZE = 48, 32
_MOST = 1e3


@dataclass(frozen=True)
class Together:
    """The sum of parts."""

    parts: tuple[Reflects, ...]

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """BRDF (..., 3) in 1/sr."""
        total: Array = np.sum([part.evaluate(wi, wo) for part in self.parts], 0)
        return total


def color_differences(source: BrdfSource, shown: Mapping[str, Reflects]) -> Facts:
    """Of each that is shown, "median" and "p95" of CIEDE2000 over the pixels of a sphere; JSON-ready.

    A lamp and a ring of dim lights, which are points, so that both pictures are exact; exposed as the source asks for,
    and cut off at a display's white.
    """
    size = _SIZE if source.isotropic else _ANISOTROPIC_SIZE
    light = lit_sphere(source, size)[1]
    exposed = exposure(light)
    truth = _seen(light * exposed)
    found: dict[str, Facts] = {}
    for name, one in shown.items():
        difference = ciede2000(truth, _seen(lit_sphere(one, size)[1] * exposed))
        median, high = np.quantile(difference, (0.5, 0.95))
        found[name] = {"median": round(float(median), 4), "p95": round(float(high), 4)}
    return found


def _seen(linear: Array) -> Array:
    return lab_of(np.clip(linear, 0, 1))


@dataclass(frozen=True)
class ColorDifferenceRecord:
    """CIEDE2000 of a sphere's pixels: half of them, and 95 of 100, differ by no more."""

    median: float
    p95: float

    @classmethod
    def parse(cls, fields: Fields) -> ColorDifferenceRecord:
        """Read from an entry of `color_differences`. Raises BakeError."""
        return cls(fields.number("median", 0, _MOST), fields.number("p95", 0, _MOST))


def color_differences_of(document: Fields) -> Mapping[str, ColorDifferenceRecord]:
    """Of a bundle's "color_difference", by what is shown; empty in older bundles. Raises BakeError."""
    if not document.has("color_difference"):
        return {}
    fields = document.part("color_difference")
    return {name: ColorDifferenceRecord.parse(fields.part(name)) for name in fields.entries}
