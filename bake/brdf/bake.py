"""From a BRDF source to a bundle: the one function that the command line and the panel both call."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from .. import VERSION
from ..bundle.bundle import Kind, write_bundle
from ..bundle.origin import file_origin, model_origin
from ..bundle.recipe import RECIPE, recipe_of
from ..bundle.result import BakeResult, Progress
from ..source import BrdfSource, Json, SheetSource
from ..sources import chosen_material, read_source
from .part_bake import PartBake
from .preview_sphere import preview_sphere
from .reflection import reflection_of
from .samplers import layout_facts
from .settings import BakeSettings
from .sheet_bake import KIND_OF_SHEET, sheet_parts

_ERROR_PAIRS = 32768
KIND: Kind = "brdf"
# Behind the name of each stage of an anisotropic source's bake: they take other times than those of an isotropic one.
KIND_OF_STAGE = ", anisotropic"


def bake_file(
    file: str | Path,
    out: str | Path,
    settings: BakeSettings | None = None,
    progress: Progress | None = None,
    on_read: Callable[[BrdfSource, dict[str, str]], None] | None = None,
) -> BakeResult:
    """Bake a measurement in any known format. Raises BakeError; then nothing is written.

    `on_read` is called with the source and its origin before they are baked.
    """
    if progress:
        progress("reading", 0.0)
    started = time.perf_counter()
    reading = (settings or BakeSettings()).reading
    source = read_source(file, reading)
    origin = file_origin(file, chosen_material(file, reading))
    if on_read:
        on_read(source, origin)
    result = bake_source(source, out, settings, progress, origin)
    return replace(result, seconds=round(time.perf_counter() - started, 2))


def bake_source(
    source: BrdfSource,
    out: str | Path,
    settings: BakeSettings | None = None,
    progress: Progress | None = None,
    origin: dict[str, str] | None = None,
    pairs: int | None = None,
) -> BakeResult:
    """Bake any source, analytic ones included, to the bundle `out`.

    Parameters
    ----------
    progress : called with the stage's name and its share done
    origin : of the measurement, "file" and "sha256", kept in the bundle
    pairs : of directions that errors are measured at; by default as many as make them sure

    Raises
    ------
    BakeError : the source is all zero, not finite or above 1e36, its table would be too large or cannot have these
        settings, or the bundle cannot be written
    """
    settings = settings or BakeSettings()
    started = time.perf_counter()
    say = _named(progress, source)
    bake = PartBake(source, settings, say, pairs or _ERROR_PAIRS)
    part = bake.baked(reflection_of)
    facts: dict[str, Json] = {
        "generator": f"measured_materials {VERSION}",
        "source": {"name": source.name, **(origin or {}), "facts": source.facts, "treatment": bake.treatment},
        "settings": _plain_settings(settings, source),
        **_recipe(settings, source, origin),
        **settings.rights.entry(),
        **part.facts,
    }
    images = part.images
    if isinstance(source, SheetSource):
        same = replace(settings, filter=bake.filter)
        facts["sheet"], further = sheet_parts(source, same, say, pairs or _ERROR_PAIRS)
        images = images | further
    say("writing", 0.0)
    path = write_bundle(out, facts, images, preview_sphere(part.table), kind=KIND)
    say("writing", 1.0)
    return BakeResult(path, facts, round(time.perf_counter() - started, 2))


def _recipe(settings: BakeSettings, source: BrdfSource, origin: dict[str, str] | None) -> dict[str, str]:
    """The bundle's recipe, where the source's content is known: that of a file, or of a formula."""
    if origin is None and source.facts.get("format") != "analytic":
        return {}
    return {RECIPE: recipe_of(settings, origin or model_origin(source.name, source.facts))}


def _named(progress: Progress | None, source: BrdfSource) -> Progress:
    """Stages are called after the kind of source."""
    suffix = ("" if source.isotropic else KIND_OF_STAGE) + (KIND_OF_SHEET if isinstance(source, SheetSource) else "")
    return lambda stage, share: progress(stage + suffix, share) if progress else None


def _plain_settings(settings: BakeSettings, source: BrdfSource) -> dict[str, Any]:
    """All that has an effect on such a source, JSON-ready."""
    plain = asdict(settings)
    plain["viewers"] = list(settings.viewers)
    del plain["rights"]
    plain["reading"] = settings.reading.told()
    if "material" not in source.facts:
        plain["reading"].pop("material", None)
    if not plain["reading"] or source.facts.get("format") == "analytic":
        del plain["reading"]
    if source.isotropic:
        del plain["viewers"]
    if settings.table_bytes is None:
        del plain["table_bytes"]
    plain["storage"] = str(settings.storage)
    plain["sampler"] = layout_facts(settings.sampler)
    plain["alpha"] = settings.alpha if isinstance(settings.alpha, str) else list(settings.alpha)
    return plain
