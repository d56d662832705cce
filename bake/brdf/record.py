"""A baked BRDF's material.json as one record, of either symmetry: read once, and checked here and nowhere else."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from ..bundle.checked_json import Fields
from ..envelope import (
    EnvelopeFit,
    PreviewFit,
    ShareLayout,
    SlopeShareLayout,
    checked_shares,
    fit_from_image,
    preview_from_image,
)
from ..errors import BakeError
from ..images.storage import Storage
from ..sampling.slope_cells import SlopeLayout
from ..source import SHEET_PARTS, SheetPart
from ..tables.atlas import AtlasLayout
from ..tables.filter_choice import filter_why_of
from ..tables.table import Table
from .appearance import ColorDifferenceRecord, color_differences_of
from .baked_table import SAMPLERS, BakedTable, images_of_table
from .common import AlbedoRecord, BundleRecord, ImageRecord, check_size, rights_of
from .grids import is_anisotropic
from .modes import TABLE_OF
from .parts import (
    AlphaSearchRecord,
    CandidateRecord,
    EnvelopeRecord,
    ErrorsRecord,
    PreviewRecord,
    ResidualRecord,
    StoredTableRecord,
    TableRecord,
    candidates_of,
    settings_of,
)
from .samplers import Layout, Sampler, layout_of
from .settings import BakeSettings


@dataclass(frozen=True)
class BrdfRecord(BundleRecord):
    """All that is known of a baked BRDF.

    Attributes
    ----------
    settings : to bake the same again with
    table, residual : the stored tables; no residual where no envelope was fitted
    sampler : kind and sizes of the table's sampler, and of the residual's where that has none of its own
    rms_by_filter : RMS in 1/sr with the filter of the bake and with every simpler one; empty in older bundles
    search : of a Bezier shape, where one was searched for
    sheet : what else there is of a sheet that lets light through
    candidates : grids that were tried, best first; none in older bundles
    table_albedo : of the table rather than of the measurement; None in older and in anisotropic bundles
    color_differences : from the measurement as a sphere shows them, of "exact" and of the "table"; empty in older
        bundles
    filter_why : what was weighed where the filter was left to the bake; else empty
    """

    kind, kind_words = "brdf", "a BRDF"

    settings: BakeSettings
    table: TableRecord
    sampler: Layout
    errors: ErrorsRecord
    albedo: AlbedoRecord
    table_albedo: AlbedoRecord | None
    rms_by_filter: Mapping[str, float]
    color_differences: Mapping[str, ColorDifferenceRecord]
    filter_why: str
    search: AlphaSearchRecord | None
    candidates: tuple[CandidateRecord, ...]
    envelope: EnvelopeRecord | None
    residual: ResidualRecord | None
    preview: PreviewRecord | None
    sheet: SheetRecord | None

    @classmethod
    def _parts(cls, fields: Fields, images: Mapping[str, ImageRecord]) -> Mapping[str, Any]:
        table = _table_of(fields, images)
        anisotropic = is_anisotropic(table.grid)
        residual = _residual_of(fields, images, table)
        return {
            "table": table,
            "residual": residual,
            "settings": replace(settings_of(fields.part("settings")), rights=rights_of(fields)),
            "sampler": _sampler_of(fields, images, anisotropic, residual),
            "errors": ErrorsRecord.parse(fields.part("errors")),
            "albedo": AlbedoRecord.parse(fields, "albedo"),
            "table_albedo": AlbedoRecord.parse(fields, "table_albedo") if fields.has("table_albedo") else None,
            "rms_by_filter": _numbers_of(fields, "rms_by_filter"),
            "color_differences": color_differences_of(fields),
            "filter_why": filter_why_of(fields),
            "search": _search_of(fields),
            "candidates": candidates_of(fields),
            "envelope": EnvelopeRecord.parse(fields.part("envelope"), anisotropic) if fields.has("envelope") else None,
            "preview": PreviewRecord.parse(fields.part("preview"), anisotropic) if fields.has("preview") else None,
            "sheet": SheetRecord.parse(fields) if fields.has("sheet") else None,
        }

    @property
    def anisotropic(self) -> bool:
        """Whether the table has four dimensions."""
        return is_anisotropic(self.table.grid)

    @property
    def share_layout(self) -> ShareLayout | SlopeShareLayout:
        """Where the image "residual_share" has what: of an anisotropic table as its sampler has it."""
        return SlopeShareLayout.of(self.sampler) if isinstance(self.sampler, SlopeLayout) else ShareLayout()

    def images_of(self, mode: str) -> tuple[str, ...]:
        """Names of the images it holds of which a material of this mode is built, whatever its scene calls for."""
        names = ["preview_weights"]  # which EEVEE shows in every mode
        if mode in TABLE_OF:
            names += images_of_table(TABLE_OF[mode])
        if TABLE_OF.get(mode) == "residual":
            names += "envelope", "residual_share"
        found = [name for name in names if self.has(name)]
        for part, record in self.sheet.parts.items() if self.sheet is not None else ():
            found += [f"{part}_{name}" for name in record.images_of(mode)]
        return tuple(found)

    def part(self, name: SheetPart) -> BrdfRecord | None:
        """A part of a sheet with its images, as a record of its own; None where there is none, or it is black."""
        found = self.sheet.parts.get(name) if self.sheet is not None else None
        if found is None or self.bundle is None:
            return found
        return replace(found, bundle=self.bundle.part(name, dict(found.document)))

    @property
    def tables(self) -> tuple[BrdfRecord, ...]:
        """This record and those of a sheet's other parts, each of one table, without bundles."""
        return (self, *(self.sheet.parts.values() if self.sheet is not None else ()))

    def check_filter(self, name: str, mode: str) -> None:
        """Raise BakeError where a mode of `bake.brdf.modes.MODES` would interpolate fitted coefficients, of any part of
        a sheet too, as if they were values; the residual, of which other modes are built, holds values."""
        for part in self.tables:
            if mode == "reference" and part.table.spline == "fitted" and name != "bspline":
                cause = f"holds fitted spline coefficients, which {name} would take for values of the table"
                raise BakeError(part.where, cause, "leave the filter as baked, or bake it again with another")

    def stored(self, part: str) -> StoredTableRecord:
        """How the "table" or the "residual" is stored. Raises BakeError where there is none."""
        found: StoredTableRecord | None = self.table if part == "table" else self.residual
        if found is None:
            raise BakeError(self.where, f"'{part}' is missing", "bake it again")
        return found

    def baked(self, part: str = "table") -> BakedTable:
        """The "table" or the "residual" with its sampler. Raises BakeError where there is none."""
        own = self.residual.sampler if part == "residual" and self.residual is not None else None
        return BakedTable(self.files(), part, self.stored(part), own or self.sampler, self.table.filter)

    def load_table(self, part: str = "table") -> Table:
        """The stored values of the "table" or the "residual". Raises BakeError."""
        return self.baked(part).load()

    def load_sampler(self, part: str = "table") -> Sampler:
        """The stored sampler of the "table" or the "residual". Raises BakeError where a number would lead out."""
        return self.baked(part).load_sampler()

    def load_envelope(self) -> EnvelopeFit:
        """The stored envelope. Raises BakeError."""
        if self.envelope is None:
            raise BakeError(self.where, "'envelope' is missing", "bake it again")
        image, viewers, measured = self.files().load("envelope"), self.envelope.viewers, dict(self.envelope.measured)
        return fit_from_image(self.envelope.closures, viewers, image, measured, self.where)

    def load_preview(self) -> PreviewFit:
        """The stored closures of mode Preview. Raises BakeError."""
        if self.preview is None:
            raise BakeError(self.where, "'preview' is missing", "bake it again")
        image, viewers = self.files().load("preview_weights"), self.preview.viewers
        return preview_from_image(self.preview.closures, viewers, image, self.preview.error or 0.0, self.where)

    def check_shares(self) -> None:
        """Raise BakeError where the image "residual_share" is not what `bake.envelope.lamp_shares` gives for
        `share_layout`."""
        bundle = self.files()
        checked_shares(bundle.load("residual_share"), bundle.image_path("residual_share"), self.share_layout)


