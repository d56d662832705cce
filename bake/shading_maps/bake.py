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
from ..bundle.origin import Origin, photographs_origin
from ..bundle.recipe import RECIPE, recipe_of
from ..bundle.result import BakeResult
from ..errors import BakeError, check_choice
from ..images.storage import IMAGE_STORAGES, Storage
from ..photographs.lights import light_files_beside, read_with
from ..photographs.stack import FORMAT, PhotoStack, StackSettings, read_stack
from ..rights import Rights
from ..source import BrdfSource, Facts, Json
from ..tables.albedo import directional_albedo
from ..tiling.tileable import TileSettings, make_tileable
from .against_light import ThroughSettings, read_both
from .albedo import map_albedo_facts
from .lobe_fit import fit_lobe
from .render_settings import RenderSettings
from .shading_map import MAX_SLICES, Linearised, ShadingMap, averages_of, held_out_errors, level_by_cosine, linearise
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
    through : photographs against the light, of which the bundle then holds a second map
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
    through: ThroughSettings | None = None

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
        if self.through is not None:
            self.through.stack(self.stack)


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
    paths, through = _paths(source), None
    if settings.through is None:
        stack = read_stack(paths, settings.stack, progress, decoder)
    else:
        behind = settings.through.found(paths if isinstance(paths, Path) else Path(*paths[:1]).parent)
        stack, through = read_both(paths, settings.stack, behind, progress, decoder)
    name = Path(source).resolve().name if isinstance(source, str | Path) else Path(out).stem
    origin = photographs_origin(paths)
    recipe = arc_recipe(paths, settings, {"name": name, **origin})
    if on_read:
        on_read(stack, name, origin)
    result = bake_stack(stack, out, settings, progress, name=name, origin=origin, through=through, recipe=recipe)
    return replace(result, seconds=round(time.perf_counter() - started, 2))


def arc_recipe(source: Path | Sequence[Path], settings: ArcSettings, origin: Origin) -> str:
    """Recipe of a bundle that `bake_arc` makes of these photographs; `origin` with their name. Raises BakeError."""
    folder = source if isinstance(source, Path) else Path(*source[:1]).parent
    if settings.through is not None:
        settings = replace(settings, through=settings.through.found(folder))
    given = settings.stack.lights
    files = light_files_beside(folder) if given is None else read_with(Path(given))
    return recipe_of(settings, origin, files)


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
    through: PhotoStack | None = None,
    recipe: str = "",
) -> BakeResult:
    """Bake photographs already read; `origin` is kept in the bundle. Raises BakeError.

    Parameters
    ----------
    through : of the same frame against the light
    recipe : of all that is baked, kept in the bundle
    """
    say = progress or (lambda stage, share: None)
    started = time.perf_counter()
    stacks = [stack] if through is None else [stack, through]
    _check_size(stack, settings, len(stacks))
    say("averages and slices", 0.0)
    made = [linearise(one.images, settings.slices, name) for one in stacks]
    say("predicting photographs", 0.0)
    held_out = [held_out_errors(one.images, settings.slices) for one in stacks]
    swatches, tiling = [_Swatch(one.map, one.a_max) for one in made], None
    if settings.tileable != "off":
        swatches, tiling = _tiled(
            swatches, TileSettings(method=settings.tileable), name, lambda share: say("making it tile", share)
        )
    measured, f_r = _measured_brdf(settings.brdf)
    render, fit = _chosen_render(stack, made[0].averages, settings)
    say("compressing", 0.0)
    kept = [_Kept(*store_map(one.map, settings.compression, settings.storage, settings.rank)) for one in swatches]
    say("measuring", 0.0)
    told = [_told(*one) for one in zip(stacks, made, swatches, held_out, kept, strict=True)]
    calibrated = swatches[0].a_max if stack.calibrated else None
    facts: dict[str, Json] = {
        "generator": f"measured_materials {VERSION}",
        **told[0],
        "source": {"name": name, **(origin or {}), **_source(stack)},
        "warnings": [*stack.warnings, *_slice_warnings(made[0]), *_tiling_warnings(tiling)],
        "settings": _plain(settings),
        **({RECIPE: recipe} if recipe else {}),
        **settings.rights.entry(),
        "tiling": tiling,
        "lobe_fit": fit,
        "render": render.facts(),
        **_f_r_facts(measured, f_r),
        "albedo": map_albedo_facts(kept[0].stored, render, calibrated, f_r),
    }
    images = dict(kept[0].images)
    if through is not None:
        behind = swatches[1].a_max if through.calibrated else None
        lit = render.of_transmission(through.calibrated)
        facts["through"] = {
            **told[1],
            "source": {"name": name, **_source(through)},
            "warnings": [*through.warnings, *_slice_warnings(made[1])],
            "albedo": map_albedo_facts(kept[1].stored, lit, behind),
        }
        images |= {f"through_{key}": image for key, image in kept[1].images.items()}
    say("writing", 0.0)
    if measured:
        images |= {part: _copied(measured, part) for part in ("table", "sampler")}
    path = write_bundle(out, facts, images, preview_swatch(kept[0].stored), kind="shading_map")
    say("writing", 1.0)
    return BakeResult(path, facts, round(time.perf_counter() - started, 2))


