"""Parts of a baked BRDF's record: settings, errors, searches, the stored tables and the fitted closures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np

from .. import xp_numpy
from ..bundle.checked_json import Fields, settings_in
from ..envelope.anisotropic_lobes import AnisotropicLobe
from ..envelope.viewers import MOST_EACH_WAY, MOST_NODES, Elevations, ViewerGrid
from ..errors import BakeError
from ..images.storage import TABLE_STORAGES, Storage
from ..lobes.lobes import Lobe
from ..reading import READING_NAMES, Reading
from ..source import Array
from ..tables.grids.grid import Grid
from ..tables.log_codes import LEAST_RANGE, MOST_PEAK, MOST_RANGE, LogCodes
from ..tables.table import FILTERS, Filter
from .closures import anisotropic_closures_of, closures_of
from .grids import grid_of, is_anisotropic
from .samplers import Layout, isotropic_layout_of, layout_of
from .settings import FILTER_CHOICES, BakeSettings

# Light that native closures may leave out unasked: as much as the envelope's own stated bias.
NEGLIGIBLE = 1e-3
_MOST_PREVIEW = 3  # closures of an isotropic preview
_MOST_CANDIDATES = 100
_SPLINES = ("none", "plain", "fitted")


def settings_of(fields: Fields) -> BakeSettings:
    """A bundle's "settings", to bake the same again; what older ones do not record is as usual. Raises BakeError."""
    given: dict[str, Any] = {
        "resolution": fields.whole("resolution"),
        "storage": Storage(fields.text("storage", choices=TABLE_STORAGES)),
        "filter": fields.text("filter", choices=FILTER_CHOICES),
    }
    given |= {key: fields.text(key) for key in ("basis", "parameterization", "spline") if fields.has(key)}
    if fields.has("alpha"):
        shape = isinstance(fields.entries["alpha"], list)
        given["alpha"] = fields.numbers("alpha", (2, 2), 0, 1) if shape else fields.text("alpha")
    if fields.has("sampler"):
        given["sampler"] = isotropic_layout_of(fields.part("sampler"))
    if fields.has("envelope"):
        given["envelope"] = fields.flag("envelope")
    if fields.has("viewers"):
        given["viewers"] = fields.wholes("viewers", (2, 2))
    if fields.has("table_bytes"):
        given["table_bytes"] = fields.whole("table_bytes")
    with settings_in(fields.where):
        if fields.has("reading"):
            told = fields.part("reading")
            chosen: dict[str, Any] = {name: told.text(name) for name in READING_NAMES if told.has(name)}
            given["reading"] = Reading(**chosen)
        return BakeSettings(**given)


@dataclass(frozen=True)
class ErrorsRecord:
    """Cosine-weighted RMS in 1/sr, the error relative to the energy, and at how many directions they were measured."""

    rms: float
    relative: float
    directions: int | None = None

    @classmethod
    def parse(cls, fields: Fields) -> ErrorsRecord:
        """Read from `bake.tables.accuracy.table_errors`, or an entry of `bake.envelope.reconstruction_errors`. Raises
        BakeError."""
        directions = fields.whole("directions", 0) if fields.has("directions") else None
        return cls(fields.number("rms"), fields.number("relative"), directions)


@dataclass(frozen=True)
class AlphaRecord:
    """Bezier shapes of elevations and azimuth."""

    theta: float
    phi: float

    @classmethod
    def parse(cls, fields: Fields) -> AlphaRecord:
        """Read from a trial of `bake.tables.search.alpha_search`. Raises BakeError."""
        return cls(fields.number("alpha_theta"), fields.number("alpha_phi"))


@dataclass(frozen=True)
class AlphaSearchRecord:
    """The Bezier shapes of least error and of largest intensity, and the latter's error over the former's."""

    by_error: AlphaRecord
    by_intensity: AlphaRecord
    intensity_finds_least_error: bool
    error_of_intensity_choice: float

    @classmethod
    def parse(cls, fields: Fields) -> AlphaSearchRecord:
        """Read from `bake.tables.search.alpha_search.AlphaSearch.facts`. Raises BakeError."""
        by_error, by_intensity = (AlphaRecord.parse(fields.part(key)) for key in ("by_error", "by_intensity"))
        same = fields.flag("intensity_finds_least_error")
        return cls(by_error, by_intensity, same, fields.number("error_of_intensity_choice"))


