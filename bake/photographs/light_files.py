"""Files that say where the light stood: `.lp` of reflectance transformation imaging, and tables with a header.

An `.lp` file holds the number of lights (some writers leave it out), then `file x y z` per line. A table has a line of
column names: `file` and either `elevation` with or without `azimuth`, or `theta` (from the normal) with or without
`phi`, in degrees, or `x`, `y`, `z`.
"""

from __future__ import annotations

import csv
import io
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from ..errors import BakeError

MAX_BYTES = 4 << 20
Vector = tuple[float, float, float]

_NAMES = {
    "file": {"file", "filename", "name", "image", "photograph", "photo", "path"},
    "elevation": {"elevation", "elev", "el", "altitude"},
    "theta": {"theta", "polar", "zenith", "incidence", "theta_i"},
    "azimuth": {"azimuth", "azim", "az", "phi", "phi_i"},
    "x": {"x", "lx"},
    "y": {"y", "ly"},
    "z": {"z", "lz"},
}
_UNIT = re.compile(r"[\s_]*[\[(]?(?:deg(?:rees?)?|°)[\])]?$")
_FLOAT = r"([-+]?\d+(?:\.\d+)?)"
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


def read_lights(path: Path) -> tuple[list[LightEntry], list[str]]:
    """Entries of a lights file and warnings. Raises BakeError naming the line."""
    try:
        with open(path, "rb") as stream:
            data = stream.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise BakeError(path, f"cannot be read ({reason})", "give a lights.csv or .lp file") from error
    if len(data) > MAX_BYTES:
        raise BakeError(path, f"is longer than {MAX_BYTES >> 20} MiB", "give a lights.csv or .lp file")
    if b"\0" in data:
        raise BakeError(path, "is not text", "give a lights.csv or .lp file in UTF-8")
    text = data.decode("utf-8-sig", "replace")
    return _read_lp(path, text) if path.suffix.lower() == ".lp" else (_read_table(path, text), [])


def direction_of_angles(elevation: float, azimuth: float) -> Vector:
    """Unit vector of angles in degrees; an elevation beyond 90 lies on the far side of the arc."""
    e, a = math.radians(elevation), math.radians(azimuth)
    return math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)


def direction_in_name(stem: str) -> Vector | None:
    """Direction from angles in a file name such as `el45`, `elev_45_az_90` or `theta30`, None without one.

    A negative theta lies on the far side of the arc, as an elevation beyond 90 does.
    """
    found = {name: match for name, pattern in _IN_NAME.items() if (match := pattern.search(stem))}
    azimuth = float(found["azimuth"][1]) if "azimuth" in found else 0.0
    if "elevation" in found:
        elevation = float(found["elevation"][1])
    elif "theta" in found:
        elevation = 90 - float(found["theta"][1])
    else:
        return None
    if not (-90 <= elevation <= 180 and abs(azimuth) <= 3600):
        return None
    return direction_of_angles(elevation, azimuth)


def _refuse(path: Path, line: int, cause: str, remedy: str = "correct the line") -> NoReturn:
    raise BakeError(path, f"line {line}: {cause}", remedy)


def _unit(path: Path, line: int, vector: list[float]) -> Vector:
    if not all(math.isfinite(value) for value in vector):
        _refuse(path, line, "the direction is not finite")
    length = math.hypot(*vector)
    if not 1e-9 < length < 1e150:
        _refuse(path, line, "the direction is zero" if length <= 1e-9 else "the direction is too long")
    x, y, z = (value / length for value in vector)
    return x, y, z


def _read_lp(path: Path, text: str) -> tuple[list[LightEntry], list[str]]:
    entries: list[LightEntry] = []
    declared: int | None = None
    for number, raw in enumerate(text.splitlines(), 1):
        line = raw.strip()
        if not line or line.startswith("#"):
            continue
        if declared is None and not entries and line.isdecimal():
            declared = int(line[:9])
            continue
        words = line.rsplit(None, 3) if "," not in line else [word.strip() for word in line.rsplit(",", 3)]
        try:
            vector = [float(word) for word in words[1:]]
        except ValueError:
            vector = []
        if len(vector) != 3:
            _refuse(path, number, "is not 'file x y z'")
        entries.append(LightEntry(_tidy(words[0]), _unit(path, number, vector)))
    if not entries:
        raise BakeError(path, "lists no light", "write 'file x y z' per photograph")
    if declared is not None and declared != len(entries):
        return entries, [f"{path.name} announces {declared} lights and lists {len(entries)}"]
    return entries, []


def _tidy(name: str) -> str:
    return name.strip().strip("\"'").replace("\\", "/")


def _read_table(path: Path, text: str) -> list[LightEntry]:
    head = next((line for line in text.splitlines() if line.strip() and not line.startswith("#")), "")
    delimiter = max(",;\t", key=head.count)
    columns: dict[str, int] | None = None
    entries: list[LightEntry] = []
    rows = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter)
    try:
        for row in rows:
            cells = [cell.strip() for cell in row]
            if not any(cells) or cells[0].startswith("#"):
                continue
            if columns is None:
                columns = _columns(path, cells)
                continue
            entries.append(_table_entry(path, rows.line_num, cells, columns, delimiter))
    except csv.Error as error:
        raise BakeError(path, f"line {rows.line_num}: {error}", "export it again as plain CSV") from error
    if not entries:
        raise BakeError(path, "lists no light", "write a line 'file,elevation,azimuth' and one line per photograph")
    return entries


def _columns(path: Path, cells: list[str]) -> dict[str, int]:
    columns: dict[str, int] = {}
    for place, cell in enumerate(cells):
        plain = _UNIT.sub("", cell.lower()).strip().replace(" ", "_")
        for name, spellings in _NAMES.items():
            if plain in spellings and name not in columns:
                columns[name] = place
    angles = "elevation" in columns or "theta" in columns
    if "file" not in columns or not (angles or {"x", "y", "z"} <= columns.keys()):
        cause = f"has no columns for the file and its light ({', '.join(cells)[:80]})"
        raise BakeError(path, cause, "begin with a line 'file,elevation,azimuth' (degrees) or 'file,x,y,z'")
    return columns


def _table_entry(path: Path, line: int, cells: list[str], columns: dict[str, int], delimiter: str) -> LightEntry:
    def number(name: str) -> float:
        place = columns[name]
        cell = cells[place] if place < len(cells) else ""
        try:
            value = float(cell.replace(",", ".") if delimiter != "," else cell)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            _refuse(path, line, f"{name} is {cell[:20]!r}, not a number")
        return value

    if columns["file"] >= len(cells) or not cells[columns["file"]]:
        _refuse(path, line, "names no file")
    file = _tidy(cells[columns["file"]])
    if {"x", "y", "z"} <= columns.keys():
        return LightEntry(file, _unit(path, line, [number("x"), number("y"), number("z")]))
    elevation = number("elevation") if "elevation" in columns else 90 - number("theta")
    if not -90 <= elevation <= 180:
        _refuse(path, line, f"an elevation of {elevation:g} degrees", "give 0 to 90, or up to 180 on the far side")
    return LightEntry(file, direction_of_angles(elevation, number("azimuth") if "azimuth" in columns else 0.0))