@dataclass(frozen=True, eq=False)
class _Swatch:
    """A map and its level 1 in the unit of the photographs."""

    map: ShadingMap
    a_max: float


@dataclass(frozen=True, eq=False)
class _Kept:
    """What `store_map` makes."""

    images: dict[str, StoredImage]
    facts: Facts
    stored: ShadingMap


def _tiled(
    swatches: list[_Swatch], settings: TileSettings, name: str, say: Callable[[float], None]
) -> tuple[list[_Swatch], dict[str, Any]]:
    """The same made to tile, by one set of seams for the slices of all, and the account of it."""
    slices = np.concatenate([swatches[0].map.slices, *(one.map.slices[1:] for one in swatches[1:])])
    tiled = make_tileable(slices, settings, lambda _, share: say(share))
    parts, found = np.split(tiled.slices[1:], len(swatches)), []
    for one, part in zip(swatches, parts, strict=True):
        # The tile shows a choice of the swatch's texels, whose averages are no longer even.
        again = linearise(part, len(part) + 1, name)
        found.append(_Swatch(again.map, one.a_max * again.a_max))
    return found, tiled.facts


def _told(
    stack: PhotoStack, made: Linearised, swatch: _Swatch, held_out: list[dict[str, float]], kept: _Kept
) -> dict[str, Json]:
    """Map, averages and errors of a stack, JSON-ready."""
    count, height, width, _ = swatch.map.slices.shape
    return {
        "map": {
            **kept.facts,
            "slices": count,
            "height": int(height),
            "width": int(width),
            "gutter": GUTTER,
            "storage": str(next(iter(kept.images.values())).storage),
            "a_max": swatch.a_max if stack.calibrated else None,
            "level_by_cosine": level_by_cosine(stack.directions, made.averages / made.a_max),
        },
        # For the plot of the linearisation (Kautz et al. 2004).
        "averages": {
            **stack.in_order(made.averages, made.order),
            "after": averages_of(swatch.map.slices).tolist(),
        },
        "errors": _errors(held_out, swatch.map, kept.stored),
    }


def _source(stack: PhotoStack) -> dict[str, Json]:
    return {"facts": {"format": FORMAT, **stack.facts}}


def _check_size(stack: PhotoStack, settings: ArcSettings, maps: int) -> None:
    """Refuse, before memory is taken, what no image or no memory would hold."""
    height, width = stack.images.shape[1:3]
    if settings.compression == "none":
        SliceLayout(settings.slices - 1, height, width)
    if maps * settings.slices * height * width * 12 > MAX_MAP_BYTES:
        slices = f"{maps * settings.slices} slices of {width} x {height}"
        cause = f"would take more than {MAX_MAP_BYTES >> 30} GiB as {slices}"
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
    stack = {key: _json_ready(value) for key, value in plain["stack"].items() if key != "behind"}
    if not stack["spheres"]:  # which older versions do not know
        del stack["spheres"]
    plain["stack"] = stack
    plain.pop("through")
    if settings.through is not None:
        plain["through"] = settings.through.facts()
    return plain


def _json_ready(value: Any) -> Any:
    # Only the name of a file: the bundle travels, and paths of this computer are nobody else's business.
    if isinstance(value, Path):
        return value.name
    return [_json_ready(part) for part in value] if isinstance(value, tuple | list) else value
