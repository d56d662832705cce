"""Marks of colour written into image files: PNG chunks, JPEG segments, Exif, ICC profiles, OpenEXR attributes."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np

Triple = tuple[float, float, float]
# Colorants of profiles as their makers publish them, XYZ relative to D50.
ADOBE_ICC: tuple[Triple, ...] = ((0.60974, 0.31111, 0.01947), (0.20528, 0.62567, 0.06087), (0.14919, 0.06322, 0.74457))
DISPLAY_P3_ICC: tuple[Triple, ...] = (
    (0.51512, 0.24120, -0.00105),
    (0.29198, 0.69225, 0.04189),
    (0.15710, 0.06657, 0.78407),
)
PROPHOTO_ICC: tuple[Triple, ...] = ((0.79767, 0.28804, 0.0), (0.13519, 0.71187, 0.0), (0.03134, 0.00009, 0.82491))
SRGB_ICC: tuple[Triple, ...] = ((0.43607, 0.22249, 0.01392), (0.38515, 0.71687, 0.09708), (0.14307, 0.06061, 0.71410))


def chunk(name: bytes, data: bytes) -> bytes:
    """A PNG chunk."""
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def write_png(path: Path, codes: np.ndarray, *marks: bytes) -> Path:
    """(H, W, 3) uint8 or uint16 codes with the given chunks behind the header."""
    codes = np.asarray(codes)
    big = codes.astype(codes.dtype.newbyteorder(">"))
    rows = b"".join(b"\0" + row.tobytes() for row in big)
    head = struct.pack(">IIBBBBB", codes.shape[1], codes.shape[0], 8 * codes.itemsize, 2, 0, 0, 0)
    body = b"".join(marks) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + body)
    return path


def icc_chunk(profile: bytes) -> bytes:
    """A profile in a PNG."""
    return chunk(b"iCCP", b"camera\0\0" + zlib.compress(profile))


def mark_jpeg(path: Path, *segments: tuple[int, bytes]) -> None:
    """Put segments (marker, data) in front of everything."""
    data = path.read_bytes()
    marks = b"".join(bytes([0xFF, marker]) + struct.pack(">H", len(body) + 2) + body for marker, body in segments)
    path.write_bytes(data[:2] + marks + data[2:])


def icc_segments(profile: bytes, size: int = 300) -> list[tuple[int, bytes]]:
    """A profile in several segments of a JPEG, the last first, which the format allows."""
    parts = [profile[k : k + size] for k in range(0, len(profile), size)]
    told = [(0xE2, b"ICC_PROFILE\0" + bytes([k + 1, len(parts)]) + part) for k, part in enumerate(parts)]
    return told[::-1]


def exif(color_space: int, index: bytes | None, order: str = ">") -> bytes:
    """A TIFF structure whose Exif says this of its colours."""

    def entry(tag: int, kind: int, count: int, value: bytes) -> bytes:
        return struct.pack(order + "HHI", tag, kind, count) + value.ljust(4, b"\0")

    def place(value: int) -> bytes:
        return struct.pack(order + "I", value)

    entries = [entry(0xA001, 3, 1, struct.pack(order + "H", color_space))]
    if index is not None:
        entries.append(entry(0xA005, 4, 1, place(26 + 2 + 24 + 4)))
    directory = struct.pack(order + "H", len(entries)) + b"".join(entries) + place(0)
    interoperability = struct.pack(order + "H", 1) + entry(1, 2, 4, index or b"") + place(0)
    head = {">": b"MM", "<": b"II"}[order] + struct.pack(order + "HI", 42, 8)
    first = struct.pack(order + "H", 1) + entry(0x8769, 4, 1, place(26)) + place(0)
    return head + first + directory + (interoperability if index is not None else b"")


def curve_of(kind: str) -> bytes:
    """A curve as ICC stores it: "gamma:1.8", "linear", "srgb" by 1024 samples, "srgb formula"."""
    if kind == "linear":
        return b"curv" + bytes(4) + struct.pack(">I", 0)
    if kind.startswith("gamma:"):
        return b"curv" + bytes(4) + struct.pack(">IH", 1, round(float(kind[6:]) * 256))
    if kind == "srgb formula":
        numbers = (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)
        return b"para" + bytes(4) + struct.pack(">HH5i", 3, 0, *(round(n * 65536) for n in numbers))
    x = np.linspace(0, 1, 1024)
    samples = np.rint(np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4) * 65535).astype(">u2")
    return b"curv" + bytes(4) + struct.pack(">I", 1024) + samples.tobytes()


def icc(name: str, colorants: tuple[Triple, ...], *curves: str, space: bytes = b"RGB ", **others: bytes) -> bytes:
    """A profile of colorants and curves, one for all channels or three; without colorants, of `others` alone."""
    tags: dict[bytes, bytes] = {b"desc": b"desc" + bytes(4) + struct.pack(">I", len(name) + 1) + name.encode() + b"\0"}
    for tag, xyz in zip((b"rXYZ", b"gXYZ", b"bXYZ"), colorants):
        tags[tag] = b"XYZ " + bytes(4) + struct.pack(">3i", *(round(value * 65536) for value in xyz))
    names = (b"kTRC",) if space == b"GRAY" else (b"rTRC", b"gTRC", b"bTRC")
    for tag, kind in zip(names, curves * 3 if len(curves) == 1 else curves):
        tags[tag] = curve_of(kind)
    tags |= {tag.encode(): data for tag, data in others.items()}
    table, body = b"", b""
    start = 128 + 4 + 12 * len(tags)
    for tag, data in tags.items():
        data += bytes(-len(data) % 4)
        table += struct.pack(">4sII", tag, start + len(body), len(data))
        body += data
    connection = b"XYZ " if colorants or space == b"GRAY" else b"Lab "
    head = struct.pack(">I", start + len(body)) + bytes(8) + b"mntr" + space + connection + bytes(12) + b"acsp"
    return head.ljust(128, b"\0") + struct.pack(">I", len(tags)) + table + body


def mark_exr(path: Path, name: str, kind: str, data: bytes) -> None:
    """Put an attribute in front of the others of an OpenEXR file, and move its pixels, which follow the header."""
    old = path.read_bytes()
    more = name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(data)) + data
    position = 8
    while old[position]:
        position = old.index(b"\0", old.index(b"\0", position) + 1) + 1
        position += 4 + struct.unpack_from("<i", old, position)[0]
    position += 1
    (first,) = struct.unpack_from("<Q", old, position)
    offsets = np.frombuffer(old[position:first], "<u8") + len(more)
    path.write_bytes(old[:8] + more + old[8:position] + offsets.tobytes() + old[first:])


def luminance_chroma_exr(width: int, height: int, rgb: Triple) -> bytes:
    """An even picture as luminance and chroma at half the resolution, half floats, not compressed."""
    luminance = 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]
    chroma = [(value - luminance) / luminance for value in (rgb[2], rgb[0])]
    names = ((b"BY", 2), (b"RY", 2), (b"Y", 1))
    channels = b"".join(name + b"\0" + struct.pack("<4i", 1, 0, step, step) for name, step in names) + b"\0"
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    known = {
        ("channels", "chlist"): channels, ("compression", "compression"): b"\0", ("dataWindow", "box2i"): window,
        ("displayWindow", "box2i"): window, ("lineOrder", "lineOrder"): b"\0",
        ("pixelAspectRatio", "float"): struct.pack("<f", 1), ("screenWindowCenter", "v2f"): struct.pack("<2f", 0, 0),
        ("screenWindowWidth", "float"): struct.pack("<f", 1),
    }  # fmt: skip
    head = b"\x76\x2f\x31\x01" + struct.pack("<I", 2)
    for (name, kind), data in known.items():
        head += name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(data)) + data
    head += b"\0"
    lines = []
    for y in range(height):
        values = [np.full(width // 2, value, "<f2") for value in chroma] if y % 2 == 0 else []
        data = b"".join(part.tobytes() for part in [*values, np.full(width, luminance, "<f2")])
        lines.append(struct.pack("<ii", y, len(data)) + data)
    offsets = len(head) + 8 * height + np.cumsum([0] + [len(line) for line in lines[:-1]])
    return head + offsets.astype("<u8").tobytes() + b"".join(lines)
