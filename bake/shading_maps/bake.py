"""Photographs on a light arc, or lit from all around, to a bundle of kind "shading_map": read, linearise, compress,
measure, write.
"""

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
from ..lobes.lobe_fit import fit_lobe
from ..photographs.lights import cut_to_arc, light_files_beside, read_with
from ..photographs.stack import FORMAT, FoundStack, PhotoStack, StackSettings, find_stack, plan_found, read_planned
from ..rights import Rights
from ..source import BrdfSource, Facts, Json
from ..tables.albedo import directional_albedo
from ..tiling.tileable import TileSettings
from .against_light import ThroughSettings, read_both
from .albedo import map_albedo_facts
from .azimuth.against_arc import check_lights, foretells, surround
from .azimuth.azimuth_basis import MAX_RANK, MIN_RANK
from .azimuth.azimuth_fit import Prepared
from .baked_map import Storing, along_arc, check_arc_size, check_size_around, over_azimuth, prepare
from .render_settings import RenderSettings
from .store import COMPRESSIONS, Compression, check_azimuth_storage, check_storage
from .swatch_preview import preview_swatch

Progress = Callable[[str, float], None]
Tileable = Literal["off", "auto", "quilt", "offset"]
TILEABLES: tuple[str, ...] = get_args(Tileable)
Azimuths = Literal["auto", "arc", "all"]
AZIMUTHS: tuple[str, ...] = get_args(Azimuths)
# How photographs are baked: see `bake_stack`.
Way = Prepared | Literal["arc", "try"]

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
    azimuths : "arc" keeps the photographs of one arc; "all" makes a map over azimuth of all of them; "auto" that, where
        lights surround the swatch, nothing is said of the arc, and it foretells photographs better
    azimuth_rank : curves of a map over azimuth; None takes as many as predict photographs that are
        left out and keep those that are there
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
    azimuths: Azimuths = "auto"
    azimuth_rank: int | None = None

    def __post_init__(self) -> None:
        offered = {"compression": COMPRESSIONS, "tileable": TILEABLES, "storage": IMAGE_STORAGES, "azimuths": AZIMUTHS}
        for name, choices in offered.items():
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
        if self.azimuth_rank is not None and not MIN_RANK <= self.azimuth_rank <= MAX_RANK:
            raise BakeError("azimuth rank", f"cannot be {self.azimuth_rank}", f"choose {MIN_RANK} to {MAX_RANK}")
        if self.azimuths == "all":
            check_azimuth_storage(self.storage)
        self._check_azimuths()

    def _check_azimuths(self) -> None:
        """Raise BakeError where something else is asked for that these azimuths have no use for."""
        of_an_arc = {
            "an azimuth": self.stack.azimuth is not None,
            "a spread": "spread" in self._said(),
            "sides": "sides" in self._said(),
            f"compression {self.compression}": self.compression != "none",
            "photographs against the light": self.through is not None,
        }
        excluded = {"all": of_an_arc, "arc": {"an azimuth rank": self.azimuth_rank is not None}}
        for name, asked in excluded.get(self.azimuths, {}).items():
            if asked:
                other = "arc" if self.azimuths == "all" else "all"
                remedy = f"choose azimuths {other}, or leave it out"
                raise BakeError(f"azimuths {self.azimuths}", f"and {name} exclude each other", remedy)

    def _said(self) -> set[str]:
        """What is said of the arc."""
        usual = StackSettings()
        return {name for name in ("azimuth", "spread", "sides") if getattr(self.stack, name) != getattr(usual, name)}

    def takes_azimuths(self) -> bool:
        """Whether a map over azimuth is made where lights surround the swatch."""
        kept = self.compression == "none" and self.storage in (Storage.HALF, Storage.FLOAT32)
        auto = self.azimuths == "auto" and kept and not self._said() and self.through is None
        return self.azimuths == "all" or auto


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
    name = Path(source).resolve().name if isinstance(source, str | Path) else Path(out).stem
    paths, through = _paths(source), None
    way: Way = "arc"
    if settings.through is None:
        stack, way = _read(paths, settings, progress, decoder, name)
    else:
        behind = settings.through.found(paths if isinstance(paths, Path) else Path(*paths[:1]).parent)
        stack, through = read_both(paths, settings.stack, behind, progress, decoder)
    origin = photographs_origin(paths)
    recipe = arc_recipe(paths, settings, {"name": name, **origin})
    if on_read:
        on_read(stack, name, origin)
    beside: dict[str, Any] = {"origin": origin, "through": through, "recipe": recipe, "way": way}
    result = bake_stack(stack, out, settings, progress, name=name, **beside)
    return replace(result, seconds=round(time.perf_counter() - started, 2))


def _read(
    source: Path | Sequence[Path], settings: ArcSettings, progress: Progress | None, decoder: Any, name: str
) -> tuple[PhotoStack, Way]:
    """Photographs of all lights, where a map over azimuth is to be made of them; else of one arc. Raises BakeError."""
    if progress is not None:
        progress("reading", 0.0)
    found, warnings = find_stack(source, settings.stack, decoder), []
    try:
        if (around := _read_around(found, settings, progress, decoder, name)) is not None:
            return around
    except BakeError as error:  # what is wrong may not be of the arc
        if settings.azimuths == "all":
            raise
        # Without the folder: the bundle keeps it.
        where = Path(error.file).name
        warnings.append(f"one arc is used instead of all lights: {where} {error.cause}; {error.remedy}")
    stack = read_planned(plan_found(found, settings.stack), progress, decoder)
    return replace(stack, warnings=(*stack.warnings, *warnings)), "arc"


