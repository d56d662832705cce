"""Sub-command `render`: a bundle in the studio, as a picture."""

from __future__ import annotations

import argparse
import importlib
from pathlib import Path
from typing import Any

from ..bake.bundle import Bundle, read_bundle
from ..bake.errors import BakeError
from ..bake.table import FILTERS
from .cli_result import Result
from .progress import Progress

_LARGEST = 16384


def add_to(commands: Any) -> None:
    """Add `render`."""
    parser = commands.add_parser(
        "render",
        help="a picture of a bundle in the studio",
        description="Render a bundle in the studio scene with Cycles. Needs Blender or its Python module.",
    )
    parser.add_argument("bundle", type=Path, metavar="BUNDLE", help="a folder NAME.mmat")
    parser.add_argument("--out", type=Path, metavar="FILE.png", help="picture (default: NAME.png here)")
    parser.add_argument("--exr", action="store_true", help="also FILE.exr, linear Rec.709, 32 bits")
    parser.add_argument("--resolution", type=_positive(_LARGEST), default=480, metavar="PIXELS", help="(%(default)s)")
    parser.add_argument("--samples", type=_positive(1 << 20), default=64, metavar="N", help="(%(default)s)")
    parser.add_argument("--environment", type=Path, metavar="FILE", help="surroundings, an .exr or .hdr image")
    parser.add_argument("--filter", choices=FILTERS, help="(default: the one the bundle was baked for)")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    parser.set_defaults(run=run, command="render")


def _positive(largest: int) -> Any:
    def parse(text: str) -> int:
        if not text.isdecimal() or not 1 <= int(text) <= largest:
            raise argparse.ArgumentTypeError(f"{text!r} is no whole number from 1 to {largest}")
        return int(text)

    return parse


def need_blender(command: str) -> None:
    """Raise BakeError where bpy cannot be imported."""
    try:
        importlib.import_module("bpy")
    except ImportError as error:
        remedy = (
            f"run it inside Blender: blender --background --command measured_materials {command} ..., "
            "or install the bpy module"
        )
        raise BakeError(command, "needs Blender", remedy) from error


def run(options: argparse.Namespace) -> Result:
    """Render one bundle. Raises BakeError."""
    bundle = read_bundle(options.bundle)
    out = options.out or Path(bundle.path.resolve().stem + ".png")
    if out.suffix.lower() != ".png":
        raise argparse.ArgumentTypeError(f"--out {out} is not a FILE.png; --exr adds a linear .exr beside it")
    need_blender("render")
    # About 1.5 million samples a second on two cores; only the proportion matters.
    rendering = 0.5 + options.resolution**2 * options.samples / 1.5e6
    with Progress({"building": 2.0, "rendering": rendering, "writing": 0.3}) as progress:
        progress.start(bundle.path.stem)
        mean = _render(bundle, options, out, progress)
    files = [str(out)] + ([str(out.with_suffix(".exr"))] if options.exr else [])
    document = {
        "command": options.command,
        "bundle": str(bundle.path),
        "files": files,
        "resolution": options.resolution,
        "samples": options.samples,
        "mean_linear": [float(value) for value in mean],
    }
    return Result(document, files)


def _render(bundle: Bundle, options: argparse.Namespace, out: Path, progress: Progress) -> Any:
    """Write the files and return the picture's mean colour."""
    import bpy

    from ..bake.image_io import write_png
    from ..nodes.material import build_material
    from .picture_sheet import to_display
    from .studio import build_studio, remove_studio, render_linear

    progress("building", 0.0)
    material = build_material(bundle, filter=options.filter)
    try:
        scene = build_studio(
            material,
            resolution=(options.resolution, options.resolution),
            samples=options.samples,
            environment=options.environment,
        )
        try:
            linear = render_linear(
                scene,
                out.with_suffix(".exr") if options.exr else None,
                progress=lambda share: progress("rendering", share),
            )
        finally:
            remove_studio(scene)
    finally:
        bpy.data.materials.remove(material)
    progress("writing", 0.0)
    write_png(out, to_display(linear))
    return linear.mean((0, 1))
