"""Headers of JPEG, PNG and TIFF files, read without any image library: sizes, bits and what the camera noted.

For Blenders whose Python has no OpenImageIO. Blender itself can show such files, but reports neither their bits nor
their Exif, and reads all pixels before it reports their size.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO

from ...bake.errors import BakeError
from ...bake.photographs.photograph import Exposure, PhotoInfo
from ...bake.photographs.radiometry.tiff_tags import Tags, TiffTags

_PNG = b"\x89PNG\r\n\x1a\n"
_PNG_CHANNELS = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}
_WIDTH, _HEIGHT, _BITS, _ORIENTATION, _SAMPLES, _FORMAT = 256, 257, 258, 274, 277, 339
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
                return _tiff_header(TiffTags(stream, 0))
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
        return _noted(info, TiffTags(stream, stream.tell()))
    except (struct.error, ValueError, IndexError, KeyError, OverflowError):
        return info


def _number(tags: Tags, tag: int, usual: float | None = None) -> float | None:
    """First value of a tag, if it is a number above 0."""
    values = tags.get(tag, ())
    first = values[0] if isinstance(values, tuple) and values else 0
    return first if math.isfinite(first) and first > 0 else usual


def _tiff_header(tiff: TiffTags) -> Header:
    page = tiff.page
    width, height = int(page[_WIDTH][0]), int(page[_HEIGHT][0])
    channels, bits = int(_number(page, _SAMPLES, 1) or 1), int(_number(page, _BITS, 1) or 1)
    is_float = _number(page, _FORMAT) == _FLOAT
    info = PhotoInfo("tiff", width, height, channels, is_float)
    return Header(_noted(info, tiff), bits)


def _noted(info: PhotoInfo, tiff: TiffTags) -> PhotoInfo:
    tags = {**tiff.page, **tiff.exif}
    exposure = Exposure(_number(tags, _SECONDS), _number(tags, _F_NUMBER), _number(tags, _ISO))
    orientation = _number(tags, _ORIENTATION)
    return replace(
        info,
        exposure=exposure,
        orientation=int(orientation) if orientation in range(1, 9) else 1,
        automatic_white=tags.get(_WHITE_BALANCE, (1,))[0] == 0,
    )
