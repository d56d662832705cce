"""Sub-command `inspect`: what is in a bundle, in a measurement or in a folder of photographs."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ...bake.brdf.common import AlbedoRecord, kind_of
from ...bake.bundle.bundle import MATERIAL, SUFFIX, is_bundle, read_bundle
from ...bake.bundle.checked_json import Fields
from ...bake.errors import BakeError
from ...bake.photographs.settings import StackSettings
from ...bake.photographs.stack import read_stack
from ...bake.reading import Reading
from ...bake.shading_maps.record import Record, read_record
from ...bake.shading_maps.record_parts import PhotographsRecord
from ...bake.source import SheetSource
from ...bake.sources import read_source
from ...bake.tables.albedo import albedo_facts
from ...bake.tables.sheet import sheet_facts
from ..photographs.find_decoder import blender_decoder
from ..summary import brdf_rows, shading_map_rows
from ..summary.parts import parts_of
from ..summary.sheet_rows import measured_sheet_rows
from ..summary.text import columns, one_line
from .console.progress import Progress
from .reading_options import add_reading, reading_of
from .result import Result


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
    parser.add_argument("--json", action="store_true", help="print everything as JSON")
    parser.set_defaults(run=run, command="inspect")


def run(options: argparse.Namespace) -> Result:
    """Inspect one path. Raises BakeError."""
    path = options.path
    if path.name == MATERIAL:
        path = path.parent
    try:
        folder = path.is_dir()
        bundle = path.suffix.lower() == SUFFIX and (folder or not path.exists())
    except (OSError, ValueError) as error:
        raise BakeError(path, f"cannot be read ({error})", "check the path and its permissions") from error
    if bundle or (folder and is_bundle(path)):
        return inspect_bundle(path)
    return inspect_photographs(path) if folder else inspect_measurement(path, reading_of(options))


def inspect_bundle(path: Path) -> Result:
    """Parameters, errors, albedo and sizes of a bundle."""
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
    return Result(document, columns(shown))


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


def inspect_measurement(path: Path, reading: Reading) -> Result:
    """Format, what the reader found, and albedo of a measurement."""
    source = read_source(path, reading)
    albedo = albedo_facts(source)
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
    }
    rows = [("File", str(path)), ("Format", name), ("Size", brdf_rows.readable_size(path.stat().st_size))]
    rows += brdf_rows.measurement_rows(source)
    rows += brdf_rows.reflected_rows(AlbedoRecord.parse(Fields({"albedo": albedo}, path), "albedo"))
    if isinstance(source, SheetSource):
        document["sheet"] = sheet_facts(source, albedo)
        rows += measured_sheet_rows(document["sheet"], albedo, path)
    return Result(document, columns(rows))
