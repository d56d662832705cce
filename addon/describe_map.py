"""A shading map's facts in words: label and value pairs for the terminal and the panel alike."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..bake.bundle import require
from ..bake.material_json import Fields
from ..bake.shading.lobes import Lobe
from ..bake.shading.map_facts import MODELS
from ..bake.shading.record_parts import render_settings_of
from ..bake.shading.shading_map import SAME_LEVEL
from .describe import Rows, colour

_MODEL_WORDS = {"slices": "slices", "power": "power law", "basis": "basis"}


def photograph_rows(facts: Mapping[str, Any], where: str | Path) -> Rows:
    """What was photographed, how it was read and what fixed its scale. Raises BakeError, as all here do.

    `facts`, which may be anybody's, are those of a bundle or of `stack_document`.
    """
    averages = require(facts, "averages", dict, where)
    before = _numbers(averages, "before", where)
    files = _about(facts, where).get("photographs")
    lights = f"{len(before)} lights"
    if isinstance(files, int) and files != len(before):
        lights = f"{files} of {lights}"
    rows = [("Photographs", f"{lights}, {level_count(before)} levels"), ("Elevations", _elevations(averages))]
    about = _about(facts, where)
    source = about.get("lights")
    if isinstance(source, dict) and isinstance(source.get("source"), str):
        rows.append(("Directions", source["source"]))
    decoding = about.get("decoding")
    if isinstance(decoding, dict) and isinstance(decoding.get("used"), list):
        used = [use for use in decoding["used"] if use]
        rows += [("Decoded as", f"{use.get('rule')}: {use.get('why')}") for use in used]
        rows += [("Converted", f"from {what}") for what in _converted(about)]
    calibration = about.get("calibration")
    if isinstance(calibration, dict):
        how = str(calibration.get("how", "?"))
        rows.append(("Calibration", how if calibration.get("by") else "none, sigma sets the scale"))
    return rows


def _about(facts: Mapping[str, Any], where: str | Path) -> dict[str, Any]:
    about = require(facts, "source", dict, where).get("facts")
    return about if isinstance(about, dict) else {}


def _converted(about: Mapping[str, Any]) -> list[str]:
    """What the colours of the photographs were converted from and to."""
    decoding = about.get("decoding")
    used = decoding.get("used") if isinstance(decoding, dict) else None
    found = [use.get("converted") for use in used if isinstance(use, dict)] if isinstance(used, list) else []
    return list(dict.fromkeys(str(what) for what in found if what))


def _elevations(averages: Mapping[str, Any]) -> str:
    degrees = averages.get("elevations_deg")
    known = [value for value in degrees if isinstance(value, int | float)] if isinstance(degrees, list) else []
    return f"{min(known):.0f}° to {max(known):.0f}°" if known else "not known"


def level_count(averages: Sequence[float]) -> int:
    """Distinct levels of light among average radiances, as linearisation sees them."""
    count, last = 0, None
    for value in sorted(averages):
        if last is None or value - last > SAME_LEVEL * max(averages):
            count, last = count + 1, value
    return count


def map_rows(facts: Mapping[str, Any], where: str | Path) -> Rows:
    """Size, model and tiling of the map."""
    map_facts = require(facts, "map", dict, where)
    slices, width, height = (require(map_facts, key, int, where, minimum=1) for key in ("slices", "width", "height"))
    model = require(map_facts, "model", str, where, choices=MODELS)
    storage = require(map_facts, "storage", str, where)
    words = _MODEL_WORDS[model]
    if model == "basis":
        words = f"basis of rank {len(require(map_facts, 'curves', list, where, minimum=1))}"
    rows = [("Shading map", f"{slices} slices of {width} x {height}"), ("Texels", f"{words}, {storage}")]
    if isinstance(facts.get("tiling"), dict):
        rows.append(("Tileable", _tiling(facts["tiling"], where)))
    return rows


def _tiling(tiling: Mapping[str, Any], where: str | Path) -> str:
    seams = require(tiling, "seams", dict, where)
    before, after = (
        require(require(seams, key, dict, where), "visibility", float, where) for key in ("before", "after")
    )
    return f"{require(tiling, 'method', str, where)}, seams {before:.2g} before, {after:.2g} now (1: not to be seen)"


def lighting_rows(facts: Mapping[str, Any], where: str | Path) -> Rows:
    """How the map is lit."""
    settings = render_settings_of(Fields(facts, where).part("render"))
    albedo = require(facts, "albedo", dict, where)
    sigma, a_max = (require(albedo, key, float, where) for key in ("sigma", "a_max"))
    rows = [
        ("f_r", lobe_words(settings.lobe)),
        ("Sigma", f"{sigma:.4g}" + (", by default" if settings.sigma is None else "")),
        ("Brightest", f"r = {a_max:.4g} 1/sr, beyond it {settings.above}"),
    ]
    rows.append(("Technique", f"{settings.technique.replace('_', ' ')}, {settings.mode}, {settings.tiling}"))
    return rows + _fit_rows(facts, where)


def lobe_words(lobe: Lobe | None) -> str:
    """Name and parameters of a lobe; None is a measured BRDF."""
    if lobe is None:
        return "measured BRDF"
    name, *parameters = (f"{key} {value:.4g}" if key != "name" else str(value) for key, value in lobe.facts().items())
    return ", ".join([name.replace("_", " "), *parameters])


def _fit_rows(facts: Mapping[str, Any], where: str | Path) -> Rows:
    """Which lobe the averages along the arc ask for."""
    if not isinstance(facts.get("lobe_fit"), dict):
        return []
    fit = require(facts, "lobe_fit", dict, where)
    lobe = require(fit, "lobe", dict, where)
    parameters = [f"{key} {value:.4g}" for key, value in lobe.items() if isinstance(value, int | float)]
    words = ", ".join([str(lobe.get("name", "?")).replace("_", " "), *parameters])
    return [("Fits best", f"{words}, {_percent(require(fit, 'residual', float, where))} left")]


def energy_rows(facts: Mapping[str, Any], where: str | Path) -> Rows:
    """Shares of the reflected light that the native closure and the stochastic mirror carry."""
    map_facts = require(facts, "map", dict, where)
    envelope, residual = (
        require(map_facts, key, float, where, minimum=0, maximum=1) for key in ("envelope_energy", "residual_energy")
    )
    return [("Envelope", f"{_percent(envelope)} of the light"), ("Residual", _percent(residual))]


def map_error_rows(facts: Mapping[str, Any], where: str | Path) -> Rows:
    """Errors at photographs that were left out, and of the storage."""
    errors = require(facts, "errors", dict, where)
    storage, signal = (require(errors, key, float, where, minimum=0) for key in ("storage_rms", "signal_rms"))
    rows: Rows = []
    if errors.get("held_out_relative") is not None:
        relative, rms = (require(errors, f"held_out_{key}", float, where) for key in ("relative", "rms"))
        count = len(require(errors, "held_out", list, where))
        rows.append(("Held-out", f"{_percent(relative)} median of {count} photographs, RMS {rms:.3g}"))
    else:
        rows.append(("Held-out", "too few photographs to leave one out"))
    return [*rows, ("Storage RMS", f"{storage:.2g} of a_max ({_percent(storage / max(signal, 1e-30))})")]


def warning_rows(facts: Mapping[str, Any], where: str | Path) -> Rows:
    """What is doubtful about the photographs."""
    warnings = facts.get("warnings")
    told = [text for text in warnings if isinstance(text, str)] if isinstance(warnings, list) else []
    return [("Warning" if k == 0 else "", text) for k, text in enumerate(told)]


def albedo_warning(facts: Mapping[str, Any], where: str | Path) -> str:
    """One line where more light leaves than arrives; empty otherwise."""
    albedo = require(facts, "albedo", dict, where)
    if not albedo.get("above_one_deg"):
        return ""
    largest = require(albedo, "largest", float, where)
    a_max = require(facts, "map", dict, where).get("a_max")
    sigma = require(albedo, "sigma", float, where) / max(largest, 1e-9)
    remedy = "check the white card" if a_max is not None else f"state --albedo, or choose --sigma {sigma:.2g}"
    if a_max is not None and _about(facts, where).get("calibration", {}).get("by") == "albedo":
        remedy = "state a lower --albedo, or another --lobe"
    return f"the albedo reaches {largest:.3g} in a channel: more light leaves than arrives; {remedy}"


def arc_summary(path: Path, facts: Mapping[str, Any], seconds: float) -> str:
    """One line on a shading map just baked."""
    before = _numbers(require(facts, "averages", dict, path), "before", path)
    map_facts, errors = require(facts, "map", dict, path), require(facts, "errors", dict, path)
    held_out = errors.get("held_out_relative")
    albedo = require(require(facts, "albedo", dict, path), "directional", list, path, minimum=1)[0]
    parts = [
        f"{len(before)} photographs",
        f"{level_count(before)} levels",
        f"{map_facts['slices']} slices of {map_facts['width']} x {map_facts['height']}",
        f"envelope {_percent(map_facts['envelope_energy'])} of the energy",
        "held-out error " + ("unknown" if held_out is None else _percent(held_out)),
        f"albedo {colour(albedo)}",
        *(f"colours converted from {what}" for what in _converted(_about(facts, path))),
        f"{seconds:.1f} s",
    ]
    return f"{path}: {', '.join(parts)}"


def stack_document(stack: Any, name: str) -> dict[str, Any]:
    """JSON-ready account of photographs read but not baked, with the parts of a bundle's facts that there are."""
    averages = stack.images.mean(axis=(1, 2, 3), dtype="float64")
    order = averages.argsort(kind="stable")
    elevations = None
    if stack.directions is not None:
        elevations = np.degrees(np.arcsin(np.clip(stack.directions[order, 2], -1, 1))).round(3).tolist()
    return {
        "source": {"name": name, "facts": {"format": "photographs on a light arc", **stack.facts}},
        "averages": {
            "photographs": [stack.names[k] for k in order],
            "elevations_deg": elevations,
            "before": averages[order].tolist(),
        },
        "clipped_share": [stack.facts["clipped_share"][k] for k in order],
        "width": int(stack.images.shape[2]),
        "height": int(stack.images.shape[1]),
        "warnings": list(stack.warnings),
    }


def stack_lines(document: Mapping[str, Any]) -> list[str]:
    """A table of photographs from dark to bright."""
    averages = document["averages"]
    names, levels = averages["photographs"], averages["before"]
    elevations = averages["elevations_deg"] or [None] * len(names)
    width = min(max(map(len, names)), 48)
    width = max(width, 10)
    lines = [f"{'photograph':{width}s}  elevation   average  of brightest  clipped"]
    for name, elevation, level, clipped in zip(names, elevations, levels, document["clipped_share"]):
        angle = "        ?" if elevation is None else f"{elevation:8.1f}°"
        share = 100 * level / max(levels[-1], 1e-30)
        lines.append(f"{name[:width]:{width}s}  {angle} {level:9.4g} {share:11.1f} % {100 * clipped:6.1f} %")
    return lines


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %"


def _numbers(facts: Mapping[str, Any], key: str, where: str | Path) -> list[float]:
    values = require(facts, key, list, where, minimum=1)
    return [float(value) for value in values if isinstance(value, int | float)] or [0.0]
