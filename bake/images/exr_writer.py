"""OpenEXR scan-line files with numpy alone, for Blenders that come without any OpenEXR library for Python.

The builds of blender.org bring OpenImageIO; those of Linux distributions mostly do not. What a bundle holds
is written and read here, and foreign files of the same kinds: uncompressed, ZIPS and ZIP, half or float.
Format: "OpenEXR File Layout", openexr.com.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .exr_header import ExrHeader, header_attributes

_ROWS_PER_CHUNK = {0: 1, 2: 1, 3: 16}  # none, ZIPS, ZIP
_ZIP = 3
_LONG_NAMES = 0x400
_TYPES = {np.dtype(np.float16): 1, np.dtype(np.float32): 2}


def can_read(path: Path) -> bool:
    """Whether the compression of an OpenEXR file, whose header was found good, is one of those known here."""
    return _compression(header_attributes(path.read_bytes()[: 1 << 24])[0]) in _ROWS_PER_CHUNK


def read_exr(path: Path, header: ExrHeader) -> NDArray[Any] | None:
    """Pixels (H, W, C) of a file whose header was found good, None where the pixels are damaged.

    Memory is taken for the header's size, which the caller has judged. Raises OSError.
    """
    data = path.read_bytes()
    attributes, end = header_attributes(data)
    rows = _ROWS_PER_CHUNK[compression := _compression(attributes)]
    kind = np.dtype("<f2" if header.half else "<f4")
    (top,) = struct.unpack_from("<i", attributes["dataWindow"][1], 4)
    shape = header.height, len(header.channels), header.width
    planes = np.zeros(shape, kind)
    missing = set(range(-(-header.height // rows)))
    try:
        for offset in struct.unpack_from(f"<{len(missing)}Q", data, end):
            y, size = struct.unpack_from("<ii", data, offset)
            chunk, remainder = divmod(y - top, rows)
            missing.remove(chunk)
            part = planes[chunk * rows : (chunk + 1) * rows]
            stored = data[offset + 8 : offset + 8 + max(size, 0)]
            raw = _unpacked(stored, part.nbytes, compression)
            if remainder or len(stored) != size or len(raw) != part.nbytes:
                return None
            part[:] = np.frombuffer(raw, kind).reshape(part.shape)
    except (struct.error, OverflowError, KeyError, zlib.error):  # KeyError: a chunk twice, or outside the image
        return None
    # A line holds its channels in alphabetical order.
    order = [sorted(header.channels).index(name) for name in header.channels]
    return planes[:, order].transpose(0, 2, 1)


def write_exr(path: Path, pixels: NDArray[Any], names: str, attributes: Mapping[str, str]) -> None:
    """Write (H, W, C) float16 or float32 values as a ZIP-compressed file. Raises OSError.

    Parameters
    ----------
    names : of the channels, one letter each
    attributes : ASCII strings for the header
    """
    height, width, _ = pixels.shape
    ordered = sorted(names)
    head = _header(width, height, ordered, _TYPES[pixels.dtype], attributes)
    little = pixels.dtype.newbyteorder("<")
    planes = pixels[..., [names.index(name) for name in ordered]].transpose(0, 2, 1).astype(little)
    chunks = list(_chunks(planes))
    offsets = len(head) + 8 * len(chunks) + np.cumsum([0] + [len(chunk) for chunk in chunks[:-1]])
    with open(path, "wb") as stream:
        stream.write(head)
        stream.write(offsets.astype("<u8").tobytes())
        stream.writelines(chunks)


def _compression(attributes: Mapping[str, tuple[str, bytes]]) -> int:
    return attributes["compression"][1][0]


def _header(width: int, height: int, names: list[str], kind: int, strings: Mapping[str, str]) -> bytes:
    channels = b"".join(name.encode() + b"\0" + struct.pack("<4i", kind, 0, 1, 1) for name in names) + b"\0"
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    known = {
        "channels": ("chlist", channels),
        "compression": ("compression", bytes([_ZIP])),
        "dataWindow": ("box2i", window),
        "displayWindow": ("box2i", window),
        "lineOrder": ("lineOrder", b"\0"),
        "pixelAspectRatio": ("float", struct.pack("<f", 1)),
        "screenWindowCenter": ("v2f", struct.pack("<2f", 0, 0)),
        "screenWindowWidth": ("float", struct.pack("<f", 1)),
    }
    known |= {name: ("string", text.encode("ascii")) for name, text in strings.items()}
    flags = _LONG_NAMES if any(len(name) > 31 for name in known) else 0
    body = b"".join(
        name.encode("ascii") + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(value)) + value
        for name, (kind, value) in known.items()
    )
    return b"\x76\x2f\x31\x01" + struct.pack("<I", 2 | flags) + body + b"\0"


def _chunks(planes: NDArray[Any]) -> Iterator[bytes]:
    rows = _ROWS_PER_CHUNK[_ZIP]
    for y in range(0, len(planes), rows):
        raw = planes[y : y + rows].tobytes()
        packed = zlib.compress(_spread(raw))
        # By the format, what does not shrink is stored as it is.
        stored = packed if len(packed) < len(raw) else raw
        yield struct.pack("<ii", y, len(stored)) + stored


def _unpacked(stored: bytes, size: int, compression: int) -> bytes:
    if compression == 0 or len(stored) == size:
        return stored
    # No more than is expected, whatever the stream would grow to.
    inflater = zlib.decompressobj()
    spread = inflater.decompress(stored, size + 1)
    return _gathered(spread) if len(spread) == size and inflater.eof else b""


def _spread(raw: bytes) -> bytes:
    """Even bytes, then odd ones, each as its difference from the one before, plus 128."""
    values = np.frombuffer(raw, np.uint8)
    halves = np.concatenate([values[::2], values[1::2]])
    halves[1:] = np.diff(halves) + np.uint8(128)
    return halves.tobytes()


def _gathered(spread: bytes) -> bytes:
    differences = np.frombuffer(spread, np.uint8).copy()
    differences[1:] -= np.uint8(128)
    halves = np.cumsum(differences, dtype=np.uint8)
    values = np.empty_like(halves)
    middle = (len(halves) + 1) // 2
    values[::2], values[1::2] = halves[:middle], halves[middle:]
    return values.tobytes()
