"""Options on how photographs are read, of every command that takes some."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ....bake.photographs.settings import ALIGNMENTS, SIDES, StackSettings
from ...summary.quality_levels import MAP_LEVELS, by_quality


def add_photographs(group: Any, *, arc: bool = True) -> None:
    """Add the options on how the photographs are read; those on the choice of an `arc` only where one is."""
    usual = StackSettings()
    group.add_argument(
        "--size",
        type=int,
        metavar="TEXELS",
        help="reduce the swatch's longer side to so many; 0 keeps it as photographed "
        f"({by_quality(MAP_LEVELS, 'size')})",
    )
    group.add_argument(
        "--decode",
        default=usual.decode,
        metavar="RULE",
        help="the curve of JPEG, PNG and TIFF: auto, srgb, linear or gamma:2.2; primaries are the file's (%(default)s)",
    )
    group.add_argument(
        "--lights",
        type=Path,
        metavar="FILE",
        help="directions of the lights: lights.csv, .lp, a list 'file x y z' or DiLiGenT's light_directions.txt "
        "(default: found in the folder, or angles in the file names)",
    )
    group.add_argument(
        "--sphere",
        type=numbers(float, 3),
        action="append",
        default=[],
        metavar="X,Y,R",
        help="a mirror sphere in the picture, in place of --lights: centre and radius in pixels from the upper left; "
        "its highlight tells where each light was, for a camera far above; may be given several times",
    )
    if arc:
        _add_arc(group, usual)
    group.add_argument("--crop", type=numbers(int, 4), metavar="X,Y,W,H", help="the swatch in the photograph, pixels")
    group.add_argument(
        "--corners",
        type=numbers(float, 2),
        nargs=4,
        metavar="X,Y",
        help="of the swatch: top left, top right, bottom right, bottom left; makes an oblique view square-on",
    )
    group.add_argument(
        "--flat-field",
        type=Path,
        metavar="FILE|FOLDER",
        help="photograph of an evenly white board under the same lamp, or one per light under the same names",
    )
    group.add_argument("--white-card", type=numbers(int, 4), metavar="X,Y,W,H", help="a diffuse card in the picture")
    group.add_argument(
        "--white-reflectance",
        type=float,
        default=usual.white_reflectance,
        metavar="SHARE",
        help="of that card (%(default)g)",
    )
    group.add_argument("--albedo", type=float, metavar="SHARE", help="of the swatch, stated instead of a card")
    group.add_argument(
        "--align",
        choices=ALIGNMENTS,
        default=usual.align,
        help="small movements of the camera (%(default)s: corrected)",
    )


def _add_arc(group: Any, usual: StackSettings) -> None:
    group.add_argument(
        "--azimuth",
        type=float,
        metavar="DEGREES",
        help="of the arc's plane, 0 right, 90 up (default: the plane with most elevations)",
    )
    group.add_argument(
        "--spread",
        type=float,
        default=usual.spread,
        metavar="DEGREES",
        help="that a light may lie off the plane (%(default)g)",
    )
    group.add_argument(
        "--sides",
        choices=SIDES,
        default=usual.sides,
        help="of the arc that may be lit from: that of the azimuth, or the far one too (%(default)s)",
    )


def stack_settings(options: argparse.Namespace, size: int | None, **arc: Any) -> StackSettings:
    """What `add_photographs` added; `arc` is azimuth, spread and sides. Raises BakeError."""
    return StackSettings(
        size=size or None,
        decode=options.decode,
        lights=options.lights,
        spheres=tuple(options.sphere),
        crop=options.crop,
        corners=None if options.corners is None else tuple(options.corners),
        flat_field=options.flat_field,
        white_card=options.white_card,
        white_reflectance=options.white_reflectance,
        albedo=options.albedo,
        align=options.align,
        **arc,
    )


def numbers(kind: type, count: int) -> Any:
    """What parses so many numbers with commas between them."""

    def parse(text: str) -> tuple[Any, ...]:
        try:
            numbers = tuple(kind(part) for part in text.split(","))
        except ValueError:
            numbers = ()
        if len(numbers) != count:
            example = ",".join(str(100 * (k + 1)) for k in range(count))
            raise argparse.ArgumentTypeError(f"{text!r} is not {count} numbers such as {example}")
        return numbers

    return parse
