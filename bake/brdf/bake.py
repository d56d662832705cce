"""From a BRDF source to a bundle: the one function that the command line and the panel both call."""

from __future__ import annotations

import time
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from .. import VERSION
from ..albedo import albedo_facts
from ..alias_sampler import build_sampler
from ..anisotropic.bake import bake_anisotropic
from ..bundle import Kind, StoredImage, write_bundle
from ..envelope import (
    EnvelopeFit,
    fit_envelope,
    fit_preview,
    lamp_shares,
    pack_weights,
    reconstruction_errors,
    residual_source,
    residual_table,
)
from ..errors import BakeError
from ..origin import file_origin
from ..preview import preview_sphere
from ..result import BakeResult, Progress
from ..source import Array, BrdfSource
from ..sources import read_source
from ..storage import Storage
from ..tables.accuracy import DirectionPairs, direction_pairs, table_errors
from ..tables.bspline_fit import fit_coefficients, sample_spline
from ..tables.grid import Grid
from ..tables.grid_search import GridChoice, best_horizon, choose_grid, refit_grid
from ..tables.stored_table import StoredTable, store_table
from ..tables.table import FILTERS, Filter, Table, tabulate
from ..tables.treated_source import TreatedSource
from .settings import BakeSettings

_ERROR_PAIRS = 32768
KIND: Kind = "brdf"


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
) -> BakeResult:
    """Bake any source, analytic ones included, to the bundle `out`.

    Parameters
    ----------
    progress : called with the stage's name and its share done
    origin : of the measurement, "file" and "sha256", kept in the bundle

    Raises
    ------
    BakeError : the source is all zero, not finite or above 1e36, or the bundle cannot be written
    """
    settings = settings or BakeSettings()
    say = progress or _silent
    started = time.perf_counter()
    if not source.isotropic:
        basis = settings.bases[0] if len(settings.bases) == 1 else "auto"
        return bake_anisotropic(source, out, settings, progress, origin, basis=basis)
    treated = TreatedSource(source)
    pairs = direction_pairs(_ERROR_PAIRS)
    truth = treated.evaluate(pairs.wi, pairs.wo)
    treatment = treated.treatment()
    if not truth.any():
        raise BakeError(source.name, "reflects nothing", "check the file")

    choice = _choose_grid(treated, settings, say)
    grid = best_horizon(treated, choice.grid, pairs, truth)
    table = tabulate(treated, grid, lambda share: say("tabulating", share))
    kept, spline = _store(table, settings, pairs, truth, say)
    stored = kept.table
    say("sampler", 0.0)
    sampler = build_sampler(_sampled(stored), settings.sampler)
    say("measuring", 0.0)
    facts = {
        "generator": f"measured_materials {VERSION}",
        "source": {
            "name": source.name,
            **(origin or {}),
            "facts": source.facts,
            "treatment": treatment,
        },
        "settings": _plain_settings(settings),
        "table": {
            **grid.facts(),
            "filter": settings.filter,
            "spline": spline,
            "storage": str(settings.storage),
            **kept.facts(),
            "total_intensity": table.total_intensity,
        },
        "search": choice.search and choice.search.facts(),
        "choice": choice.facts(),
        "sampler": asdict(settings.sampler),
        "errors": table_errors(stored, settings.filter, pairs, truth),
        "rms_by_filter": _simpler_filters(stored, settings.filter, spline, pairs, truth),
        "albedo": albedo_facts(treated),
        # A coarse table can reflect more light than arrives where the measurement does not; bounces then multiply it.
        "table_albedo": albedo_facts(stored, n=48),
    }
    images = {
        "table": kept.image(),
        "sampler": StoredImage(sampler.texels, Storage.FLOAT32),
    }
    preview = fit_preview(treated)
    facts["preview"] = preview.facts()
    images["preview_weights"] = StoredImage(preview.packed(), Storage.FLOAT32)
    if settings.envelope:
        say("envelope", 0.0)
        extra, images_of_envelope = _envelope(treated, stored, settings, pairs, say)
        facts, images = facts | extra, images | images_of_envelope
    say("writing", 0.0)
    path = write_bundle(out, facts, images, preview_sphere(stored), kind=KIND)
    say("writing", 1.0)
    return BakeResult(path, facts, round(time.perf_counter() - started, 2))


