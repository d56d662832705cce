"""A bundle's or a measurement's facts in words: label and value pairs for the terminal and the panel alike."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ...bake.brdf.common import AlbedoRecord
from ...bake.brdf.grids import AnisotropicGrid
from ...bake.brdf.record import BrdfRecord
from ...bake.shading_maps.record import Record
from ...bake.source import BrdfSource
from ...bake.tables.grids.anisotropic_grids import AnisotropicNormalGrid
from ...bake.tables.grids.normal_vector_grid import NormalVectorGrid
from ...bake.tables.grids.patch_grid import PatchGrid

Rows = list[tuple[str, str]]


def source_rows(record: Record) -> Rows:
    """Rows on the source of a bundle, and what was stated of its rights."""
    kind, rights = record.source.format, record.rights
    stated = (("Author", rights.author), ("License", rights.license), ("Found at", rights.source_url))
    return [("Source", record.name)] + ([("Format", kind)] if kind else []) + [row for row in stated if row[1]]


def table_rows(record: BrdfRecord) -> Rows:
    """Size, basis, parameterisation and filter of the table, and what else could have been chosen."""
    table, grid = record.table, record.table.grid
    sizes, basis = " x ".join(map(str, grid.shape)), grid.basis
    texels = ("Texels", f"{table.filter}, {table.storage}")
    weighed = [("Filter weighed", record.filter_why)] if record.filter_why else []
    if isinstance(grid, PatchGrid):
        count = grid.patches.count
        rows = [("Table", f"{count} x {count} patches of the file, {grid.parameterization.title()}"), texels]
    elif record.anisotropic:
        rows = [("Table", f"{sizes}, anisotropic, {basis}-vector basis"), texels, *weighed, *_spacing_rows(grid)]
    else:
        rows = [("Table", f"{sizes}, {basis} basis, {grid.parameterization}"), texels, *weighed]
        if grid.parameterization == "bezier" and isinstance(grid, NormalVectorGrid):
            rows += [_alpha_row(grid), *_search_rows(record)]
        elif grid.parameterization == "bezier":
            rows.append(("Alpha", f"theta_d, theta_h, phi_d {_plain(grid.alphas)}"))
    return rows + _limit_rows(record) + _choice_rows(record)


def _limit_rows(record: BrdfRecord) -> Rows:
    """The bytes that the table's file was to keep within."""
    most = record.settings.table_bytes
    return [("Table limit", f"{most:,} bytes of each table's file")] if most else []


def _alpha_row(grid: NormalVectorGrid | AnisotropicNormalGrid) -> tuple[str, str]:
    return "Alpha", f"theta {grid.alpha_theta:.4g}, phi {grid.alpha_phi:.4g}"


def _spacing_rows(grid: AnisotropicGrid) -> Rows:
    """What the shape of a four-dimensional table was fitted to."""
    if not isinstance(grid, AnisotropicNormalGrid):
        widths = f"{grid.width_x:.3g} along the tangent, {grid.width_y:.3g} across"
        return [("Spacing", f"half of it within slopes of {widths}")]
    return [_alpha_row(grid)] if grid.parameterization == "bezier" else [("Spacing", grid.parameterization)]


def _choice_rows(record: BrdfRecord) -> Rows:
    """The best of the candidates that were not taken, of each basis and parameterisation."""
    found = record.candidates
    if not found:
        return []
    least = max(found[0].rms, 1e-30)
    rivals = dict.fromkeys((candidate.basis, candidate.parameterization) for candidate in found)
    rivals.pop((found[0].basis, found[0].parameterization))
    words = []
    for basis, kind in rivals:
        rms = min(c.rms for c in found if (c.basis, c.parameterization) == (basis, kind))
        words.append(f"{basis} {kind} {rms / least:.3g} x")
    return [("RMS of other grids", ", ".join(words))] if words else []


def _search_rows(record: BrdfRecord) -> Rows:
    """How alpha was chosen, and what the other way of choosing it would have given."""
    search = record.search
    if search is None:
        return [("Chosen", "manually")]
    by_error = record.settings.alpha == "error"
    rival = search.by_intensity if by_error else search.by_error
    factor = search.error_of_intensity_choice
    if search.intensity_finds_least_error:
        verdict = "chooses the same"
    else:
        ratio = factor if by_error else 1 / max(factor, 1e-9)
        verdict = f"{rival.theta:.4g}, {rival.phi:.4g}, error x {ratio:.2f}"
    names = ("Least error", "Intensity")
    return [("Chosen by", names[not by_error].lower()), (names[by_error], verdict)]


