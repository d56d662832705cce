"""The measured materials that lie beside the repository, as sources."""

from __future__ import annotations

import importlib.util
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

from measured_materials.bake.source import BrdfSource
from measured_materials.bake.sources import read_source

SHARED = Path(__file__).resolve().parents[3] / "shared"


def require_shared() -> Path:
    """The folder of measurements; ends the bench with one line where it is absent."""
    if not (SHARED / "data").is_dir():
        sys.exit(f"bench: needs the measurements in {SHARED}/data, which are not part of the repository")
    return SHARED


def neural_merl() -> ModuleType:
    """The script that reconstructs MERL materials from published networks."""
    spec = importlib.util.spec_from_file_location("neural_merl", require_shared() / "tools" / "neural_merl.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def merl_file(name: str, folder: Path) -> Path:
    """A reconstruction in MERL's layout."""
    path = folder / f"{name}.binary"
    if not path.exists():
        neural_merl().write(name, path)
    return path


def merl_sources(every: int = 1) -> Iterator[BrdfSource]:
    """The 70 reconstructions, each read through its file."""
    tool = neural_merl()
    with tempfile.TemporaryDirectory() as folder:
        for name in tool.NAMES[::every]:
            path = merl_file(name, Path(folder))
            yield read_source(path)
            path.unlink()


def rgl_files() -> list[Path]:
    """The twelve genuine RGL measurements."""
    return sorted((require_shared() / "data" / "rgl").glob("*.bsdf"))


def cornell_files() -> list[Path]:
    """The three genuine Cornell paints."""
    return sorted((require_shared() / "data" / "cornell").glob("*.brdf"))
