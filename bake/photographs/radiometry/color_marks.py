"""What a photograph's file says about its colours, read from its bytes, so that no library's reading of it matters.

JPEG and TIFF carry ICC profiles and Exif (JEITA CP-3451), PNG the chunks cICP, iCCP, sRGB, gAMA, cHRM and eXIf (W3C
PNG, third edition), OpenEXR the attributes `chromaticities` and `colorInteropID`, Radiance the line PRIMARIES.
"""

from __future__ import annotations

import math
import struct
import zlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO

from ...images.exr_header import Unsuitable, channel_names, header_attributes
from .tiff_tags import TiffTags

MAX_PROFILE = 16 << 20
Chromaticities = tuple[float, float, float, float, float, float, float, float]
"""x, y of red, green, blue and white."""

_MOST_PARTS = 1 << 18
_HEADER_LIMIT = 1 << 24
_DAMAGE = (Unsuitable, struct.error, ValueError, IndexError, KeyError, OverflowError, zlib.error, ZeroDivisionError)
_COLOR_SPACE, _INTEROPERABILITY, _ICC, _WHITE, _PRIMARIES = 0xA001, 1, 34675, 318, 319


@dataclass(frozen=True)
class ColorMarks:
    """Statements of a file about its colours, None or empty where it makes none.

    icc : profile
    cicp : code points of ITU-T H.273: primaries, transfer, matrix, full range
    srgb : a PNG says sRGB
    gamma : exponent that decodes, of a PNG
    chromaticities : of primaries and white
    exif_color_space, interoperability : of Exif: 1 is sRGB, 65535 something else, which "R03" calls Adobe RGB
    color_interop_id : of an OpenEXR
    xyz : the channels are X, Y and Z
    """

    icc: bytes = b""
    cicp: tuple[int, int, int, int] | None = None
    srgb: bool = False
    gamma: float | None = None
    chromaticities: Chromaticities | None = None
    exif_color_space: int | None = None
    interoperability: str = ""
    color_interop_id: str = ""
    xyz: bool = False


NOTHING = ColorMarks()


def read_color_marks(path: Path, page: int = 0) -> ColorMarks:
    """Marks of a JPEG, PNG, TIFF (of a page), EXR or HDR; what is damaged is as good as not said. Raises OSError."""
    with open(path, "rb") as stream:
        head = stream.read(8)
        stream.seek(0)
        if head == b"\x89PNG\r\n\x1a\n":
            return _png(stream)
        if head.startswith(b"\xff\xd8"):
            return _jpeg(stream)
        try:
            if head[:2] in (b"II", b"MM"):
                marks = _tiff(TiffTags(stream, 0, page))
                return _tiff(TiffTags(stream, 0)) if page and marks == NOTHING else marks
            if head[:4] == b"\x76\x2f\x31\x01":
                return _exr(stream)
            if head.startswith(b"#?"):
                return _hdr(stream)
        except _DAMAGE:
            pass
    return NOTHING


def _png(stream: BinaryIO) -> ColorMarks:
    marks, pending = NOTHING, {b"cICP", b"iCCP", b"sRGB", b"gAMA", b"cHRM", b"eXIf"}
    stream.seek(8)
    for _ in range(_MOST_PARTS):
        head = stream.read(8)
        if len(head) < 8 or head[4:] == b"IEND":
            break
        length, kind = struct.unpack(">I4s", head)
        start = stream.tell()
        if kind in pending and length <= MAX_PROFILE:
            pending.remove(kind)  # the first counts: thousands would take hours to unpack
            try:
                marks = _with_chunk(marks, kind, stream.read(length), stream, start)
            except _DAMAGE:
                pass
        stream.seek(start + length + 4)
    return marks


def _with_chunk(marks: ColorMarks, kind: bytes, data: bytes, stream: BinaryIO, start: int) -> ColorMarks:
    if kind == b"cICP":
        primaries, transfer, matrix, full = data
        return replace(marks, cicp=(primaries, transfer, matrix, full))
    if kind == b"iCCP":
        packed = data[data.index(b"\0") + 2 :]
        return replace(marks, icc=zlib.decompressobj().decompress(packed, MAX_PROFILE))
    if kind == b"sRGB":
        return replace(marks, srgb=True)
    if kind == b"gAMA":
        (gamma,) = struct.unpack(">I", data)
        return replace(marks, gamma=1e5 / gamma if gamma else None)
    if kind == b"cHRM":
        values = [value / 1e5 for value in struct.unpack(">8I", data)]  # the white comes first
        return replace(marks, chromaticities=_plausible(*values[2:], *values[:2]))
    return _with_exif(marks, TiffTags(stream, start))


