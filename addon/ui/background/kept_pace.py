"""How long bakes take here, kept for the next session in the extension's own folder, which goes with it."""

from __future__ import annotations

import contextlib
import json
import math
import os
from pathlib import Path

import bpy

from ...summary.quality_levels import learned, recall

# Beyond these a number is damage, or a computer that slept.
_LEAST, _MOST = 0.01, 100.0


def file() -> Path | None:
    """Where it is kept; None where this is no extension that Blender has installed."""
    package = (__package__ or "").partition(".addon.")[0]
    try:
        return Path(bpy.utils.extension_path_user(package)) / "bakes.json"
    except (AttributeError, ValueError, OSError):
        return None


def keep() -> None:
    """Write what was learned; where that fails, the next session learns it anew."""
    path = file()
    if path is None:
        return
    with contextlib.suppress(OSError, ValueError):
        path.parent.mkdir(parents=True, exist_ok=True)
        beside = path.with_suffix(f".{os.getpid()}")
        try:
            beside.write_text(json.dumps({"ratios": learned()}), encoding="utf-8")
            beside.replace(path)
        finally:
            beside.unlink(missing_ok=True)


def register() -> None:
    """Called by `addon.register`."""
    path = file()
    if path is None:
        return
    with contextlib.suppress(OSError, ValueError, TypeError, KeyError, OverflowError, RecursionError):
        ratios = json.loads(path.read_text(encoding="utf-8"))["ratios"]
        numbers = [float(one) for one in ratios]
        recall([one for one in numbers if math.isfinite(one) and _LEAST <= one <= _MOST])


def unregister() -> None:
    """Called by `addon.unregister`."""
