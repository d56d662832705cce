"""From photographs on a light arc to a bundle of kind "shading_map": read, linearise, compress, measure, write."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from .. import VERSION
from ..brdf.common import kind_of
from ..brdf.record import BrdfRecord
from ..bundle.bundle import StoredImage, read_bundle, write_bundle
from ..bundle.origin import photographs_origin
from ..bundle.result import BakeResult
from ..errors import BakeError, check_choice
from ..images.storage import IMAGE_STORAGES, Storage
from ..photographs.stack import PhotoStack, StackSettings, read_stack
from ..rights import Rights
from ..source import BrdfSource, Facts
from ..tables.albedo import directional_albedo
from ..tiling.tileable import TileSettings, make_tileable
from .albedo import map_albedo_facts
from .light_angle import level_by_cosine
from .lobe_fit import fit_lobe
from .render_settings import RenderSettings
from .shading_map import MAX_SLICES, Linearised, ShadingMap, averages_of, held_out_errors, linearise
from .slice_atlas import GUTTER, SliceLayout
from .store import COMPRESSIONS, Compression, check_storage, store_map
from .swatch_preview import preview_swatch

Progress = Callable[[str, float], None]
Tileable = Literal["off", "auto", "quilt", "offset"]
TILEABLES: tuple[str, ...] = get_args(Tileable)


MAX_MAP_BYTES = 4 << 30
# Seams, relative to the swatch's own structure, from which on they catch the eye.
VISIBLE_SEAM = 1.5


@dataclass(frozen=True)
class ArcSettings:
    """Settings of a bake of photographs.

    Parameters
    ----------
    slices : N of the map, the black one included
    storage : of the texels
    compression : "none" keeps the slices; "power" two numbers per texel and channel, as in Kautz et al. 2004; "basis"
        `rank` numbers per texel and channel on curves fitted to this very swatch
    rank : of "basis"
    tileable : how to make the swatch tile, with one set of seams for all slices
    lobe_auto : choose f_r by the averages along the arc instead of `render.lobe`
    brdf : bundle of a measured BRDF to use as f_r instead; it is copied into this one
    render : as the material is first built
    stack : how the photographs are read
    rights : author, licence and source, which the bundle keeps
    """

    slices: int = 8
    storage: Storage = Storage.HALF
    compression: Compression = "none"
    rank: int = 2
    tileable: Tileable = "off"
    lobe_auto: bool = False
    brdf: Path | None = None
    render: RenderSettings = field(default_factory=RenderSettings)
    stack: StackSettings = field(default_factory=StackSettings)
    rights: Rights = field(default_factory=Rights)

    def __post_init__(self) -> None:
        for name, choices in (("compression", COMPRESSIONS), ("tileable", TILEABLES), ("storage", IMAGE_STORAGES)):
            check_choice(name, str(getattr(self, name)), choices)
        object.__setattr__(self, "storage", Storage(self.storage))
        if not 2 <= self.slices <= 64:
            raise BakeError("slices", f"cannot be {self.slices}", "choose 2 to 64")
        if self.slices < 3 and self.tileable != "off":
            raise BakeError("slices", f"cannot be {self.slices} for a swatch made to tile", "choose 3 to 64")
        if not 1 <= self.rank <= 3:
            raise BakeError("rank", f"cannot be {self.rank}", "choose 1, 2 or 3")
        check_storage(self.compression, self.storage)


def bake_arc(
    source: str | Path | Sequence[Path],
    out: str | Path,
    settings: ArcSettings | None = None,
    progress: Progress | None = None,
    decoder: Any = None,
    on_read: Callable[[PhotoStack, str, dict[str, str]], None] | None = None,
) -> BakeResult:
    """Bake a folder or a list of photographs. Raises BakeError; then nothing is written.

    Parameters
    ----------
    progress : called with the stage's name and its share done
    decoder : reads a photograph where neither OpenImageIO nor OpenEXR is at hand
    on_read : called with the photographs, the swatch's name and their origin before they are baked
    """
    settings = settings or ArcSettings()
    started = time.perf_counter()
    stack = read_stack(_paths(source), settings.stack, progress, decoder)
    name = Path(source).resolve().name if isinstance(source, str | Path) else Path(out).stem
    origin = photographs_origin(_paths(source))
    if on_read:
        on_read(stack, name, origin)
    result = bake_stack(stack, out, settings, progress, name=name, origin=origin)
    return replace(result, seconds=round(time.perf_counter() - started, 2))


def _paths(source: str | Path | Sequence[Path]) -> Path | Sequence[Path]:
    return Path(source) if isinstance(source, str) else source


def bake_stack(
    stack: PhotoStack,
    out: str | Path,
    settings: ArcSettings,
    progress: Progress | None = None,
    *,
    name: str = "swatch",
    origin: dict[str, str] | None = None,
) -> BakeResult:
    """Bake photographs already read; `origin` is kept in the bundle. Raises BakeError."""
    say = progress or (lambda stage, share: None)
    started = time.perf_counter()
    _check_size(stack, settings)
    say("averages and slices", 0.0)
    made = linearise(stack.images, settings.slices, name)
    say("predicting photographs", 0.0)
    held_out = held_out_errors(stack.images, settings.slices)
    shading_map, a_max, tiling = made.map, made.a_max, None
    if settings.tileable != "off":
        tiled = make_tileable(
            shading_map.slices,
            TileSettings(method=settings.tileable),
            lambda _, share: say("making it tile", share),
        )
        # The tile shows a choice of the swatch's texels, whose averages are no longer even.
        again = linearise(tiled.slices[1:], settings.slices, name)
        shading_map, a_max, tiling = again.map, a_max * again.a_max, tiled.facts
    measured, f_r = _measured_brdf(settings.brdf)
    render, fit = _chosen_render(stack, made.averages, settings)
    say("compressing", 0.0)
    images, map_facts, stored = store_map(shading_map, settings.compression, settings.storage, settings.rank)
    calibrated = a_max if stack.calibrated else None
    say("measuring", 0.0)
    facts: Facts = {
        "generator": f"measured_materials {VERSION}",
        "source": {"name": name, **(origin or {}), "facts": {"format": "photographs on a light arc", **stack.facts}},
        "warnings": [*stack.warnings, *_slice_warnings(made), *_tiling_warnings(tiling)],
        "settings": _plain(settings),
        **settings.rights.entry(),
        "map": {
            **map_facts,
            "slices": settings.slices,
            "height": int(shading_map.slices.shape[1]),
            "width": int(shading_map.slices.shape[2]),
            "gutter": GUTTER,
            "storage": str(settings.storage),
            "a_max": calibrated,
            "level_by_cosine": level_by_cosine(stack.directions, made.averages / made.a_max),
        },
        # For the plot of the linearisation (Kautz et al. 2004).
        "averages": {
            **stack.in_order(made.averages, made.order),
            "after": averages_of(shading_map.slices).tolist(),
        },
        "errors": _errors(held_out, shading_map, stored),
        "tiling": tiling,
        "lobe_fit": fit,
        "render": render.facts(),
        **_f_r_facts(measured, f_r),
        "albedo": map_albedo_facts(stored, render, calibrated, f_r),
    }
    say("writing", 0.0)
    if measured:
        images |= {name: _copied(measured, name) for name in ("table", "sampler")}
    path = write_bundle(out, facts, images, preview_swatch(stored), kind="shading_map")
    say("writing", 1.0)
    return BakeResult(path, facts, round(time.perf_counter() - started, 2))


def _check_size(stack: PhotoStack, settings: ArcSettings) -> None:
    """Refuse, before memory is taken, what no image or no memory would hold."""
    height, width = stack.images.shape[1:3]
    if settings.compression == "none":
        SliceLayout(settings.slices - 1, height, width)
    if settings.slices * height * width * 12 > MAX_MAP_BYTES:
        cause = f"would take more than {MAX_MAP_BYTES >> 30} GiB as {settings.slices} slices of {width} x {height}"
        raise BakeError("shading map", cause, "choose a smaller --size or fewer --slices")


def _measured_brdf(path: Path | None) -> tuple[BrdfRecord | None, BrdfSource | None]:
    """The record of a measured f_r and its table, both checked."""
    if path is None:
        return None, None
    bundle = read_bundle(path)
    if kind_of(bundle.material) != "brdf":
        raise BakeError(path, "is not the bundle of a BRDF", "bake one by `bake brdf`, or name a lobe")
    record = BrdfRecord.read(bundle)
    if record.anisotropic:
        raise BakeError(path, "is anisotropic, and a swatch has no direction of its own", "name an isotropic one")
    record.load_sampler()
    return record, record.load_table()


def _f_r_facts(record: BrdfRecord | None, f_r: BrdfSource | None) -> Facts:
    """What the copied table and sampler need to be read, and the BRDF's own albedo at the normal, a grey."""
    if record is None or f_r is None:
        return {}
    albedo = float(directional_albedo(f_r, 0.0, 48).mean())
    copied = {key: record.document[key] for key in ("table", "sampler")}
    return {"f_r": {"name": record.name, "albedo": albedo}, **copied}


