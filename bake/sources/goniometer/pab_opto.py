"""Files of pab-opto's goniophotometer, as Mountain exports them: a text file for every direction of the light.

Layout, from Radiance's pabopto2bsdf and its man page: lines `#key value` with and without a colon, then theta, phi
and a value, or CIE X, Y, Z, in degrees. `#format: theta phi DSF` is mandatory; DSF contains the cosine of the
outgoing direction and is divided by it, BSDF, BRDF and BTDF do not. The direction of the light is `#incident_angle
theta phi`, or `#intheta` and `#inphi`. All angles are of one system, away from the surface: the mirror lies at phi +
180, theta above 90 degrees is the other side.

Given one file, all files of its folder with its suffix and its sample's name are read with it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...directions import spherical
from ...errors import BakeError
from ...source import Array, Reader
from ..lookup.lookup_source import LookupSource
from ..lookup.text_file import TextFile, beginning, printable
from .scattered_source import scattered_source

MAX_FILES = 2000
MAX_SAMPLES = 2_000_000
_REMEDY = "give a file as pab-opto's Mountain exported it, with a line #format: theta phi BSDF"
_QUANTITIES = {"dsf": True, "bsdf": False, "brdf": False, "btdf": False}
# The cosine that a weighted value is divided by at least; nearer to the horizon a measurement says nothing.
_LEAST_COS = 0.02


@dataclass(frozen=True)
class _Sheet:
    """One file: its sample, whether values contain the cosine, light, viewers (N, 3) and values (N, 1 or 3)."""

    sample: str
    weighted: bool
    wi: Array
    wo: Array
    values: Array


def read(path: Path) -> LookupSource:
    """Read the files of one sample. Raises BakeError: damaged, without format or incidence, too few samples."""
    sheets, names = [_read_sheet(path)], [path.name]
    for other in _others(path):
        if _sample_of(other) == sheets[0].sample:
            sheets.append(_read_sheet(other))
            names.append(other.name)
        if sum(len(sheet.values) for sheet in sheets) > MAX_SAMPLES or len(sheets) > MAX_FILES:
            raise BakeError(path, f"belongs to more than {MAX_SAMPLES} samples", "give fewer directions of the light")
    if len({sheet.values.shape[1] for sheet in sheets}) > 1 or len({sheet.weighted for sheet in sheets}) > 1:
        raise BakeError(path, "files of one sample differ in #format or #colorimetry", "keep the kinds in own folders")
    wi = np.concatenate([np.broadcast_to(sheet.wi, sheet.wo.shape) for sheet in sheets])
    wo, values = (np.concatenate([getattr(sheet, name) for sheet in sheets]) for name in ("wo", "values"))
    file = TextFile(path, _REMEDY, comment="")
    facts: dict[str, Any] = {
        "format": "pab-opto",
        "comments": [sheets[0].sample],
        "incident_directions": len(sheets),
        "files": sorted(names)[:MAX_FILES],
        "cosine_divided_out": sheets[0].weighted,
    }
    if sheets[0].weighted:
        keep = np.abs(wo[:, 2]) > _LEAST_COS
        facts["samples_too_low"] = int(np.count_nonzero(~keep))
        wi, wo, values = wi[keep], wo[keep], values[keep] / np.abs(wo[keep, 2:])
    file.check_values(values)
    return scattered_source(file, wi, wo, values, "grey" if values.shape[1] == 1 else "xyz", facts)


def _others(path: Path) -> list[Path]:
    """Other files of the same folder and suffix that begin as such a file does."""
    try:
        found = sorted(p for p in path.parent.iterdir() if p.suffix == path.suffix and p != path and p.is_file())
    except OSError as error:
        raise BakeError(path, f"its folder cannot be listed ({error.strerror})", "check its permissions") from error
    return [p for p in found if _matches(p, b"")]


def _sample_of(path: Path) -> str:
    """The sample's name in a file, read as cheaply as recognising it was."""
    for line in beginning(path).decode("utf-8", "replace").splitlines():
        key, value = _entry(line.strip())
        if key == "sample_name":
            return printable(value.strip('"'))
    return ""


def _entry(line: str) -> tuple[str, str]:
    """Key in lower case and value of a line `#key value` or `#key: value`."""
    key, _, value = line.lstrip("#").strip().partition(" ")
    return key.rstrip(":").lower(), value.strip()


def _read_sheet(path: Path) -> _Sheet:
    file = TextFile(path, _REMEDY, comment="")
    told: dict[str, str] = {}
    rows: list[Array] = []
    width = 0
    for number, words, _ in file.split(","):
        if not words:
            continue
        if words[0].startswith("#"):
            key, value = _entry(file.lines[number - 1].strip())
            told.setdefault(key, value)
            continue
        width = width or len(words)
        if len(words) != width or width not in (3, 5):
            file.refuse(number, f"{len(words)} numbers instead of theta, phi and one value or three")
        rows.append(file.numbers(number, words))
    quantity = told.get("format", "").split()[-1:]
    if not quantity or quantity[0].lower() not in _QUANTITIES:
        raise file.error("has no line #format: theta phi with DSF, BSDF, BRDF or BTDF")
    if not rows:
        raise file.error("holds no samples")
    table = np.stack(rows)
    angles = np.radians(_incidence(file, told))
    wo = spherical(np.radians(table[:, 0]), np.radians(table[:, 1]))
    sample = printable(told.get("sample_name", "").strip('"'))
    return _Sheet(sample, _QUANTITIES[quantity[0].lower()], spherical(angles[0], angles[1]), wo, table[:, 2:])


def _incidence(file: TextFile, told: dict[str, str]) -> Array:
    """theta and phi of the light in degrees."""
    words = told["incident_angle"].replace(",", " ").split() if "incident_angle" in told else []
    words = words or [told[key].split()[0] for key in ("intheta", "inphi") if told.get(key)]
    if len(words) < 2:
        raise file.error("does not say where the light came from (#incident_angle theta phi)")
    return file.numbers(1, words[:2])


def _matches(path: Path, head: bytes) -> bool:
    data = beginning(path).lower()
    return b"#format" in data and b"theta phi" in data


READER = Reader("pab-opto", (".txt", ".dat"), _matches, lambda path, reading: read(path))
