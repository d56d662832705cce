"""Options on the Blender material that is made of maps."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ....bake.errors import BakeError
from ....bake.maps.relief import RELIEFS
from .need_blender import need_blender

_SUFFIX = ".blend"


def add_blend(group: Any) -> None:
    """Add the options that `check_blend` checks."""
    group.add_argument(
        "--blend",
        type=Path,
        metavar=f"FILE{_SUFFIX}",
        help="also write a file of Blender with a Principled BSDF material of every folder's maps, as assets; needs "
        "Blender or its Python module",
    )
    group.add_argument(
        "--relief",
        choices=RELIEFS,
        default=RELIEFS[0],
        help="what shows the relief there: the normals, the height as bump or as displacement, or filtered, for EEVEE: "
        "the normals, rougher where they are averaged: far away, and between texels (%(default)s)",
    )
    group.add_argument(
        "--width",
        type=float,
        default=1.0,
        metavar="UNITS",
        help="of the picture on the object, which the height is measured in (%(default)g)",
    )
    group.add_argument("--pack", action="store_true", help="keep the textures inside the .blend file")


def check_blend(options: argparse.Namespace) -> None:
    """Raise `argparse.ArgumentTypeError`, or BakeError where there is no Blender, before anything is baked."""
    target = options.blend
    if target is None:
        if options.relief != RELIEFS[0] or options.width != 1.0 or options.pack:
            raise argparse.ArgumentTypeError(
                f"--relief, --width and --pack are of Blender's file: give --blend FILE{_SUFFIX}"
            )
        return
    if target.suffix.lower() != _SUFFIX:
        raise argparse.ArgumentTypeError(f"--blend {target} is not a FILE{_SUFFIX}")
    need_blender("bake maps --blend")
    # The folder of the maps is made by the bake.
    if not target.parent.is_dir() and target.parent.absolute() != options.out.absolute():
        raise BakeError(target.parent, "is not a folder", "make it, or choose another place for --blend")
    if target.exists() and not options.replace:
        raise BakeError(target, "is there already", "choose another name, or --replace")