def error_rows(record: BrdfRecord) -> Rows:
    """Measured error at directions that the table was not built from."""
    errors = record.errors
    rows = [("RMS error", f"{errors.rms:.3g} 1/sr"), ("Relative", f"{100 * errors.relative:.3g} %")]
    if errors.directions is not None:
        rows.append(("Tested at", f"{errors.directions:,} other directions"))
    return rows + _color_rows(record)


def _color_rows(record: BrdfRecord) -> Rows:
    """What the error comes to on a lit sphere, as an eye sees it."""
    names = {"exact": "Color difference", "table": "In Reference"}
    if "exact" not in record.color_differences:
        names["table"] = "Color difference"
    return [
        (names[name], f"{found.median:.2g} in the median, {found.p95:.2g} at most on 95 % of a sphere (1: just seen)")
        for name, found in record.color_differences.items()
        if name in names
    ]


def envelope_rows(record: BrdfRecord) -> Rows:
    """Rows on what native closures carry of a measured BRDF, and at what bias; none where none were fitted."""
    envelope = record.envelope
    if record.residual is None or envelope is None:
        return []
    words = f"{100 * envelope.share:.3g} % of the light by {len(envelope.closures)} of them"
    return [("Cycles' shaders", f"{words}, bias {100 * envelope.overshoot:.2g} %")]


def albedo_rows(record: Record) -> Rows:
    """Directional albedo at the normal, of a white sky, and a word where more light leaves than arrives."""
    table = record.table_albedo if isinstance(record, BrdfRecord) else None
    return reflected_rows(record.albedo) + (_table_albedo_rows(table, record.albedo) if table else [])


def reflected_rows(albedo: AlbedoRecord) -> Rows:
    """Those of `albedo_rows` that are known of a measurement too."""
    rows = [("Albedo 0°", colour(albedo.directional[0])), ("White sky", colour(albedo.white_sky))]
    if albedo.above_one_deg:
        rows.append(("Above one", f"{albedo.largest:.4g}, seen from {degrees(albedo.above_one_deg)}"))
    return rows


def _table_albedo_rows(table: AlbedoRecord, measured: AlbedoRecord) -> Rows:
    """A word where interpolation reflects more than the measurement does, and more than arrives."""
    if not table.above_one_deg or table.largest < measured.largest + 0.01:
        return []
    return [("Table albedo", f"{table.largest:.3g} at {degrees(table.above_one_deg)}: raise the resolution")]


def size_rows(record: Record) -> Rows:
    """Bytes on the disk, where known, and in memory while rendering."""
    images = record.images.values()
    in_memory = sum(image.render_bytes(record.packed) for image in images)
    rows = [("In memory", f"{readable_size(in_memory)} while rendering")]
    in_files = [image.file_bytes for image in images if image.file_bytes is not None]
    if len(in_files) == len(images):
        rows.insert(0, ("In files", readable_size(sum(in_files))))
    return rows


def image_sizes(record: Record) -> dict[str, dict[str, Any]]:
    """Of each image of a bundle: width, height, storage, bytes while rendering and in its file; JSON-ready.

    Raises BakeError and OSError.
    """
    return {
        name: {
            "width": image.width,
            "height": image.height,
            "storage": str(image.storage),
            "render_bytes": image.render_bytes(record.packed),
            "file_bytes": record.files().image_path(name).stat().st_size,
        }
        for name, image in record.images.items()
    }


def measurement_rows(source: BrdfSource) -> Rows:
    """Rows on what the reader found in a measurement."""
    symmetry = "isotropic" if source.isotropic else "anisotropic"
    rows = [("Symmetry", symmetry + (", bilateral" if source.bilateral else ""))]
    return rows + [(_label(key), _plain(value)) for key, value in source.facts.items() if key != "format"]


def bake_summary(record: BrdfRecord, seconds: float) -> str:
    """One line on a bundle just baked."""
    rows = dict(table_rows(record) + error_rows(record))
    alpha = f", alpha {rows['Alpha']}" if "Alpha" in rows else ""
    told = f"RMS {rows['RMS error']} ({rows['Relative']}), {rows['Table']}{alpha}, {seconds:.1f} s"
    return f"{record.files().path}: {told}"


def readable_size(size: int) -> str:
    """Bytes as KiB or MiB."""
    return f"{size / 1024:.0f} KiB" if size < 1 << 20 else f"{size / (1 << 20):.1f} MiB"


def colour(values: Sequence[float]) -> str:
    """Three numbers."""
    return " ".join(f"{value:.3f}" for value in values)


def degrees(angles: Sequence[float]) -> str:
    """Angles from the least to the largest."""
    low, high = min(angles), max(angles)
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
