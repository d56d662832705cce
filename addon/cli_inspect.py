"""Sub-command `inspect`: what is in a bundle or in a measurement."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..bake.albedo import albedo_facts
from ..bake.bundle import MATERIAL, Bundle, read_bundle
from ..bake.errors import BakeError
from ..bake.sources import read_source
from . import describe
from .cli_result import Result, columns


def add_to(commands: Any) -> None:
    """Add `inspect`."""
    parser = commands.add_parser(
        "inspect",
        help="what is in a bundle or a measurement",
        description="Tell parameters, measured errors, albedo and sizes of a bundle, or format, faults and "
        "albedo of a measurement.",
    )
    parser.add_argument("path", type=Path, metavar="PATH", help="a folder NAME.mmat, or a measurement")
    parser.add_argument("--json", action="store_true", help="print everything as JSON")
    parser.set_defaults(run=run, command="inspect")


def run(options: argparse.Namespace) -> Result:
    """Inspect one path. Raises BakeError."""
    path = options.path
    if path.name == MATERIAL:
        path = path.parent
    return inspect_bundle(path) if is_bundle_path(path) else inspect_measurement(path)


def is_bundle_path(path: Path) -> bool:
    """Whether the path is to be read as a bundle; a missing one is, if it is named so."""
    try:
        return path.is_dir() or (path.suffix.lower() == ".mmat" and not path.exists())
    except (OSError, ValueError) as error:
        raise BakeError(path, f"cannot be read ({error})", "check the path and its permissions") from error


def inspect_bundle(path: Path) -> Result:
    """Parameters, errors, albedo and sizes of a bundle."""
    bundle = read_bundle(path)
    facts, where = bundle.material, bundle.path / MATERIAL
    sizes = _sizes(bundle)
    shown: describe.Rows = [("Bundle", str(bundle.path)), ("Kind", facts["kind"])]
    if facts["kind"] == "brdf":
        for part in (describe.source_rows, describe.table_rows, describe.error_rows, describe.albedo_rows):
            shown += part(facts, where)
    for name, size in sizes.items():
        in_file, in_memory = map(describe.readable_size, (size["file_bytes"], size["render_bytes"]))
        texels = f"{size['width']} x {size['height']} {size['storage']}"
        shown.append((f"Image {name}", f"{texels}, {in_file} in the file, {in_memory} while rendering"))
    document = {**facts, "command": "inspect", "path": str(bundle.path), "sizes": sizes}
    return Result(document, columns(shown))


def _sizes(bundle: Bundle) -> dict[str, dict[str, Any]]:
    try:
        return describe.image_sizes(bundle.material, bundle.path / MATERIAL, bundle.path)
    except OSError as error:
        raise BakeError(bundle.path, f"cannot be read ({error.strerror})", "check its permissions") from error


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
    rows += describe.measurement_rows(source) + describe.albedo_rows(document, path)
    return Result(document, columns(rows))
