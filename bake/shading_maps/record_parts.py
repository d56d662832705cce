"""Parts of a shading map's record: the stored map, the photographs, errors, tiling, and how it is lit."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from ..brdf.closures import lobe_of
from ..brdf.common import AlbedoRecord
from ..brdf.modes import MODES
from ..bundle.checked_json import Fields, settings_in
from ..errors import BakeError
from ..lobes.lobes import Lobe
from .azimuth.azimuth_basis import CROWDING, MAX_AZIMUTHS, MAX_RANK, MIN_AZIMUTHS, MIN_RANK
from .azimuth.curve_layout import PER_TEXEL, CurveLayout
from .render_settings import TECHNIQUES, TILINGS, RenderSettings
from .shading_map import ABOVE, ANGLE_KNOTS, MAX_SLICES
from .slice_atlas import GUTTER, SliceLayout

MODELS = ("slices", "power", "basis", "azimuth")
_IMAGE = {"slices": "slices", "power": "power", "basis": "coefficients", "azimuth": "coefficients"}
_MOST_PHOTOGRAPHS = 1 << 20
_SHARE = -1e-3, 1.001  # with room for rounding


@dataclass(frozen=True)
class StoredMap:
    """A shading map as its images hold it.

    Attributes
    ----------
    model : "slices", "power", "basis" or "azimuth"
    slices : N, the black one included
    layout : of the image named `image`
    scale, envelope_scale : what stored values were multiplied by
    curves : (rank, N) of model "basis"; of "azimuth", whose curves are an image, the mean over azimuth
    azimuths : P of model "azimuth", else 0
    """

    model: str
    slices: int
    layout: SliceLayout
    scale: float
    envelope_scale: float
    curves: tuple[tuple[float, ...], ...]
    azimuths: int = field(default=0, kw_only=True)

    @property
    def curve_layout(self) -> CurveLayout:
        """Of the image "curves" of model "azimuth"."""
        return CurveLayout(self.layout.tiles, self.azimuths, self.slices)

    @property
    def image(self) -> str:
        """Name of the bundle's image that holds the model."""
        return _IMAGE[self.model]


@dataclass(frozen=True)
class MapRecord(StoredMap):
    """A bundle's shading map.

    Attributes
    ----------
    storage : of the texels
    a_max : light that the brightest photograph reflects, in 1/sr; None where the photographs are not calibrated
    level_by_cosine : x of the photograph at cosines of the light's angle from 0 to 1
    envelope_energy, residual_energy : shares of the light that the native closure and the mirror carry
    means : (N, 3) mean colours of the slices; only a material's own copy holds them
    """

    storage: str
    a_max: float | None
    level_by_cosine: tuple[float, ...]
    envelope_energy: float
    residual_energy: float
    means: tuple[tuple[float, ...], ...] | None

    @classmethod
    def parse(cls, fields: Fields) -> MapRecord:
        """Read from a bundle's "map". Raises BakeError."""
        model = fields.text("model", choices=MODELS)
        slices = fields.whole("slices", 2, MAX_SLICES)
        height, width = (fields.whole(key, 1, 1 << 14) for key in ("height", "width"))
        fields.whole("gutter", GUTTER, GUTTER)
        all_around = model == "azimuth"
        rank = fields.whole("rank", MIN_RANK, MAX_RANK) if all_around else 0
        name, ranks = ("mean_curves", (rank, rank)) if all_around else ("curves", (1, 3))
        curves = fields.rows(name, ranks, slices, -1e6, 1e6) if model in ("basis", "azimuth") else ()
        azimuths = fields.whole("azimuths", MIN_AZIMUTHS, MAX_AZIMUTHS) if all_around else 0
        if all_around and not fields.has("crowding"):
            # Of schema 6: curves of S itself, at even levels.
            cause = "is a map over azimuth of an early version, which is not read any more"
            raise BakeError(fields.where, cause, "bake its photographs again")
        if all_around:
            fields.number("crowding", CROWDING, CROWDING)
        tiles = {"slices": slices - 1, "power": 2, "basis": len(curves), "azimuth": rank}[model]
        return cls(
            model,
            slices,
            SliceLayout(tiles, height, width),
            _positive(fields, "scale"),
            1.0 if model == "power" else _positive(fields, "envelope_scale"),
            curves,
            azimuths=azimuths,
            storage=fields.text("storage"),
            a_max=_positive(fields, "a_max") if fields.has("a_max") else None,
            level_by_cosine=fields.numbers("level_by_cosine", (ANGLE_KNOTS, ANGLE_KNOTS), -1e6, 1e6),
            envelope_energy=fields.number("envelope_energy", *_SHARE),
            residual_energy=fields.number("residual_energy", *_SHARE),
            means=fields.rows("means", (slices, slices), 3) if fields.has("means") else None,
        )


