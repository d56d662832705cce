"""ASTM E1392 / E2387 scatter files (`.astm`, text).

Layout as Cornell's files and libbsdf's reader have it: lines of keywords, `VARS theta_i,phi_i,theta_s,phi_s,...` as
the last of them, then rows of numbers, angles in radians. Both directions point away from the surface and each
azimuth is its own, so the mirror direction lies at phi_s = phi_i + 180 degrees. Columns behind the fourth are a
wavelength each (`550nm`), R, G, B, or X, Y, Z. Values are in 1/sr, without the cosine.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...directions import spherical
from ...reading import Illuminant, Reading
from ...source import Array, Reader
from ..lookup.lookup_source import LookupSource
from ..lookup.text_file import TextFile, beginning, printable
from .scattered_source import WAVELENGTH, Colour, scattered_source, spectral_colour

MAX_SAMPLES = 200_000
_ANGLES = ("theta_i", "phi_i", "theta_s", "phi_s")
_REMEDY = "give an ASTM E2387 text file with a line VARS theta_i,phi_i,theta_s,phi_s,..."
_KEPT = ("LAB_NAME", "SAMPLE_NAME", "MEAS_NAME", "SAMPLE_COMMENTS", "MEAS_COMMENTS")


def read(path: Path, reading: Reading) -> LookupSource:
    """Read an ASTM file, its spectra under the illuminant of `reading`.

    Raises BakeError: damaged, of unknown columns, not in radians.
    """
    file = TextFile(path, _REMEDY, comment="")
    columns, first, comments = _header(file)
    rows: list[Array] = []
    for number, words, _ in file.split(","):
        if number <= first or not words:
            continue
        if len(words) != len(columns):
            file.refuse(number, f"{len(words)} columns instead of {len(columns)}")
        if len(rows) == MAX_SAMPLES:
            file.refuse(number, f"more than {MAX_SAMPLES} samples")
        rows.append(file.numbers(number, words))
    if not rows:
        raise file.error("holds no samples")
    table = np.stack(rows)
    angles = {name: table[:, columns.index(name)] for name in _ANGLES if name in columns}
    if max(np.abs(angles["theta_i"]).max(), np.abs(angles["theta_s"]).max()) > np.pi:
        raise file.error("has polar angles above pi", "angles must be in radians; convert degrees")
    wi = spherical(angles["theta_i"], angles.get("phi_i", 0.0))
    wo = spherical(angles["theta_s"], angles["phi_s"])
    names = [c for c in columns if c not in _ANGLES]
    colour, values, white = _values(file, names, table[:, len(angles) :], reading.illuminant)
    file.check_values(values)
    facts: dict[str, Any] = {"format": "ASTM E2387", "comments": comments}
    return scattered_source(file, wi, wo, values, colour, facts, white)


def _header(file: TextFile) -> tuple[list[str], int, list[str]]:
    """Names of the columns in lower case, number of the line that has them, and what is told of the sample."""
    comments: list[str] = []
    for number, line in enumerate(file.lines, 1):
        key, _, value = line.strip().partition(" ")
        if key.upper() == "VARS":
            columns = [name.strip().lower() for name in value.split(",")]
            if columns[0] != "theta_i" or "theta_s" not in columns or "phi_s" not in columns or len(columns) < 4:
                file.refuse(number, "the columns are not theta_i, phi_i, theta_s, phi_s and values")
            expected = [name for name in _ANGLES if name in columns]
            if columns[: len(expected)] != expected or len(columns) == len(expected):
                file.refuse(number, "the columns are not in the order theta_i, phi_i, theta_s, phi_s, values")
            return columns, number, comments
        if key.upper() in _KEPT:
            comments.append(f"{key}: {printable(value)}")
    raise file.error("has no line VARS")


def _values(file: TextFile, names: list[str], table: Array, illuminant: Illuminant) -> tuple[Colour, Array, Illuminant]:
    """The columns of values as grey, RGB or XYZ, and the light under which white is white."""
    found = [WAVELENGTH.search(name) for name in names]
    if len(names) > 1 and all(found):
        return spectral_colour(file, [float(match.group(1)) for match in found if match], table, illuminant)
    if names == ["x", "y", "z"]:
        return "xyz", table, "D65"
    if len(names) == 3:
        return "rgb", table, "D65"
    if len(names) == 1:
        return "grey", table, "D65"
    raise file.error(f"has columns {', '.join(names)[:60]!r}, which are no colour and no wavelengths")


def _matches(path: Path, head: bytes) -> bool:
    return b"VARS THETA_I" in beginning(path).upper().replace(b"\t", b" ")


READER = Reader("ASTM E2387", (".astm",), _matches, read)
