"""One light of a photograph: its direction from angles, from numbers or from a file's name."""

from __future__ import annotations

import math
import re
import unicodedata
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from ...errors import BakeError

Vector = tuple[float, float, float]

_FLOAT = r"([-+]?\d+(?:[.,]\d+)?)"
# A letter before would make "model45" an elevation.
_IN_NAME = {
    "elevation": re.compile(rf"(?<![a-z])(?:elevation|elev|el)[_ -]?{_FLOAT}", re.IGNORECASE),
    "theta": re.compile(rf"(?<![a-z])theta(?:_?i)?[_ ]?{_FLOAT}", re.IGNORECASE),
    "azimuth": re.compile(rf"(?<![a-z])(?:azimuth|azim|az|phi)[_ ]?{_FLOAT}", re.IGNORECASE),
}


@dataclass(frozen=True)
class LightEntry:
    """One line: the file as written, with forward slashes, and the light's direction, unit length."""

    file: str
    direction: Vector


def name_key(name: str) -> str:
    """A file name for comparison: without case, and with letters composed, which macOS stores apart."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())


def direction_of_angles(elevation: float, azimuth: float) -> Vector:
    """Unit vector of angles in degrees; an elevation beyond 90 lies on the far side of the arc."""
    e, a = math.radians(elevation), math.radians(azimuth)
    return math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)


def direction_in_name(stem: str) -> Vector | None:
    """Direction from angles in a file name such as `el45`, `elev_45_az_90` or `theta30`, None without one.

    A negative theta lies on the far side of the arc, as an elevation beyond 90 does.
    """
    matches = {name: match for name, pattern in _IN_NAME.items() if (match := pattern.search(stem))}
    found = {name: float(match[1].replace(",", ".")) for name, match in matches.items()}
    azimuth = found.get("azimuth", 0.0)
    if "elevation" in found:
        elevation = found["elevation"]
    elif "theta" in found:
        elevation = 90 - found["theta"]
    else:
        return None
    if not (-90 <= elevation <= 180 and abs(azimuth) <= 3600):
        return None
    return direction_of_angles(elevation, azimuth)


def refuse(path: Path, line: int, cause: str, remedy: str = "correct the line") -> NoReturn:
    """Raise BakeError for a line."""
    raise BakeError(path, f"line {line}: {cause}", remedy)


def unit_vector(path: Path, line: int, vector: list[float]) -> Vector:
    """Three numbers as a direction. Raises BakeError where they are none."""
    if not all(math.isfinite(value) for value in vector):
        refuse(path, line, "the direction is not finite")
    length = math.hypot(*vector)
    if not 1e-9 < length < 1e150:
        refuse(path, line, "the direction is zero" if length <= 1e-9 else "the direction is too long")
    x, y, z = (value / length for value in vector)
    return x, y, z


def tidy_name(name: str) -> str:
    """A file name without quotes, with forward slashes."""
    return name.strip().strip("\"'").replace("\\", "/")
