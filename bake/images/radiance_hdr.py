"""Radiance .hdr images: the shared-exponent pixel format RGBE and the file around it.

Ward, "Real Pixels", Graphics Gems II, 1991. The codec is ours because Blender's OpenImageIO truncates when
it encodes, which darkens by 0.3 % on average, and cannot read the older run-length scheme.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import BakeError

SMALLEST = 1e-32  # texels darker than this are stored as black, here and in every other encoder
LARGEST = math.ldexp(255.0, 127 - 8)

_RUN_WIDTHS = range(8, 32768)
_REMEDY = "export the image again"
_HEADER_LIMIT = 1 << 16
_RESOLUTION = re.compile(rb"([-+])([XY]) +(\d{1,9}) +([-+])([XY]) +(\d{1,9})")


def encode(rgb: NDArray[Any]) -> NDArray[np.uint8]:
    """Nearest RGBE of (..., 3) linear values; ties to even, (..., 4) bytes.

    Raises ValueError for values that are negative, not finite, or above 1.69e38.
    """
    rgb = np.asarray(rgb, np.float32)
    if rgb.shape[-1:] != (3,):
        raise ValueError(f"RGBE holds 3 channels, not {rgb.shape[-1] if rgb.ndim else 0}")
    if not np.isfinite(rgb).all():
        raise ValueError("RGBE cannot hold values that are not finite")
    if (rgb < 0).any():
        raise ValueError("RGBE cannot hold negative values")
    if (rgb > LARGEST).any():
        raise ValueError(f"RGBE cannot hold values above {LARGEST:.4g}")
    peak = rgb.max(axis=-1)
    lit = peak >= SMALLEST
    peak = np.where(lit, peak, np.float32(1))
    exponent = np.frexp(peak)[1].astype(np.int32)
    exponent += np.rint(np.ldexp(peak, 8 - exponent)) == 256  # the peak rounds up to the next power of two
    mantissa = np.rint(np.ldexp(rgb, (8 - exponent)[..., None]))
    rgbe = np.concatenate([mantissa, (exponent + 128)[..., None]], axis=-1)
    return np.where(lit[..., None], rgbe, 0).astype(np.uint8)


def decode(rgbe: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Values of (..., 4) RGBE bytes as Blender decodes them (no half step added), (..., 3) float32."""
    exponent = rgbe[..., 3:].astype(np.int32)
    rgb = np.ldexp(rgbe[..., :3].astype(np.float32), exponent - 136)
    return np.where(exponent == 0, np.float32(0), rgb).astype(np.float32)


def hdr_bytes(rgb: NDArray[Any]) -> Iterator[bytes]:
    """A whole .hdr file, piece by piece, for (H, W, 3) values, top row first; ValueError as `encode`."""
    rgbe = encode(rgb)
    height, width = rgbe.shape[:2]
    yield b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n" + b"-Y %d +X %d\n" % (height, width)
    for row in rgbe:
        if width not in _RUN_WIDTHS:
            yield row.tobytes()
            continue
        channels = (_encode_runs(row[:, channel]) for channel in range(4))
        yield bytes([2, 2, width >> 8, width & 255]) + b"".join(channels)


def _encode_runs(line: NDArray[np.uint8]) -> bytes:
    starts = np.concatenate([[0], np.flatnonzero(line[1:] != line[:-1]) + 1, [line.size]])
    raw, packed, copied = line.tobytes(), bytearray(), 0
    for k in np.flatnonzero(np.diff(starts) >= 4):  # shorter runs cost more than they save
        start, end = int(starts[k]), int(starts[k + 1])
        packed += _literals(raw[copied:start])
        for position in range(start, end, 127):
            packed += bytes([128 + min(127, end - position), raw[start]])
        copied = end
    return bytes(packed + _literals(raw[copied:]))


def _literals(raw: bytes) -> bytes:
    pieces = (raw[k : k + 128] for k in range(0, len(raw), 128))
    return b"".join(bytes([len(piece)]) + piece for piece in pieces)


