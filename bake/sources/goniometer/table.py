"""Plain tables (`.csv`): a line of names, then theta_i, phi_i, theta_o, phi_o and values.

Names are recognised without case in their usual spellings; units are stated in them (`theta_i_deg`, `theta_i [rad]`)
or in a comment, or follow from the numbers where these leave no doubt (a polar angle above pi / 2 is in degrees);
otherwise the file is refused, never guessed. Values are one column, or R, G, B, or X, Y, Z, or one per wavelength
(`550nm`), in 1/sr without the cosine; a name with `cos` in it contains cos(theta_o) and is divided by it. Both
directions point away from the surface.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...directions import spherical
from ...reading import Illuminant, Reading
from ...source import Array, Reader
from ..lookup.lookup_source import LookupSource
from ..lookup.text_file import TextFile, beginning
from .scattered_source import WAVELENGTH, Colour, scattered_source, spectral_colour

MAX_SAMPLES = 200_000
_REMEDY = (
    "give a table with a line of names: theta_i_deg, phi_i_deg, theta_o_deg, phi_o_deg (or _rad) and brdf, or r, g, b"
)
_ANGLES = {
    "theta_i": ("theta_i", "thetai", "theta_in", "theta_light", "light_theta", "incident_theta"),
    "phi_i": ("phi_i", "phii", "phi_in", "phi_light", "light_phi", "incident_phi"),
    "theta_o": ("theta_o", "thetao", "theta_out", "theta_r", "theta_s", "theta_v", "theta_view", "view_theta"),
    "phi_o": ("phi_o", "phio", "phi_out", "phi_r", "phi_s", "phi_v", "phi_view", "view_phi"),
}
_NAMES = {spelling: name for name, spellings in _ANGLES.items() for spelling in spellings}
_UNIT = re.compile(r"[\s_\[(]*(deg|degree|degrees|°|rad|radian|radians)[\])]*$")
_GREY = ("brdf", "bsdf", "value", "f", "y", "luminance", "brdf_cos", "f_cos", "bsdf_cos")
_LEAST_COS = 0.02


@dataclass(frozen=True)
class _Columns:
    """Where the angles stand, their units as written (empty where not), and the columns of values."""

    angles: dict[str, int]
    units: dict[str, str]
    values: list[int]
    names: list[str]
    line: int


def read(path: Path, reading: Reading) -> LookupSource:
    """Read a table, its spectra under the illuminant of `reading`.

    Raises BakeError: no such names, no units, damaged, too few samples.
    """
    file = TextFile(path, _REMEDY)
    columns = _columns(file)
    table = _rows(file, columns)
    radians, told = _units(file, columns, table)
    angle = {name: table[:, at] * radians for name, at in columns.angles.items()}
    wi = spherical(angle["theta_i"], angle.get("phi_i", 0.0))
    wo = spherical(angle["theta_o"], angle["phi_o"])
    colour, values, white = _colour(file, columns.names, table[:, columns.values], reading.illuminant)
    facts: dict[str, Any] = {"format": "table of samples", "units": told}
    if any("cos" in name for name in columns.names):
        keep = wo[:, 2] > _LEAST_COS
        facts |= {"cosine_divided_out": True, "samples_too_low": int(np.count_nonzero(~keep))}
        wi, wo, values = wi[keep], wo[keep], values[keep] / wo[keep, 2:]
    file.check_values(values)
    return scattered_source(file, wi, wo, values, colour, facts, white)


def split_name(word: str) -> tuple[str, str]:
    """An angle's name without its unit, and "deg", "rad" or nothing."""
    word = word.strip().lower()
    match = _UNIT.search(word)
    unit = "" if match is None else "deg" if match.group(1)[0] in "d°" else "rad"
    return (word[: match.start()] if match else word).replace(" ", "_"), unit


def _cells(line: str) -> list[str]:
    separator = next((mark for mark in (";", ",", "\t") if mark in line), None)
    return [cell.strip().strip('"') for cell in (line.split(separator) if separator else line.split())]