@dataclass(frozen=True)
class SheetRecord:
    """What a sheet has beside its front's reflection.

    Attributes
    ----------
    alike : the back is as the front, each seen from its own side
    parts : of `bake.source.SHEET_PARTS` those that are not black; without bundles, which `BrdfRecord.part` adds
    """

    alike: bool
    parts: Mapping[SheetPart, BrdfRecord]

    @classmethod
    def parse(cls, fields: Fields) -> SheetRecord:
        """Read from a document's "sheet". Raises BakeError, also where albedos are of other angles than the front's,
        for they are added."""
        sheet, degrees = fields.part("sheet"), AlbedoRecord.parse(fields, "albedo").theta_o_deg
        names = [name for name in SHEET_PARTS if sheet.has(name)]
        parts = {name: BrdfRecord.parse(*_part_document(fields, name)) for name in names}
        for name, part in parts.items():
            if part.albedo.theta_o_deg != degrees:
                cause = f"'sheet.{name}': the albedo is of other angles than the front's"
                raise BakeError(fields.where, cause, "bake it again")
        return cls(sheet.flag("alike"), parts)


def _part_document(fields: Fields, name: SheetPart) -> tuple[dict[str, Any], str]:
    """Document of a part, as a BRDF of its own would have it, and where it is."""
    images = fields.part("images").entries
    front = f"{name}_"
    own = {key.removeprefix(front): entry for key, entry in images.items() if key.startswith(front)}
    shared = {key: value for key, value in fields.entries.items() if key in ("kind", "source", "settings", "packed")}
    part = {key: value for key, value in fields.part("sheet").part(name).entries.items() if key != "sheet"}
    return {**part, **shared, "images": own}, f"{fields.where}: sheet.{name}"


