"""The virtual gantry: photographs of Blender geometry or materials, on a light arc or from any side.

A pixel is f_r cos(theta_i) in 1/sr, interreflections included; see `gantry_scene`.
"""

from __future__ import annotations

import contextlib
import csv
import math
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ...bake.atomic_write import replacing_folder
from ...bake.errors import BakeError
from ...bake.images.image_io import write_image
from ...bake.images.storage import Storage
from .scene import SUN_ANGLE, Gantry, Target, gantry_scene

__all__ = ["SUN_ANGLE", "Gantry", "Target", "gantry_scene", "photograph_arc", "photograph_view", "plane_scene"]

LIGHTS_FILE = "lights.csv"
_OWN_FILES = re.compile(r"el\d{3}\.\d{2}\.exr|" + re.escape(LIGHTS_FILE))

Angles = tuple[float, float]


def photograph_arc(
    target: Target,
    folder: str | Path,
    *,
    elevations: Sequence[float],
    azimuth: float = 0.0,
    size: int = 512,
    tile: float = 1.0,
    samples: int = 64,
    behind: bool = False,
    progress: Callable[[float], None] | None = None,
) -> list[Path]:
    """Photograph a tile from straight above with the sun at each elevation of an arc.

    Image x is u, the top row is v = 1, and azimuth 0 is light from the side of larger u. The folder appears when
    everything is in it, and replaces an older arc only.

    Parameters
    ----------
    target : see `gantry_scene`
    elevations : degrees above the plane, 1 to 179; beyond 90 the sun stands on the far side
    azimuth : of the arc's plane, degrees from +u towards +v
    behind : the arc lies behind the tile, and `lights.csv` has its elevations below the horizon
    progress : called with the share done, in [0, 1]

    Returns
    -------
    the frames `elEEE.EE.exr`, float32, in the order of `elevations`. Beside them lies `lights.csv` with the
    columns file, elevation, azimuth in degrees, where no elevation is beyond 90.

    Raises
    ------
    BakeError : elevations without sense, nothing to photograph, or a folder that cannot be written or holds
        other things
    """
    folder = Path(folder)
    elevations = _checked_elevations(elevations)
    if not math.isfinite(azimuth):
        raise BakeError("azimuth", f"is {azimuth}", "give degrees")
    _check_folder(folder)
    names = [f"el{elevation:06.2f}.exr" for elevation in elevations]
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with (
            replacing_folder(folder) as temporary,
            gantry_scene(target, size=size, tile=tile, samples=samples) as gantry,
        ):
            gantry.set_view(0, 0)
            gantry.set_light(math.radians(90 - min(min(e, 180 - e) for e in elevations)), 0, behind=behind)
            for index, (elevation, name) in enumerate(zip(elevations, names)):
                gantry.set_light(*_sun_angles(elevation, azimuth), behind=behind)
                # One seed: all frames see the same points of a texel, whose noise is then no change with light.
                with _relayed(progress, index, len(names)) as report:
                    frame = gantry.render(progress=report)
                facts = {"elevation": f"{elevation:g}", "azimuth": f"{azimuth:g}", "samples": str(samples)}
                try:
                    write_image(temporary / name, frame, Storage.FLOAT32, facts)
                except BakeError as error:  # the temporary folder is nobody's concern
                    raise BakeError(folder / name, error.cause, error.remedy) from error
            _write_lights(temporary / LIGHTS_FILE, names, elevations, azimuth, behind)
    except OSError as error:
        raise BakeError(
            folder, f"cannot be written ({error.strerror or error})", "choose another place for it"
        ) from error
    return [folder / name for name in names]


def photograph_view(
    target: Target,
    *,
    view: Angles = (0.0, 0.0),
    light: Angles = (0.0, 0.0),
    size: int = 512,
    tile: float = 1.0,
    samples: int = 64,
    seed: int = 0,
    behind: bool = False,
    sun_angle: float = SUN_ANGLE,
    progress: Callable[[float], None] | None = None,
) -> NDArray[np.float32]:
    """One orthographic picture of the tiled target from any side, (size, size, 3) in 1/sr, row 0 on top.

    The frame is a square of edge `tile` about the middle of the tile at height 0, across the line of sight: the
    tile itself appears foreshortened, with its neighbours around it. The flat tile of a material gives the
    same picture pixel by pixel as geometry about height 0, occlusion apart.

    Parameters
    ----------
    view, light : (theta, phi) from the normal and from +u, radians
    behind : the light is mirrored in the tile

    Raises
    ------
    BakeError : see `gantry_scene`
    """
    with gantry_scene(target, size=size, tile=tile, samples=samples, sun_angle=sun_angle) as gantry:
        gantry.set_light(*light, behind=behind)
        gantry.set_view(*view)
        return gantry.render(seed, progress)


@contextlib.contextmanager
def plane_scene(
    material: bpy.types.Material, *, view: Angles = (0.0, 0.0), light: Angles = (0.0, 0.0), **options: Any
) -> Iterator[bpy.types.Scene]:
    """The scene of `photograph_view` around a flat tile of the material, to be rendered by other means.

    `options` are those of `gantry_scene`.
    """
    with gantry_scene(material, **options) as gantry:
        gantry.set_light(*light)
        gantry.set_view(*view)
        yield gantry.scene


# --- angles and files -----------------------------------------------------------------------------------


def _sun_angles(elevation: float, azimuth: float) -> Angles:
    """Theta and phi in radians of degrees on an arc, which may go on beyond the zenith."""
    behind = elevation > 90
    theta = elevation - 90 if behind else 90 - elevation
    return math.radians(theta), math.radians(azimuth + 180 * behind)


def _checked_elevations(elevations: Sequence[float]) -> list[float]:
    degrees = [float(elevation) for elevation in elevations]
    if not degrees:
        raise BakeError("elevations", "are none", "give at least one angle in degrees")
    for value in degrees:
        if not 1 <= value <= 179:
            raise BakeError("elevations", f"hold {value:g}", "stay between 1 and 179 degrees")
    if len({f"{value:.2f}" for value in degrees}) < len(degrees):
        raise BakeError("elevations", "name an angle twice", "keep them 0.01 degrees apart")
    return degrees


def _check_folder(folder: Path) -> None:
    """Only an arc may be replaced: whatever else lies there is somebody's."""
    try:
        held = [file.name for file in folder.iterdir()] if folder.exists() else []
    except OSError as error:
        raise BakeError(folder, f"cannot be used ({error.strerror})", "choose another place for it") from error
    if other := sorted(name for name in held if not _OWN_FILES.fullmatch(name)):
        raise BakeError(folder, f"holds other things ({other[0]})", "choose a new or an empty folder")


def _write_lights(file: Path, names: Sequence[str], elevations: Sequence[float], azimuth: float, behind: bool) -> None:
    with open(file, "w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["file", "elevation", "azimuth"])
        for name, elevation in zip(names, elevations):
            theta, phi = _sun_angles(elevation, azimuth)
            above = 90 - math.degrees(theta)
            writer.writerow([name, f"{-above if behind else above:.6g}", f"{math.degrees(phi) % 360:.6g}"])


@contextlib.contextmanager
def _relayed(
    progress: Callable[[float], None] | None, index: int, count: int
) -> Iterator[Callable[[float], None] | None]:
    """One frame's share of the whole. What `progress` raises comes out after the frame: Blender would swallow it."""
    if progress is None:
        yield None
        return
    raised: list[BaseException] = []

    def report(share: float) -> None:
        if not raised:
            try:
                progress((index + share) / count)
            except BaseException as error:
                raised.append(error)

    yield report
    if raised:
        raise raised[0]
