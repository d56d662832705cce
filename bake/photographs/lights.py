"""The light of each photograph, and the choice of one arc among many lights."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..errors import BakeError
from .brackets import bracket_stem
from .folder import list_names
from .light_files.entry import LightEntry, Vector, direction_in_name, name_key
from .light_files.readers import FILENAMES, numbers_of_lines, read_lights

_HORIZON = 1e-6
"""Sine of the elevation up to which a light lies in the plane of the swatch."""
_SAME = 1e-4
"""Directions closer than this (rad) are one light."""
_TABLE_NAMES = ("lights.csv",), ("lights.txt", "lights.tsv")
# Of DiLiGenT: directions, and beside them how strong each light was, by channel.
_DIRECTIONS, STRENGTHS = "light_directions.txt", "light_intensities.txt"
_TABLE_SUFFIXES = {".csv", ".txt", ".tsv", ".dat", ".lst"}
_CANDIDATES = range(0, 360, 10)
# A light that leans less than this beyond the zenith counts as overhead, on either side.
_OVERHEAD = np.sin(np.radians(8))


@dataclass
class Lights:
    """Photographs that stay, their unit directions (n, 3) or None, and warnings.

    intensities : (n, 3) of the lights by channel, which photographs are divided by; None where nothing tells them apart
    """

    paths: list[Path]
    directions: NDArray[np.float64] | None
    warnings: list[str] = field(default_factory=list)
    facts: dict[str, Any] = field(default_factory=dict)
    intensities: NDArray[np.float64] | None = None


def find_lights(paths: list[Path], given: Path | None, whole_folder: bool, behind: bool = False) -> Lights:
    """Directions of photographs from a lights file, else from the file names, else from a list above their folder.

    Photographs without a light, or with one below the horizon, are left out with a warning. With `whole_folder`
    lights without a photograph are reported as well. Lights `behind` the swatch are mirrored in it, where they are not
    told so already. Raises BakeError.
    """
    file = given or _of_folder(paths)
    told: list[str] = []
    if file is None:
        file, told = _by_what_it_lists(paths)
    if file is None:
        lights = _from_names(paths, behind)
        lights.warnings += _passed_over(paths)
        return lights
    entries, warnings = read_lights(file)
    warnings = [*told, *warnings]
    lookup: dict[str, list[LightEntry]] = defaultdict(list)
    for entry in entries:
        lookup[_key(entry.file)].append(entry)
    directions = [_direction(file, path, lookup) for path in paths]
    if all(direction is None for direction in directions):
        cause = f"lists none of the photographs ({entries[0].file[:60]} ...)"
        raise BakeError(file, cause, f"name them as they are, for example {paths[0].name}")
    warnings += _doubled(file, lookup)
    here = {name_key(name) for path in paths for name in _spellings(path)}
    missing = [entry.file for entry in entries if _key(entry.file) not in here]
    if missing and whole_folder:
        warnings.append(f"{file.name} lists photographs that are not here: {list_names(missing)}")
    lights = keep_lights(
        file, paths, _above(file, directions) if behind else directions, warnings, {"source": file.name}
    )
    if (strengths := _intensities_beside(file, entries)) is not None:
        lights.intensities = np.array(
            [strengths[key] for key in (_entry_key(path, strengths) for path in lights.paths)]
        )
    return lights


def _intensities_beside(file: Path, entries: list[LightEntry]) -> dict[str, list[float]] | None:
    """How strong the light of each photograph was, by the keys of their names. Raises BakeError."""
    if file.name.casefold() != _DIRECTIONS:
        return None
    beside = file.with_name(STRENGTHS)
    if not beside.is_file():
        return None
    numbers = numbers_of_lines(beside)
    if numbers is None or len(numbers) != len(entries) or not all(0 < x < math.inf for line in numbers for x in line):
        cause = f"does not hold three numbers above 0 for each of the {len(entries)} lights"
        raise BakeError(beside, cause, "write red, green and blue a line, or take it away")
    return {_key(entry.file): line for entry, line in zip(entries, numbers, strict=True)}


def _entry_key(path: Path, known: dict[str, list[float]]) -> str:
    return next(name_key(name) for name in _spellings(path) if name_key(name) in known)


def _above(origin: Path, directions: list[Vector | None]) -> list[Vector | None]:
    """Lights that all stand behind the swatch, mirrored in it. Raises BakeError where only some are said to.

    A light in the plane of the swatch is on neither side.
    """
    below = {direction[2] < 0 for direction in directions if direction is not None and abs(direction[2]) > _HORIZON}
    if len(below) > 1:
        remedy = "give all elevations below the horizon, or all as angles to the swatch"
        raise BakeError(origin, "has lights on both sides of a swatch that is lit from behind", remedy)
    return [None if d is None else (d[0], d[1], abs(d[2])) for d in directions]


def _folder_of(paths: list[Path]) -> Path | None:
    """The one folder of all photographs."""
    folders = {path.parent for path in paths}
    return folders.pop() if len(folders) == 1 else None


def _of_folder(paths: list[Path]) -> Path | None:
    """The light file in the photographs' folder, or above it one that speaks of this very folder. Raises BakeError."""
    folder = _folder_of(paths)
    if folder is None:
        return None
    for place in (folder, folder.absolute().parent):
        files = light_files(place)
        if place != folder:
            files = [file for file in files if _mentions(file, folder.absolute().name)]
        if len(files) > 1:
            raise BakeError(place, f"holds several light files ({list_names([f.name for f in files])})", "name one")
        if files:
            return files[0]
    return None