def _jpeg(stream: BinaryIO) -> ColorMarks:
    marks = NOTHING
    parts: dict[int, bytes] = {}
    stream.seek(2)
    for _ in range(_MOST_PARTS):
        head = stream.read(2)
        if len(head) < 2 or head[0] != 0xFF or head[1] in (0xD9, 0xDA):  # the end, or the pixels
            break
        if head[1] == 0xFF or head[1] == 0x01 or 0xD0 <= head[1] <= 0xD8:  # fill, or without content
            stream.seek(-1 if head[1] == 0xFF else 0, 1)
            continue
        size = stream.read(2)
        length = int.from_bytes(size, "big")
        if len(size) < 2 or length < 2:
            break
        start = stream.tell()
        data = stream.read(length - 2) if head[1] in (0xE1, 0xE2) else b""
        if data.startswith(b"Exif\0\0") and marks == NOTHING:  # the first counts
            try:
                marks = _with_exif(marks, TiffTags(stream, start + 6))
            except _DAMAGE:
                pass
        if data.startswith(b"ICC_PROFILE\0") and len(data) > 14:
            parts.setdefault(data[12], data[14:])
        stream.seek(start + length - 2)
    return replace(marks, icc=b"".join(parts[number] for number in sorted(parts)))


def _with_exif(marks: ColorMarks, tags: TiffTags) -> ColorMarks:
    space = tags.exif.get(_COLOR_SPACE, ())
    index = tags.interoperability.get(_INTEROPERABILITY, b"")
    return replace(
        marks,
        exif_color_space=int(space[0]) if space else None,
        interoperability=index.rstrip(b"\0 ").decode("ascii", "replace") if isinstance(index, bytes) else "",
    )


def _tiff(tags: TiffTags) -> ColorMarks:
    icc = tags.page.get(_ICC, b"")
    primaries, white = tags.page.get(_PRIMARIES, ()), tags.page.get(_WHITE, ())
    marks = replace(NOTHING, icc=icc if isinstance(icc, bytes) else b"")
    if len(primaries) == 6 and len(white) in (0, 2):
        marks = replace(marks, chromaticities=_plausible(*primaries, *(white or (0.3127, 0.3290))))
    return _with_exif(marks, tags)


def _exr(stream: BinaryIO) -> ColorMarks:
    attributes, _ = header_attributes(stream.read(_HEADER_LIMIT), any_kind=True)
    kind, data = attributes.get("chromaticities", ("", b""))
    found = _plausible(*struct.unpack("<8f", data)) if kind == "chromaticities" else None
    kind, name = attributes.get("colorInteropID", ("", b""))
    names = {name.upper() for name in channel_names(attributes["channels"][1])}
    xyz = names >= {"X", "Y", "Z"} and not any(name.rpartition(".")[2] == "R" for name in names)
    interop = name.decode("ascii", "replace") if kind == "string" else ""
    return ColorMarks(chromaticities=found, color_interop_id=interop, xyz=xyz)


def _hdr(stream: BinaryIO) -> ColorMarks:
    text = stream.read(1 << 16).partition(b"\n\n")[0]
    for line in text.split(b"\n")[1:]:
        name, _, value = line.strip().partition(b"=")
        if name.strip() == b"PRIMARIES":
            return ColorMarks(chromaticities=_plausible(*(float(word) for word in value.split())))
    return NOTHING


def _plausible(*values: float) -> Chromaticities | None:
    """Eight chromaticities that span a triangle with the white inside, else None: no light would mix such a white."""
    if len(values) != 8 or not all(math.isfinite(value) and abs(value) < 10 for value in values):
        return None
    rx, ry, gx, gy, bx, by, wx, wy = values
    area = (gx - rx) * (by - ry) - (bx - rx) * (gy - ry)
    around = ((rx, ry, gx, gy), (gx, gy, bx, by), (bx, by, rx, ry))
    shares = [((x1 - x0) * (wy - y0) - (wx - x0) * (y1 - y0)) * area for x0, y0, x1, y1 in around]
    sound = abs(area) > 1e-4 and wy > 1e-3 and min(shares) > 0
    return (rx, ry, gx, gy, bx, by, wx, wy) if sound else None