def _columns(file: TextFile) -> _Columns:
    for number, line in enumerate(file.lines, 1):
        text = line.partition("#")[0].strip()
        if not text:
            continue
        named = [split_name(cell) for cell in _cells(text)]
        known = [_NAMES.get(name, "") for name, _ in named]
        missing = [name for name in ("theta_i", "theta_o", "phi_o") if name not in known]
        if missing:
            file.refuse(number, f"no column is called {missing[0]}")
        if any(known.count(name) > 1 for name in known if name):
            file.refuse(number, "two columns have the same angle's name")
        values = [index for index, name in enumerate(known) if not name]
        angles = {name: known.index(name) for name in _ANGLES if name in known}
        units = {name: named[at][1] for name, at in angles.items()}
        names = [_cells(text)[index].lower() for index in values]
        return _Columns(angles, units, values, names, number)
    raise file.error("has no line of names")


def _rows(file: TextFile, columns: _Columns) -> Array:
    width = len(columns.angles) + len(columns.values)
    rows: list[Array] = []
    for number, line in enumerate(file.lines, 1):
        text = line.partition("#")[0].strip()
        if number <= columns.line or not text:
            continue
        cells = _cells(text)
        if len(cells) != width:
            file.refuse(number, f"{len(cells)} columns instead of {width}")
        if len(rows) == MAX_SAMPLES:
            file.refuse(number, f"more than {MAX_SAMPLES} samples")
        rows.append(file.numbers(number, cells))
    if not rows:
        raise file.error("holds no samples")
    return np.stack(rows)


def _units(file: TextFile, columns: _Columns, table: Array) -> tuple[float, str]:
    """Radians per unit of the angles, and how it is known."""
    written = {unit for unit in columns.units.values() if unit}
    if len(written) > 1:
        raise file.error("has angles in degrees and in radians")
    if written:
        unit = written.pop()
        return (np.pi / 180 if unit == "deg" else 1.0), f"{unit}, by the names of columns"
    for line in file.lines[: columns.line]:
        said = {split_name(word)[1] for word in line.replace("=", " ").split()} - {""} if "#" in line else set()
        if len(said) == 1:
            unit = said.pop()
            return (np.pi / 180 if unit == "deg" else 1.0), f"{unit}, by a comment"
    polar = np.abs(table[:, [columns.angles["theta_i"], columns.angles["theta_o"]]]).max()
    if np.pi / 2 + 1e-3 < polar <= 90.001:
        return np.pi / 180, "deg, since a polar angle exceeds pi / 2"
    raise file.error(
        "does not say whether angles are degrees or radians", "name the columns theta_i_deg or theta_i_rad"
    )


def _colour(file: TextFile, names: list[str], table: Array, illuminant: Illuminant) -> tuple[Colour, Array, Illuminant]:
    plain = [name.removesuffix("_cos") for name in names]
    found = [WAVELENGTH.search(name) for name in plain]
    if len(plain) == 1 and (plain[0] in _GREY or found[0]):
        return "grey", table, "D65"
    if plain in (["r", "g", "b"], ["red", "green", "blue"]):
        return "rgb", table, "D65"
    if plain == ["x", "y", "z"]:
        return "xyz", table, "D65"
    if names and all(found):
        return spectral_colour(file, [float(match.group(1)) for match in found if match], table, illuminant)
    raise file.error(f"has columns {', '.join(names)[:60]!r} beside the angles, which are no known values")


def _matches(path: Path, head: bytes) -> bool:
    """The first line that is not a comment names the angles."""
    for line in beginning(path).decode("utf-8", "replace").lstrip("\ufeff").splitlines():
        if text := line.partition("#")[0].strip():
            names = {_NAMES.get(split_name(cell)[0], "") for cell in _cells(text)}
            return {"theta_i", "theta_o"} <= names
    return False


READER = Reader("table of samples", (".csv",), _matches, read)