def light_files_beside(folder: Path) -> list[Path]:
    """Files that may say where the lights of photographs in this folder were: in it, and in the one that it lies in.

    With those that are read with them.
    """
    places = folder, folder.absolute().parent
    files = [file for place in places for file in light_files(place)]
    files += [file for place in places for file in _texts(place) if file not in files and _entries_of(file)]
    return [*files, *(beside for file in files for beside in read_with(file))]


def read_with(file: Path) -> list[Path]:
    """Files beside one of lights that are read with it: names and strengths of DiLiGenT's."""
    if file.name.casefold() != _DIRECTIONS:
        return []
    return [path for path in (file.with_name(FILENAMES), file.with_name(STRENGTHS)) if path.is_file()]


def light_files(folder: Path) -> list[Path]:
    """`lights.csv` in any case, else `lights.txt` or `.tsv`, else all `.lp`, else `light_directions.txt`."""
    try:
        files = sorted(path for path in folder.iterdir() if path.is_file())
    except OSError:
        return []
    for names in _TABLE_NAMES:
        if found := [path for path in files if path.name.casefold() in names]:
            return found
    lists = [path for path in files if path.suffix.casefold() == ".lp"]
    return lists or [path for path in files if path.name.casefold() == _DIRECTIONS]


def _passed_over(paths: list[Path]) -> list[str]:
    """A warning where files of other names list lights of these photographs, and why none of them is read."""
    files = _texts(paths[0].parent)
    if len(whole := [file.name for file in files if _lists_all(file, paths)]) > 1:
        return [f"{list_names(whole)} list the lights of these photographs: call one of them lights.csv, or give it"]
    for file in files:
        listed = {_key(entry.file) for entry in _entries_of(file)}
        if told := sum(any(name_key(name) in listed for name in _spellings(path)) for path in paths):
            why = f"those of {told} of {len(paths)} photographs alone" if told < len(paths) else "with names of folders"
            return [f"{file.name} lists lights, {why}, and is not read: call it lights.csv, or give it"]
    return []


def _by_what_it_lists(paths: list[Path]) -> tuple[Path | None, list[str]]:
    """The one file, whatever it is called, that lists the lights of all these photographs, and a warning that says so.

    Above their folder it may be of other photographs of these names: there it comes after angles in the names.
    """
    folder = _folder_of(paths)
    if folder is None:
        return None, []
    if (file := _only(_texts(folder), paths)) is not None:
        return file, [f"the lights are those of {file.name}, which lists these photographs"]
    above = folder.absolute().parent
    if _in_names(paths) is None:
        for files in (light_files(above), _texts(above)):
            if (file := _only(files, paths)) is not None:
                told = f"the lights are those of {file.name} above this folder, which lists such names but no folder"
                return file, [told]
    return None, []


