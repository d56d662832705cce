"""From a BRDF source to a bundle: the one function that the command line and the panel both call."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, get_args

from . import VERSION
from .accuracy import DirectionPairs, direction_pairs, table_errors
from .albedo import albedo_facts
from .anisotropic.bake import bake_anisotropic
from .atlas import pack
from .brdf.grids import MAX_RESOLUTION
from .bspline_fit import fit_coefficients, sample_spline
from .bundle import Kind, StoredImage, write_bundle
from .envelope import (
    EnvelopeFit,
    ResidualSource,
    fit_envelope,
    fit_preview,
    lamp_shares,
    pack_weights,
    reconstruction_errors,
)
from .errors import BakeError
from .grid_search import BASES, Basis, GridChoice, best_horizon, choose_grid, refit_grid
from .origin import file_origin
from .parameterization import PARAMETERIZATIONS, Parameterization
from .preview import preview_sphere
from .sampling.cell_sampler import build_sampler
from .sampling.half_vector_cells import SamplerLayout
from .source import Array, BrdfSource
from .sources import read_source
from .storage import TABLE_STORAGES, Storage
from .table import FILTERS, BrdfTable, Filter, Grid, TreatedSource, pad_slices, tabulate
from .table_storage import StoredTable, store_table

AlphaChoice = Literal["error", "intensity"]
SplineFit = Literal["auto", "plain", "fitted"]
Progress = Callable[[str, float], None]

_ERROR_PAIRS = 32768
KIND: Kind = "brdf"


@dataclass(frozen=True)
class BakeSettings:
    """What the user chooses.

    Parameters
    ----------
    resolution : samples per elevation, N of the N x N x 2N table in the normal-vector basis; one in the half-vector
        basis has as many bytes
    parameterization : of the table's axes, or "auto": of least error
    alpha : how the Bezier shape is chosen, "error", "intensity", or a given (alpha_theta, alpha_phi). The latter two
        are of the normal-vector basis: with them "auto" means a Bezier table in that basis
    storage : of the table's texels
    filter : that the material reconstructs with
    spline : coefficients for filter "bspline": the samples themselves as in MY16, fitted >= 0, or whichever of the
        two has the smaller measured error (a peak between two samples is better left smooth)
    sampler : sizes of the alias tables
    envelope : also fit native closures under the measurement, and bake what they leave, for modes "exact", "balanced"
    basis : "normal" (theta_o, theta_i, phi_delta), "half" (theta_d, theta_h, phi_d), or "auto": of least error
    """

    resolution: int = 64
    parameterization: Parameterization | Literal["auto"] = "auto"
    alpha: AlphaChoice | tuple[float, float] = "error"
    storage: Storage = Storage.HALF
    filter: Filter = "trilinear"
    spline: SplineFit = "auto"
    sampler: SamplerLayout = field(default_factory=SamplerLayout)
    envelope: bool = True
    basis: Basis | Literal["auto"] = "auto"

    def __post_init__(self) -> None:
        _check(
            "resolution",
            4 <= self.resolution <= MAX_RESOLUTION,
            f"from 4 to {MAX_RESOLUTION}",
            self.resolution,
        )
        _check_choice("basis", self.basis, (*BASES, "auto"))
        _check_choice("parameterization", self.parameterization, (*PARAMETERIZATIONS, "auto"))
        _check_choice("filter", self.filter, FILTERS)
        _check_choice("spline", self.spline, get_args(SplineFit))
        _check_choice("storage", str(self.storage), TABLE_STORAGES)
        object.__setattr__(self, "storage", Storage(self.storage))
        if isinstance(self.alpha, str):
            _check_choice("alpha", self.alpha, get_args(AlphaChoice))
        else:
            _check("alpha", all(0 <= a <= 1 for a in self.alpha), "two numbers in [0, 1]", self.alpha)
        if self.alpha != "error":
            _check("alpha", self.basis != "half", "alpha error, or basis normal", f"{self.alpha} in the half basis")

    @property
    def bases(self) -> tuple[str, ...]:
        """Those to choose from."""
        if self.basis == "auto":
            return BASES if self.alpha == "error" else ("normal",)
        return (self.basis,)

    @property
    def spacing(self) -> Parameterization | Literal["auto"]:
        """The parameterisation, or "auto" where it is to be chosen."""
        return "bezier" if self.parameterization == "auto" and self.alpha != "error" else self.parameterization


def _check(name: str, ok: bool, wanted: str, given: object) -> None:
    if not ok:
        raise BakeError(name, f"cannot be {given}", f"choose {wanted}")


def _check_choice(name: str, given: str, choices: tuple[str, ...]) -> None:
    _check(name, given in choices, " or ".join(choices), given)


@dataclass(frozen=True)
class BakeResult:
    """Where the bundle is, the facts that were written into it, and the time from the call to the finished bundle."""

    path: Path
    facts: dict[str, Any]
    seconds: float


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
    treatment = treated.facts()
    if not truth.any():
        raise BakeError(source.name, "reflects nothing", "check the file")

    choice = _choose_grid(treated, settings, say)
    grid = best_horizon(treated, choice.grid, pairs, truth)
    table = tabulate(treated, grid, lambda share: say("tabulating", share))
    kept, spline = _store(table, settings, pairs, truth, say)
    stored = kept.table
    say("sampler", 0.0)
    sampler = build_sampler(_sampled(stored, settings.filter), settings.sampler)
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
        "albedo": albedo_facts(treated_protocol(treated)),
        # A coarse table can reflect more light than arrives where the measurement does not; bounces then multiply it.
        "table_albedo": albedo_facts(TableSource(stored, settings.filter), n=48),
    }
    images = {
        "table": kept.image(pack(stored.values)),
        "sampler": StoredImage(sampler.texels, Storage.FLOAT32),
    }
    preview = fit_preview(treated)
    facts["preview"] = preview.facts()
    images["preview_weights"] = StoredImage(pack_weights(preview), Storage.FLOAT32)
    if settings.envelope:
        say("envelope", 0.0)
        extra, images_of_envelope = _envelope(treated, stored, settings, pairs, say)
        facts, images = facts | extra, images | images_of_envelope
    say("writing", 0.0)
    path = write_bundle(out, facts, images, preview_sphere(stored, settings.filter), kind=KIND)
    say("writing", 1.0)
    return BakeResult(path, facts, round(time.perf_counter() - started, 2))


def _silent(stage: str, share: float) -> None:
    pass


class TableSource:
    """A table as a source: what is rendered rather than what was measured."""

    isotropic = bilateral = True

    def __init__(self, table: BrdfTable, filter: Filter) -> None:
        self.table, self.filter, self.name = table, filter, "table"
        self.facts: dict[str, Any] = {}

    def evaluate(self, wi: Array, wo: Array) -> Array:
        return self.table.evaluate(wi, wo, self.filter)


def _envelope(
    treated: TreatedSource, table: BrdfTable, settings: BakeSettings, pairs: DirectionPairs, say: Progress
) -> tuple[dict[str, Any], dict[str, StoredImage]]:
    """Facts and images of the envelope and of the residual."""
    fit = fit_envelope(treated, progress=lambda share: say("envelope", 0.4 * share))
    grid = _residual_grid(treated, fit, table.grid, settings)
    say("envelope", 0.7)
    source = ResidualSource(treated, fit)
    kept = _quantized(tabulate(source, grid), settings, pairs, source.evaluate(pairs.wi, pairs.wo))
    residual = kept.table
    sampler = build_sampler(TableSource(residual, "trilinear"), settings.sampler)
    errors = reconstruction_errors(treated, fit, residual, table, pairs, settings.filter)
    images = {
        "envelope": StoredImage(pack_weights(fit), Storage.FLOAT32),
        "residual": kept.image(pack(residual.values)),
        "residual_sampler": StoredImage(sampler.texels, Storage.FLOAT32),
        "residual_share": StoredImage(lamp_shares(fit, residual), Storage.FLOAT32),
    }
    facts = {**kept.facts(), "grid": grid.facts(), "errors": errors}
    return {"envelope": fit.facts(), "residual": facts}, images


def _residual_grid(treated: TreatedSource, fit: EnvelopeFit, grid: Grid, settings: BakeSettings) -> Grid:
    """Of the residual's table: what the envelope leaves of a highlight has another width, and no reciprocity."""
    if settings.bases == ("normal",) and settings.spacing != "auto":
        return grid
    return refit_grid(ResidualSource(treated, fit), grid, settings.resolution)


