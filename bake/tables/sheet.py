"""A thin sheet seen from one side: each of its parts as a BRDF, so that whatever serves reflection serves it too."""

from __future__ import annotations

import numpy as np

from ..patches import patches_of
from ..source import SHEET_PARTS, Array, Facts, SheetPart, SheetSource
from .albedo import albedo_facts

_OTHER_SIDE = np.array([1.0, 1.0, -1.0])
# Turned about the tangent, as a renderer turns the frame of a back: it keeps the tangent and flips the normal.
_TURNED = np.array([1.0, -1.0, -1.0])


class SheetView:
    """A `BrdfSource` of one part of a sheet, both directions above the horizon.

    wo is the viewer in the frame of its own side. Light from the far side is mirrored in the sheet's plane: what goes
    straight on has the mirror direction's place.
    """

    def __init__(self, sheet: SheetSource, part: SheetPart) -> None:
        self._sheet, self._part = sheet, part
        self.name = f"{sheet.name} {part.replace('_', ' ')}"
        self.isotropic, self.bilateral = sheet.isotropic, sheet.bilateral
        self.facts: Facts = {}
        # Neither the mirrored light's nor the turned frame's patches are others.
        self.patches = patches_of(sheet)

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """BRDF or mirrored BTDF in 1/sr; see `BrdfSource.evaluate`."""
        if self._part == "behind":
            seen = self._sheet.reflected_behind(wi * _TURNED, wo * _TURNED)
        elif self._part == "through":
            seen = self._sheet.transmitted(wi * _OTHER_SIDE, wo)
        else:
            seen = self._sheet.transmitted(wi * (_OTHER_SIDE * _TURNED), wo * _TURNED)
        above = (wi[..., 2:] > 0) & (wo[..., 2:] > 0)
        return np.where(above, seen, 0)


def sheet_views(sheet: SheetSource) -> dict[SheetPart, SheetView]:
    """The parts beside the front's reflection; of a sheet whose sides are alike only "through"."""
    return {part: SheetView(sheet, part) for part in (SHEET_PARTS[:1] if sheet.alike else SHEET_PARTS)}


def side_energy(*seen: Facts) -> Facts:
    """What leaves towards a viewer of one side, under a white sky on both.

    Parameters
    ----------
    seen : as `bake.tables.albedo.albedo_facts` or its kin made them of all parts seen there

    Returns
    -------
    dict with "largest", of the sum in a channel, and "above_one_deg", the angles at which more leaves than arrives;
    JSON-ready
    """
    rows = [np.array(part["directional"]) for part in seen]
    total = np.sum(rows, 0)
    degrees = np.array(seen[0]["theta_o_deg"])
    return {
        "largest": round(float(total.max()), 6),
        "above_one_deg": degrees[total.max(-1) > 1.001].tolist(),
    }


def sheet_facts(sheet: SheetSource, albedo: Facts) -> Facts:
    """Transmittance and albedo of the parts by angle, and the energy of each side, given the front's; JSON-ready."""
    found: dict[str, Facts] = {part: albedo_facts(view) for part, view in sheet_views(sheet).items()}
    energy = {"front": side_energy(albedo, found["through"])}
    if not sheet.alike:
        energy["behind"] = side_energy(found["behind"], found["through_behind"])
    return {**found, "energy": energy}