def _positive(fields: Fields, key: str) -> float:
    return fields.number(key, 1e-30, 1e30)


def render_settings_of(fields: Fields) -> RenderSettings:
    """Render settings from a bundle's "render". Raises BakeError for anything but what `RenderSettings.facts` gives."""
    measured = "lobe" in fields.entries and fields.entries["lobe"] is None
    above: Any = fields.text("above", choices=ABOVE)
    technique: Any = fields.text("technique", choices=TECHNIQUES)
    mode: Any = fields.text("mode", choices=MODES)
    tiling: Any = fields.text("tiling", choices=TILINGS)
    with settings_in(fields.where):
        return RenderSettings(
            None if measured else lobe_of(fields.part("lobe")),
            fields.number("sigma") if fields.has("sigma") else None,
            above,
            technique,
            mode,
            tiling,
            fields.number("a_max") if fields.has("a_max") else None,
            lobe_of(fields.part("transmission")) if fields.has("transmission") else Lobe("lambert"),
            fields.number("transmission_sigma") if fields.has("transmission_sigma") else None,
        )


@dataclass(frozen=True)
class PhotographsRecord:
    """Photographs of a bake. All but the averages is only told: what cannot be read of it is left out.

    Attributes
    ----------
    averages : (n,) average radiance of each light's photograph, as sorted for the slices
    after : (N,) averages of the slices; none of photographs that were not baked
    elevations_deg : (n,) of the lights; none where they are not known
    files : photographs in all, where exposures were joined; None where that is not told
    lights : where the directions of the lights came from
    decoded_as, converted_from : what the pixels were decoded by and why, and what their colours were converted from
    calibration : what fixed the scale, in words; None where nothing is told
    calibrated_by : "card", "albedo" and their like, None where sigma sets the scale
    warnings : what is doubtful about them
    azimuths_deg : (n,) of the lights of a map over azimuth, else none
    """

    averages: tuple[float, ...]
    after: tuple[float, ...]
    elevations_deg: tuple[float, ...]
    files: int | None
    lights: str | None
    decoded_as: tuple[str, ...]
    converted_from: tuple[str, ...]
    calibration: str | None
    calibrated_by: str | None
    warnings: tuple[str, ...]
    azimuths_deg: tuple[float, ...] = ()

    @classmethod
    def parse(cls, document: Fields) -> PhotographsRecord:
        """Read from a bundle's document, or from an account of photographs that were read but not baked. BakeError."""
        averages = document.part("averages")
        about = _object(document.part("source").entries.get("facts"))
        used = [_object(use) for use in _list(_object(about.get("decoding")).get("used")) if use]
        calibration = about.get("calibration")
        by, files = _object(calibration).get("by"), about.get("photographs")
        converted = dict.fromkeys(str(use["converted"]) for use in used if use.get("converted"))
        return cls(
            averages=averages.numbers("before", (1, _MOST_PHOTOGRAPHS)),
            after=averages.numbers("after", (2, MAX_SLICES)) if averages.has("after") else (),
            elevations_deg=_numbers(averages.entries.get("elevations_deg")),
            files=files if isinstance(files, int) and not isinstance(files, bool) else None,
            lights=_text(_object(about.get("lights")).get("source")),
            decoded_as=tuple(f"{use.get('rule')}: {use.get('why')}" for use in used),
            converted_from=tuple(converted),
            calibration=str(calibration.get("how", "?")) if isinstance(calibration, dict) else None,
            calibrated_by=str(by) if by else None,
            warnings=tuple(text for text in _list(document.entries.get("warnings")) if isinstance(text, str)),
            azimuths_deg=_numbers(averages.entries.get("azimuths_deg")),
        )