def _copied(record: BrdfRecord, name: str) -> StoredImage:
    return StoredImage(record.files().load(name), record.images[name].storage)


def _chosen_render(
    stack: PhotoStack, averages: NDArray[np.float64], settings: ArcSettings
) -> tuple[RenderSettings, Facts | None]:
    if settings.brdf:
        return replace(settings.render, lobe=None), None
    if stack.directions is None:
        if settings.lobe_auto:
            remedy = "give --lights FILE, put the angles into the file names, or name a lobe"
            raise BakeError("lobe auto", "needs the elevations of the light, which are not known", remedy)
        return settings.render, None
    # A light in the plane of the swatch says nothing about f_r.
    seen = stack.directions[:, 2] > 1e-3
    fit = fit_lobe(np.arcsin(np.minimum(stack.directions[seen, 2], 1)), averages[seen])
    return (replace(settings.render, lobe=fit.lobe) if settings.lobe_auto else settings.render), fit.facts()


def _slice_warnings(made: Linearised) -> list[str]:
    """Warnings where a highlight takes up the slices: most photographs then lie below the first of them."""
    slices = len(made.map.slices)
    below = int((made.averages < made.a_max / (slices - 1)).sum())
    if 2 * below <= len(made.averages):
        return []
    wanted = int(min(np.ceil(made.a_max / max(float(np.median(made.averages)), 1e-30)) * 4, MAX_SLICES))
    return [f"{below} of {len(made.averages)} photographs are darker than the first of {slices} slices; try {wanted}"]


