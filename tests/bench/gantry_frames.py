"""The gantry's frames of a swatch, kept beside the bench: they take most of its time, and no bake changes them.

They are made again where anything differs that they may depend on: swatch, frames, size, samples, Blender, or a line of
what builds and renders the scene.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
from measured_materials.addon.gantry.techniques import Case, Frames

_ROOT = Path(__file__).resolve().parents[2]
_SOURCES = ("addon/gantry", "addon/rendering", "addon/studio", "nodes/compat.py")


def kept(folder: Path, name: str, told: str, cases: tuple[Case, ...], make: Callable[[], Frames]) -> Frames:
    """Frames of all the cases, from `folder` where they were kept there, else made.

    Parameters
    ----------
    told : what else they depend on
    """
    wanted = sorted({frame for case in cases for frame in case.frames})
    key = hashlib.sha256(f"{name} {told} {wanted} {bpy.app.version_string}".encode())
    for source in _SOURCES:
        place = _ROOT / source
        for file in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            key.update(file.read_bytes())
    kind = f"{name}-{hashlib.sha256(told.encode()).hexdigest()[:8]}"  # a quick run leaves those of a whole one
    path = folder / f"{kind}-{key.hexdigest()[:16]}.npz"
    if path.is_file():
        with np.load(path) as held:
            return dict(zip(wanted, held["images"], strict=True))
    frames = make()
    folder.mkdir(parents=True, exist_ok=True)
    for older in folder.glob(f"{kind}-*.npz"):
        older.unlink()
    half_written = path.with_suffix(".part")
    with open(half_written, "wb") as stream:
        np.savez(stream, images=np.stack([frames[one] for one in wanted]))
    os.replace(half_written, path)
    return frames
