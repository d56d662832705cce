"""Files that say where the light stood: `.lp` of reflectance transformation imaging, lists like it, and tables.

An `.lp` file holds the number of lights (some writers leave it out), then `file x y z` per line, set apart by blanks,
commas, semicolons or tabs, with decimal points or, where commas do not also set the numbers apart, decimal commas. A
table (`table`) has a line of column names; without one, a file of another suffix is read as an `.lp` is. Three numbers
a line and no file are the directions of DiLiGenT (Shi et al. 2016, "A benchmark dataset and evaluation for
non-Lambertian and uncalibrated photometric stereo"): the photographs stand line by line in `filenames.txt` beside it.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

from ...errors import BakeError
from .entry import LightEntry, Vector, direction_in_name, direction_of_angles, refuse, tidy_name, unit_vector
from .table import read_table

__all__ = ["LightEntry", "Vector", "direction_in_name", "direction_of_angles", "numbers_of_lines", "read_lights"]

MAX_BYTES = 4 << 20
FILENAMES = "filenames.txt"
_POINT = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[-+]?(?:nan|inf)", re.IGNORECASE)
_COMMA = re.compile(r"[-+]?(?:\d+(?:,\d+)?|,\d+)(?:[eE][-+]?\d+)?")
_NUMBERS_AFTER_NAME = re.compile(r"\.[a-z]\w{1,3}[\"']?[\s,;]+[-+\d.,eE\s;]+$", re.IGNORECASE)
_CELL_AFTER_NAME = re.compile(r".*[,;]\s*[-+]?\d+(?:[.,]\d+)?$")
_ONE_LENGTH = 1.5
"""Directions of a file without column names may differ in length by this factor; other numbers differ more."""
_LIST_REMEDY = "write 'file x y z' with decimal points, set apart by blanks"


def read_lights(path: Path) -> tuple[list[LightEntry], list[str]]:
    """Entries of a lights file and warnings. Raises BakeError naming the line."""
    text = _decoded(path)
    if (bare := _bare_numbers(text)) is not None:
        return _read_bare(path, bare)
    if path.suffix.lower() == ".lp" or _is_list(text):
        return _read_list(path, text)
    return read_table(path, text)


def _decoded(path: Path) -> str:
    """UTF-8, UTF-16 with its mark, else Windows-1252, in which editors there save by default."""
    try:
        with open(path, "rb") as stream:
            data = stream.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise BakeError(path, f"cannot be read ({reason})", "give a lights.csv or .lp file") from error
    if len(data) > MAX_BYTES:
        raise BakeError(path, f"is longer than {MAX_BYTES >> 20} MiB", "give a lights.csv or .lp file")
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        text = data.decode("utf-16", "replace")
    else:
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("cp1252", "replace")
    if "\0" in text:
        raise BakeError(path, "is not text", "give a lights.csv or .lp file in UTF-8")
    return text


def _lines(text: str) -> list[tuple[int, str]]:
    """Lines that say something, with their numbers, without surrounding blanks."""
    numbered = ((number, line.strip()) for number, line in enumerate(text.splitlines(), 1))
    return [(number, line) for number, line in numbered if line and not line.startswith("#")]


def _is_list(text: str) -> bool:
    """Whether a file without a suffix that says so begins as a list does: with a count, or with a file and numbers."""
    first = [line for _, line in _lines(text)[:2]]
    return bool(first) and (first[0].isdecimal() or _split(first[0]) is not None)


def numbers_of_lines(path: Path) -> list[list[float]] | None:
    """Three numbers of each line of a file of nothing else; None where it is no such file. Raises BakeError."""
    bare = _bare_numbers(_decoded(path))
    return None if bare is None else [vector for _, vector in bare]


def _bare_numbers(text: str) -> list[tuple[int, list[float]]] | None:
    found = []
    for number, line in _lines(text):
        words = line.replace(",", " ").replace(";", " ").split()
        if len(words) != 3 or not all(_POINT.fullmatch(word) for word in words):
            return None
        found.append((number, [float(word) for word in words]))
    return found or None


def _read_bare(path: Path, bare: list[tuple[int, list[float]]]) -> tuple[list[LightEntry], list[str]]:
    """Directions by the names in the file beside them."""
    listed = path.with_name(FILENAMES)
    if not listed.is_file():
        raise BakeError(path, "names no photographs", f"write 'file x y z' a line, or put {FILENAMES} beside it")
    names = [line for _, line in _lines(_decoded(listed))]
    if len(names) != len(bare):
        cause = f"lists {len(names)} photographs, but {path.name} has {len(bare)} directions"
        raise BakeError(listed, cause, "write one line for each photograph in both")
    entries = [
        LightEntry(tidy_name(name), unit_vector(path, number, vector))
        for name, (number, vector) in zip(names, bare, strict=True)
    ]
    return entries, []


def _read_list(path: Path, text: str) -> tuple[list[LightEntry], list[str]]:
    entries: list[LightEntry] = []
    lengths: list[float] = []
    declared: int | None = None
    for number, line in _lines(text):
        if declared is None and not entries and line.isdecimal():
            declared = int(line[:9])
            continue
        found = _split(line)
        if found is None:
            refuse(path, number, f"is not 'file x y z' ({line[:60]})", _LIST_REMEDY)
        name, vector, separator = found
        if _NUMBERS_AFTER_NAME.search(name) or (separator and _CELL_AFTER_NAME.fullmatch(name)):
            refuse(path, number, f"holds more numbers than three after the file ({line[:60]})", _LIST_REMEDY)
        entries.append(LightEntry(tidy_name(name), unit_vector(path, number, vector)))
        lengths.append(math.hypot(*vector))
    if path.suffix.lower() != ".lp" and entries and max(lengths) > _ONE_LENGTH * min(lengths):
        cause = "has no line of column names, and its numbers are no directions of one length"
        raise BakeError(path, cause, "begin with a line 'file,elevation,azimuth' (degrees) or 'file,x,y,z'")
    if not entries:
        raise BakeError(path, "lists no light", "write 'file x y z' per photograph")
    if declared is not None and declared != len(entries):
        return entries, [f"{path.name} announces {declared} lights and lists {len(entries)}"]
    return entries, []


def _split(line: str) -> tuple[str, list[float], str | None] | None:
    """File, three numbers and separator of a line, blanks first, so that names and numbers may hold commas."""
    for separator, pattern in ((None, _POINT), (None, _COMMA), (";", _POINT), (";", _COMMA), (",", _POINT)):
        words = [word.strip() for word in line.rsplit(separator, 3)]
        if len(words) == 4 and words[0] and all(pattern.fullmatch(word) for word in words[1:]):
            return words[0].rstrip(",; "), [float(word.replace(",", ".")) for word in words[1:]], separator
    return None
