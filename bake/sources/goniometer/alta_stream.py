"""ALTA's binary variant: the same header of lines, then rows of numbers between `#BEGIN_STREAM` and `#END_STREAM`.

Layout, from ALTA's documentation of data formats and its writer (mkae/alta, MPL-2.0): `#FORMAT binary`, `#PRECISION
ieee754-double`, `#SAMPLE_COUNT n`, `#ENDIAN little` or `big`; the stream begins behind the line `#BEGIN_STREAM` and
holds n rows of the inputs and the outputs, nothing of what `#VS` adds to a text's rows.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...source import Array
from ..lookup.text_file import NamedFile, checked_bytes, widened

MAX_BYTES = 256 << 20
MAX_SAMPLES = 2_000_000
_MAX_HEADER = 1 << 16
_BEGIN, _END = b"#BEGIN_STREAM", b"#END_STREAM"
_ENDIAN = {"little": "<f8", "big": ">f8"}


def is_stream(path: Path) -> bool:
    """Whether the file begins as a binary one; also where it cannot be read to its end."""
    try:
        with path.open("rb") as stream:
            head = stream.read(_MAX_HEADER).partition(_BEGIN)[0].upper()
    except (OSError, ValueError):
        return False
    return b"#PARAM_IN" in head and b"BINARY" in head.partition(b"#FORMAT")[2][:16]


class Stream(NamedFile):
    """The header of a binary file by its keys in capitals, and its samples. Raises BakeError."""

    def __init__(self, path: Path, remedy: str) -> None:
        super().__init__(path, remedy)
        data = checked_bytes(path, remedy, MAX_BYTES)
        head, begin, self._data = data.partition(_BEGIN)
        if not begin or len(head) > _MAX_HEADER:
            raise self.error("has no line #BEGIN_STREAM behind its header")
        self.header: dict[str, str] = {}
        for line in head.decode("utf-8", "replace").splitlines():
            key, _, value = line.strip().removeprefix("#").partition(" ")
            if line.strip().startswith("#") and key[:1].isalpha():
                self.header[key.upper()] = value.strip()

    def rows(self, columns: int) -> Array:
        """(N, columns) finite numbers."""
        precision = self.header.get("PRECISION", "ieee754-double").lower()
        if precision != "ieee754-double":
            raise self.error(f"has numbers of precision {precision[:20]!r}, not ieee754-double")
        kind = _ENDIAN.get(self.header.get("ENDIAN", "little").lower())
        if kind is None:
            raise self.error(f"has #ENDIAN {self.header['ENDIAN'][:20]!r}, not little or big")
        text = self.header.get("SAMPLE_COUNT", "")
        count = int(text) if text.isascii() and text.isdigit() and len(text) < 12 else 0
        if not 0 < count <= MAX_SAMPLES:
            raise self.error(f"has #SAMPLE_COUNT {text[:20]!r}, not a number from 1 to {MAX_SAMPLES}")
        start = len(self._data) - len(self._data.lstrip(b" \t\r")) if self._data[:1] in b" \t\r" else 0
        if self._data[start : start + 1] != b"\n":
            raise self.error("has more than #BEGIN_STREAM on the line of it")
        size, first = count * columns * 8, start + 1
        if len(self._data) < first + size:
            raise self.error(f"is truncated: {count} samples take {size} bytes, {len(self._data) - first} are there")
        if self._data[first + size :].strip() not in (b"", _END):
            raise self.error(f"does not end behind {count} samples of {columns} numbers")
        values = widened(np.frombuffer(self._data, kind, count * columns, first))
        if not np.isfinite(values).all():
            raise self.error("holds numbers that are not finite")
        return values.reshape(count, columns)
