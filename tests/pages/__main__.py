"""`./run docs [NAME ...] [--window BLENDER]`: the pictures of the pages for people, made again into addon/docs."""

from __future__ import annotations

import argparse
import importlib
import sys
import tempfile
import time
from pathlib import Path

PICTURES = {
    "setup": "setup.jpg: how a swatch is photographed, drawn",
    "sheets": "lampshade.jpg, curtain.jpg: light through cloth, photographed and of a formula",
    "swatch": "swatch_photographs.jpg, swatch_plot.jpg, swatch.jpg: denim of the gantry, to the material",
    "turned": "turned.jpg: suede and cloth turned under a lamp: geometry, map over azimuth, map of one arc",
    "fig4": "fig4.jpg: wool and cloth rolled up: geometry, compressed BTF, shading map, map over azimuth",
    "gallery": "gallery.jpg: one material for each command of gallery.md",
    "quieter": "quieter.jpg: a paint by Principled and Exact, before and after lamps were sampled, denoised or not",
    "formats": "formats.jpg: a sphere of each format, on formats.md",
    "store": "store/icon.png, store/featured.jpg: what is uploaded beside the zip",
    "window": "window_*.jpg: a real Blender at work; only with --window",
    "assets": "asset_library.jpg: an asset library in a real Blender; only with --window",
}
_IN_A_WINDOW = ("window", "assets")
DOCS = Path(__file__).resolve().parents[2] / "addon" / "docs"


def main() -> int:
    """Make those asked for, or all."""
    listing = "\n".join(f"  {name:8s} {what}" for name, what in PICTURES.items())
    parser = argparse.ArgumentParser(
        prog="./run docs",
        description=__doc__,
        epilog="pictures:\n" + listing + "\n\ndemo.jpg, arc.jpg and the plots: see ./run demo and ./run bench.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("names", nargs="*", choices=[*PICTURES, []], metavar="NAME")
    parser.add_argument("--window", type=Path, metavar="BLENDER", help="the program, or a folder to chroot into")
    parser.add_argument("--out", type=Path, default=DOCS, help="folder (default: addon/docs)")
    parser.add_argument("--work", type=Path, metavar="DIR", help="keep what is baked here, and take what is there")
    options = parser.parse_args()
    names = options.names or [name for name in PICTURES if name not in _IN_A_WINDOW or options.window]
    for name in (name for name in _IN_A_WINDOW if name in names and not options.window):
        parser.error(f"{name} needs --window BLENDER")
    options.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as temporary:
        # What one bakes the others take.
        folder = options.work or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        for name in names:
            began = time.perf_counter()
            more = [options.window] if name in _IN_A_WINDOW else []
            importlib.import_module(name).make(options.out.resolve(), folder.resolve(), *more)
            print(f"docs {name}: {time.perf_counter() - began:.0f} s", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