class HdrFile:
    """A checked .hdr header; `pixels` decodes the rest.

    Attributes
    ----------
    width, height : size after the header's orientation is undone
    """

    def __init__(self, path: Path, max_bytes: int) -> None:
        """Read the header. Raises BakeError if it is malformed, or exceeds `max_bytes` or the file."""
        self.path = path
        with open(path, "rb") as stream:
            size = stream.seek(0, 2)
            stream.seek(0)
            head = stream.read(_HEADER_LIMIT)
        text, blank, rest = head.partition(b"\n\n")
        line, newline, _ = rest[:64].partition(b"\n")
        match = _RESOLUTION.fullmatch(line.rstrip(b"\r"))
        if not text.startswith(b"#?") or not blank or not newline or not match:
            raise BakeError(path, "is not a Radiance .hdr file or its header is damaged", _REMEDY)
        self._exposure = self._read_variables(text)
        y_sign, y_axis, rows, x_sign, x_axis, columns = match.groups()
        if (y_axis, x_axis) != (b"Y", b"X"):
            raise BakeError(path, "stores columns instead of rows", "turn the image upright and export again")
        self._upside_down, self._mirrored = y_sign == b"+", x_sign == b"-"
        self.height, self.width = int(rows), int(columns)
        self._start = len(text) + len(blank) + len(line) + len(newline)
        if not self.width or not self.height:
            raise BakeError(path, "has no pixels", _REMEDY)
        if self.width * self.height * 12 > max_bytes:
            raise BakeError(
                path,
                f"declares {self.width} x {self.height} pixels, more than {max_bytes >> 20} MiB",
                "use a smaller image",
            )
        # The longest encoding of a row spends a count on every byte.
        self._length = min(size - self._start, self.height * (8 * self.width + 4))
        if self._length < 4 * self.height:  # no scheme stores a row in less than one pixel
            raise BakeError(path, "is cut short", _REMEDY)

    def _read_variables(self, text: bytes) -> float:
        exposure = 1.0
        for line in text.split(b"\n")[1:]:
            name, _, value = line.strip().partition(b"=")
            if name == b"FORMAT" and value.strip() != b"32-bit_rle_rgbe":
                raise BakeError(self.path, "holds XYZ instead of RGB", "export it as RGB")
            if name == b"COLORCORR":
                raise BakeError(self.path, "carries a colour correction", "export it without COLORCORR")
            if name == b"EXPOSURE":
                try:
                    exposure *= float(value)
                except ValueError:
                    exposure = math.nan
        if not 1e-30 < exposure < 1e30:
            raise BakeError(self.path, "states an unusable EXPOSURE", "fix or remove that header line")
        return exposure

    def pixels(self) -> NDArray[np.float32]:
        """Radiance (EXPOSURE divided out), (H, W, 3) float32, top row first. Raises BakeError."""
        with open(self.path, "rb") as stream:
            stream.seek(self._start)
            data = stream.read(self._length)
        rgbe = np.empty((self.height, self.width, 4), np.uint8)
        position = 0
        try:
            for row in rgbe:
                position = _decode_row(data, position, row)
        except (IndexError, ValueError) as error:
            raise BakeError(self.path, "is cut short or its pixels are damaged", _REMEDY) from error
        rgb = decode(rgbe[:: -1 if self._upside_down else 1, :: -1 if self._mirrored else 1])
        if self._exposure != 1.0:
            with np.errstate(over="ignore", under="ignore"):
                rgb = (rgb / self._exposure).astype(np.float32)
        return np.ascontiguousarray(rgb)


def _decode_row(data: bytes, position: int, row: NDArray[np.uint8]) -> int:
    """Fill `row` (W, 4) and return where the next one starts; ValueError or IndexError on damage."""
    width = len(row)
    if width in _RUN_WIDTHS and data[position : position + 2] == b"\2\2" and data[position + 2] < 128:
        if data[position + 2] << 8 | data[position + 3] != width:
            raise ValueError
        position += 4
        for channel in range(4):
            row[:, channel], position = _decode_runs(data, position, width)
        return position
    end = position + 4 * width
    if end <= len(data):
        flat = np.frombuffer(data, np.uint8, 4 * width, position).reshape(width, 4)
        if not (flat[:, :3] == 1).all(axis=1).any():
            row[:] = flat
            return end
    return _decode_repeats(data, position, row)


def _decode_runs(data: bytes, position: int, width: int) -> tuple[NDArray[np.uint8], int]:
    line = bytearray()
    while len(line) < width:
        count = data[position]
        if count > 128:
            line += data[position + 1 : position + 2] * (count - 128)
            position += 2
        else:
            line += data[position + 1 : position + 1 + count]
            position += 1 + count
        if count == 0 or position > len(data):
            raise ValueError
    if len(line) != width:
        raise ValueError
    return np.frombuffer(bytes(line), np.uint8), position


def _decode_repeats(data: bytes, position: int, row: NDArray[np.uint8]) -> int:
    """The first Radiance scheme: (1, 1, 1, n) repeats the pixel before; further ones count bytes."""
    column = shift = 0
    while column < len(row):
        pixel = data[position : position + 4]
        if len(pixel) < 4:
            raise ValueError
        position += 4
        if pixel[:3] == b"\1\1\1":
            count = pixel[3] << shift
            if column == 0 or shift > 16 or count > len(row) - column:
                raise ValueError
            row[column : column + count] = row[column - 1]
            column, shift = column + count, shift + 8
        else:
            row[column] = np.frombuffer(pixel, np.uint8)
            column, shift = column + 1, 0
    return position
