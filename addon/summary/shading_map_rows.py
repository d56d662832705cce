"""A shading map's facts in words: label and value pairs for the terminal and the panel alike."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ...bake.lobes.lobes import Lobe
from ...bake.photographs.stack import FORMAT, PhotoStack
from ...bake.shading_maps.record import ShadingMapRecord
from ...bake.shading_maps.record_parts import MapRecord, PhotographsRecord
from ...bake.shading_maps.shading_map import SAME_LEVEL
from .brdf_rows import Rows, colour
from .sheet_rows import above_one, beyond_one

# The control that scales what is let through.
_TRANSMITTED = "Transmitted"


def photograph_rows(record: ShadingMapRecord) -> Rows:
    """Rows on what was photographed, how it was read and what fixed its scale."""
    return read_rows(record.photographs)


def read_rows(photographs: PhotographsRecord, scale: str = "Strength") -> Rows:
    """Those of photographs, baked or only read; `scale` is the control that scales those without a calibration."""
    averages, files = photographs.averages, photographs.files
    lights = f"{len(averages)} lights"
    if files is not None and files != len(averages):
        lights = f"{files} of {lights}"
    degrees = photographs.elevations_deg
    elevations = f"{min(degrees):.0f}° to {max(degrees):.0f}°" if degrees else "not known"
    rows = [("Photographs", f"{lights}, {level_count(averages)} levels"), ("Elevations", elevations)]
    if photographs.azimuths_deg:
        gaps = _gaps(photographs.azimuths_deg)
        rows.append(("Azimuths", f"all around, at most {max(gaps):.0f}° between neighbours"))
    if photographs.lights is not None:
        rows.append(("Directions", photographs.lights))
    rows += [("Decoded as", words) for words in photographs.decoded_as]
    rows += [("Converted", f"from {what}") for what in photographs.converted_from]
    if photographs.calibration is not None:
        known = photographs.calibrated_by is not None
        rows.append(("Calibration", photographs.calibration if known else f"none, {scale} sets the scale"))
    return rows


def _gaps(degrees: Sequence[float]) -> list[float]:
    """Angles between neighbouring azimuths all around."""
    ordered = sorted(degrees)
    return [after - before for before, after in zip(ordered, [*ordered[1:], ordered[0] + 360], strict=True)]


def level_count(averages: Sequence[float]) -> int:
    """Distinct levels of light among average radiances, as linearisation sees them."""
    count, last = 0, None
    for value in sorted(averages):
        if last is None or value - last > SAME_LEVEL * max(averages):
            count, last = count + 1, value
    return count


def map_rows(record: ShadingMapRecord) -> Rows:
    """Size, model and tiling of the map."""
    stored = record.map
    size = f"{stored.slices} slices of {stored.layout.width} x {stored.layout.height}"
    rows = [("Shading map", size), ("Texels", f"{_model_words(stored)}, {stored.storage}")]
    if (tiling := record.tiling) is not None:
        seams = f"seams {tiling.before:.2g} before, {tiling.after:.2g} now (1: not to be seen)"
        rows.append(("Tileable", f"{tiling.method}, {seams}"))
    return rows


def _model_words(stored: MapRecord) -> str:
    if stored.model == "basis":
        return f"basis of rank {len(stored.curves)}"
    if stored.model == "azimuth":
        return f"light from every side, {stored.azimuths} azimuths, basis of rank {stored.layout.tiles}"
    return {"slices": "slices", "power": "power law"}[stored.model]


def lighting_rows(record: ShadingMapRecord) -> Rows:
    """Rows on how a shading map is lit."""
    settings, albedo = record.render, record.albedo
    rows = [
        ("Base reflection", lobe_words(settings.lobe)),
        ("Strength", _scale_words(record, settings.sigma)),
        ("Brightest", f"r = {albedo.a_max:.4g} 1/sr, beyond it {settings.above}"),
    ]
    rows.append(("Technique", f"{settings.technique.replace('_', ' ')}, {settings.mode}, {settings.tiling}"))
    return rows + _fit_rows(record)


def _scale_words(record: ShadingMapRecord, given: float | None) -> str:
    """The factor of the base, and what set it where it was not given."""
    usual = "by default" if record.map.a_max is None else "as calibrated"
    if record.render.a_max is not None:
        usual = "by the brightest"
    return f"{record.albedo.sigma:.4g}" + (f", {usual}" if given is None else "")


def lobe_words(lobe: Lobe | None) -> str:
    """Name and parameters of a lobe; None is a measured BRDF."""
    if lobe is None:
        return "measured BRDF"
    name, *parameters = (f"{key} {value:.4g}" if key != "name" else str(value) for key, value in lobe.facts().items())
    return ", ".join([name.replace("_", " "), *parameters])


def _fit_rows(record: ShadingMapRecord) -> Rows:
    """Which lobe the averages along the arc ask for."""
    fit = record.lobe_fit
    return [("Fits best", f"{lobe_words(fit.lobe)}, {_percent(fit.residual)} left")] if fit else []


def energy_rows(record: ShadingMapRecord) -> Rows:
    """Shares of the reflected light that the native closure and the stochastic mirror carry."""
    envelope, residual = record.map.envelope_energy, record.map.residual_energy
    return [("Cycles' shaders", f"{_percent(envelope)} of the light"), ("Mirror part", _percent(residual))]


def map_error_rows(record: ShadingMapRecord) -> Rows:
    """Errors at photographs that were left out, and of the storage."""
    errors = record.errors
    rows: Rows = []
    if errors.held_out_relative is not None:
        told = f"{_percent(errors.held_out_relative)} median of {errors.held_out} photographs"
        rows.append(("Left-out error", f"{told}, RMS {errors.held_out_rms:.3g}"))
    else:
        rows.append(("Left-out error", "too few photographs to leave one out"))
    share = _percent(errors.storage_rms / max(errors.signal_rms, 1e-30))
    storage = f"{errors.storage_rms:.2g} of the brightest ({share})"
    return [*rows, ("Storage RMS", storage)]


def all_warnings(record: ShadingMapRecord) -> tuple[str, ...]:
    """What is doubtful about the photographs, those against the light included."""
    behind = () if record.through is None else record.through.photographs.warnings
    return *record.photographs.warnings, *(f"against the light: {text}" for text in behind)


def warning_rows(record: ShadingMapRecord) -> Rows:
    """Rows of warnings about the photographs."""
    return doubt_rows(record.photographs)


def doubt_rows(photographs: PhotographsRecord) -> Rows:
    """What is doubtful about photographs, baked or only read."""
    return [("Warning" if k == 0 else "", text) for k, text in enumerate(photographs.warnings)]


def through_rows(record: ShadingMapRecord) -> Rows:
    """Rows on the map of light that is let through; none of what was not photographed against the light."""
    through = record.through
    if through is None:
        return []
    albedo, fitted = through.albedo, through.render
    held_out = through.errors.held_out_relative
    rows = [
        *read_rows(through.photographs, _TRANSMITTED),
        ("Transmittance 0°", colour(albedo.directional[0])),
        ("Base transmission", lobe_words(fitted.lobe)),
        (_TRANSMITTED, _scale_words(through, record.render.transmission_sigma)),
        ("Cycles' shaders", f"{_percent(through.map.envelope_energy)} of the light"),
        ("Left-out error", "unknown" if held_out is None else f"{_percent(held_out)} median"),
        *doubt_rows(through.photographs),
    ]
    told = [(f"Through: {name[:1].lower()}{name[1:]}" if name else name, words) for name, words in rows]
    return told + above_one(record.albedo, albedo)


def albedo_warning(record: ShadingMapRecord) -> str:
    """One line where more light leaves than arrives; empty otherwise."""
    albedo, calibrated = record.albedo, record.map.a_max is not None
    if record.through is not None and not albedo.above_one_deg:
        total, angles = beyond_one(albedo, record.through.albedo)
        told = f"up to {total:.3g} is reflected and let through: more light leaves than arrives"
        remedies = dict.fromkeys((_remedy(record, "--sigma"), _remedy(record.through, "--transmission-sigma")))
        return f"{told}; {', or '.join(remedies)}" if angles else ""
    if not albedo.above_one_deg:
        return ""
    sigma = albedo.sigma / max(albedo.largest, 1e-9)
    remedy = "check the white card" if calibrated else f"state --albedo, or choose --sigma {sigma:.2g}"
    if calibrated and record.photographs.calibrated_by == "albedo":
        remedy = "state a lower --albedo, or another --lobe"
    return f"the albedo reaches {albedo.largest:.3g} in a channel: more light leaves than arrives; {remedy}"


def _remedy(record: ShadingMapRecord, option: str) -> str:
    """What makes a map darker, by what its scale is from; `option` is that of its factor."""
    by = record.photographs.calibrated_by
    if by is None:
        return f"choose a lower {option}"
    return f"check the {by}" if by in ("white card", "diffuser") else f"state a lower --{by}"


def arc_summary(record: ShadingMapRecord, seconds: float) -> str:
    """One line on a shading map just baked."""
    photographs, stored, held_out = record.photographs, record.map, record.errors.held_out_relative
    parts = [
        f"{len(photographs.averages)} photographs",
        f"{level_count(photographs.averages)} levels",
        f"{stored.slices} slices of {stored.layout.width} x {stored.layout.height}",
        f"Cycles' shaders {_percent(stored.envelope_energy)} of the light",
        "left-out error " + ("unknown" if held_out is None else _percent(held_out)),
        f"albedo {colour(record.albedo.directional[0])}",
        *([f"transmittance {colour(record.through.albedo.directional[0])}"] if record.through is not None else []),
        *(f"colours converted from {what}" for what in photographs.converted_from),
        f"{seconds:.1f} s",
    ]
    return f"{record.files().path}: {', '.join(parts)}"


def stack_document(stack: PhotoStack, name: str) -> dict[str, Any]:
    """JSON-ready account of photographs read but not baked, with the parts of a bundle's facts that there are."""
    averages = stack.images.mean(axis=(1, 2, 3), dtype="float64")
    order = averages.argsort(kind="stable")
    return {
        "source": {"name": name, "facts": {"format": FORMAT, **stack.facts}},
        "averages": stack.in_order(averages, order),
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
