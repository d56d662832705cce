"""From a BRDF source to a bundle: the one function that the command line and the panel both call."""

from __future__ import annotations

import time
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from .. import VERSION
from ..bundle.bundle import Kind, StoredImage, write_bundle
from ..bundle.origin import file_origin
from ..bundle.result import BakeResult, Progress
from ..envelope import EnvelopeFit, pack_weights, reconstruction_errors
from ..errors import BakeError
from ..images.storage import Storage
from ..source import Array, BrdfSource
from ..sources import read_source
from ..tables.accuracy import DirectionPairs, direction_pairs, table_errors
from ..tables.atlas import AtlasLayout
from ..tables.bspline_fit import fit_coefficients, sample_spline
from ..tables.search.grid_search import best_horizon, choose_grid
from ..tables.stored_table import StoredTable, store_table
from ..tables.table import FILTERS, Table, tabulate
from ..tables.treated_source import TreatedSource
from .preview_sphere import preview_sphere
from .reflection import Reflection, ViewerCounts, reflection_of
from .settings import BakeSettings

_ERROR_PAIRS = 32768
KIND: Kind = "brdf"
# Behind the name of each stage of an anisotropic source's bake: they take other times than those of an isotropic one.
KIND_OF_STAGE = ", anisotropic"


def bake_file(
    file: str | Path, out: str | Path, settings: BakeSettings | None = None, progress: Progress | None = None
) -> BakeResult:
    """Bake a measurement in any known format. Raises BakeError; then nothing is written."""
    if progress:
        progress("reading", 0.0)
    started = time.perf_counter()
    source = read_source(file)
    result = bake_source(source, out, settings, progress, file_origin(file))
    return replace(result, seconds=round(time.perf_counter() - started, 2))


def bake_source(
    source: BrdfSource,
    out: str | Path,
    settings: BakeSettings | None = None,
    progress: Progress | None = None,
    origin: dict[str, str] | None = None,
    *,
    viewers: ViewerCounts = (24, 8),
) -> BakeResult:
    """Bake any source, analytic ones included, to the bundle `out`.

    Parameters
    ----------
    progress : called with the stage's name and its share done
    origin : of the measurement, "file" and "sha256", kept in the bundle
    viewers : nodes of an anisotropic envelope's weights in elevation, and in half a turn of the azimuth

    Raises
    ------
    BakeError : the source is all zero, not finite or above 1e36, its table would be too large or cannot have these
        settings, or the bundle cannot be written
    """
    settings, say = settings or BakeSettings(), _named(progress, source)
    started = time.perf_counter()
    treated = TreatedSource(source)
    pairs = direction_pairs(_ERROR_PAIRS, turned=not source.isotropic)
    truth = treated.evaluate(pairs.wi, pairs.wo)
    treatment = treated.treatment()
    if not truth.any():
        raise BakeError(source.name, "reflects nothing", "check the file")

    choice = choose_grid(
        treated,
        settings.resolution,
        settings.bases,
        settings.spacing,
        settings.alpha,
        lambda share: say("choosing grid", share),
    )
    grid = best_horizon(treated, choice.grid, pairs, truth)
    AtlasLayout.of(grid)
    table = tabulate(treated, grid, lambda share: say("tabulating", share))
    kept, spline = _store(table, settings, pairs, truth, say)
    stored = kept.table
    say("sampler", 0.0)
    reflection = reflection_of(treated, grid, choice, settings, viewers)
    sampler = reflection.cells(_sampled(stored), lambda share: say("sampler", share))
    say("measuring", 0.0)
    facts = {
        "generator": f"measured_materials {VERSION}",
        "source": {"name": source.name, **(origin or {}), "facts": source.facts, "treatment": treatment},
        "settings": _plain_settings(settings) | reflection.settings(),
        "table": {
            **({} if source.isotropic else {"anisotropic": True}),
            **grid.facts(),
            "filter": settings.filter,
            "spline": spline,
            "storage": str(settings.storage),
            **kept.facts(),
            "total_intensity": table.total_intensity,
        },
        "search": choice.search and choice.search.facts(),
        "choice": choice.facts(),
        "sampler": asdict(reflection.layout),
        "errors": table_errors(stored, settings.filter, pairs, truth),
        "rms_by_filter": _simpler_filters(stored, spline, pairs, truth),
        "albedo": reflection.albedo(treated),
        # A coarse table can reflect more light than arrives where the measurement does not; bounces then multiply it.
        "table_albedo": reflection.table_albedo(stored),
    }
    images = {"table": kept.image(), "sampler": StoredImage(sampler, Storage.FLOAT32)}
    fit = None
    if settings.envelope:
        fit, extra, further = _envelope(treated, reflection, stored, settings, pairs, say)
        facts, images = facts | extra, images | further
    preview = reflection.preview(fit)
    facts["preview"] = preview.facts()
    images["preview_weights"] = StoredImage(pack_weights(preview), Storage.FLOAT32)
    say("writing", 0.0)
    path = write_bundle(out, facts, images, preview_sphere(stored), kind=KIND)
    say("writing", 1.0)
    return BakeResult(path, facts, round(time.perf_counter() - started, 2))


