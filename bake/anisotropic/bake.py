"""From an anisotropic source to a bundle; `bake.bake_brdf.bake_source` hands those that are not isotropic over."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from .. import VERSION
from ..albedo import directional_albedo, white_sky_albedo
from ..bundle import StoredImage, write_bundle
from ..errors import BakeError
from ..preview import preview_sphere
from ..source import Array, BrdfSource
from ..storage import Storage
from ..tables.accuracy import DirectionPairs, direction_pairs, table_errors
from ..tables.anisotropic_grids import AnisotropicHalfGrid
from ..tables.anisotropic_search import Symmetry, choose_grid, measured_symmetry
from ..tables.atlas import AtlasLayout
from ..tables.grid import Grid
from ..tables.stored_table import StoredTable, store_table
from ..tables.table import FILTERS, Filter, Table, tabulate
from ..tables.treated_source import TreatedSource
from .envelope import AnisotropicResidual, fit_anisotropic_envelope, fit_anisotropic_preview, preview_error
from .envelope_texture import guarded_share, pack_weights
from .sampler import SlopeLayout, build_slope_sampler
from .views import ViewerGrid

if TYPE_CHECKING:
    from ..brdf.settings import BakeSettings
    from ..result import BakeResult, Progress

# Behind the name of each stage.
KIND_OF_STAGE = ", anisotropic"
_ERROR_PAIRS = 16384
_DEGREES = (0, 10, 20, 30, 40, 50, 60, 70, 75, 80, 85, 88)
_AZIMUTHS = 8
# Cells follow the lobe more closely than samples, which have to serve its tail too.
_CELL_WIDTH = 0.5


def bake_anisotropic(
    source: BrdfSource,
    out: str | Path,
    settings: BakeSettings,
    progress: Progress | None = None,
    origin: dict[str, str] | None = None,
    *,
    basis: str = "auto",
    viewers: tuple[int, int] = (24, 8),
) -> BakeResult:
    """Bake an anisotropic source to the bundle `out`.

    Parameters
    ----------
    settings : of the resolution n see `choice.half_shape`, of the parameterisation `choice.choose_grid`; a spline takes
        the samples as they are
    basis : "half", "normal" or "auto"
    viewers : nodes of the envelope's weights in elevation, and in half a turn of the azimuth
    progress : called with the stage's name and its share done

    Raises
    ------
    BakeError : the source is all zero or not finite, its table would be too large, or the bundle cannot be written
    """
    from ..result import BakeResult

    say = _named(progress)
    started = time.perf_counter()
    treated = TreatedSource(source)
    pairs = direction_pairs(_ERROR_PAIRS, turned=True)
    truth = treated.evaluate(pairs.wi, pairs.wo)
    treatment = treated.treatment()
    if not truth.any():
        raise BakeError(source.name, "reflects nothing", "check the file")
    symmetry = measured_symmetry(treated, pairs, truth)
    grid, search = choose_grid(
        treated,
        settings.resolution,
        symmetry,
        basis,
        lambda share: say("choosing grid", share),
        parameterization=settings.spacing,
        alpha=settings.alpha,
    )
    AtlasLayout.of(grid)
    kept = quantized(tabulate(treated, grid, lambda share: say("tabulating", share)), settings, pairs, truth)
    table = kept.table
    say("sampler", 0.0)
    layout = sampler_layout(settings, grid, symmetry, search)
    sampler = build_slope_sampler(table, layout, partial(say, "sampler"))
    say("measuring", 0.0)
    simpler = cast("tuple[Filter, ...]", FILTERS[: FILTERS.index(settings.filter) + 1])
    facts: dict[str, Any] = {
        "generator": f"measured_materials {VERSION}",
        "source": {"name": source.name, **(origin or {}), "facts": source.facts, "treatment": treatment},
        "settings": {"resolution": settings.resolution, "storage": str(settings.storage), "filter": settings.filter},
        "table": {
            "anisotropic": True,
            **grid.facts(),
            "filter": settings.filter,
            "spline": "plain" if settings.filter == "bspline" else "none",
            "storage": str(settings.storage),
            **kept.facts(),
            **symmetry.facts(),
        },
        "search": search,
        "sampler": asdict(layout),
        "errors": table_errors(table, settings.filter, pairs, truth),
        "rms_by_filter": {name: table_errors(table, name, pairs, truth)["rms"] for name in simpler},
        "albedo": mean_albedo(treated),
    }
    images = {
        "table": kept.image(),
        "sampler": StoredImage(sampler.texels, Storage.FLOAT32),
    }
    if settings.envelope:
        say("envelope", 0.0)
        fitted = partial(say, "envelope")
        extra, further = _envelope(treated, table, layout, viewers, settings, pairs, truth, fitted)
        facts, images = facts | extra, images | further
    say("writing", 0.0)
    path = write_bundle(out, facts, images, preview_sphere(table))
    say("writing", 1.0)
    return BakeResult(path, facts, round(time.perf_counter() - started, 2))


def _envelope(
    treated: TreatedSource,
    table: Table,
    layout: SlopeLayout,
    viewers: tuple[int, int],
    settings: BakeSettings,
    pairs: DirectionPairs,
    truth: Array,
    say: Callable[[float], None],
) -> tuple[dict[str, Any], dict[str, StoredImage]]:
    """Facts and images of the envelope, of the residual, whose table has the grid of the whole one, and of Preview."""
    nodes = ViewerGrid(viewers[0], viewers[1] * (1 if layout.folded else 2), layout.folded)
    widths = layout.width_x, layout.width_y
    fit = fit_anisotropic_envelope(treated, nodes, widths, lambda share: say(0.6 * share))
    preview = fit_anisotropic_preview(treated, fit, widths)
    say(0.7)
    source = AnisotropicResidual(treated, fit)
    kept = quantized(tabulate(source, table.grid), settings, pairs, source.evaluate(pairs.wi, pairs.wo))
    residual = kept.table
    say(0.8)
    sampler = build_slope_sampler(residual, layout, lambda share: say(0.8 + 0.15 * share))
    say(0.95)
    together = fit.evaluate(pairs.wi, pairs.wo) + residual.evaluate(pairs.wi, pairs.wo)
    errors = {
        "rms": pairs.rms(together - truth),
        "relative": pairs.relative_error(together - truth, truth),
    }
    plain = {key: fit.facts()[key] for key in ("closures", "n_theta", "n_phi", "folded")}
    plain["error"] = round(preview_error(treated, replace(fit, weights=preview), widths), 6)
    facts = {**kept.facts(), "errors": {"envelope_and_residual": errors}}
    images = {
        "envelope": StoredImage(pack_weights(fit.weights, guarded_share(fit)), Storage.FLOAT32),
        "residual": kept.image(),
        "residual_sampler": StoredImage(sampler.texels, Storage.FLOAT32),
        "preview_weights": StoredImage(pack_weights(preview), Storage.FLOAT32),
    }
    return {"envelope": fit.facts(), "preview": plain, "residual": facts}, images


def _named(progress: Progress | None) -> Progress:
    """Stages are called after the kind of bake: they take other times than those of isotropic ones."""
    if progress is None:
        return lambda stage, share: None
    return lambda stage, share: progress(stage + KIND_OF_STAGE, share)


def sampler_layout(settings: BakeSettings, grid: Grid, symmetry: Symmetry, search: dict[str, Any]) -> SlopeLayout:
    """Bins and cells of the sizes that the settings have for isotropic materials, shared between two axes each."""
    wanted = settings.sampler
    bins, cells = max(4, wanted.n_o // 4), max(8, round((wanted.n_h * wanted.n_phi) ** 0.5) * 2 // 3)
    if isinstance(grid, AnisotropicHalfGrid):
        widths = grid.width_x, grid.width_y
    else:
        # The normal basis knows no slopes.
        widths = 0.3, 0.3
    return SlopeLayout(bins, bins, cells, cells, _CELL_WIDTH * widths[0], _CELL_WIDTH * widths[1], symmetry.half_turn)


def quantized(table: Table, settings: BakeSettings, pairs: DirectionPairs, truth: Array) -> StoredTable:
    """The table as it will come back from the file, with the filter chosen."""
    table = replace(table, filter=settings.filter)
    return store_table(table, settings.storage, pairs, truth)


def mean_albedo(source: BrdfSource) -> dict[str, Any]:
    """As `bake.albedo.albedo_facts`, by elevation the mean over the viewer's azimuth; "largest" is that of any."""
    azimuths = np.arange(_AZIMUTHS) * (2 * np.pi / _AZIMUTHS) + 0.1
    rows = np.array([directional_albedo(source, np.radians(_DEGREES), 48, float(phi)) for phi in azimuths])
    degrees = np.array(_DEGREES)
    return {
        "theta_o_deg": degrees.tolist(),
        "directional": rows.mean(0).round(6).tolist(),
        "white_sky": white_sky_albedo(source, 48).round(6).tolist(),
        "largest": round(float(rows.max()), 6),
        "above_one_deg": degrees[rows.max((0, 2)) > 1.001].tolist(),
    }