def _object(value: object) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def _list(value: object) -> list[Any]:
    return value if isinstance(value, list) else []


def _text(value: object) -> str | None:
    return value if isinstance(value, str) else None


def _numbers(value: object) -> tuple[float, ...]:
    return tuple(entry for entry in _list(value) if isinstance(entry, int | float) and not isinstance(entry, bool))


@dataclass(frozen=True)
class MapErrorsRecord:
    """Errors in parts of a_max.

    Attributes
    ----------
    storage_rms, signal_rms : RMS that storage and compression cost, and of the map itself, over lights of all
        directions
    held_out_relative, held_out_rms : of photographs that were left out; None where there were too few
    held_out : how many were
    """

    storage_rms: float
    signal_rms: float
    held_out_relative: float | None
    held_out_rms: float | None
    held_out: int

    @classmethod
    def parse(cls, fields: Fields) -> MapErrorsRecord:
        """Read from a bundle's "errors". Raises BakeError."""
        storage, signal = (fields.number(key, 0) for key in ("storage_rms", "signal_rms"))
        if not fields.has("held_out_relative"):
            return cls(storage, signal, None, None, 0)
        relative, rms = fields.number("held_out_relative"), fields.number("held_out_rms")
        return cls(storage, signal, relative, rms, len(fields.parts("held_out", 0, _MOST_PHOTOGRAPHS)))


@dataclass(frozen=True)
class TilingRecord:
    """How the swatch was made to tile, and how visible its seams were before and are now (1: not to be seen)."""

    method: str
    before: float
    after: float

    @classmethod
    def parse(cls, fields: Fields) -> TilingRecord:
        """Read from a bundle's "tiling". Raises BakeError."""
        seams = fields.part("seams")
        before, after = (seams.part(key).number("visibility") for key in ("before", "after"))
        return cls(fields.text("method"), before, after)


@dataclass(frozen=True)
class LobeFitRecord:
    """The lobe that the averages along the arc fit best, and what it leaves of them."""

    lobe: Lobe
    residual: float

    @classmethod
    def parse(cls, fields: Fields) -> LobeFitRecord:
        """Read from a bundle's "lobe_fit". Raises BakeError."""
        return cls(lobe_of(fields.part("lobe")), fields.number("residual"))


@dataclass(frozen=True)
class LitAlbedoRecord(AlbedoRecord):
    """The albedo of the swatch's average, and the sigma and a_max in 1/sr that it holds for."""

    sigma: float
    a_max: float

    @classmethod
    def parse(cls, document: Fields, key: str) -> LitAlbedoRecord:
        """Read from `albedo.map_albedo_facts`. Raises BakeError."""
        albedo, fields = AlbedoRecord.parse(document, key), document.part(key)
        return cls(**vars(albedo), sigma=fields.number("sigma"), a_max=fields.number("a_max"))


def check_images_hold(record: StoredMap, sizes: dict[str, tuple[int, int, int]], where: Any) -> None:
    """Raise BakeError where an image of the map, of (width, height, channels), has not the map's size."""
    layout = record.layout
    wanted = {record.image: (layout.width, layout.rows)}
    if record.model != "power":
        wanted["envelope"] = (layout.width, layout.height)
    if record.model == "azimuth":
        wanted["curves"] = (record.curve_layout.width, record.curve_layout.rows)
    for name, size in wanted.items():
        if name not in sizes:
            raise BakeError(where, f"'{name}' is missing", "bake it again")
        width, height, channels = sizes[name]
        if (width, height) != size or channels not in ((PER_TEXEL,) if name == "curves" else (3, 4)):
            raise BakeError(where, f"{name} is {width} x {height} texels, not {size[0]} x {size[1]}", "bake it again")
