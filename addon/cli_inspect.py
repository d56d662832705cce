"""Sub-command `inspect`: what is in a bundle, in a measurement or in a folder of photographs."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..bake.albedo import albedo_facts
from ..bake.brdf.common import AlbedoRecord, kind_of
from ..bake.brdf.record import BrdfRecord
from ..bake.bundle import MATERIAL, SUFFIX, is_bundle, read_bundle
from ..bake.errors import BakeError
from ..bake.material_json import Fields
from ..bake.photographs.settings import StackSettings
from ..bake.photographs.stack import read_stack
from ..bake.shading.record import Record, read_record
from ..bake.shading.record_parts import PhotographsRecord
from ..bake.sources import read_source
from . import describe, describe_map
from .cli_result import Result
from .find_decoder import blender_decoder
from .progress import Progress
from .text import columns, one_line

_BRDF_ROWS = (
    describe.source_rows,
    describe.table_rows,
    describe.error_rows,
    describe.envelope_rows,
    describe.albedo_rows,
)
_MAP_ROWS = (
    describe.source_rows,
    describe_map.photograph_rows,
    describe_map.map_rows,
    describe_map.lighting_rows,
    describe_map.energy_rows,
    describe_map.map_error_rows,
    describe.albedo_rows,
    describe_map.warning_rows,
)


def add_to(commands: Any) -> None:
    """Add `inspect`."""
    parser = commands.add_parser(
        "inspect",
        help="what is in a bundle, a measurement or a folder of photographs",
        description="Tell parameters, measured errors, albedo and sizes of a bundle, format, faults and "
        "albedo of a measurement, or lights, averages and faults of photographs on a light arc.",
    )
    parser.add_argument(
        "path", type=Path, metavar="PATH", help="a folder NAME.mmat, a measurement, or a folder of photographs"
    )
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
    return inspect_photographs(path) if folder else inspect_measurement(path)


def inspect_bundle(path: Path) -> Result:
    """Parameters, errors, albedo and sizes of a bundle."""
    bundle = read_bundle(path)
    record = read_record(bundle)
    sizes = _sizes(record)
    shown: describe.Rows = [("Bundle", str(bundle.path)), ("Kind", kind_of(bundle.material))]
    for part in _BRDF_ROWS if isinstance(record, BrdfRecord) else _MAP_ROWS:
        shown += part(record)
    for name, size in sizes.items():
        in_file, in_memory = map(describe.readable_size, (size["file_bytes"], size["render_bytes"]))
        texels = f"{size['width']} x {size['height']} {size['storage']}"
        shown.append((f"Image {name}", f"{texels}, {in_file} in the file, {in_memory} while rendering"))
    document = {**bundle.material, "command": "inspect", "path": str(bundle.path), "sizes": sizes}
    return Result(document, columns(shown))


def _sizes(record: Record) -> dict[str, dict[str, Any]]:
    try:
        return describe.image_sizes(record)
    except OSError as error:
        raise BakeError(record.files().path, f"cannot be read ({error.strerror})", "check its permissions") from error


def inspect_photographs(path: Path) -> Result:
    """What the reader finds in a folder of photographs: names, elevations, averages, doubts. Nothing is baked."""
    with Progress({"reading": 2.0, "aligning": 1.5}) as progress:
        progress.start(path.name)
        stack = read_stack(path, StackSettings(align="warn"), progress, blender_decoder())
    found = describe_map.stack_document(stack, path.resolve().name)
    rows = [("Folder", str(path)), ("Size", f"{found['width']} x {found['height']}")]
    photographs = PhotographsRecord.parse(Fields(found, path))
    rows += describe_map.read_rows(photographs) + describe_map.doubt_rows(photographs)
    document = {**found, "command": "inspect", "kind": "photographs", "path": str(path)}
    return Result(document, [*columns(rows), "", *map(one_line, describe_map.stack_lines(found))])


def inspect_measurement(path: Path) -> Result:
    """Format, what the reader found, and albedo of a measurement."""
    source = read_source(path)
    albedo = albedo_facts(source)
    name = str(source.facts.get("format", "unknown"))
    document = {
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
    rows = [("File", str(path)), ("Format", name), ("Size", describe.readable_size(path.stat().st_size))]
    rows += describe.measurement_rows(source)
    rows += describe.reflected_rows(AlbedoRecord.parse(Fields({"albedo": albedo}, path), "albedo"))
    return Result(document, columns(rows))