def _sampled(table: BrdfTable, filter: Filter) -> BrdfSource:
    """What the sampler follows: the table, and for a spline its values at the nodes, an eighth of the work.

    Between the nodes a spline is smoother than that; the sampler's weights, never its truth, feel the difference
    (tried on a lobe narrower than the spacing: a third more variance).
    """
    if filter == "bspline":
        return TableSource(BrdfTable(table.grid, sample_spline(table.values)), "trilinear")
    return TableSource(table, filter)


def treated_protocol(treated: TreatedSource) -> BrdfSource:
    """The treated measurement as a BRDF source."""
    treated.isotropic = treated.bilateral = True  # type: ignore[attr-defined]
    return treated  # type: ignore[return-value]


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
    table: BrdfTable, settings: BakeSettings, pairs: DirectionPairs, truth: Array, say: Progress
) -> tuple[StoredTable[BrdfTable], str]:
    """The table as it will come back from the file, and what its values are."""
    if settings.filter != "bspline":
        return _quantized(table, settings, pairs, truth), "none"
    candidates = {}
    if settings.spline != "fitted":
        candidates["plain"] = _quantized(table, settings, pairs, truth)
    if settings.spline != "plain":
        coefficients = fit_coefficients(table.values, lambda share: say("fitting spline", share))
        candidates["fitted"] = _quantized(BrdfTable(table.grid, coefficients), settings, pairs, truth)
    if len(candidates) == 1:
        ((name, chosen),) = candidates.items()
    else:
        rms = {k: table_errors(kept.table, "bspline", pairs, truth)["rms"] for k, kept in candidates.items()}
        name = min(rms, key=rms.__getitem__)
        chosen = candidates[name]
    return chosen, name


def _quantized(table: BrdfTable, settings: BakeSettings, pairs: DirectionPairs, truth: Array) -> StoredTable[BrdfTable]:
    return store_table(table, pad_slices(table.values), settings.storage, settings.filter, pairs, truth)


def _simpler_filters(
    table: BrdfTable, filter: Filter, spline: str, pairs: DirectionPairs, truth: Array
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