def _silent(stage: str, share: float) -> None:
    pass


def _envelope(
    treated: TreatedSource, table: Table, settings: BakeSettings, pairs: DirectionPairs, say: Progress
) -> tuple[dict[str, Any], dict[str, StoredImage]]:
    """Facts and images of the envelope and of the residual."""
    fit = fit_envelope(treated, progress=lambda share: say("envelope", 0.4 * share))
    grid = _residual_grid(treated, fit, table.grid, settings)
    say("envelope", 0.7)
    rest = residual_source(treated, fit).evaluate(pairs.wi, pairs.wo)
    kept = _quantized(residual_table(treated, fit, grid), settings, pairs, rest)
    # Drawn by and compared with the lamps' light linearly, whatever the filter.
    residual = replace(kept.table, filter="trilinear")
    sampler = build_sampler(residual, settings.sampler)
    errors = reconstruction_errors(treated, fit, residual, table, pairs, settings.filter)
    images = {
        "envelope": StoredImage(pack_weights(fit), Storage.FLOAT32),
        "residual": kept.image(),
        "residual_sampler": StoredImage(sampler.texels, Storage.FLOAT32),
        "residual_share": StoredImage(lamp_shares(fit, residual), Storage.FLOAT32),
    }
    facts = {**kept.facts(), "grid": grid.facts(), "errors": errors}
    return {"envelope": fit.facts(), "residual": facts}, images


def _residual_grid(treated: TreatedSource, fit: EnvelopeFit, grid: Grid, settings: BakeSettings) -> Grid:
    """Of the residual's table: what the envelope leaves of a highlight has another width, and no reciprocity."""
    if settings.bases == ("normal",) and settings.spacing != "auto":
        return grid
    return refit_grid(residual_source(treated, fit), grid, settings.resolution)


def _sampled(table: Table) -> Table:
    """What the sampler follows: the table, and for a spline its values at the nodes, an eighth of the work.

    Between the nodes a spline is smoother than that; the sampler's weights, never its truth, feel the difference
    (tried on a lobe narrower than the spacing: a third more variance).
    """
    if table.filter == "bspline":
        return Table(table.grid, sample_spline(table.grid, table.values))
    return table


def _choose_grid(treated: TreatedSource, settings: BakeSettings, say: Progress) -> GridChoice:
    return choose_grid(
        treated,
        settings.resolution,
        settings.bases,
        settings.spacing,
        settings.alpha,
        lambda share: say("choosing grid", share),
    )


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
        candidates["fitted"] = _quantized(Table(table.grid, coefficients), settings, pairs, truth)
    if len(candidates) == 1:
        ((name, chosen),) = candidates.items()
    else:
        rms = {k: table_errors(kept.table, "bspline", pairs, truth)["rms"] for k, kept in candidates.items()}
        name = min(rms, key=rms.__getitem__)
        chosen = candidates[name]
    return chosen, name


def _quantized(table: Table, settings: BakeSettings, pairs: DirectionPairs, truth: Array) -> StoredTable:
    return store_table(replace(table, filter=settings.filter), settings.storage, pairs, truth)


def _simpler_filters(
    table: Table, filter: Filter, spline: str, pairs: DirectionPairs, truth: Array
) -> dict[str, float]:
    """RMS with this filter and every simpler one that the stored values serve as well: builders may choose."""
    last = FILTERS.index(filter)
    names = FILTERS[last : last + 1] if spline == "fitted" else FILTERS[: last + 1]
    return {name: table_errors(table, name, pairs, truth)["rms"] for name in names}  # type: ignore[arg-type]


def _plain_settings(settings: BakeSettings) -> dict[str, Any]:
    plain = asdict(settings)
    plain["storage"] = str(settings.storage)
    plain["alpha"] = settings.alpha if isinstance(settings.alpha, str) else list(settings.alpha)
    return plain
