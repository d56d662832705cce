"""Rows on what a thin sheet lets through."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...bake.brdf.common import AlbedoRecord
from ...bake.brdf.record import BrdfRecord
from ...bake.bundle.checked_json import Fields
from ...bake.source import SHEET_PARTS, luminance
from .brdf_rows import Rows, colour, degrees

_ANGLES = (0, 30, 60, 80)
# Parts of a sheet that a side shows.
_SIDES = ("", "through"), ("behind", "through_behind")
_ENERGY = "above one"


def sheet_rows(record: BrdfRecord) -> Rows:
    """Rows of a bundle; none where it is no sheet."""
    if record.sheet is None:
        return []
    return _rows({"": record.albedo, **{name: part.albedo for name, part in record.sheet.parts.items()}})


def measured_sheet_rows(albedo: AlbedoRecord, sheet: Fields) -> Rows:
    """Rows of what `bake.tables.sheet.sheet_facts` found of a measurement, given the albedo of its front."""
    return _rows({"": albedo, **{name: AlbedoRecord.parse(sheet, name) for name in SHEET_PARTS if sheet.has(name)}})


def sheet_warning(record: BrdfRecord) -> str:
    """One line where more light leaves a side of a sheet than arrives; empty otherwise."""
    told = [f"{name}: {words}" for name, words in sheet_rows(record) if name.endswith(_ENERGY)]
    return f"more light leaves than arrives ({'; '.join(told)})" if told else ""


def _rows(seen: Mapping[str, AlbedoRecord]) -> Rows:
    rows: Rows = []
    for reflection, transmission in _SIDES:
        reflected, through = seen.get(reflection), seen.get(transmission)
        side: Rows = []
        if through is not None:
            name = "Transmittance 0°" if not reflection else "Through 0°"
            side += [(name, colour(through.directional[0])), ("By angle", _by_angle(through))]
        if reflected is not None and reflection:
            side.append(("Albedo 0°", colour(reflected.directional[0])))
        if reflected is not None and through is not None:
            side += above_one(reflected, through)
        rows += [(f"Back: {name[:1].lower()}{name[1:]}", words) for name, words in side] if reflection else side
    return rows


def above_one(reflected: AlbedoRecord, through: AlbedoRecord) -> Rows:
    """A word where more light leaves than arrives."""
    total, above = beyond_one(reflected, through)
    return [(f"R + T {_ENERGY}", f"up to {total:.4g} reflected and let through, at {degrees(above)}")] if above else []


def beyond_one(reflected: AlbedoRecord, through: AlbedoRecord) -> tuple[float, list[float]]:
    """The largest sum of what is reflected and let through, and the angles, common to both, at which more leaves."""
    total = (np.array(reflected.directional) + through.directional).max(-1)
    above = [angle for angle, most in zip(through.theta_o_deg, total, strict=True) if most > 1.001]
    return float(total.max()), above


def _by_angle(found: AlbedoRecord) -> str:
    shown = dict(zip(found.theta_o_deg, found.directional))
    return ", ".join(f"{angle}° {float(luminance(np.array(shown[angle]))):.3g}" for angle in _ANGLES if angle in shown)