def _stored_as(images: Mapping[str, ImageRecord], name: str) -> Storage | None:
    return images[name].storage if name in images else None


def _table_of(fields: Fields, images: Mapping[str, ImageRecord]) -> TableRecord:
    """The table, of the size of its image. Raises BakeError."""
    table = TableRecord.parse(fields.part("table"), _stored_as(images, "table"))
    check_size(images, "table", AtlasLayout.of(table.grid).size, fields)
    return table


def _residual_of(fields: Fields, images: Mapping[str, ImageRecord], table: TableRecord) -> ResidualRecord | None:
    if not fields.has("residual"):
        return None
    residual = ResidualRecord.parse(fields.part("residual"), table, _stored_as(images, "residual"))
    check_size(images, "residual", AtlasLayout.of(residual.grid).size, fields)
    return residual


def _sampler_of(
    fields: Fields, images: Mapping[str, ImageRecord], anisotropic: bool, residual: ResidualRecord | None
) -> Layout:
    """Kind and sizes of the table's sampler, both being of the sizes of their images. Raises BakeError."""
    layout = layout_of(fields.part("sampler"), anisotropic)
    own = residual.sampler if residual is not None else None
    for part, name in SAMPLERS.items():
        found = own or layout if part == "residual" else layout
        check_size(images, name, (found.width, found.bins), fields)
    return layout


def _search_of(fields: Fields) -> AlphaSearchRecord | None:
    """None also for the account of all kinds of grid that anisotropic bundles have there: see `candidates_of`."""
    found = fields.entries.get("search")
    return AlphaSearchRecord.parse(fields.part("search")) if isinstance(found, dict) and "best" not in found else None


def _numbers_of(fields: Fields, key: str) -> dict[str, float]:
    if not fields.has(key):
        return {}
    part = fields.part(key)
    return {name: part.number(name) for name in part.entries}
