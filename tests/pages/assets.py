"""The picture of an asset library in a real Blender's asset browser, one of its materials dragged onto a ball."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from commands import save
from PIL import Image

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "real_blender"))
import asset_library as real

_RESOLUTION, _WIDEST = 48, 900


def make(out: Path, folder: Path, place: Path) -> None:
    """Do what `tests/real_blender/asset_library.py` checks, and keep its last picture."""
    share = folder / "asset_library"
    share.mkdir(exist_ok=True)
    for name in ("home", "assets"):
        shutil.rmtree(share / name, ignore_errors=True)
    real.show(place, share, _RESOLUTION)
    save(Image.open(share / "asset_library.png"), out / "asset_library.jpg", _WIDEST)