def _only(files: list[Path], paths: list[Path]) -> Path | None:
    """The one of the files that lists all photographs; None where several do."""
    found = [file for file in files if _lists_all(file, paths)]
    return found[0] if len(found) == 1 else None


def _texts(folder: Path) -> list[Path]:
    """Files of a folder that may be lists or tables."""
    try:
        return sorted(p for p in folder.iterdir() if p.suffix.casefold() in _TABLE_SUFFIXES and p.is_file())
    except OSError:
        return []


def _entries_of(file: Path) -> list[LightEntry]:
    """Entries of a file; none where it lists no lights."""
    try:
        return read_lights(file)[0]
    except BakeError:
        return []


def _lists_all(file: Path, paths: list[Path]) -> bool:
    """Whether a file lists every photograph, by names without a folder."""
    listed = {_key(entry.file) for entry in _entries_of(file) if "/" not in entry.file}
    return bool(listed) and all(any(name_key(name) in listed for name in _spellings(path)) for path in paths)


def _key(file: str) -> str:
    return name_key(PurePosixPath(file).name)


def _mentions(file: Path, folder: str) -> bool:
    return any(name_key(PurePosixPath(entry.file).parent.name) == name_key(folder) for entry in _entries_of(file))


def _spellings(path: Path) -> list[str]:
    """Names under which a lights file may list a photograph; a bracket may be listed once for all exposures."""
    stem = bracket_stem(path.stem)
    return list(dict.fromkeys([path.name, path.stem, stem + path.suffix, stem]))


def _direction(file: Path, path: Path, lookup: dict[str, list[LightEntry]]) -> Vector | None:
    for name in _spellings(path):
        found = lookup.get(name_key(name))
        if not found:
            continue
        # Of equal names in several folders the one of this photograph's folder counts.
        folders = {"", name_key(path.absolute().parent.name)}
        near = [entry for entry in found if name_key(PurePosixPath(entry.file).parent.name) in folders]
        chosen = near or found
        if any(_angle(entry.direction, chosen[0].direction) > _SAME for entry in chosen):
            raise BakeError(file, f"gives {path.name} two different lights", "keep one line per photograph")
        return chosen[0].direction
    return None


def _angle(a: Vector, b: Vector) -> float:
    return float(np.linalg.norm(np.subtract(a, b)))


def _doubled(file: Path, lookup: dict[str, list[LightEntry]]) -> list[str]:
    names = [entry.file for found in lookup.values() for entry in found[1:] if entry.file == found[0].file]
    return [f"{file.name} lists twice: {list_names(names)}"] if names else []


def _in_names(paths: list[Path]) -> list[Vector | None] | None:
    """Directions by angles in the names; None where there are not two."""
    directions = [direction_in_name(path.stem) for path in paths]
    return directions if sum(direction is not None for direction in directions) > 1 else None


def _from_names(paths: list[Path], behind: bool) -> Lights:
    directions = _in_names(paths)
    if directions is None:
        return Lights(paths, None, ["no light directions are known: neither a lights file nor angles in the names"])
    directions = _above(paths[0].parent, directions) if behind else directions
    return keep_lights(paths[0].parent, paths, directions, [], {"source": "file names"})


def keep_lights(
    origin: Path, paths: list[Path], directions: list[Vector | None], warnings: list[str], facts: dict[str, Any]
) -> Lights:
    """Photographs whose lights are known and above the horizon, others left out with a warning. Raises BakeError."""
    unknown = [path.name for path, direction in zip(paths, directions) if direction is None]
    if unknown:
        warnings.append(f"left out, without a light direction: {list_names(unknown)}")
    below = [
        path.name for path, direction in zip(paths, directions) if direction is not None and direction[2] <= _HORIZON
    ]
    if below:
        warnings.append(f"left out, lit from below the horizon: {list_names(below)}")
    kept = [(path, d) for path, d in zip(paths, directions) if d is not None and d[2] > _HORIZON]
    if not kept:
        raise BakeError(origin, "every light lies below the horizon", "let z point from the swatch to the camera")
    facts |= {"left_out": unknown + below}
    return Lights([path for path, _ in kept], np.array([d for _, d in kept]), warnings, facts)


