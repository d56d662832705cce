"""Sub-command `assets`: bundles as an asset library of Blender."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ...bake.bundle.bundle import SUFFIX
from ...bake.errors import BakeError
from ..summary.text import columns
from .console.need_blender import need_blender
from .console.progress import Progress
from .console.result import Result

_MOST_SAMPLES = 1 << 16


def add_to(commands: Any) -> None:
    """Add `assets`."""
    parser = commands.add_parser(
        "assets",
        help="bundles as an asset library: a .blend each, with catalog, picture and tags",
        description="Write a .blend for each bundle of a folder, in which its material is an asset with catalog, "
        "picture, tags, author, license and error. Done again it writes what has changed. Needs Blender or its Python "
        "module.",
    )
    parser.add_argument("library", type=Path, metavar="LIB", help="a folder with bundles, in it or below, or a bundle")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder of the asset library (default: LIB itself)")
    add_asset_options(parser)
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    parser.set_defaults(run=run, command="assets")


def add_asset_options(parser: Any) -> None:
    """Add the options of how an asset is made, and --replace."""
    parser.add_argument(
        "--textures",
        choices=("packed", "relative"),
        default="packed",
        help="in the .blend, or read from the bundle by a relative path (%(default)s)",
    )
    parser.add_argument(
        "--preview",
        choices=("render", "bundle"),
        default="render",
        help="the asset's picture: rendered in the studio, or the bundle's own, at once (%(default)s)",
    )
    parser.add_argument(
        "--preview-samples", type=_samples, default=32, metavar="N", help="of a rendered picture (%(default)s)"
    )
    parser.add_argument(
        "--replace", action="store_true", help="also .blend files that somebody else has written, or saved since"
    )


def _samples(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= _MOST_SAMPLES:
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number from 1 to {_MOST_SAMPLES}")
    return int(text)


def run(options: argparse.Namespace) -> Result:
    """Bring one asset library in line with a folder of bundles. Raises BakeError."""
    need_blender("assets")
    from ..asset_library.library import bundles_below

    library = options.library
    if not library.is_dir():
        raise BakeError(library, "is not a folder", f"give a folder with bundles (NAME{SUFFIX})")
    bundles = bundles_below(library)
    if not bundles:
        raise BakeError(library, f"holds no bundle (a folder NAME{SUFFIX})", "bake some with --out there")
    out = options.out or (library.parent if bundles == [library] else library)
    given = {"textures": options.textures, "preview": options.preview, "samples": options.preview_samples}
    return write_assets(bundles, library, out, options, replace=options.replace, **given)


def write_assets(
    bundles: list[Path], root: Path, out: Path, options: argparse.Namespace, *, replace: bool, **given: str | int
) -> Result:
    """As `asset_library.library.write_library`, with its progress and a table; `given` are its settings.

    Raises BakeError.
    """
    need_blender("assets")
    from ..asset_library.blend_file import AssetSettings
    from ..asset_library.library import STAGES, write_library

    settings = AssetSettings(**given)
    with Progress(STAGES, len(bundles)) as progress:
        found = list(write_library(bundles, root, out, settings, progress, replace=replace))
    document = {
        "command": options.command,
        "library": str(out),
        "assets": [
            {"file": one.file, "bundle": str(one.bundle), "state": one.state, "told": one.told, "seconds": one.seconds}
            for one in found
        ],
    }
    rows = [(one.file, "; ".join(filter(None, (one.state, one.told)))) for one in found]
    states = {state: sum(one.state == state for one in found) for state in ("written", "unchanged", "failed")}
    total = ", ".join(f"{count} {state}" for state, count in states.items() if count)
    return Result(document, [*columns(rows), f"{out}: {total}"], [one.error for one in found if one.error is not None])
