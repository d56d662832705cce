"""NVIDIA's measured BSDF files (`.mbsdf`), isotropic, grey or RGB; a sheet where they hold transmission.

Layout, from NVIDIA's MDL SDK (BSD-3-Clause; `bsdf_measurement.cpp`, `ibsdf_isotropic_data.h`): a first line, lines of
free text, then `MBSDF_DATA=` (older, reflection), `MBSDF_DATA_REFLECTION=` or `MBSDF_DATA_TRANSMISSION=`, each followed
by three uint32 (0 scalar or 1 RGB; resolution in theta; in phi) and float32 [theta_in, theta_out, phi, channel],
little-endian. Entries are the centres of equal cells of theta over [0, pi / 2] and of phi over [0, pi], as its two
evaluators have it. phi lies between the azimuths of the two directions, both away from the surface: its first entry is
the retro direction, its last the mirror, or what passes straight through. Values are in 1/sr, without the cosine.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np

from ..directions import polar_angle
from ..errors import BakeError
from ..source import Array, Json, Reader
from .lookup.lookup_source import Axis, LookupSource, azimuth_between, grey, interpolate, negative_facts
from .lookup.sheet_lookup import Lookup, SheetLookup
from .lookup.text_file import LARGEST_VALUE, checked_bytes, printable, widened

MAGIC = b"NVIDIA ARC MBSDF V1\n"
MAX_BYTES = 512 << 20
MAX_NOTES = 20
_REFLECTION = (b"MBSDF_DATA=\n", b"MBSDF_DATA_REFLECTION=\n")
_TRANSMISSION = b"MBSDF_DATA_TRANSMISSION=\n"
_REMEDY = "give an .mbsdf file as its program wrote it"


@dataclass(frozen=True)
class MbsdfParts:
    """Contents of a file: its notes, and the tables (theta_in, theta_out, phi, 1 or 3) of both hemispheres."""

    notes: list[str]
    reflection: Array | None
    transmission: Array | None


def read_parts(path: Path) -> MbsdfParts:
    """Parse a file. Raises BakeError where it is damaged."""
    data = _bytes(path)
    position, notes = len(MAGIC), []
    parts: dict[bytes, Array] = {}
    while position < len(data):
        end = data.find(b"\n", position)
        line = data[position : end + 1] if end >= 0 else data[position:]
        if line in (*_REFLECTION, _TRANSMISSION):
            kind = _TRANSMISSION if line == _TRANSMISSION else _REFLECTION[0]
            if kind in parts:
                _refuse(path, "holds the same hemisphere twice")
            parts[kind], position = _table(path, data, position + len(line))
        elif parts or end < 0:
            _refuse(path, f"holds {len(data) - position} bytes that belong to no table")
        else:
            notes.append(printable(line.decode("utf-8", "replace")))
            position = end + 1
    return MbsdfParts(notes[:MAX_NOTES], parts.get(_REFLECTION[0]), parts.get(_TRANSMISSION))


def _bytes(path: Path) -> bytes:
    data = checked_bytes(path, _REMEDY, MAX_BYTES)
    if not data.startswith(MAGIC):
        _refuse(path, "does not begin as an .mbsdf file does")
    return data


def _table(path: Path, data: bytes, start: int) -> tuple[Array, int]:
    """The table whose three numbers begin at `start`, and where the next may begin."""
    if len(data) < start + 12:
        _refuse(path, "ends within the sizes of a table")
    kind, n_theta, n_phi = (int(number) for number in np.frombuffer(data, "<u4", 3, start))
    if kind not in (0, 1) or not n_theta or not n_phi:
        _refuse(path, f"describes a table of kind {kind}, {n_theta} x {n_theta} x {n_phi}, which does not exist")
    channels = 3 if kind else 1
    count = n_theta * n_theta * n_phi * channels
    first = start + 12
    if first + 4 * count > len(data):
        _refuse(path, f"is truncated: a table of {4 * count} bytes has {max(len(data) - first, 0)}")
    table = widened(np.frombuffer(data, "<f4", count, first)).reshape(n_theta, n_theta, n_phi, channels)
    if not np.isfinite(table).all() or np.abs(table).max() > LARGEST_VALUE:
        _refuse(path, f"holds values that are not finite or exceed {LARGEST_VALUE:g} 1/sr")
    return table, first + 4 * count


def read(path: Path) -> LookupSource:
    """Read an `.mbsdf` file; of a sheet, whose sides the format does not tell apart, both are taken to be alike.

    Raises
    ------
    BakeError : damaged, or without reflection
    """
    parts = read_parts(path)
    table = parts.reflection
    if table is None:
        cause = "holds transmission only" if parts.transmission is not None else "holds no data"
        _refuse(path, cause, "give a file with the reflection of a surface")
    colour = "RGB of primaries that the file does not state, read as Rec.709"
    if table.shape[3] == 1:
        colour = "grey"
    exchanged = np.abs(table - table.swapaxes(0, 1)).sum() / max(np.abs(table).sum() * 2, 1e-30)
    facts: dict[str, Json] = {
        "format": "NVIDIA MBSDF",
        "comments": parts.notes,
        "colour": colour,
        "entries": list(table.shape[:3]),
        "interpolation": "trilinear between cell centres",
        "reciprocity_error": float(2 * exchanged),
        **negative_facts(table),
    }
    lookup = _lookup_of(table)
    if parts.transmission is None:
        return LookupSource(path.stem, lookup, facts, isotropic=True, bilateral=True)
    facts["transmission"] = "both ways alike, and so are the sides: the format knows one"
    through = _lookup_of(parts.transmission)
    return SheetLookup(path.stem, lookup, facts, True, True, through, through, lookup, alike=True)


def _lookup_of(table: Array) -> Lookup:
    """Values between the entries of a table (theta_in, theta_out, phi, 1 or 3)."""
    n_theta, n_phi = table.shape[1:3]
    colours = grey(table[..., 0]) if table.shape[3] == 1 else table
    axes = _centres(n_theta, np.pi / 2), _centres(n_theta, np.pi / 2), _centres(n_phi, np.pi)
    return lambda wi, wo: interpolate(axes, colours, polar_angle(wi), polar_angle(wo), azimuth_between(wi, wo))


def _centres(count: int, whole: float) -> Axis:
    return Axis((np.arange(count) + 0.5) * (whole / count))


def _refuse(path: Path, cause: str, remedy: str = _REMEDY) -> NoReturn:
    raise BakeError(path, cause, remedy)


READER = Reader(
    "NVIDIA MBSDF", (".mbsdf",), lambda path, head: head.startswith(MAGIC), lambda path, reading: read(path)
)