def _read_around(
    found: FoundStack, settings: ArcSettings, progress: Progress | None, decoder: Any, name: str
) -> tuple[PhotoStack, Prepared] | None:
    """Photographs of all lights; None where no map over azimuth is asked for or called for. Raises BakeError."""
    if not _may_surround(found.lights.directions, settings):
        return None
    planned = plan_found(found, settings.stack.all_around())
    plan, place = planned.plan, planned.plan.placement
    if not _may_surround(plan.directions, settings):
        return None
    tiled = settings.tileable != "off"
    check_size_around(len(plan.groups), place.height, place.width, settings.azimuth_rank, tiled)
    stack = read_planned(planned, progress, decoder)
    way = _tried(stack, settings, name)
    return None if isinstance(way, str) else (stack, way)


def _may_surround(directions: NDArray[np.float64] | None, settings: ArcSettings) -> bool:
    """Whether a map over azimuth is asked for, or may be made of photographs under these lights. Raises BakeError."""
    if settings.azimuths == "all":
        check_lights(directions)
    return settings.azimuths == "all" or (settings.takes_azimuths() and surround(directions))


def _tried(stack: PhotoStack, settings: ArcSettings, name: str) -> Prepared | Literal["arc"]:
    """Which way photographs are baked, by the settings, their lights, and what foretells those left out better."""
    if not _may_surround(stack.directions, settings):
        return "arc"
    count, height, width, _ = stack.images.shape
    check_size_around(count, height, width, settings.azimuth_rank, settings.tileable != "off")
    prepared = prepare(stack, name)
    better = settings.azimuths == "all" or foretells(prepared, settings.stack.spread)
    return prepared if better else "arc"


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
    way: Way = "try",
) -> BakeResult:
    """Bake photographs already read; `origin` is kept in the bundle. Raises BakeError.

    Parameters
    ----------
    through : of the same frame against the light
    recipe : of all that is baked, kept in the bundle
    way : "arc" for a map of all these photographs as one arc, or what was prepared for a map over azimuth; "try"
        decides by `settings` and the photographs
    """
    say = progress or (lambda stage, share: None)
    started = time.perf_counter()
    stacks = [stack] if through is None else [stack, through]
    tile = None if settings.tileable == "off" else TileSettings(method=settings.tileable)
    measured, f_r = _measured_brdf(settings.brdf)
    if way == "try":
        way = _tried(stack, settings, name) if through is None else "arc"
    if isinstance(way, Prepared):
        made, tiling = over_azimuth(stack, settings.storage, settings.azimuth_rank, tile, say, way)
        maps = [made]
    else:
        storing = Storing(settings.slices, settings.compression, settings.storage, settings.rank)
        check_arc_size(stack, storing, len(stacks))
        maps, tiling = along_arc(stacks, storing, tile, name, say)
        if settings.azimuth_rank is not None:
            maps[0].warnings.append(f"azimuth rank {settings.azimuth_rank} has no effect on the map of one arc")
    render, fit = _chosen_render(stack, maps[0].averages, settings)
    calibrated = maps[0].a_max if stack.calibrated else None
    facts: dict[str, Json] = {
        "generator": f"measured_materials {VERSION}",
        **maps[0].told,
        "source": {"name": name, **(origin or {}), **_source(stack)},
        "warnings": [*stack.warnings, *maps[0].warnings, *_tiling_warnings(tiling)],
        "settings": _plain(settings, stack),
        **({RECIPE: recipe} if recipe else {}),
        **settings.rights.entry(),
        "tiling": tiling,
        "lobe_fit": fit,
        "render": render.facts(),
        **_f_r_facts(measured, f_r),
        "albedo": map_albedo_facts(maps[0].stored, render, calibrated, f_r),
    }
    images = dict(maps[0].images)
    if through is not None:
        behind = maps[1].a_max if through.calibrated else None
        lit = render.of_transmission(through.calibrated)
        facts["through"] = {
            **maps[1].told,
            "source": {"name": name, **_source(through)},
            "warnings": [*through.warnings, *maps[1].warnings],
            "albedo": map_albedo_facts(maps[1].stored, lit, behind),
        }
        images |= {f"through_{key}": image for key, image in maps[1].images.items()}
    say("writing", 0.0)
    if measured:
        images |= {part: _copied(measured, part) for part in ("table", "sampler")}
    path = write_bundle(out, facts, images, preview_swatch(maps[0].stored), kind="shading_map")
    say("writing", 1.0)
    return BakeResult(path, facts, round(time.perf_counter() - started, 2))


def _source(stack: PhotoStack) -> dict[str, Json]:
    return {"facts": {"format": FORMAT, **stack.facts}}


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


def _tiling_warnings(tiling: dict[str, Any] | None) -> list[str]:
    """Warnings of seams that people will see; a picture, unlike a texture, has no good ones."""
    after = float(tiling["seams"]["after"]["visibility"]) if tiling else 0.0
    if after <= VISIBLE_SEAM:
        return []
    return [f"seams remain visible where the swatch repeats ({after:.1f} times as strong as its own structure)"]


def _plain(settings: ArcSettings, photographs: PhotoStack) -> dict[str, Any]:
    plain = asdict(replace(settings, render=RenderSettings()))
    plain.pop("render")
    plain.pop("rights")
    plain["storage"] = str(settings.storage)
    usual = ArcSettings()
    if settings.azimuth_rank is None:
        plain.pop("azimuth_rank")
    if settings.azimuths == usual.azimuths and not cut_to_arc(photographs.facts):
        plain.pop("azimuths")  # as bundles were before there was a choice
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
