"""Rows on what a thin sheet lets through."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...bake.source import luminance
from .brdf_rows import Rows, colour, degrees

_ANGLES = (0, 30, 60, 80)
_SIDES = (("front", "through", ""), ("behind", "through_behind", " from behind"))


def sheet_rows(facts: Mapping[str, Any]) -> Rows:
    """Rows of what `bake.tables.sheet.sheet_facts` found."""
    rows: Rows = []
    for side, through, words in _SIDES:
        if side not in facts["energy"]:
            continue
        found, energy = facts[through], facts["energy"][side]
        rows.append((f"Transmittance 0°{words}", colour(found["directional"][0])))
        rows.append((f"By angle{words}", _by_angle(found)))
        if side in facts:
            rows.append((f"Albedo 0°{words}", colour(facts[side]["directional"][0])))
        if energy["above_one_deg"]:
            told = f"up to {energy['largest']:.4g} reflected and let through, at {degrees(energy['above_one_deg'])}"
            rows.append((f"Above one{words}", told))
    return rows


def _by_angle(found: Mapping[str, Any]) -> str:
    shown = dict(zip(found["theta_o_deg"], found["directional"]))
    return ", ".join(f"{angle}° {float(luminance(np.array(shown[angle]))):.3g}" for angle in _ANGLES if angle in shown)
