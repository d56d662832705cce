"""Headers of JPEG, PNG and TIFF files, read without any image library: sizes, bits and what the camera noted.

For Blenders whose Python has no OpenImageIO. Blender itself can show such files, but tells neither their bits nor
their Exif, and reads all pixels before it tells their size.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO

from ..bake.errors import BakeError
from ..bake.photographs.photograph import Exposure, PhotoInfo

_PNG = b"\x89PNG\r\n\x1a\n"
_PNG_CHANNELS = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}
_MOST_TAGS = 4096
# Size in bytes and struct code of the TIFF types that matter here.
_TYPES = {1: (1, "B"), 3: (2, "H"), 4: (4, "I"), 5: (8, "II"), 13: (4, "I")}
_WIDTH, _HEIGHT, _BITS, _ORIENTATION, _SAMPLES, _FORMAT, _EXIF = 256, 257, 258, 274, 277, 339, 0x8769
_SECONDS, _F_NUMBER, _ISO, _WHITE_BALANCE = 0x829A, 0x829D, 0x8827, 0xA403
_FLOAT = 3  # of _FORMAT


@dataclass(frozen=True)
class Header:
    """A photograph's header and the bits per channel that its file has."""

    info: PhotoInfo
    bits: int


def read_photo_header(path: Path) -> Header:
    """Header of a JPEG, PNG or TIFF file. Raises BakeError for damage, for a cut file where it shows, and OSError."""
    with open(path, "rb") as stream:
        head = stream.read(8)
        try:
            if head == _PNG:
                return _png(stream)
            if head.startswith(b"\xff\xd8"):
                return _jpeg(stream)
            if head[:4] in (b"II*\0", b"MM\0*"):
                return _tiff_header(_Tiff(stream, 0))
        except (struct.error, ValueError, IndexError, KeyError, OverflowError) as error:
            raise BakeError(path, "has a damaged header or is cut short", "copy it again from the camera") from error
    raise BakeError(path, "is not an image", "export it again or take it out")


def _read(stream: BinaryIO, code: str) -> tuple[Any, ...]:
    return struct.unpack(code, stream.read(struct.calcsize(code)))


def _png(stream: BinaryIO) -> Header:
    info, bits = None, 8
    while True:
        length, kind = _read(stream, ">I4s")
        start = stream.tell()
        if kind == b"IHDR":
            width, height, bits, color = _read(stream, ">IIBB")
            info = PhotoInfo("png", width, height, _PNG_CHANNELS[color])
        elif info is None:
            raise ValueError("no header")
        elif kind == b"IEND":
            return Header(info, max(bits, 8))
        stream.seek(start + length + 4)


def _jpeg(stream: BinaryIO) -> Header:
    info = PhotoInfo("jpeg", 0, 0)
    stream.seek(2)
    while True:
        marker, kind = _read(stream, "BB")
        if marker != 0xFF:
            raise ValueError("no marker")
        if kind == 0xFF or kind == 0x01 or 0xD0 <= kind <= 0xD7:  # fill, or without content
            stream.seek(-1 if kind == 0xFF else 0, 1)
            continue
        (length,) = _read(stream, ">H")
        start = stream.tell()
        if 0xC0 <= kind <= 0xCF and kind not in (0xC4, 0xC8, 0xCC):
            bits, height, width, channels = _read(stream, ">BHHB")
            info = replace(info, width=width, height=height, channels=channels)
            _check_end(stream)
            return Header(info, bits)
        if kind == 0xE1 and stream.read(6) == b"Exif\0\0":
            info = _with_exif(info, stream)
        stream.seek(start + length - 2)


def _check_end(stream: BinaryIO) -> None:
    """Raise ValueError where the last part of a JPEG, which ends with a marker of its own, is missing."""
    end = stream.seek(0, 2)
    stream.seek(max(0, end - (1 << 16)))
    if b"\xff\xd9" not in stream.read():
        raise ValueError("cut short")


def _with_exif(info: PhotoInfo, stream: BinaryIO) -> PhotoInfo:
    """What the camera noted; damaged notes are as good as none."""
    try:
        return _noted(info, _Tiff(stream, stream.tell()))
    except (struct.error, ValueError, IndexError, KeyError, OverflowError):
        return info


class _Tiff:
    """Tags of the first directory of a TIFF structure and of its Exif directory, at `origin` of a stream."""

    def __init__(self, stream: BinaryIO, origin: int) -> None:
        self.stream, self.origin = stream, origin
        stream.seek(origin)
        self.order = {b"II": "<", b"MM": ">"}[stream.read(2)]
        magic, first = _read(stream, self.order + "HI")
        if magic != 42:
            raise ValueError("no TIFF")
        self.tags = dict(self._directory(first))
        if _EXIF in self.tags:
            self.tags |= dict(self._directory(int(self.tags[_EXIF][0])))

    def _directory(self, offset: int) -> Iterator[tuple[int, tuple[Any, ...]]]:
        self.stream.seek(self.origin + offset)
        (count,) = _read(self.stream, self.order + "H")
        for k in range(min(count, _MOST_TAGS)):
            self.stream.seek(self.origin + offset + 2 + 12 * k)
            tag, kind, number = _read(self.stream, self.order + "HHI")
            if kind not in _TYPES or not 1 <= number <= 16:
                continue
            size, code = _TYPES[kind]
            if size * number > 4:
                self.stream.seek(self.origin + _read(self.stream, self.order + "I")[0])
            values = _read(self.stream, self.order + code * number)
            yield tag, values if kind != 5 else tuple(a / b for a, b in zip(values[::2], values[1::2]) if b)

    def number(self, tag: int, usual: float | None = None) -> float | None:
        """First value of a tag, if it is a number above 0."""
        values = self.tags.get(tag, ())
        return values[0] if values and math.isfinite(values[0]) and values[0] > 0 else usual


def _tiff_header(tiff: _Tiff) -> Header:
    width, height = int(tiff.tags[_WIDTH][0]), int(tiff.tags[_HEIGHT][0])
    channels, bits = int(tiff.number(_SAMPLES, 1) or 1), int(tiff.number(_BITS, 1) or 1)
    is_float = tiff.number(_FORMAT) == _FLOAT
    info = PhotoInfo("tiff", width, height, channels, is_float)
    return Header(_noted(info, tiff), bits)


def _noted(info: PhotoInfo, tiff: _Tiff) -> PhotoInfo:
    exposure = Exposure(tiff.number(_SECONDS), tiff.number(_F_NUMBER), tiff.number(_ISO))
    orientation = tiff.number(_ORIENTATION)
    return replace(
        info,
        exposure=exposure,
        orientation=int(orientation) if orientation in range(1, 9) else 1,
        automatic_white=tiff.tags.get(_WHITE_BALANCE, (1,))[0] == 0,
    )
