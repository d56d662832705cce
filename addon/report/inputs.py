"""What a report is made of: measured BRDFs, and swatches as photographs or baked maps; built-in ones without any."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...bake.brdf.common import kind_of
from ...bake.bundle.bundle import MATERIAL, is_bundle, read_bundle
from ...bake.errors import BakeError
from ...bake.photographs.folder import find_photographs
from ...bake.source import BrdfSource
from ...bake.sources import read_source
from ...bake.sources.analytic import by_name

# By formula, so that everyone has them: a sharp coat over flakes, a matte one, brushed metal.
_SOURCES: dict[str, tuple[str, dict[str, Any]]] = {
    "paint": ("metallic-paint", {}),
    "matte": ("oren-nayar", {}),
    "brushed metal": ("ggx", {"alpha": 0.06, "alpha_y": 0.35, "f0": (0.9, 0.75, 0.55)}),
}
# Threads, and a gloss, on which few slices fail.
_SWATCHES = ("cloth", "plastic_60")


@dataclass(frozen=True)
class Inputs:
    """Inputs of a report: what to measure.

    Parameters
    ----------
    sources : name to measured BRDF
    swatches : name to a folder of photographs or a baked map; None for a built-in one of that name
    origin : JSON-ready; changes whenever an input does
    """

    sources: dict[str, BrdfSource]
    swatches: dict[str, Path | None]
    origin: list[Any]


def built_in_inputs(quick: bool) -> Inputs:
    """One of each kind, or all."""
    wanted = dict(list(_SOURCES.items())[: 1 if quick else None])
    sources: dict[str, BrdfSource] = {name: by_name(model, **p) for name, (model, p) in wanted.items()}
    swatches = _SWATCHES[: 1 if quick else None]
    return Inputs(sources, dict.fromkeys(swatches), ["built-in", *sources, *swatches])


def read_inputs(paths: Sequence[Path]) -> Inputs:
    """Files of measured BRDFs are read; folders are only looked into. Raises BakeError."""
    sources: dict[str, BrdfSource] = {}
    swatches: dict[str, Path | None] = {}
    origin = []
    for path in paths:
        if path.is_dir():
            name = path.resolve().stem if is_bundle(path) else path.resolve().name
            _refuse_twice(name, sources, swatches)
            swatches[name] = path
            origin.append([name, *_photographs(path)])
        else:
            source = read_source(path)
            _refuse_twice(source.name, sources, swatches)
            sources[source.name] = source
            origin.append([source.name, hashlib.sha256(path.read_bytes()).hexdigest()])
    return Inputs(sources, swatches, origin)


def _photographs(folder: Path) -> list[Any]:
    """Names, sizes and times: to read them all would take as long as measuring them."""
    if is_bundle(folder):
        if kind_of(read_bundle(folder).material) != "shading_map":
            raise BakeError(folder, "is a baked BRDF", "give the measurement that it was baked from")
        return [hashlib.sha256((folder / MATERIAL).read_bytes()).hexdigest()]
    paths, _ = find_photographs(folder, ())
    others = [path for path in folder.iterdir() if path.suffix.lower() in (".csv", ".lp")]
    facts = [(path.name, path.stat().st_size, path.stat().st_mtime_ns) for path in (*paths, *others)]
    return [list(fact) for fact in sorted(facts)]


def _refuse_twice(name: str, *found: dict[str, Any]) -> None:
    if any(name in each for each in found):
        raise BakeError(name, "is the name of two inputs", "give one of them another name")
