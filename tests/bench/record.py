"""Figures of a bench by name, as they stand in the README: kept while it runs, then written for comparison.

A bench calls `put` with every figure that a text states. After it, `out/bench/NAME.json` holds them; `--record` also
writes `tests/bench/recorded/NAME.json`, which the suite holds the README to (`readme_figures.py`).
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import time
from pathlib import Path
from typing import Any

RECORDED = Path(__file__).resolve().parent / "recorded"
_values: dict[str, float] = {}


def _commit() -> str:
    """With a plus sign where the files differ from it."""
    root = Path(__file__).resolve().parents[2]
    call = ["git", "-C", str(root), "describe", "--always", "--dirty=+", "--exclude=*"]
    try:
        return subprocess.run(call, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


# Of what is measured: files that are edited while a bench runs are not what it has loaded.
_COMMIT = _commit()


def put(name: str, value: float) -> None:
    """Keep a figure; the last of a name counts."""
    _values[name] = float(value)


def put_range(name: str, values: Any) -> None:
    """Keep the least and the most of several, as `NAME, least` and `NAME, most`."""
    found = [float(value) for value in values]
    put(f"{name}, least", min(found))
    put(f"{name}, most", max(found))


def taken() -> dict[str, float]:
    """All figures kept so far, to six digits; the next bench begins with none."""
    found = {name: float(f"{value:.6g}") for name, value in _values.items()}
    _values.clear()
    return found


def write(path: Path, bench: str, quick: bool, seconds: float, values: dict[str, float]) -> None:
    """One JSON object: what was measured, and of what, when, where and how."""
    document = {
        "bench": bench,
        "quick": quick,
        "commit": _COMMIT,
        "date": time.strftime("%Y-%m-%d"),
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores",
        "blender": _blender(),
        "seconds": round(seconds),
        "values": dict(sorted(values.items())),
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


def read(bench: str, folder: Path = RECORDED) -> dict[str, Any] | None:
    """What was recorded of a bench last; None where nothing was."""
    path = folder / f"{bench}.json"
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else None


def _blender() -> str:
    import bpy

    return str(bpy.app.version_string)
