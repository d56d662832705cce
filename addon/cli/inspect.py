"""Sub-command `inspect`: what is in a bundle, in a measurement or in a folder of photographs."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from ...bake.brdf.appearance import Together
from ...bake.brdf.common import AlbedoRecord, kind_of
from ...bake.brdf.preview_sphere import Reflects
from ...bake.brdf.record import BrdfRecord
from ...bake.bundle.bundle import MATERIAL, SUFFIX, is_bundle, read_bundle
from ...bake.bundle.checked_json import Fields
from ...bake.bundle.origin import file_origin, mark_of
from ...bake.errors import BakeError
from ...bake.inspection.readings import held_out
from ...bake.inspection.survey import survey
from ...bake.photographs.settings import StackSettings
from ...bake.photographs.stack import read_stack
from ...bake.reading import Reading
from ...bake.shading_maps.record import Record, read_record
from ...bake.shading_maps.record_parts import PhotographsRecord
from ...bake.source import SheetSource
from ...bake.sources import chosen_material, read_source
from ...bake.tables.albedo import albedo_facts
from ...bake.tables.sheet import sheet_facts
from ..photographs.arc_plot import draw_arc
from ..photographs.find_decoder import blender_decoder
from ..plots.brdf_plots import draw_brdf, figure_files
from ..plots.figure import need_matplotlib, refuse_others
from ..summary import brdf_rows, shading_map_rows
from ..summary.parts import parts_of
from ..summary.sheet_rows import measured_sheet_rows
from ..summary.survey_rows import survey_rows
from ..summary.text import columns, one_line
from .console.progress import Progress
from .console.reading_options import add_reading, reading_of
from .console.result import Result

# Behind the mark of a bundle's figures: those of the measurement show something else.
_BAKED = " baked"


def add_to(commands: Any) -> None:
    """Add `inspect`."""
    parser = commands.add_parser(
        "inspect",
        help="what is in a bundle, a measurement or a folder of photographs",
        description="Report parameters, measured errors, albedo and sizes of a bundle, format, faults and "
        "albedo of a measurement, or lights, averages and faults of photographs on a light arc.",
    )
    parser.add_argument(
        "path", type=Path, metavar="PATH", help="a folder NAME.mmat, a measurement, or a folder of photographs"
    )
    add_reading(parser)
    parser.add_argument(
        "--plots",
        type=Path,
        metavar="DIR",
        help="draw slices, polar plots, albedo, reciprocity and a picture by half and difference angle of a "
        "measurement or a bundle as PNG into this folder; of a baked swatch its photographs and slices (needs "
        "matplotlib)",
    )
    parser.add_argument("--replace", action="store_true", help="also figures of those names that show something else")
    parser.add_argument("--json", action="store_true", help="print everything as JSON")
    parser.set_defaults(run=run, command="inspect")


def run(options: argparse.Namespace) -> Result:
    """Inspect one path. Raises BakeError."""
    path, plots = options.path, options.plots
    if path.name == MATERIAL:
        path = path.parent
    try:
        folder = path.is_dir()
        bundle = path.suffix.lower() == SUFFIX and (folder or not path.exists())
    except (OSError, ValueError) as error:
        raise BakeError(path, f"cannot be read ({error})", "check the path and its permissions") from error
    if bundle or (folder and is_bundle(path)):
        return inspect_bundle(path, plots, options.replace)
    if not folder:
        return inspect_measurement(path, reading_of(options), plots, options.replace)
    if plots is not None:
        remedy = "draw the baked swatch, or bake with --plot FILE.png"
        raise BakeError(path, "is a folder of photographs, of which nothing is drawn", remedy)
    return inspect_photographs(path)


def inspect_bundle(path: Path, plots: Path | None = None, replace_others: bool = False) -> Result:
    """Parameters, errors, albedo and sizes of a bundle; its figures in the folder `plots`."""
    bundle = read_bundle(path)
    record = read_record(bundle)
    sizes = _sizes(record)
    shown: brdf_rows.Rows = [("Bundle", str(bundle.path)), ("Kind", kind_of(bundle.material))]
    for rows in parts_of(record):
        shown += rows
    for name, size in sizes.items():
        in_file, in_memory = map(brdf_rows.readable_size, (size["file_bytes"], size["render_bytes"]))
        texels = f"{size['width']} x {size['height']} {size['storage']}"
        shown.append((f"Image {name}", f"{texels}, {in_file} in the file, {in_memory} while rendering"))
    document = {**bundle.material, "command": "inspect", "path": str(bundle.path), "sizes": sizes}
    return _with_plots(document, shown, _draw_bundle(record, plots, replace_others) if plots is not None else [])


def _draw_bundle(record: Record, folder: Path, replace_others: bool) -> list[Path]:
    """Of a BRDF what modes Reference and Exact show; of a swatch how its photographs became slices."""
    need_matplotlib("--plots")
    bundle = record.files().path
    swatch = folder / f"{bundle.stem}_slices.png"
    is_brdf = isinstance(record, BrdfRecord)
    mark = mark_of(record.source.entries) + _BAKED
    if not replace_others:
        refuse_others(figure_files(bundle.stem, folder) if is_brdf else [swatch], mark)
    if not isinstance(record, BrdfRecord):
        draw_arc(bundle, swatch, mark)
        return [swatch]
    table = record.load_table()
    shown: dict[str, Reflects] = {"Reference": table}
    if record.residual is not None:
        shown["Exact"] = Together((record.load_envelope(), record.load_table("residual")))
    return draw_brdf(table, shown, bundle.stem, folder, mark)


def _with_plots(document: dict[str, Any], rows: brdf_rows.Rows, drawn: list[Path]) -> Result:
    """The result, with the figures where there are any."""
    if drawn:
        document = {**document, "plots": [str(path) for path in drawn]}
        rows = [*rows, *(("Figures" if k == 0 else "", str(path)) for k, path in enumerate(drawn))]
    return Result(document, columns(rows))


def _sizes(record: Record) -> dict[str, dict[str, Any]]:
    try:
        return brdf_rows.image_sizes(record)
    except OSError as error:
        raise BakeError(record.files().path, f"cannot be read ({error.strerror})", "check its permissions") from error


def inspect_photographs(path: Path) -> Result:
    """Report what the reader finds in a folder of photographs: names, elevations, averages, doubts. Nothing is
    baked."""
    with Progress({"reading": 2.0, "aligning": 1.5}) as progress:
        progress.start(path.name)
        stack = read_stack(path, StackSettings(align="warn"), progress, blender_decoder())
    found = shading_map_rows.stack_document(stack, path.resolve().name)
    rows = [("Folder", str(path)), ("Size", f"{found['width']} x {found['height']}")]
    photographs = PhotographsRecord.parse(Fields(found, path))
    rows += shading_map_rows.read_rows(photographs) + shading_map_rows.doubt_rows(photographs)
    document = {**found, "command": "inspect", "kind": "photographs", "path": str(path)}
    return Result(document, [*columns(rows), "", *map(one_line, shading_map_rows.stack_lines(found))])


def inspect_measurement(
    path: Path, reading: Reading, plots: Path | None = None, replace_others: bool = False
) -> Result:
    """Format, what the reader found, symmetry, gaps and albedo of a measurement; its figures in the folder `plots`."""
    if plots is not None:
        need_matplotlib("--plots")
    source = read_source(path, reading)
    mark = mark_of(file_origin(path, chosen_material(path, reading)))
    if plots is not None and not replace_others:
        refuse_others(figure_files(source.name, plots), mark)
    by_itself = (
        source if reading.reciprocity == "measured" else read_source(path, replace(reading, reciprocity="measured"))
    )
    albedo, surveyed, left_out = albedo_facts(source), survey(source), held_out(by_itself)
    name = str(source.facts.get("format", "unknown"))
    document: dict[str, Any] = {
        "command": "inspect",
        "kind": "measurement",
        "path": str(path),
        "format": name,
        "name": source.name,
        "isotropic": source.isotropic,
        "bilateral": source.bilateral,
        "bytes": path.stat().st_size,
        "facts": source.facts,
        "albedo": albedo,
        "survey": surveyed,
        "held_out": left_out,
    }
    rows = [("File", str(path)), ("Format", name), ("Size", brdf_rows.readable_size(path.stat().st_size))]
    rows += brdf_rows.measurement_rows(source)
    reflected = AlbedoRecord.parse(Fields({"albedo": albedo}, path), "albedo")
    rows += brdf_rows.reflected_rows(reflected)
    if isinstance(source, SheetSource):
        document["sheet"] = sheet_facts(source, albedo)
        rows += measured_sheet_rows(reflected, Fields(document["sheet"], path))
    rows += survey_rows(surveyed, left_out, reading)
    shown = {"measurement": source}
    return _with_plots(document, rows, draw_brdf(source, shown, source.name, plots, mark) if plots is not None else [])