@dataclass(frozen=True)
class CandidateRecord:
    """A grid that was tried, and its RMS in 1/sr."""

    basis: str
    parameterization: str
    rms: float

    @classmethod
    def parse(cls, fields: Fields) -> CandidateRecord:
        """Read from an entry of the account of a search. Raises BakeError."""
        slopes = fields.entries.get("basis") == "half" and "parameterization" not in fields.entries
        kind = "slopes" if slopes else fields.text("parameterization")
        return cls(fields.text("basis"), kind, fields.number("rms"))


def candidates_of(document: Fields) -> tuple[CandidateRecord, ...]:
    """Of a bundle's "choice", or of the "search" of an anisotropic one, best first; none in old ones. BakeError."""
    if isinstance(document.entries.get("choice"), dict):
        listed = document.part("choice").parts("candidates", 1, _MOST_CANDIDATES)
        return tuple(CandidateRecord.parse(entry) for entry in listed)
    search = document.entries.get("search")
    if not isinstance(search, dict) or "best" not in search:
        return ()
    best = document.part("search").part("best")
    found = [CandidateRecord.parse(best.part(name)) for name in best.entries]
    return tuple(sorted(found, key=lambda candidate: candidate.rms))


@dataclass(frozen=True)
class StoredTableRecord:
    """A table on its grid, and how its values come back from texels.

    Attributes
    ----------
    scale : what values were multiplied by before they were stored
    offset : what scaled values were raised by; 0 in older bundles
    log : what codes stand for, of storage "log"; None where texels are values
    """

    grid: Grid
    scale: float
    offset: float
    log: LogCodes | None

    def decoded(self, texels: Array) -> Array:
        """Values (..., 3) of texels (..., 3)."""
        if self.log is not None:
            return np.asarray(self.log.decode(xp_numpy, texels.astype(np.float64)), np.float32)
        values: Array = (texels - self.offset) / self.scale
        return values


@dataclass(frozen=True)
class TableRecord(StoredTableRecord):
    """The table of the whole BRDF.

    Attributes
    ----------
    storage : of its texels, and of the residual's
    filter : that it was baked for
    spline : of filter "bspline": whether the samples are "plain" or "fitted" coefficients; else "none"
    """

    storage: Storage
    filter: Filter
    spline: str

    @classmethod
    def parse(cls, fields: Fields, stored_as: Storage | None = None) -> TableRecord:
        """Read from a bundle's "table", whose image has the storage `stored_as`, if it is known. Raises BakeError."""
        anisotropic = fields.entries.get("anisotropic") is True
        storage = Storage(fields.text("storage", choices=TABLE_STORAGES))
        spline = fields.text("spline", choices=_SPLINES) if fields.has("spline") else "none"
        codes = _codes(fields, storage, stored_as, "table")
        return cls(grid_of(fields, anisotropic), *codes, storage, _filter(fields), spline)


@dataclass(frozen=True)
class ResidualRecord(StoredTableRecord):
    """The table of what the envelope leaves, the errors of both together where they are told, and the layout of its
    sampler where it has its own."""

    errors: ErrorsRecord | None
    sampler: Layout | None

    @classmethod
    def parse(cls, fields: Fields, table: TableRecord, stored_as: Storage | None = None) -> ResidualRecord:
        """Read from a bundle's "residual"; older ones have the table's grid. Raises BakeError."""
        own = "grid" in fields.entries
        grid = grid_of(fields.part("grid"), is_anisotropic(table.grid)) if own else table.grid
        told = fields.part("errors") if fields.has("errors") else Fields({}, fields.where)
        together = told.part("envelope_and_residual") if told.has("envelope_and_residual") else None
        errors = ErrorsRecord.parse(together) if together else None
        sampler = layout_of(fields.part("sampler"), is_anisotropic(table.grid)) if fields.has("sampler") else None
        return cls(grid, *_codes(fields, table.storage, stored_as, "residual"), errors, sampler)