def _named(progress: Progress | None, source: BrdfSource) -> Progress:
    """Stages are called after the kind of source."""
    suffix = "" if source.isotropic else KIND_OF_STAGE
    return lambda stage, share: progress(stage + suffix, share) if progress else None


def _envelope(
    treated: TreatedSource,
    reflection: Reflection,
    table: Table,
    settings: BakeSettings,
    pairs: DirectionPairs,
    say: Progress,
) -> tuple[EnvelopeFit, dict[str, Any], dict[str, StoredImage]]:
    """The envelope; facts and images of it and of the residual."""
    say("envelope", 0.0)
    fit = reflection.fit_envelope(lambda share: say("envelope", 0.4 * share))
    source = reflection.residual(fit)
    grid = reflection.residual_grid(source, table.grid)
    say("envelope", 0.7)
    kept = _quantized(tabulate(source, grid), settings, pairs, source.evaluate(pairs.wi, pairs.wo))
    # Drawn and compared with the lamps' light linearly, whatever the filter.
    residual = replace(kept.table, filter="trilinear")
    sampler = reflection.cells(residual, lambda share: say("envelope", 0.7 + 0.2 * share))
    errors = reconstruction_errors(treated, fit, residual, table, pairs, settings.filter)
    images = {
        "envelope": StoredImage(pack_weights(fit), Storage.FLOAT32),
        "residual": kept.image(),
        "residual_sampler": StoredImage(sampler, Storage.FLOAT32),
        **{name: StoredImage(image, Storage.FLOAT32) for name, image in reflection.shares(fit, residual).items()},
    }
    facts = {**kept.facts(), "grid": grid.facts(), "errors": errors}
    return fit, {"envelope": fit.facts(), "residual": facts}, images


def _sampled(table: Table) -> Table:
    """What the sampler follows: the table, and for a spline its values at the nodes, an eighth of the work.

    Between the nodes a spline is smoother than that; the sampler's weights, never its truth, feel the difference
    (tried on a lobe narrower than the spacing: a third more variance).
    """
    if table.filter == "bspline":
        return Table(table.grid, sample_spline(table.grid, table.values))
    return table


def _store(
    table: Table, settings: BakeSettings, pairs: DirectionPairs, truth: Array, say: Progress
) -> tuple[StoredTable, str]:
    """The table as it will come back from the file, and what its values are."""
    if settings.filter != "bspline":
        return _quantized(table, settings, pairs, truth), "none"
    candidates = {}
    if settings.spline != "fitted":
        candidates["plain"] = _quantized(table, settings, pairs, truth)
    if settings.spline != "plain":
        coefficients = fit_coefficients(table.grid, table.values, lambda share: say("fitting spline", share))
        candidates["fitted"] = _quantized(replace(table, values=coefficients), settings, pairs, truth)
    if len(candidates) == 1:
        ((name, chosen),) = candidates.items()
    else:
        rms = {k: table_errors(kept.table, "bspline", pairs, truth)["rms"] for k, kept in candidates.items()}
        name = min(rms, key=rms.__getitem__)
        chosen = candidates[name]
    return chosen, name


def _quantized(table: Table, settings: BakeSettings, pairs: DirectionPairs, truth: Array) -> StoredTable:
    return store_table(replace(table, filter=settings.filter), settings.storage, pairs, truth)


def _simpler_filters(table: Table, spline: str, pairs: DirectionPairs, truth: Array) -> dict[str, float]:
    """RMS with its filter and every simpler one that the stored values serve as well: builders may choose."""
    last = FILTERS.index(table.filter)
    names = FILTERS[last : last + 1] if spline == "fitted" else FILTERS[: last + 1]
    return {name: table_errors(table, name, pairs, truth)["rms"] for name in names}  # type: ignore[arg-type]


def _plain_settings(settings: BakeSettings) -> dict[str, Any]:
    plain = asdict(settings)
    plain["storage"] = str(settings.storage)
    plain["alpha"] = settings.alpha if isinstance(settings.alpha, str) else list(settings.alpha)
    return plain