def choose_arc(
    origin: Path, lights: Lights, azimuth: float | None, spread: float, sides: Literal["one", "both"] | str = "one"
) -> Lights:
    """Keep the lights within `spread` degrees of one vertical plane, on one of its sides or on both.

    Without an `azimuth` lights that already lie near one plane, and side, all stay; otherwise the candidate (every 10
    degrees) with the most distinct elevations is taken and reported in a warning. Raises BakeError.
    """
    if lights.directions is None:
        if azimuth is None:
            return lights
        raise BakeError(origin, "an azimuth was asked for, but no light directions are known", "give a lights file")
    chosen, near = arc_of(lights.directions, azimuth, spread, sides)
    if near.sum() < 2:
        cause = f"{int(near.sum())} of {len(near)} lights lie within {spread:g} degrees of azimuth {chosen:g}"
        raise BakeError(origin, cause, "choose another azimuth, a larger spread, or both sides")
    facts: dict[str, Any] = {"lights": len(near), "used": int(near.sum())}
    warnings = list(lights.warnings)
    if azimuth is not None or not near.all():
        facts |= {"azimuth_deg": chosen, "spread_deg": spread, "sides": sides}
        facts["chosen_by"] = "user" if azimuth is not None else "count"
    if azimuth is None and not near.all():
        warnings.append(
            f"lights cover many azimuths: {int(near.sum())} of {len(near)} used, those within {spread:g} degrees "
            f"of azimuth {chosen:g}{' on both sides' if sides == 'both' else ''}, which has the most elevations; "
            "azimuths all takes those of every side"
        )
    paths = [path for path, keep in zip(lights.paths, near) if keep]
    strengths = None if lights.intensities is None else lights.intensities[near]
    return Lights(paths, lights.directions[near], warnings, lights.facts | {"arc": facts}, strengths)


def cut_to_arc(facts: Any) -> bool:
    """Whether photographs of these facts are those of one arc, which nobody named, of lights of many azimuths."""
    told = facts
    for key in ("lights", "arc", "chosen_by"):
        told = told.get(key) if isinstance(told, dict) else None
    return bool(told == "count")


def arc_of(
    directions: NDArray[np.float64], azimuth: float | None, spread: float, sides: str = "one"
) -> tuple[float, NDArray[np.bool_]]:
    """Azimuth of the plane that `choose_arc` takes, in degrees, and which of the lights (n, 3) lie near it."""
    if azimuth is None:
        azimuth = float(max(_CANDIDATES, key=lambda a: _merit(directions, a, spread, sides)))
    return azimuth, _near(directions, azimuth, spread, sides)


def _near(directions: NDArray[np.float64], azimuth: float, spread: float, sides: str) -> NDArray[np.bool_]:
    a = np.radians(azimuth)
    near: NDArray[np.bool_] = _distance(directions, azimuth) <= np.radians(spread) + 1e-9
    if sides == "one":
        near &= directions @ [np.cos(a), np.sin(a), 0.0] >= -_OVERHEAD
    return near


def _distance(directions: NDArray[np.float64], azimuth: float) -> NDArray[np.float64]:
    a = np.radians(azimuth)
    return np.abs(np.arcsin(np.clip(directions @ [-np.sin(a), np.cos(a), 0.0], -1, 1)))


def _merit(directions: NDArray[np.float64], azimuth: float, spread: float, sides: str) -> tuple[int, float]:
    """Distinct elevations (to a degree) near the plane, then how near they lie."""
    near = _near(directions, azimuth, spread, sides)
    elevations = np.degrees(np.arcsin(np.clip(directions[near, 2], -1, 1)))
    distance = float(_distance(directions[near], azimuth).mean()) if near.any() else 9.0
    return len(np.unique(np.round(elevations))), -distance