def _tiling_warnings(tiling: dict[str, Any] | None) -> list[str]:
    """Warnings of seams that people will see; a picture, unlike a texture, has no good ones."""
    after = float(tiling["seams"]["after"]["visibility"]) if tiling else 0.0
    if after <= VISIBLE_SEAM:
        return []
    return [f"seams remain visible where the swatch repeats ({after:.1f} times as strong as its own structure)"]


def _errors(held_out: list[dict[str, float]], shading_map: ShadingMap, stored: ShadingMap) -> Facts:
    difference = stored.slices[1:] - shading_map.slices[1:]
    return {
        "storage_rms": float(np.sqrt(np.square(difference).mean(dtype=np.float64))),
        "signal_rms": float(np.sqrt(np.square(shading_map.slices[1:]).mean(dtype=np.float64))),
        "held_out": held_out,
        "held_out_rms": float(np.sqrt(np.mean([row["rms"] ** 2 for row in held_out]))) if held_out else None,
        "held_out_relative": float(np.median([row["relative"] for row in held_out])) if held_out else None,
    }


def _plain(settings: ArcSettings) -> dict[str, Any]:
    plain = asdict(replace(settings, render=RenderSettings()))
    plain.pop("render")
    plain.pop("rights")
    plain["storage"] = str(settings.storage)
    plain["brdf"] = settings.brdf.name if settings.brdf else None
    plain["stack"] = {key: _json_ready(value) for key, value in plain["stack"].items()}
    return plain


def _json_ready(value: Any) -> Any:
    # Only the name of a file: the bundle travels, and paths of this computer are nobody else's business.
    if isinstance(value, Path):
        return value.name
    return [_json_ready(part) for part in value] if isinstance(value, tuple | list) else value
