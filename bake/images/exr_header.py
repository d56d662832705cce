"""The header of an OpenEXR file, read and judged before any library is let near it.

Format: "OpenEXR File Layout", openexr.com. Libraries allocate what a header declares; this reads a header
in plain Python so that a malformed or boastful one costs nothing.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

from ..errors import BakeError

_MAGIC = b"\x76\x2f\x31\x01"
_HEADER_LIMIT = 1 << 24
_FLAGS = {0x200: "is tiled", 0x800: "holds deep pixels", 0x1000: "has several parts"}
_ROWS_PER_CHUNK = {0: 1, 1: 1, 2: 1, 3: 16, 4: 32, 5: 16, 6: 32, 7: 32, 8: 32, 9: 256}
# Most that a compression can shrink: run lengths 64 to 1, deflate 1032 to 1; others have no firm bound.
_SHRINKS_BY = {0: 1, 1: 64, 2: 1032, 3: 1032}
_PIXEL_BYTES = {1: 2, 2: 4}  # half, float
_REMEDY = "export it as a plain OpenEXR: one part, scan lines, half or float, channels R, G, B and A"
CHANNELS = "RGBA"


@dataclass(frozen=True)
class ExrHeader:
    """Header of an OpenEXR file, as a reader needs it: size, channel names in the order R, G, B, A, type, string
    attributes."""

    width: int
    height: int
    channels: tuple[str, ...]
    half: bool
    attributes: dict[str, str]


def read_exr_header(path: Path, max_bytes: int) -> ExrHeader:
    """Header of a single-part scan-line image with 1, 3 or 4 channels.

    Raises BakeError where it is malformed, of another kind, larger than `max_bytes` as float32, or declares
    more than the file can hold; OSError where the file cannot be read.
    """
    with open(path, "rb") as stream:
        size = stream.seek(0, 2)
        stream.seek(0)
        data = stream.read(min(size, _HEADER_LIMIT))  # Python takes the memory for a whole request at once
    try:
        attributes, end = header_attributes(data)
        header, compression = _judge(attributes)
    except Unsuitable as error:
        raise BakeError(path, str(error), _REMEDY) from error
    except (struct.error, ValueError, IndexError, KeyError) as error:
        raise BakeError(path, "is not an OpenEXR file or its header is damaged", "export it again") from error
    texels = header.width * header.height * len(header.channels)
    if texels * 4 > max_bytes:
        cause = f"declares {header.width} x {header.height} pixels, more than {max_bytes >> 20} MiB"
        raise BakeError(path, cause, "use a smaller image")
    chunks = -(-header.height // _ROWS_PER_CHUNK.get(compression, 256))
    stored = texels * (2 if header.half else 4)
    if compression in _SHRINKS_BY and compression != 0:
        stored = -(-stored // _SHRINKS_BY[compression])
    elif compression:
        stored = 0
    if size < end + 16 * chunks + stored:  # each chunk has an offset, its first row and its length
        raise BakeError(path, "is cut short or declares more pixels than it holds", "export it again")
    return header


class Unsuitable(Exception):
    """A good header of a kind that is not read."""


def header_attributes(data: bytes, any_kind: bool = False) -> tuple[dict[str, tuple[str, bytes]], int]:
    """Name to (type, value) of a header, and where the file goes on; raises what struct and bytes do on damage.

    With `any_kind` tiled and deep images too, and the first header of several parts.
    """
    if data[:4] != _MAGIC:
        raise ValueError
    (version,) = struct.unpack_from("<I", data, 4)
    if version & 0xFF != 2:
        raise Unsuitable(f"has OpenEXR version {version & 0xFF}, not 2")
    for flag, what in _FLAGS.items():
        if version & flag and not any_kind:
            raise Unsuitable(what)
    found: dict[str, tuple[str, bytes]] = {}
    position = 8
    while data[position]:
        name, position = _name(data, position)
        kind, position = _name(data, position)
        (length,) = struct.unpack_from("<i", data, position)
        position += 4
        if length < 0 or position + length > len(data) or name in found:
            raise ValueError
        found[name] = kind, data[position : position + length]
        position += length
    return found, position + 1


def _name(data: bytes, start: int) -> tuple[str, int]:
    end = data.index(b"\0", start, start + 256)
    return data[start:end].decode("utf-8", "replace"), end + 1


def _judge(attributes: dict[str, tuple[str, bytes]]) -> tuple[ExrHeader, int]:
    left, top, right, bottom = struct.unpack("<4i", attributes["dataWindow"][1])
    width, height = right - left + 1, bottom - top + 1
    if width < 1 or height < 1:
        raise ValueError
    compression = attributes["compression"][1][0]
    names, kinds = _channels(attributes["channels"][1])
    ordered = tuple(sorted(names, key=CHANNELS.find))
    if len(names) != 1 and ordered not in (tuple("RGB"), tuple(CHANNELS)):
        shown = ", ".join(name if name.isprintable() else ascii(name) for name in names[:8])
        raise Unsuitable(f"has channels {shown or 'none'}")
    if len(kinds) != 1 or not kinds <= _PIXEL_BYTES.keys():
        raise Unsuitable("has integer channels or channels of different types")
    strings = {name: value.decode("utf-8", "replace") for name, (kind, value) in attributes.items() if kind == "string"}
    return ExrHeader(width, height, ordered, kinds == {1}, strings), compression


def channel_names(data: bytes) -> list[str]:
    """Names in a channel list, whatever their types; raises as `header_attributes`."""
    names, position = [], 0
    while data[position]:
        name, position = _name(data, position)
        names.append(name)
        position += 16
    return names


def _channels(data: bytes) -> tuple[list[str], set[int]]:
    names: list[str] = []
    kinds: set[int] = set()
    position = 0
    while data[position]:
        name, position = _name(data, position)
        kind, _, x_step, y_step = struct.unpack_from("<4i", data, position)
        position += 16
        if (x_step, y_step) != (1, 1):
            raise Unsuitable("has subsampled channels")
        names.append(name)
        kinds.add(kind)
    return names, kinds
