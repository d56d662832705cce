"""The bake of one BRDF from a source to facts and images, which are written elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from ..bundle.bundle import StoredImage
from ..bundle.result import Progress
from ..envelope import EnvelopeFit, pack_weights, reconstruction_errors
from ..errors import BakeError
from ..images.storage import Storage
from ..source import Array, BrdfSource, Facts, Json, SheetSource
from ..tables.accuracy import DirectionPairs, direction_pairs, table_errors
from ..tables.atlas import AtlasLayout
from ..tables.bspline_fit import fit_coefficients, sample_spline
from ..tables.code_fit import can_be_fitted
from ..tables.filter_choice import LEAST_GAIN, LEAST_GAIN_OF_CODES, FilterChoice, unweighed, weighed
from ..tables.grids.grid import Grid
from ..tables.grids.patch_grid import PatchGrid
from ..tables.search.byte_limit import file_bytes, grid_within, least_grid
from ..tables.search.coded_grid import coded_grid
from ..tables.search.grid_search import GridChoice, best_horizon, choose_grid
from ..tables.sheet import sheet_views
from ..tables.stored_table import StoredTable, store_table
from ..tables.table import FILTERS, Filter, Table, tabulate
from ..tables.treated_source import TreatedSource
from .appearance import Together, color_differences
from .preview_sphere import Reflects
from .reflection import Reflection
from .samplers import Layout, isotropic_layout, kind_of_layout, layout_facts
from .settings import BakeSettings

_SMALL_SAMPLER = 16
# Fitted codes take up to a tenth more room than those of the samples. A table that takes even more, or leaves more than
# this share, is made again.
_FITTED, _REFITS, _FILLED = 1.08, 4, 0.97


@dataclass(frozen=True)
class BakedPart:
    """What a bake has made: facts for material.json, images by name, and the table as it will come back."""

    facts: dict[str, Json]
    images: dict[str, StoredImage]
    table: Table


@dataclass(frozen=True)
class _Tabulated:
    """A table as it will come back from its file.

    spline : what its values are: "plain" or "fitted" coefficients, or "none"; "none" of a residual
    total_intensity : of the table as tabulated
    weighed : why it has its filter, where that is left to the bake
    """

    kept: StoredTable
    spline: str
    total_intensity: float
    weighed: FilterChoice | None = None


class PartBake:
    """Steps of the bake of one BRDF, or of one part of a sheet.

    pairs, truth : directions that no table holds, and the source there: errors are measured at them
    treatment : what was changed of the source, counted at these directions
    black : it reflects nothing, as the front of a sheet may, and is kept in the smallest table there is
    filter, weighed : that the table is for, and where the settings leave it to the bake the account of the choice
    """

    def __init__(self, source: BrdfSource, settings: BakeSettings, say: Progress, pairs: int) -> None:
        self.source, self.settings, self.say = TreatedSource(source), settings, say
        self.pairs = direction_pairs(pairs, turned=not source.isotropic)
        self.truth = self.source.evaluate(self.pairs.wi, self.pairs.wo)
        self.treatment = self.source.treatment()
        self.filter: Filter = "trilinear" if settings.filter == "auto" else settings.filter
        self.weighed: FilterChoice | None = None
        self.black = not self.truth.any()
        if settings.table_bytes is not None:
            if not source.isotropic:
                raise BakeError(
                    source.name, "is anisotropic: its table cannot be fitted to bytes", "state a resolution"
                )
            self.settings = replace(settings, resolution=settings.usual_resolution)
        if self.black:
            if not _has_other_sides(source, self.pairs):
                raise BakeError(source.name, "reflects nothing", "check the file")
            small = isotropic_layout(kind_of_layout(settings.sampler), _SMALL_SAMPLER)
            self.settings = replace(self.settings, filter=self.filter, sampler=small, table_bytes=None)

    def baked(self, reflection: Callable[..., Reflection], front: bool = True) -> BakedPart:
        """All steps, given what makes the `Reflection` of a treated source, its grid, its choice and the settings.

        Parameters
        ----------
        front : not of another side of a sheet: then also how different it looks

        Raises
        ------
        BakeError : as `bake_source`
        """
        choice, grid = self.choose_grid()
        made = self.tabulate(grid)
        seen = reflection(self.source, made.kept.table.grid, choice, self.settings)
        seen.black = self.black
        cells, layout = self.sampler(made.kept.table, seen)
        images = {"table": made.kept.image(), "sampler": cells}
        facts: dict[str, Json] = {
            "table": self.table_facts(made),
            "search": choice.search.facts() if choice.search else None,
            "choice": choice.facts(),
            "sampler": layout_facts(layout),
            **self.measured(made, seen),
        }
        fit: EnvelopeFit | None = None
        shown: dict[str, Reflects] = {"table": made.kept.table}
        if self.settings.envelope:
            fit, residual, extra, further = self.envelope(made.kept.table, seen)
            facts, images, shown = facts | extra, images | further, {"exact": Together((fit, residual)), **shown}
        if self.weighed is not None:
            facts["filter_choice"] = self.weighed.facts()
        if front:
            facts["color_difference"] = color_differences(self.source, shown)
        preview = seen.fit_preview(fit)
        facts["preview"] = preview.facts()
        images["preview_weights"] = StoredImage(pack_weights(preview), Storage.FLOAT32)
        return BakedPart(facts, images, made.kept.table)

    def choose_grid(self) -> tuple[GridChoice, Grid]:
        """The candidates, and the best of them with the horizon that serves it best. Raises BakeError."""
        wanted = self.settings
        if self.black:
            choice = GridChoice.of_black(self.source.isotropic)
            return choice, choice.grid
        choice = choose_grid(
            self.source,
            wanted.resolution,
            wanted.bases,
            wanted.spacing,
            wanted.alpha,
            lambda share: self.say("choosing grid", share),
        )
        grid = best_horizon(self.source, choice.grid, self.pairs, self.truth)
        if isinstance(grid, PatchGrid):
            # Within a patch nothing is blended.
            self.filter = "nearest"
        elif wanted.parameterization == "auto" and wanted.storage is Storage.LOG:
            grid = coded_grid(self.source, grid, wanted.resolution)
        AtlasLayout.of(grid)
        return choice, grid

    def tabulate(self, grid: Grid) -> _Tabulated:
        """The table on this grid, of a spline its coefficients; within `table_bytes` on one of the sizes that fit.

        Raises BakeError where the storage cannot hold them.
        """
        made = self._within_bytes(self.source, self.truth, grid, self._tabulated)
        # Of several that were tried this need not be the last.
        self.filter, self.weighed = made.kept.table.filter, made.weighed
        return made

    def _within_bytes(
        self, source: BrdfSource, truth: Array, grid: Grid, make: Callable[[Grid], _Tabulated]
    ) -> _Tabulated:
        """What is made of the source, `truth` at the pairs, on this grid or a size of it that `table_bytes` allows."""
        most = self.settings.table_bytes
        if most is None:
            return make(grid)
        room = most / _FITTED
        fitting: list[_Tabulated] = []
        tried: set[Grid] = set()
        for _ in range(_REFITS):
            grid = grid_within(source, grid, room, self.pairs, truth)
            if grid in tried:
                break
            tried.add(grid)
            made = make(grid)
            size = file_bytes(made.kept)
            if size <= most:
                fitting.append(made)
                if size >= _FILLED * most:
                    break
            # More than this is needed only where texels take next to nothing, and serve nothing.
            room = min(room * 0.99 * most / size, most)
        if fitting:
            return min(fitting, key=lambda made: self.pairs.rms(self._seen(made) - truth))
        made = make(least_grid(grid))
        if (size := file_bytes(made.kept)) > most:
            raise BakeError(source.name, f"has no table within {most} bytes: the smallest takes {size}", "allow more")
        return made

    def _tabulated(self, grid: Grid) -> _Tabulated:
        table = tabulate(self.source, grid, lambda share: self.say("tabulating", share))
        found: dict[str, tuple[StoredTable, str]] = {}
        if self.settings.filter == "auto" and not isinstance(grid, PatchGrid):
            self.weighed, found = self._weighed(table)
            self.filter = self.weighed.filter
        kept, spline = found.get(self.filter) or self._kept(table)
        return _Tabulated(kept, spline, table.total_intensity, self.weighed)

    def _weighed(self, table: Table) -> tuple[FilterChoice, dict[str, tuple[StoredTable, str]]]:
        """Which filter serves the table, where it is read as a whole, and as `_kept` what was weighed."""
        found: dict[str, tuple[StoredTable, str]] = {}
        if self.settings.envelope:
            return unweighed("over Cycles' own shaders a B-spline only smooths the rest"), found
        if not self.source.isotropic:
            return unweighed("four dimensions have no B-spline that pays"), found
        codes = self.settings.storage is Storage.LOG
        if codes and not self._fits_codes(table):
            return unweighed("so large a table of logarithms has no fitted B-spline"), found
        errors: dict[str, Mapping[str, float]] = {}
        for self.filter in ("trilinear", "bspline"):
            found[self.filter] = self._kept(table)
            errors[self.filter] = self._errors(found[self.filter][0].table, self.filter)
        rms: dict[str, float] = {name: found["rms"] for name, found in errors.items()}
        least_gain = LEAST_GAIN_OF_CODES if codes else LEAST_GAIN
        return weighed(rms, errors["trilinear"]["relative"], least_gain), found

    def _kept(self, table: Table) -> tuple[StoredTable, str]:
        """As it comes back, with what its values are: see `_Tabulated.spline`."""
        if self.filter == "bspline":
            return self._spline(table)
        return self._stored(table, self.truth, self.source), "none"

    def _spline(self, table: Table) -> tuple[StoredTable, str]:
        """The coefficients that are asked for, or those of less error, and which they are."""
        candidates = {}
        # Fitted codes are kept only where they err less than those of samples.
        if self.settings.spline == "plain" or (self.settings.spline == "auto" and not self._fits_codes(table)):
            candidates["plain"] = self._stored(table, self.truth)
        if self.settings.spline != "plain":
            candidates["fitted"] = self._fitted_spline(table)
        if len(candidates) == 1:
            ((name, chosen),) = candidates.items()
        else:
            rms = {name: self._errors(kept.table, "bspline")["rms"] for name, kept in candidates.items()}
            name = min(rms, key=rms.__getitem__)
            chosen = candidates[name]
        return chosen, name

    def _fits_codes(self, table: Table) -> bool:
        return self.settings.storage is Storage.LOG and can_be_fitted(replace(table, filter="bspline"))

    def _fitted_spline(self, table: Table) -> StoredTable:
        """Coefficients fitted to the source where they are codes, and those are few enough, else to the samples."""
        if self._fits_codes(table):
            self.say("fitting spline", 0.0)
            return self._stored(table, self.truth, self.source)
        values = fit_coefficients(table.grid, table.values, lambda share: self.say("fitting spline", share))
        return self._stored(replace(table, values=values), self.truth)

    def _stored(self, table: Table, truth: Array, source: BrdfSource | None = None) -> StoredTable:
        filtered = replace(table, filter=self.filter)
        return store_table(filtered, self.settings.storage, self.pairs, truth, source)

    def sampler(self, table: Table, reflection: Reflection) -> tuple[StoredImage, Layout]:
        """Sampler of the table, and its layout."""
        self.say("sampler", 0.0)
        texels, layout = reflection.sampler(_sampled(table), lambda share: self.say("sampler", share))
        return StoredImage(texels, Storage.FLOAT32), layout

    def table_facts(self, made: _Tabulated) -> Facts:
        """Grid, filter and storage, and how values come back; JSON-ready."""
        return {
            **({} if self.source.isotropic else {"anisotropic": True}),
            **made.kept.table.grid.facts(),
            "filter": self.filter,
            "spline": made.spline,
            "storage": str(self.settings.storage),
            **made.kept.facts(),
            "total_intensity": made.total_intensity,
        }

    def measured(self, made: _Tabulated, reflection: Reflection) -> Facts:
        """Errors and albedos; JSON-ready."""
        self.say("measuring", 0.0)
        table = made.kept.table
        return {
            "errors": self._errors(table, self.filter),
            "rms_by_filter": {name: self._errors(table, name)["rms"] for name in _filters_of(table, made.spline)},
            "albedo": reflection.albedo(self.source),
            # A coarse table can reflect more light than arrives where the measurement does not; bounces then multiply
            # it.
            "table_albedo": reflection.table_albedo(table),
        }

    def _seen(self, made: _Tabulated) -> Array:
        return made.kept.table.evaluate(self.pairs.wi, self.pairs.wo)

    def _errors(self, table: Table, filter: Filter) -> Mapping[str, float]:
        return table_errors(table, filter, self.pairs, self.truth)

    def envelope(
        self, table: Table, reflection: Reflection
    ) -> tuple[EnvelopeFit, Table, dict[str, Json], dict[str, StoredImage]]:
        """The envelope and the residual; facts and images of both."""
        self.say("envelope", 0.0)
        fit = reflection.fit_envelope(lambda share: self.say("envelope", 0.4 * share))
        source = reflection.residual(fit)
        grid = table.grid
        if not self.black:
            grid = reflection.residual_grid(source, grid, lambda share: self.say("envelope", 0.4 + 0.2 * share))
        truth = source.evaluate(self.pairs.wi, self.pairs.wo)

        def left(grid: Grid) -> _Tabulated:
            made = tabulate(source, grid, lambda share: self.say("envelope", 0.6 + 0.1 * share))
            return _Tabulated(self._stored(made, truth, source), "none", made.total_intensity)

        kept = self._within_bytes(source, truth, grid, left).kept
        grid = kept.table.grid
        self.say("envelope", 0.7)
        # Drawn and compared with the lamps' light linearly, whatever the filter.
        residual = replace(kept.table, filter="trilinear")
        sampler, layout = reflection.sampler(residual, lambda share: self.say("envelope", 0.7 + 0.2 * share))
        errors = reconstruction_errors(self.source, fit, residual, table, self.pairs, self.filter)
        images = {
            "envelope": StoredImage(pack_weights(fit), Storage.FLOAT32),
            "residual": kept.image(),
            "residual_sampler": StoredImage(sampler, Storage.FLOAT32),
        }
        found = reflection.shares(fit, residual)
        images |= {name: StoredImage(image, Storage.FLOAT32) for name, image in found.items()}
        # Alias tables of both are of one layout.
        own: dict[str, Json] = {"sampler": layout_facts(layout)} if kind_of_layout(layout) == "warp" else {}
        facts = {**kept.facts(), "grid": grid.facts(), "errors": errors, **own}
        return fit, kept.table, {"envelope": fit.facts(), "residual": facts}, images


def _has_other_sides(source: BrdfSource, pairs: DirectionPairs) -> bool:
    """Whether it is a sheet that lets light through or reflects it at its back."""
    if not isinstance(source, SheetSource):
        return False
    return any(view.evaluate(pairs.wi, pairs.wo).any() for view in sheet_views(source).values())


def _sampled(table: Table) -> Table:
    """What the sampler follows: the table, and for a spline its values at the nodes, an eighth of the work.

    Between the nodes a spline is smoother than that; the sampler's weights, never its truth, feel the difference
    (tried on a lobe narrower than the spacing: a third more variance).
    """
    if table.filter == "bspline":
        return Table(table.grid, sample_spline(table.grid, table.values))
    return table


def _filters_of(table: Table, spline: str) -> tuple[Filter, ...]:
    """The table's filter and every simpler one that the stored values serve as well: builders may choose."""
    last = FILTERS.index(table.filter)
    names: Any = FILTERS[last : last + 1] if spline == "fitted" else FILTERS[: last + 1]
    return tuple(names)
