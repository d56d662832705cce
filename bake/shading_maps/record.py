"""A shading map's material.json as one record: read once, and checked here and nowhere else."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..brdf.baked_table import BakedTable
from ..brdf.common import AlbedoRecord, BundleRecord, ImageRecord, check_size, kind_of, rights_of
from ..brdf.grids import is_anisotropic
from ..brdf.parts import TableRecord
from ..brdf.record import BrdfRecord
from ..brdf.samplers import IsotropicLayout, isotropic_layout_of
from ..bundle.bundle import MATERIAL, Bundle
from ..bundle.checked_json import Fields
from ..errors import BakeError
from ..photographs.lights import cut_to_arc
from ..photographs.settings import StackSettings
from ..tables.atlas import AtlasLayout
from . import power_law, slice_basis
from .against_light import ThroughSettings
from .azimuth.azimuth_basis import AzimuthBasis, mean_curves, mean_over_azimuth
from .azimuth.curve_layout import pack_curves, unpack_curves
from .bake import ArcSettings
from .record_parts import (
    LitAlbedoRecord,
    LobeFitRecord,
    MapErrorsRecord,
    MapRecord,
    PhotographsRecord,
    TilingRecord,
    check_images_hold,
    render_settings_of,
)
from .render_settings import RenderSettings
from .shading_map import ShadingMap
from .slice_atlas import unpack_slices

_LARGEST_CURVE = 1e6


@dataclass(frozen=True)
class MeasuredLobeRecord:
    """A measured, isotropic BRDF that a shading map holds as its f_r.

    Attributes
    ----------
    table, sampler : as of a BRDF's record
    albedo : at the normal, a grey; None in bundles of before version 2
    """

    table: TableRecord
    sampler: IsotropicLayout
    albedo: float | None


@dataclass(frozen=True)
class ShadingMapRecord(BundleRecord):
    """All that is known of a baked shading map.

    Attributes
    ----------
    map : the stored map
    render : how it is lit
    albedo : under that light
    tiling, lobe_fit : None where the swatch was not made to tile, and where no lobe was fitted
    f_r : the measured BRDF that the bundle holds, if any
    through : the same of light that is let through, `render` being that of it alone; None of what was not photographed
        against the light. Without its bundle, which `transmitted` adds
    settings : to bake the same again with, but for files, of which a bundle keeps the names alone, and gives only those
        of photographs against the light; None where they are not all there
    """

    kind, kind_words = "shading_map", "a shading map"

    photographs: PhotographsRecord
    map: MapRecord
    render: RenderSettings
    albedo: LitAlbedoRecord
    errors: MapErrorsRecord
    tiling: TilingRecord | None
    lobe_fit: LobeFitRecord | None
    f_r: MeasuredLobeRecord | None
    settings: ArcSettings | None
    through: ShadingMapRecord | None

    @classmethod
    def _parts(cls, fields: Fields, images: Mapping[str, ImageRecord]) -> Mapping[str, Any]:
        stored = MapRecord.parse(fields.part("map"))
        sizes = {name: (image.width, image.height, image.channels) for name, image in images.items()}
        check_images_hold(stored, sizes, fields.where)
        tiling, fit = (isinstance(fields.entries.get(key), dict) for key in ("tiling", "lobe_fit"))
        return {
            "map": stored,
            "photographs": PhotographsRecord.parse(fields),
            "render": render_settings_of(fields.part("render")),
            "albedo": LitAlbedoRecord.parse(fields, "albedo"),
            "errors": MapErrorsRecord.parse(fields.part("errors")),
            "tiling": TilingRecord.parse(fields.part("tiling")) if tiling else None,
            "lobe_fit": LobeFitRecord.parse(fields.part("lobe_fit")) if fit else None,
            "f_r": _measured_lobe_of(fields, images),
            "settings": _settings_of(fields, render_settings_of(fields.part("render"))),
            "through": _through_of(fields, stored) if fields.has("through") else None,
        }

    def transmitted(self) -> ShadingMapRecord | None:
        """The map of light that is let through, with its images, as a record of its own; None where there is none."""
        if self.through is None or self.bundle is None:
            return self.through
        return replace(self.through, bundle=self.bundle.part("through", dict(self.through.document)))

    def lit(self, render: RenderSettings) -> ShadingMapRecord:
        """The same record under another light."""
        return type(self).parse({**self.document, "render": render.facts()}, self.where, self.bundle)

    def measured_lobe(self) -> MeasuredLobeRecord:
        """The measured f_r. Raises BakeError where the bundle holds none."""
        if self.f_r is None or not self.has("table"):
            raise BakeError(self.where, "holds no measured BRDF to use as f_r", "choose a lobe, or bake with --brdf")
        return self.f_r

    def baked_lobe(self) -> BakedTable:
        """The table of the measured f_r with its alias tables. Raises BakeError where the bundle holds none."""
        lobe = self.measured_lobe()
        return BakedTable(self.files(), "table", lobe.table, lobe.sampler, lobe.table.filter)

    def load_azimuth(self) -> AzimuthBasis:
        """The map over azimuth as stored. Raises BakeError where the swatch was lit along an arc alone."""
        stored = self.map
        if stored.model != "azimuth":
            raise BakeError(self.where, "holds no map over azimuth", "bake photographs with lights all around")
        tiles = self.load_tiles() * np.float32(1 / stored.scale)
        return AzimuthBasis(np.ascontiguousarray(np.moveaxis(tiles, 0, -1)), self.load_curves())

    def load_tiles(self) -> NDArray[np.float32]:
        """Slices, or coefficients, as stored: times `map.scale`, (n, H, W, 3). Raises BakeError."""
        return unpack_slices(self.files().load(self.map.image), self.map.layout)[..., :3]

    def load_curves(self) -> NDArray[np.float32]:
        """Curves (rank, P, N) of a map over azimuth, held against what the record says of them. Raises BakeError."""
        bundle, stored = self.files(), self.map
        image, remedy = bundle.load("curves"), "bake the photographs again"
        curves = unpack_curves(image, stored.curve_layout)
        if np.abs(image).max() > _LARGEST_CURVE:
            cause = f"holds curves above {_LARGEST_CURVE:g}"
        elif not np.array_equal(image, pack_curves(curves)):
            # A shader reads the row that repeats azimuth 0, and all four channels.
            cause = "does not go on at a whole turn as it begins, or holds more curves than the map has"
        elif not np.array_equal(curves[:, :, 0], curves[:, :, 1]):
            # Means are of light, of which there is none at black.
            cause = "has curves at black that are not those of the level after it"
        elif not np.allclose(mean_curves(curves), stored.curves, rtol=1e-5, atol=1e-5 * np.abs(curves).max()):
            cause = f"holds other curves than those whose means {MATERIAL} gives"
        else:
            return curves
        raise BakeError(bundle.image_path("curves"), cause, remedy)

    def load_map(self) -> ShadingMap:
        """The map as stored, for numpy; of one over azimuth its mean over that. Raises BakeError."""
        bundle, stored = self.files(), self.map
        if stored.model == "azimuth":
            return ShadingMap(mean_over_azimuth(self.load_azimuth()))
        tiles = self.load_tiles() * np.float32(1 / stored.scale)
        levels = np.linspace(0, 1, stored.slices)
        if stored.model == "slices":
            m = bundle.load("envelope")[..., :3] * np.float32(1 / stored.envelope_scale)
            rest = np.concatenate([np.zeros_like(tiles[:1]), tiles])
            return ShadingMap(rest + levels[:, None, None, None].astype(np.float32) * m)
        model: Any
        if stored.model == "power":
            model = power_law.PowerLaw(tiles[0], tiles[1])
        else:
            model = slice_basis.SliceBasis(np.moveaxis(tiles, 0, -1), np.array(stored.curves))
        return ShadingMap(np.stack([np.maximum(model.evaluate(x), 0).astype(np.float32) for x in levels]))


def _measured_lobe_of(fields: Fields, images: Mapping[str, ImageRecord]) -> MeasuredLobeRecord | None:
    """None where the bundle holds no table. Raises BakeError."""
    if not fields.has("table"):
        return None
    table = TableRecord.parse(fields.part("table"), images["table"].storage if "table" in images else None)
    if is_anisotropic(table.grid):
        raise BakeError(fields.where, "takes f_r from an anisotropic BRDF", "bake it again with an isotropic one")
    layout = isotropic_layout_of(fields.part("sampler"))
    check_size(images, "table", AtlasLayout.of(table.grid).size, fields)
    check_size(images, "sampler", (layout.width, layout.bins), fields)
    told = fields.part("f_r") if fields.has("f_r") else None
    albedo = told.number("albedo", 0, 10) if told and told.has("albedo") else None
    return MeasuredLobeRecord(table, layout, albedo)


def _through_of(fields: Fields, beside: MapRecord) -> ShadingMapRecord:
    """Raises BakeError where it is not as the bake writes it, or of another size than the map of reflected light."""
    images, front = fields.part("images").entries, "through_"
    own = {key.removeprefix(front): entry for key, entry in images.items() if key.startswith(front)}
    shared = {key: value for key, value in fields.entries.items() if key in ("kind", "packed", "settings")}
    told = fields.part("through")
    render = render_settings_of(fields.part("render")).of_transmission(told.part("map").has("a_max"))
    part = {key: value for key, value in told.entries.items() if key != "through"}
    where = f"{fields.where}: through"
    record = ShadingMapRecord.parse({**part, **shared, "images": own, "render": render.facts()}, where)
    layouts = beside.layout, record.map.layout
    if len({(layout.width, layout.height) for layout in layouts}) > 1:
        raise BakeError(where, "is of another size than the map of reflected light", "bake it again")
    if record.albedo.theta_o_deg != AlbedoRecord.parse(fields, "albedo").theta_o_deg:
        raise BakeError(where, "gives the albedo at other angles than that of reflected light", "bake it again")
    return record


_FILES = ("lights", "flat_field")


def _settings_of(fields: Fields, render: RenderSettings) -> ArcSettings | None:
    """The settings as `bake.shading_maps.bake` writes them; None where they are not those of this version."""
    told: Any = fields.entries.get("settings")
    rights = rights_of(fields)
    try:
        read = {key: _hashable(value) for key, value in told["stack"].items() if key not in _FILES}
        kept = {key: value for key, value in told.items() if key not in ("stack", "brdf", "through")}
        through = ThroughSettings.told(told["through"]) if told.get("through") is not None else None
        if "azimuths" not in kept and cut_to_arc(fields.part("source").entries.get("facts")):
            kept["azimuths"] = "arc"  # before there was a choice, an arc was all there was
        return ArcSettings(**kept, render=render, stack=StackSettings(**read), rights=rights, through=through)
    except (BakeError, TypeError, ValueError, KeyError, AttributeError):
        return None


def _hashable(value: Any) -> Any:
    return tuple(map(_hashable, value)) if isinstance(value, list) else value


Record = BrdfRecord | ShadingMapRecord


def read_record(bundle: Bundle) -> Record:
    """Of a bundle of either kind. Raises BakeError where an entry is missing or wrong."""
    return parse_record(bundle.material, bundle.path / MATERIAL, bundle)


def parse_record(document: Mapping[str, Any], where: str | Path, bundle: Bundle | None = None) -> Record:
    """Read the record of a document from anywhere, named `where` in errors. Raises BakeError as `read_record`."""
    kind = ShadingMapRecord if kind_of(document) == "shading_map" else BrdfRecord
    return kind.parse(document, where, bundle)
