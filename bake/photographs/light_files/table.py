"""Tables of lights: a line of column names, then one line per photograph.

The columns are `file` and either `elevation` with or without `azimuth`, or `theta` (from the normal) with or without
`phi`, in degrees unless the column's name says radians, or `x`, `y`, `z`.
"""

from __future__ import annotations

import csv
import io
import math
import re
from dataclasses import dataclass
from pathlib import Path

from ...errors import BakeError
from .entry import LightEntry, direction_of_angles, refuse, tidy_name, unit_vector

_NAMES = {
    "file": {"file", "filename", "name", "image", "photograph", "photo", "path"},
    "elevation": {"elevation", "elev", "el", "altitude"},
    "theta": {"theta", "polar", "zenith", "incidence", "theta_i"},
    "azimuth": {"azimuth", "azim", "az", "phi", "phi_i"},
    "x": {"x", "lx"},
    "y": {"y", "ly"},
    "z": {"z", "lz"},
}
_UNIT = re.compile(r"[\s_]*[\[(]?(?:(?P<degrees>deg(?:rees?)?|°)|rad(?:ians?)?)[\])]?$")
_AXES = ("x", "y", "z")
_ROUNDING = 0.01
_STRAIGHT = 90.0


@dataclass(frozen=True)
class _Columns:
    """Place of each known column, those that are read, those whose name states a unit, cells of the header."""

    places: dict[str, int]
    wanted: tuple[str, ...]
    degrees: frozenset[str]
    radians: frozenset[str]
    count: int


@dataclass(frozen=True)
class _Row:
    """The known numbers of one line."""

    line: int
    file: str
    numbers: dict[str, float]


def read_table(path: Path, text: str) -> tuple[list[LightEntry], list[str]]:
    """Entries of a table and warnings. Raises BakeError naming the line."""
    columns: _Columns | None = None
    found: list[_Row] = []
    delimiter = _delimiter(text)
    rows = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, skipinitialspace=delimiter == " ")
    try:
        for row in rows:
            cells = [cell.strip() for cell in row]
            if not any(cells) or cells[0].startswith("#"):
                continue
            if columns is None:
                columns = _columns(path, cells)
                continue
            found.append(_row(path, rows.line_num, cells, columns, delimiter))
    except csv.Error as error:
        raise BakeError(path, f"line {rows.line_num}: {error}", "export it again as plain CSV") from error
    if columns is None or not found:
        raise BakeError(path, "lists no light", "write a line 'file,elevation,azimuth' and one line per photograph")
    if columns.wanted == _AXES:
        return [
            LightEntry(row.file, unit_vector(path, row.line, [row.numbers[axis] for axis in _AXES])) for row in found
        ], []
    radians, warnings = _units(path, found, columns)
    return [LightEntry(row.file, _direction(path, row, radians)) for row in found], warnings


def _delimiter(text: str) -> str:
    head = next((line for line in text.splitlines() if line.strip() and not line.startswith("#")), "")
    chosen = max(",;\t", key=head.count)
    return chosen if chosen in head else " "


def _columns(path: Path, cells: list[str]) -> _Columns:
    places: dict[str, int] = {}
    units: dict[str, set[str]] = {"degrees": set(), "radians": set()}
    for place, cell in enumerate(cells):
        unit = _UNIT.search(cell.lower())
        plain = _UNIT.sub("", cell.lower()).strip().replace(" ", "_")
        for name, spellings in _NAMES.items():
            if plain in spellings and name not in places:
                places[name] = place
                if unit:
                    units["degrees" if unit["degrees"] else "radians"].add(name)
    polar = "elevation" if "elevation" in places else "theta"
    wanted = _AXES if places.keys() >= set(_AXES) else (polar, *(["azimuth"] if "azimuth" in places else []))
    if not places.keys() >= {"file", *wanted}:
        cause = f"has no columns for the file and its light ({', '.join(cells)[:80]})"
        raise BakeError(path, cause, "begin with a line 'file,elevation,azimuth' (degrees) or 'file,x,y,z'")
    return _Columns(places, wanted, frozenset(units["degrees"]), frozenset(units["radians"]), len(cells))


def _row(path: Path, line: int, cells: list[str], columns: _Columns, delimiter: str) -> _Row:
    if any(cells[columns.count :]):
        cause = f"has {len(cells)} cells, the header has {columns.count}"
        remedy = "write decimal points, or set columns apart by semicolons" if delimiter == "," else "correct the line"
        refuse(path, line, cause, remedy)
    cells = cells + [""] * (columns.count - len(cells))

    def number(name: str) -> float:
        cell = cells[columns.places[name]]
        try:
            value = float(cell.replace(",", ".") if delimiter != "," else cell)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            refuse(path, line, f"{name} is {cell[:20]!r}, not a number")
        return value

    if not cells[columns.places["file"]]:
        refuse(path, line, "names no file")
    return _Row(line, tidy_name(cells[columns.places["file"]]), {name: number(name) for name in columns.wanted})


def _units(path: Path, rows: list[_Row], columns: _Columns) -> tuple[frozenset[str], list[str]]:
    """Columns in radians: those whose name says so, or, with a warning, all where degrees cannot be meant.

    As degrees, numbers up to half a turn in radians would put every light within 3.2 degrees of the horizon or 1.6
    degrees of the normal, which no arc does.
    """
    polar = columns.wanted[0]
    if columns.radians or columns.degrees or len(rows) < 2:
        return columns.radians, []
    values = [row.numbers[polar] for row in rows]
    largest = math.pi if polar == "elevation" else math.pi / 2
    if not min(values) < max(values) or max(map(abs, values)) > largest + _ROUNDING:
        return frozenset(), []
    if all(value == int(value) for value in values):
        return frozenset(), []
    if any(abs(row.numbers.get("azimuth", 0.0)) > 2 * math.pi + _ROUNDING for row in rows):
        cause = (
            f"gives {polar} from {min(values):g} to {max(values):g}, which look like radians, and azimuth in degrees"
        )
        raise BakeError(path, cause, f"name the column '{polar} [deg]' or '{polar} [rad]'")
    meant = sorted(math.degrees(value) for value in values)
    return frozenset({polar, "azimuth"}), [
        f"{path.name} gives {polar} from {min(values):g} to {max(values):g}, taken as radians ({meant[0]:.3g} to "
        f"{meant[-1]:.3g} degrees); name the column '{polar} [deg]' where degrees are meant"
    ]


def _direction(path: Path, row: _Row, radians: frozenset[str]) -> tuple[float, float, float]:
    angles = {name: math.degrees(value) if name in radians else value for name, value in row.numbers.items()}
    elevation = angles["elevation"] if "elevation" in angles else _STRAIGHT - angles["theta"]
    if not -90 <= elevation <= 180:
        cause = f"an elevation of {elevation:g} degrees"
        refuse(path, row.line, cause, "give 0 to 90, or up to 180 on the far side")
    return direction_of_angles(elevation, angles.get("azimuth", 0.0))
