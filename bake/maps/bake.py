"""From photographs under lights of many directions to a folder of maps: read, fit, level, integrate, write."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import VERSION
from ..atomic_write import publish_folder, replacing_folder
from ..bundle.checked_json import dump_json, load_json
from ..bundle.origin import Origin, photographs_origin
from ..errors import BakeError, check_choice
from ..photographs.photograph import Decoder
from ..photographs.stack import PhotoStack, StackSettings, plan_stack, read_planned
from ..source import Facts
from .detail import MOST as MOST_REDUCED
from .detail import reduced_maps
from .height import height_of, slopes, unfollowed
from .materialx import materialx_document
from .normals import Surface, check_directions
from .surface import surface_of
from .write import (
    DOCUMENT,
    FILE_KINDS,
    FULL_SPECULAR,
    MATERIALX,
    NORMAL_CONVENTIONS,
    PROGRAM,
    FileKind,
    Maps,
    NormalConvention,
    write_maps,
)

STAGES = {"reading": 3.0, "aligning": 2.0, "fitting": 10.0, "writing": 1.0}
# Of photographs on no known scale, the brightest texels but for a two-hundredth are made as bright as this.
_BRIGHTEST, _BRIGHT_SHARE = 0.8, 99.5
# A misfit beyond this share of what is seen says that lights or their directions are not what they are said to be.
_DOUBTFUL = 0.2
_FEW_LIGHTS = 8
_WORTH_TELLING = 0.01


@dataclass(frozen=True)
class MapSettings:
    """Settings of `bake_maps`.

    Parameters
    ----------
    normals : which way green points: "opengl" up the picture, as in Blender and glTF, or "directx" down
    files : "png8", "png16" or "exr"
    level : the swatch is flat as a whole: slopes that are linear across the frame are those of a lamp that was near, or
        of a swatch not quite square to the camera, and are left out
    reduce : so many texels of the fit, across and down, become one of the maps (`reduced_maps`)
    repeats : the frame goes on at its opposite edge, as that of a swatch made tileable does
    stack : how the photographs are read; whichever arc it names, all lights are used

    Raises
    ------
    BakeError : a value that makes no sense
    """

    normals: NormalConvention = "opengl"
    files: FileKind = "png16"
    level: bool = True
    repeats: bool = False
    stack: StackSettings = field(default_factory=StackSettings)
    reduce: int = 1

    def __post_init__(self) -> None:
        if not 1 <= self.reduce <= MOST_REDUCED:
            raise BakeError("reduce", f"is {self.reduce}", f"choose 1 to {MOST_REDUCED}")
        check_choice("normals", self.normals, NORMAL_CONVENTIONS)
        check_choice("files", self.files, FILE_KINDS)


@dataclass(frozen=True, eq=False)
class MapsResult:
    """Folder that was written, what `DOCUMENT` in it says, the seconds it took, and warnings, a line each."""

    path: Path
    facts: dict[str, Any]
    seconds: float
    warnings: tuple[str, ...]


def bake_maps(
    source: Path | str | Sequence[Path | str],
    folder: Path,
    settings: MapSettings | None = None,
    progress: Callable[[str, float], None] | None = None,
    decoder: Decoder | None = None,
    *,
    replace: bool = False,
) -> MapsResult:
    """Write normal, albedo, height, roughness and specular maps of a stack of photographs into a folder of its own.

    The folder appears when everything is in it, and replaces maps of the same photographs only, or with `replace` of
    any.

    Raises
    ------
    BakeError : as `read_stack` and `photometric_stereo`; the folder holds something else, or cannot be written
    """
    started = time.monotonic()
    settings, say = settings or MapSettings(), progress or (lambda stage, share: None)
    _refuse_foreign(folder)
    planned = plan_stack(source, settings.stack.all_around(), decoder)
    name = _name_of(source)
    _check(planned.plan.directions, name)
    origin = photographs_origin(source if isinstance(source, str | Path) else [Path(path) for path in source])
    if not replace:
        _refuse_another(folder, name, origin)
    stack = read_planned(planned, say, decoder)
    maps, facts, warnings = maps_of(stack, settings, name, lambda share: say("fitting", share))
    facts["origin"] = origin
    say("writing", 0.0)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with replacing_folder(folder) as temporary:
            facts["maps"] = written = write_maps(temporary, maps, settings.normals, settings.files)
            facts["materialx"] = MATERIALX
            (temporary / MATERIALX).write_text(materialx_document(name, written), encoding="utf-8")
            (temporary / DOCUMENT).write_text(dump_json(facts, folder / DOCUMENT), encoding="utf-8")
    except OSError as error:
        raise _unwritten(folder, error) from error
    say("writing", 1.0)
    return MapsResult(folder, facts, time.monotonic() - started, warnings)


def move_maps(whole: Path, target: Path) -> Facts:
    """Have a folder of maps become `target`, in one step, and return its facts. Raises BakeError."""
    _refuse_foreign(target)
    try:
        publish_folder(whole, target)
    except OSError as error:
        raise _unwritten(target, error) from error
    return load_json(target / DOCUMENT)


def _unwritten(folder: Path, error: OSError) -> BakeError:
    return BakeError(folder, f"cannot be written ({error.strerror or error})", "choose another folder")


def maps_of(
    stack: PhotoStack, settings: MapSettings, origin: str, progress: Callable[[float], None] | None = None
) -> tuple[Maps, dict[str, Any], tuple[str, ...]]:
    """Maps, a JSON-ready account, and warnings.

    Raises
    ------
    BakeError : as `photometric_stereo`, naming the `origin`
    """
    warnings = list(stack.warnings)
    _check(stack.directions, origin)
    assert stack.directions is not None
    surface, gloss = surface_of(stack.images, stack.directions, progress)
    scale = 1.0
    if not stack.calibrated:
        scale = _BRIGHTEST / max(float(np.percentile(surface.albedo, _BRIGHT_SHARE)), 1e-12)
        warnings.append(
            f"brightness is not calibrated: albedo and specular are scaled so that the brightest albedo is "
            f"{_BRIGHTEST:g}; give --albedo or --white-card"
        )
    misfit = float(np.median(surface.misfit))
    if misfit > _DOUBTFUL:
        warnings.append(
            f"the photographs contradict the directions of their lights by {misfit:.0%} in the median: check those"
        )
    if len(stack.images) < _FEW_LIGHTS:
        warnings.append(f"{len(stack.images)} lights tell shadow and gloss from slope badly: {_FEW_LIGHTS} or more do")
    strong = float((gloss.strength * scale > FULL_SPECULAR).mean())
    if settings.files != "exr" and strong > _WORTH_TELLING:
        warnings.append(
            f"{strong:.0%} of the texels reflect more than PNG's specular holds, an F0 of {FULL_SPECULAR:g}: give "
            "--files exr"
        )
    normal, tilt = _levelled(surface) if settings.level else (surface.normals, 0.0)
    height = height_of(normal, repeats=settings.repeats)
    albedo = surface.albedo * np.float32(scale)
    beyond = float((albedo > 1).mean())
    facts = {
        "program": PROGRAM,
        "version": VERSION,
        "source": origin,
        "photographs": list(stack.names),
        "lights": np.round(stack.directions, 6).tolist(),
        "calibrated": stack.calibrated,
        "misfit": round(misfit, 4),
        "levelled_deg": round(tilt, 3),
        "slopes_without_height": round(unfollowed(normal, height), 4),
        "gloss_told_share": round(float(gloss.told.mean()), 4),
        "mean_albedo": np.round(albedo.mean((0, 1)), 4).tolist(),
        "albedo_above_one_share": round(beyond, 6),
        "specular_above_png_share": round(strong, 6),
        "reading": stack.facts,
        "warnings": warnings,
    }
    width = np.float32(normal.shape[1])
    reflectance = gloss.strength * np.float32(scale)
    maps = Maps(normal, albedo, height / width, gloss.roughness, reflectance)
    if settings.reduce > 1:
        facts["reduced"] = settings.reduce
    return reduced_maps(maps, settings.reduce), facts, tuple(warnings)


def _levelled(surface: Surface) -> tuple[NDArray[np.float32], float]:
    """Normals without the part of their slopes that is linear across the frame, and its RMS in degrees.

    A lamp that is near lights the sides of the frame from other directions than its middle, as if the swatch were a
    bowl: slopes that grow evenly across it.
    """
    p, q = slopes(surface.normals)
    rows, columns = np.indices(p.shape)
    place = np.stack([np.ones(p.size), rows.ravel() / p.shape[0], columns.ravel() / p.shape[1]], -1)
    found, *_ = np.linalg.lstsq(place, np.stack([p.ravel(), q.ravel()], -1), rcond=None)
    bowl = (place @ found).reshape(*p.shape, 2)
    normal = np.dstack([bowl[..., 0] - p, bowl[..., 1] - q, np.ones_like(p)])
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    return normal.astype(np.float32), float(np.degrees(np.arctan(np.sqrt((bowl**2).sum(-1).mean()))))


def _check(directions: NDArray[np.float64] | None, origin: str) -> None:
    try:
        check_directions(directions)
    except BakeError as error:
        raise BakeError(origin, f"{error.file} {error.cause}", error.remedy) from None


def _refuse_another(folder: Path, name: str, origin: Origin) -> None:
    """Raise BakeError where the folder holds maps of other photographs."""
    if not (folder / DOCUMENT).is_file():
        return
    document = load_json(folder / DOCUMENT)
    if document.get("origin") != origin or document.get("source") != name:
        what = f"holds maps of other photographs ({str(document.get('source'))[:60]!r})"
        raise BakeError(folder, what, "give another --out, or --replace")


def _name_of(source: Path | str | Sequence[Path | str]) -> str:
    path = Path(source) if isinstance(source, str | Path) else Path(source[0]).parent
    return path.resolve().name or "swatch"


def _refuse_foreign(folder: Path) -> None:
    """Raise BakeError where the folder holds anything but maps that we wrote."""
    if not folder.exists() and not folder.is_symlink():
        return
    remedy = "choose another name, or move it away"
    if folder.is_symlink() or not folder.is_dir():
        raise BakeError(folder, "is there already, and no folder of maps", remedy)
    names = {path.name for path in folder.iterdir()}
    if not names:
        return
    try:
        document = load_json(folder / DOCUMENT)
        maps = document.get("maps")
        known = {str(about["file"]) for about in maps.values()} if isinstance(maps, dict) else set()
        known.add(str(document.get("materialx")))
    except (BakeError, OSError, ValueError, KeyError, TypeError, AttributeError):
        known, document = set(), {}
    if document.get("program") != PROGRAM or (foreign := sorted(names - known - {DOCUMENT})):
        what = f"holds other files ({foreign[0]})" if document.get("program") == PROGRAM else "holds other files"
        raise BakeError(folder, what, remedy)
