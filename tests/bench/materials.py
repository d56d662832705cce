"""The measured materials that lie beside the repository, as sources."""

from __future__ import annotations

import importlib.util
import itertools
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

from measured_materials.bake.reading import Reading
from measured_materials.bake.source import BrdfSource
from measured_materials.bake.sources import read_source
from measured_materials.bake.sources.analytic import AshikhminShirley, Ggx, Lambert, MetallicPaint, OrenNayar, Ward

SHARED = Path(__file__).resolve().parents[3] / "shared"


# What stands in for measurements where there are none, matte to glossy.
ANALYTIC: dict[str, BrdfSource] = {
    "Lambert": Lambert(),
    "Oren-Nayar": OrenNayar(),
    "satin (Ward 0.3)": Ward(alpha=0.3, diffuse=(0.3, 0.1, 0.05), specular=0.2),
    "plastic (Ashikhmin-Shirley 50)": AshikhminShirley(exponent=50),
    "metal (GGX 0.3)": Ggx(alpha=0.3),
    "metallic paint": MetallicPaint(),
    "metal (GGX 0.1)": Ggx(alpha=0.1),
    "plastic (Ashikhmin-Shirley 1000)": AshikhminShirley(exponent=1000),
    "mirror (GGX 0.02)": Ggx(alpha=0.02),
}


def has_measurements() -> bool:
    """Whether they lie beside the repository; says in one line what is taken instead."""
    if (SHARED / "data").is_dir():
        return True
    print(f"no measurements in {SHARED}/data, which are not part of the repository: analytic materials instead")
    return False


def all_sources(quick: bool) -> Iterator[tuple[str, BrdfSource]]:
    """Name and source of the 70 reconstructions and the twelve RGL files (with `quick` every tenth and three)."""
    if not has_measurements():
        yield from ANALYTIC.items()
        return
    yield from ((source.name, source) for source in merl_sources(10 if quick else 1))
    yield from ((path.stem, read_source(path)) for path in itertools.islice(rgl_files(), 3 if quick else None))


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
            yield read_source(path, Reading(merl="nodes"))
            path.unlink()


def rgl_files() -> list[Path]:
    """The twelve genuine RGL measurements."""
    return sorted((require_shared() / "data" / "rgl").glob("*.bsdf"))


def cornell_files() -> list[Path]:
    """The three genuine Cornell paints."""
    return sorted((require_shared() / "data" / "cornell").glob("*.brdf"))
