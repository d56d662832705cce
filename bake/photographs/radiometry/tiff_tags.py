"""Tags of TIFF structures: a TIFF file's pages, and the Exif that JPEG and PNG carry. Formats: TIFF 6.0, BigTIFF."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any, BinaryIO

_MOST_TAGS, _MOST_PAGES = 4096, 4096
_LARGEST = 16 << 20
_MOST_NUMBERS = 16
_PROFILE = 34675
# Size in bytes and struct code of each type; text and undefined bytes stay bytes.
_TYPES = {
    1: (1, "B"), 2: (1, "s"), 3: (2, "H"), 4: (4, "I"), 5: (8, "II"), 7: (1, "s"), 8: (2, "h"), 9: (4, "i"),
    10: (8, "ii"), 11: (4, "f"), 12: (8, "d"), 13: (4, "I"), 16: (8, "Q"), 18: (8, "Q"),
}  # fmt: skip
_EXIF, _INTEROPERABILITY = 0x8769, 0xA005
_KIND, _WIDTH, _HEIGHT = 254, 256, 257
_NOT_WHOLE = 1 | 4
Tags = dict[int, Any]
"""Tag to numbers, fractions as floats, or to bytes."""


class TiffTags:
    """Tags of one page and of its Exif and interoperability directories, at `origin` of a stream.

    Raises what struct and dictionaries do on damage: struct.error, ValueError, KeyError, OverflowError.
    """

    def __init__(self, stream: BinaryIO, origin: int, page: int = 0) -> None:
        self._stream, self._origin = stream, origin
        stream.seek(origin)
        self._order = {b"II": "<", b"MM": ">"}[stream.read(2)]
        (magic,) = self._read("H")
        if magic not in (42, 43):
            raise ValueError
        self._big = magic == 43
        if self._big:
            self._read("HH")
        (self._first,) = self._read(self._word)
        place = self._first
        for _ in range(page):
            place = self._next(place)
        self.page = self._directory(place)
        self.exif = self._linked(self.page, _EXIF)
        self.interoperability = self._linked(self.exif, _INTEROPERABILITY)

    @property
    def _word(self) -> str:
        return "Q" if self._big else "I"

    def _read(self, code: str) -> tuple[Any, ...]:
        return struct.unpack(self._order + code, self._stream.read(struct.calcsize(self._order + code)))

    def sizes(self) -> list[tuple[int, int, int]]:
        """Width, height and NewSubfileType of every page: 1 a reduced copy, 4 a mask."""
        place = self._first
        found: list[tuple[int, int, int]] = []
        seen: set[int] = set()
        while place not in seen and len(found) < _MOST_PAGES:
            seen.add(place)
            tags = self._directory(place)
            found.append((int(tags[_WIDTH][0]), int(tags[_HEIGHT][0]), int(tags.get(_KIND, (0,))[0])))
            try:
                place = self._next(place)
            except (struct.error, ValueError, OverflowError):
                break
        return found

    def _linked(self, tags: Tags, tag: int) -> Tags:
        """A directory that a tag points to, empty where it is missing or damaged."""
        try:
            return self._directory(int(tags[tag][0]))
        except (struct.error, ValueError, KeyError, IndexError, OverflowError):
            return {}

    def _count(self, place: int) -> int:
        self._stream.seek(self._origin + place)
        return int(self._read("Q" if self._big else "H")[0])

    def _next(self, place: int) -> int:
        """Place of the directory after the one at `place`."""
        count = self._count(place)
        self._stream.seek(count * (20 if self._big else 12), 1)
        (following,) = self._read(self._word)
        if not following:
            raise ValueError
        return int(following)

    def _directory(self, place: int) -> Tags:
        count, tags = self._count(place), {}
        entry, start = (20, 8) if self._big else (12, 2)
        for k in range(min(count, _MOST_TAGS)):
            self._stream.seek(self._origin + place + start + entry * k)
            tag, kind, number = self._read("HH" + self._word)
            size, code = _TYPES.get(kind, (0, ""))
            # Strips, previews and makers' notes are nothing to this reader, and may be made to fill the memory.
            most = _LARGEST if tag == _PROFILE and size == 1 else _MOST_NUMBERS
            if not code or not 1 <= number <= most:
                continue
            if size * number > (8 if self._big else 4):
                self._stream.seek(self._origin + self._read(self._word)[0])
            data = self._stream.read(size * number)
            if len(data) == size * number:
                tags[tag] = self._values(data, kind, code, number)
        return tags

    def _values(self, data: bytes, kind: int, code: str, number: int) -> Any:
        if code == "s" or (kind == 1 and number > 16):
            return data
        values = struct.unpack(self._order + code * number, data)
        return tuple(a / b for a, b in zip(values[::2], values[1::2]) if b) if kind in (5, 10) else values


def choose_page(path: Path) -> tuple[int, str]:
    """Which page of a TIFF is the photograph, and what to report about the choice, "" for nothing.

    It is the largest that is no reduced copy and no mask, the first of several. Raises OSError.
    """
    with open(path, "rb") as stream:
        try:
            sizes = TiffTags(stream, 0).sizes()
        except (struct.error, ValueError, KeyError, IndexError, OverflowError):
            return 0, ""
    ranks = [(not kind & _NOT_WHOLE, width * height) for width, height, kind in sizes]
    best = max(ranks)
    told = "files hold several pictures, the largest is read" if len(ranks) > 1 else ""
    if not best[0]:
        told = "files hold only what is marked as a reduced copy or a mask"
    elif ranks.count(best) > 1:
        told = "files hold several pictures of one size, the first is read (save each by itself)"
    return ranks.index(best), told