def _codes(
    fields: Fields, storage: Storage, stored_as: Storage | None, part: str
) -> tuple[float, float, LogCodes | None]:
    """Scale, offset and codes of a table of this storage. Raises BakeError."""
    if stored_as is not None and stored_as != storage.image:
        cause = f"'{part}' is stored as {stored_as}, and the table as {storage}"
        raise BakeError(fields.where, cause, "bake it again")
    scale = fields.number("scale", 2.0**-126, 2.0**126)
    offset = fields.number("offset", 0, 1) if "offset" in fields.entries else 0.0
    if storage is not Storage.LOG:
        return scale, offset, None
    log = fields.part("log")
    ranges: Any = log.numbers("range", (3, 3), LEAST_RANGE, MOST_RANGE)
    gains: Any = log.numbers("gain", (3, 3), 0, MOST_PEAK)
    codes = LogCodes(ranges, gains)
    if max(codes.peaks) > 1.01 * MOST_PEAK:
        raise BakeError(fields.where, f"'{part}.log' stands for values above {MOST_PEAK:g}", "bake it again")
    return scale, offset, codes


def _filter(fields: Fields) -> Filter:
    return cast(Filter, fields.text("filter", choices=FILTERS))


@dataclass(frozen=True)
class ClosuresRecord:
    """Native closures, and where their weights are given: at n elevations of the viewer, or all around."""

    closures: tuple[Lobe, ...] | tuple[AnisotropicLobe, ...]
    viewers: Elevations | ViewerGrid


def _fitted(fields: Fields, anisotropic: bool, most: int, nodes: tuple[int, int]) -> ClosuresRecord:
    if not anisotropic:
        return ClosuresRecord(closures_of(fields, most), Elevations(fields.whole("nodes", *nodes)))
    n_theta, n_phi = (fields.whole(key, 2, MOST_EACH_WAY) for key in ("n_theta", "n_phi"))
    return ClosuresRecord(anisotropic_closures_of(fields), ViewerGrid(n_theta, n_phi, fields.flag("folded")))


@dataclass(frozen=True)
class EnvelopeRecord(ClosuresRecord):
    """Native closures under the measurement.

    Attributes
    ----------
    share : of all light that they carry
    overshoot : integral of what they exceed the measurement by, as a share of the energy: their bias
    by_theta_o_deg : (viewing angle in degrees, share carried there) pairs
    measured : all that the fit measured, these three included, for `EnvelopeFit.measured`
    """

    share: float
    overshoot: float
    by_theta_o_deg: tuple[tuple[float, ...], ...]
    measured: Mapping[str, Any] = field(repr=False)

    @property
    def rest(self) -> tuple[float, float]:
        """Share of all light that is left, and of what the viewer sees to whom most is left: a residual of the rim is a
        small part of all light, and all that is seen there."""
        return 1 - self.share, max(1 - share for _, share in self.by_theta_o_deg)

    @property
    def suffices(self) -> bool:
        """Whether the closures alone are as good, but for a bias of the order of their own."""
        rest, worst = self.rest
        return rest <= NEGLIGIBLE and worst <= 10 * NEGLIGIBLE

    @classmethod
    def parse(cls, fields: Fields, anisotropic: bool) -> EnvelopeRecord:
        """Read from a bundle's "envelope". Raises BakeError."""
        found = _fitted(fields, anisotropic, 12, (4, MOST_NODES))
        rows = fields.rows("by_theta_o_deg", (1, 1024), 2)
        sizes = ("closures", "nodes") if not anisotropic else ("closures", "n_theta", "n_phi", "folded")
        measured = {key: value for key, value in fields.entries.items() if key not in sizes}
        share, overshoot = fields.number("share", 0, 1), fields.number("overshoot")
        return cls(found.closures, found.viewers, share, overshoot, rows, measured)


@dataclass(frozen=True)
class PreviewRecord(ClosuresRecord):
    """Native closures close to the measurement, and their relative error where it is told."""

    error: float | None

    @classmethod
    def parse(cls, fields: Fields, anisotropic: bool) -> PreviewRecord:
        """Read from a bundle's "preview". Raises BakeError."""
        found = _fitted(fields, anisotropic, _MOST_PREVIEW, (4, MOST_NODES))
        error = fields.number("error", 0) if fields.has("error") or not anisotropic else None
        return cls(found.closures, found.viewers, error)
