"""A folder of maps as `bake_maps` wrote it, read again: which file holds what, and in which units."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..bundle.checked_json import load_json
from ..errors import BakeError
from .write import DOCUMENT, MAP_NAMES, PROGRAM

_BAKE = "bake the photographs again with bake maps"
_COLOR_SPACES = "Non-Color", "sRGB", "Linear Rec.709"


@dataclass(frozen=True)
class MapFile:
    """One map.

    path : of its file, which is there
    color_space : "Non-Color", "sRGB" or "Linear Rec.709", as Blender calls them
    about : what else `maps.json` says of it
    """

    path: Path
    color_space: str
    about: dict[str, Any]

    @property
    def exact(self) -> bool:
        """Whether it holds numbers as they are, and not cut to [0, 1]."""
        return self.path.suffix == ".exr"

    def number(self, name: str) -> float:
        """A number that the document gives for this map. Raises BakeError where it is none."""
        value = self.about.get(name)
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e12:
            cause = f"gives no {name} for {self.path.name}"
            raise BakeError(self.path.with_name(DOCUMENT), cause, _BAKE)
        return float(value)


@dataclass(frozen=True)
class MapsFolder:
    """A folder of maps.

    name : of the swatch
    files : by `MAP_NAMES`, all of them
    green_up : whether the normals' green points up the picture, as in Blender
    mean_albedo : linear Rec.709
    """

    path: Path
    name: str
    files: dict[str, MapFile]
    green_up: bool
    mean_albedo: tuple[float, float, float]


def read_maps_folder(folder: Path) -> MapsFolder:
    """Read what is known of a folder of maps, no pixels. Raises BakeError where it is none, or a file is missing."""
    document = folder / DOCUMENT
    if not document.is_file():
        raise BakeError(folder, f"holds no {DOCUMENT}", "give a folder that bake maps wrote")
    facts = load_json(document)
    entries = facts.get("maps")
    if facts.get("program") != PROGRAM or not isinstance(entries, dict):
        raise BakeError(document, "is not of bake maps", "give a folder that bake maps wrote")
    files = {name: _file(document, name, entries.get(name)) for name in MAP_NAMES}
    name = facts.get("source")
    return MapsFolder(
        folder,
        name if isinstance(name, str) and name else folder.name,
        files,
        files["normal"].about.get("green") != "down",
        _colour(document, facts.get("mean_albedo")),
    )


def _file(document: Path, name: str, about: Any) -> MapFile:
    file = about.get("file") if isinstance(about, dict) else None
    if not isinstance(file, str) or file in ("", ".", "..") or os.path.basename(file) != file or "\\" in file:
        raise BakeError(document, f"names no file of its {name}", _BAKE)
    if not (path := document.with_name(file)).is_file():
        raise BakeError(path, "is missing", _BAKE)
    space = about.get("color_space")
    if space not in _COLOR_SPACES:
        raise BakeError(document, f"gives no known color_space for its {name}", _BAKE)
    return MapFile(path, space, {key: value for key, value in about.items() if key not in ("file", "color_space")})


def _colour(document: Path, value: Any) -> tuple[float, float, float]:
    numbers = value if isinstance(value, list) else []
    if len(numbers) != 3 or not all(isinstance(x, int | float) and 0 <= x < 1e6 for x in numbers):
        raise BakeError(document, "gives no mean_albedo of three numbers", _BAKE)
    return float(numbers[0]), float(numbers[1]), float(numbers[2])
