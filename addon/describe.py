"""A bundle's or a measurement's facts in words: label and value pairs for the terminal and the panel alike."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..bake.bundle import require
from ..bake.source import BrdfSource
from ..bake.storage import IMAGE_STORAGES, Storage

Rows = list[tuple[str, str]]


def source_rows(facts: Mapping[str, Any], where: str | Path) -> Rows:
    """Where a bundle came from. Raises BakeError where `facts`, which may be anybody's, are not a bundle's."""
    source = require(facts, "source", dict, where)
    name = require(source, "name", str, where)
    about = source.get("facts")
    kind = about.get("format") if isinstance(about, dict) else None
    return [("Source", name)] + ([("Format", kind)] if isinstance(kind, str) else [])


def table_rows(facts: Mapping[str, Any], where: str | Path) -> Rows:
    """Size, basis, parameterisation and filter of the table, and what else could have been chosen."""
    table = require(facts, "table", dict, where)
    if table.get("anisotropic") is True:
        return _anisotropic_rows(table, where)
    kind, basis = (require(table, key, str, where) for key in ("parameterization", "basis"))
    words = (require(table, key, str, where) for key in ("filter", "storage"))
    rows = [("Table", f"{_table_size(table, where)}, {basis} basis, {kind}"), ("Texels", ", ".join(words))]
    if kind == "bezier" and basis == "normal":
        theta, phi = (require(table, f"alpha_{g}", float, where) for g in ("theta", "phi"))
        rows.append(("Alpha", f"theta {theta:.4g}, phi {phi:.4g}"))
        rows += _search_rows(facts, where)
    elif kind == "bezier":
        alphas = require(table, "alphas", list, where, minimum=3, maximum=3)
        rows.append(("Alpha", f"theta_d, theta_h, phi_d {_plain(alphas)}"))
    return rows + _choice_rows(facts, where)


def _table_size(table: Mapping[str, Any], where: str | Path) -> str:
    if require(table, "basis", str, where) == "normal":
        n = require(table, "n", int, where, minimum=1, maximum=1 << 16)
        return f"{n} x {n} x {2 * n}"
    return " x ".join(_plain(n) for n in require(table, "sizes", list, where, minimum=3, maximum=3))


def _choice_rows(facts: Mapping[str, Any], where: str | Path) -> Rows:
    """The best of the candidates that were not taken, of each basis and parameterisation."""
    if not isinstance(facts.get("choice"), dict):
        return []
    candidates = require(require(facts, "choice", dict, where), "candidates", list, where, minimum=1, maximum=100)
    found = [
        (*(require(candidate, key, str, where) for key in ("basis", "parameterization")), candidate)
        for candidate in candidates
    ]
    least = max(require(found[0][2], "rms", float, where), 1e-30)
    rivals = dict.fromkeys((basis, kind) for basis, kind, _ in found)
    rivals.pop(found[0][:2])
    words = []
    for name in rivals:
        rms = min(require(c, "rms", float, where) for *other, c in found if tuple(other) == name)
        words.append(f"{' '.join(name)} {rms / least:.3g} x")
    return [("Others' error", ", ".join(words))] if words else []


def _anisotropic_rows(table: Mapping[str, Any], where: str | Path) -> Rows:
    """Of a four-dimensional table: basis, sizes, and what its shape was fitted to."""
    basis = require(table, "basis", str, where, choices=("half", "normal"))
    sizes = " x ".join(str(n) for n in require(table, "shape", list, where, minimum=4)[:4])
    words = (require(table, key, str, where) for key in ("filter", "storage"))
    rows = [("Table", f"{sizes}, anisotropic, {basis}-vector basis"), ("Texels", ", ".join(words))]
    if basis == "half":
        x, y = (require(table, f"width_{k}", float, where) for k in "xy")
        return [*rows, ("Spacing", f"half of it within slopes of {x:.3g} along the tangent, {y:.3g} across")]
    if table.get("parameterization", "bezier") != "bezier":
        return [*rows, ("Spacing", require(table, "parameterization", str, where))]
    theta, phi = (require(table, f"alpha_{g}", float, where) for g in ("theta", "phi"))
    return [*rows, ("Alpha", f"theta {theta:.4g}, phi {phi:.4g}")]


def _search_rows(facts: Mapping[str, Any], where: str | Path) -> Rows:
    """How alpha was chosen, and what the other way of choosing it would have given."""
    if not isinstance(facts.get("search"), dict):
        return [("Chosen by", "hand")]
    search = require(facts, "search", dict, where)
    chosen = require(require(facts, "settings", dict, where), "alpha", str, where)
    by_error = chosen == "error"
    rival = require(search, "by_intensity" if by_error else "by_error", dict, where)
    factor = require(search, "error_of_intensity_choice", float, where)
    if require(search, "intensity_finds_least_error", bool, where):
        verdict = "chooses the same"
    else:
        theta, phi = (require(rival, f"alpha_{g}", float, where) for g in ("theta", "phi"))
        verdict = f"{theta:.4g}, {phi:.4g}, error x {factor if by_error else 1 / max(factor, 1e-9):.2f}"
    names = ("Least error", "Intensity")
    return [("Chosen by", names[not by_error].lower()), (names[by_error], verdict)]


def error_rows(facts: Mapping[str, Any], where: str | Path) -> Rows:
    """Measured error at directions that the table was not built from."""
    errors = require(facts, "errors", dict, where)
    rms, relative = (require(errors, key, float, where) for key in ("rms", "relative"))
    rows = [("RMS error", f"{rms:.3g} 1/sr"), ("Relative", f"{100 * relative:.3g} %")]
    if "directions" in errors:
        rows.append(("Tested at", f"{require(errors, 'directions', int, where):,} other directions"))
    return rows


def envelope_rows(facts: Mapping[str, Any], where: str | Path) -> Rows:
    """What native closures carry of a measured BRDF, and at what bias; nothing where none were fitted."""
    if "residual" not in facts:
        return []
    envelope = require(facts, "envelope", dict, where)
    closures = len(require(envelope, "closures", list, where, minimum=1))
    share, bias = (require(envelope, key, float, where) for key in ("share", "overshoot"))
    words = f"{100 * share:.3g} % of the light by {closures} closure{'s' if closures > 1 else ''}"
    return [("Native", f"{words}, bias {100 * bias:.2g} %")]


def albedo_rows(facts: Mapping[str, Any], where: str | Path) -> Rows:
    """Directional albedo at the normal, of a white sky, and a word where more light leaves than arrives."""
    albedo = require(facts, "albedo", dict, where)
    directional = require(albedo, "directional", list, where, minimum=1)
    rows = [
        ("Albedo 0°", colour(directional[0])),
        ("White sky", colour(require(albedo, "white_sky", list, where))),
    ]
    above = require(albedo, "above_one_deg", list, where)
    if above:
        largest = require(albedo, "largest", float, where)
        rows.append(("Above one", f"{largest:.4g}, seen from {_span(above)}"))
    return rows + _table_albedo_rows(facts, where)


def _table_albedo_rows(facts: Mapping[str, Any], where: str | Path) -> Rows:
    """A word where interpolation reflects more than the measurement does, and more than arrives."""
    if "table_albedo" not in facts:
        return []
    table = require(facts, "table_albedo", dict, where)
    above, largest = require(table, "above_one_deg", list, where), require(table, "largest", float, where)
    measured = require(require(facts, "albedo", dict, where), "largest", float, where)
    if not above or largest < measured + 0.01:
        return []
    return [("Table albedo", f"{largest:.3g} at {_span(above)}: raise the resolution")]


def size_rows(facts: Mapping[str, Any], where: str | Path) -> Rows:
    """Bytes on the disk, where known, and in memory while rendering."""
    sizes = image_sizes(facts, where)
    rows = [("In memory", f"{readable_size(sum(size['render_bytes'] for size in sizes.values()))} while rendering")]
    if all("file_bytes" in size for size in sizes.values()):
        rows.insert(0, ("In files", readable_size(sum(size["file_bytes"] for size in sizes.values()))))
    return rows


def image_sizes(facts: Mapping[str, Any], where: str | Path, folder: Path | None = None) -> dict[str, dict[str, Any]]:
    """Of each image of a bundle: width, height, render_bytes, and file_bytes if `folder` holds the files.

    `render_bytes` is for images read from their files, or, where the facts say "packed", from inside a .blend.
    """
    sizes = {}
    for name, entry in require(facts, "images", dict, where).items():
        width, height, channels = (
            require(entry, key, int, where, minimum=1, maximum=1 << 24) for key in ("width", "height", "channels")
        )
        storage = Storage(require(entry, "storage", str, where, choices=[str(kind) for kind in IMAGE_STORAGES]))
        sizes[name] = {
            "width": width,
            "height": height,
            "storage": str(storage),
            "render_bytes": width * height * storage.render_bytes(channels, facts.get("packed") is True),
        }
        if folder is not None:
            sizes[name]["file_bytes"] = (folder / require(entry, "file", str, where)).stat().st_size
        elif "file_bytes" in entry:
            sizes[name]["file_bytes"] = require(entry, "file_bytes", int, where, minimum=0)
    return sizes


def measurement_rows(source: BrdfSource) -> Rows:
    """What the reader found in a measurement."""
    symmetry = "isotropic" if source.isotropic else "anisotropic"
    rows = [("Symmetry", symmetry + (", bilateral" if source.bilateral else ""))]
    return rows + [(_label(key), _plain(value)) for key, value in source.facts.items() if key != "format"]


def bake_summary(path: Path, facts: Mapping[str, Any], seconds: float) -> str:
    """One line on a bundle just baked."""
    rows = dict(table_rows(facts, path) + error_rows(facts, path))
    alpha = f", alpha {rows['Alpha']}" if "Alpha" in rows else ""
    return f"{path}: RMS {rows['RMS error']} ({rows['Relative']}), {rows['Table']}{alpha}, {seconds:.1f} s"


def readable_size(size: int) -> str:
    """Bytes as KiB or MiB."""
    return f"{size / 1024:.0f} KiB" if size < 1 << 20 else f"{size / (1 << 20):.1f} MiB"


def colour(values: Any) -> str:
    """Three numbers, as far as they are numbers."""
    if not isinstance(values, list):
        return "?"
    return " ".join(f"{value:.3f}" for value in values if isinstance(value, int | float))


def _span(degrees: list[Any]) -> str:
    known = [value for value in degrees if isinstance(value, int | float)] or [0]
    low, high = min(known), max(known)
    return f"{low:g}°" if low == high else f"{low:g}° to {high:g}°"


def _label(key: str) -> str:
    words = key.replace("_", " ")
    return words[:1].upper() + words[1:]


def _plain(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list | tuple):
        shown = [_plain(item) for item in value[:12]]
        return " ".join(shown) + (f" ... ({len(value)})" if len(value) > 12 else "")
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {_plain(item)}" for key, item in value.items())
    return str(value)
