"""8-bit PNG in numpy and zlib: the bytes as stored, without a library's alpha or colour handling.

Format: ISO/IEC 15948:2004, *Portable Network Graphics*. Reads any file of 8-bit grey, RGB or RGBA that is not
interlaced, whatever wrote it, and takes no more memory than its checked header calls for. Also writes 16-bit ones.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from ..errors import BakeError

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_KINDS = {1: 0, 3: 2, 4: 6}  # channels to colour type: grey, RGB, RGBA
_COLOURS = {3: "a palette", 4: "grey with alpha"}
_REMEDY = "export the image again"
_PLAIN = "save it as an 8-bit grey, RGB or RGBA PNG without interlacing"
_NO_FILTER, _UP = 0, 2
_BEST, _USUAL, _LARGE = 9, 6, 1 << 20  # levels of deflate; the best takes long for large images
_TRIED = 1 << 21  # bytes that are compressed to find the filters, a fifth of a second
_MOST_SHRUNK = 1032  # deflate, to 1
_MOST_CHUNKS = 1 << 18  # so that a file of empty chunks costs little
_AT_ONCE = 1 << 16
_TEXT, _LONGEST_TEXT = b"tEXtSource\0", 200
_LONGEST_SIDE = 1 << 16  # of an image whose rows take from their left, which are undone diagonal by diagonal


def png_bytes(pixels: NDArray[np.uint8] | NDArray[np.uint16], about: str = "") -> bytes:
    """A whole file for (H, W, 1, 3 or 4) values of 8 or 16 bits, top row first; equal pixels make equal files.

    Rows are stored as they are or as differences from the row above, whichever takes less room: the slices of a table
    are smooth down their columns, and their gutters repeat.

    `about`, of ASCII, is kept as the text chunk "Source", which `png_about` reads.
    """
    height, width, channels = pixels.shape
    depth = 8 * pixels.dtype.itemsize
    rows = pixels.astype(f">u{depth // 8}").view(np.uint8).reshape(height, -1)
    packed = _packed(rows, np.concatenate([rows[:1], rows[1:] - rows[:-1]]))
    text = {_TEXT[:4]: _TEXT[4:] + about.encode("ascii")} if about else {}
    chunks = {
        b"IHDR": struct.pack(">IIBBBBB", width, height, depth, _KINDS[channels], 0, 0, 0),
        **text,
        b"IDAT": packed,
        b"IEND": b"",
    }
    parts = [_SIGNATURE]
    for name, data in chunks.items():
        parts += [struct.pack(">I", len(data)), name, data, struct.pack(">I", zlib.crc32(name + data))]
    return b"".join(parts)


def _packed(rows: NDArray[np.uint8], differences: NDArray[np.uint8]) -> bytes:
    """Compressed rows (H, W C), each opening with its filter: all alike, then shorter and shorter runs changed.

    Of an image of some kilobytes a run is a row. That is a tenth of the file.
    """
    height, level = len(rows), _BEST if rows.size < _LARGE else _USUAL
    kinds = np.full((2, height, 1 + rows.shape[1]), _NO_FILTER, np.uint8)
    kinds[0, :, 1:], kinds[1, :, 1:], kinds[1, :, 0] = rows, differences, _UP

    def compressed(chosen: NDArray[np.intp]) -> bytes:
        return zlib.compress(kinds[chosen, np.arange(height)].tobytes(), level)

    candidates = [(compressed(chosen), chosen) for chosen in (np.zeros(height, np.intp), np.ones(height, np.intp))]
    best, chosen = min(candidates, key=lambda candidate: len(candidate[0]))
    left, counts = _TRIED // kinds[0].size - len(candidates), [1]
    for count in (2, 8, height):
        if (affordable := min(count, height, left)) > counts[-1]:
            counts.append(affordable)
            left -= affordable
    for run in (run for count in counts[1:] for run in np.array_split(np.arange(height), count)):
        other = chosen.copy()
        other[run] = 1 - other[run]
        if len(found := compressed(other)) < len(best):
            best, chosen = found, other
    return best


def with_about(data: bytes, about: str) -> bytes:
    """A whole file of any writer, with the text that `png_about` reads; `about` of ASCII, where there is none yet."""
    text = _TEXT + about.encode("ascii")
    chunk = struct.pack(">I", len(text) - 4) + text + struct.pack(">I", zlib.crc32(text))
    return data[:33] + chunk + data[33:]


def png_about(path: Path) -> str:
    """Text that `png_bytes` kept in the file; empty for any other file. Raises OSError."""
    with open(path, "rb") as stream:
        head = stream.read(33 + 8 + len(_TEXT) - 4 + _LONGEST_TEXT)
    if head[:8] != _SIGNATURE or head[37 : 37 + len(_TEXT)] != _TEXT:
        return ""
    text = head[37 + len(_TEXT) : 41 + struct.unpack_from(">I", head, 33)[0]]
    return text.decode("ascii", "replace")


class PngFile:
    """A checked header; `pixels` decodes the rest.

    Attributes
    ----------
    width, height, channels : of the image; channels is 1, 3 or 4
    """

    def __init__(self, path: Path, max_bytes: int) -> None:
        """Read the header.

        Raises BakeError where it is malformed, of another kind, larger than `max_bytes` as float32, or
        declares more than the file can hold; OSError where the file cannot be read.
        """
        self.path = path
        with open(path, "rb") as stream:
            size = stream.seek(0, 2)
            stream.seek(0)
            head = stream.read(33)
        if len(head) < 33 or head[:16] != _SIGNATURE + b"\0\0\0\rIHDR":
            raise self._damaged("is not a PNG file or its header is damaged")
        if struct.unpack_from(">I", head, 29)[0] != zlib.crc32(head[12:29]):
            raise self._damaged("has a damaged header")
        self.width, self.height, depth, colour, compression, filtering, interlace = struct.unpack_from(
            ">IIBBBBB", head, 16
        )
        if not self.width or not self.height or compression or filtering:
            raise self._damaged("has a damaged header")
        if depth != 8 or colour not in _KINDS.values() or interlace:
            what = f"{depth} bits per channel" if depth != 8 else _COLOURS.get(colour, "interlacing")
            raise BakeError(path, f"is a PNG with {what}", _PLAIN)
        self.channels = next(channels for channels, kind in _KINDS.items() if kind == colour)
        self._row = 1 + self.width * self.channels
        if self.width * self.height * self.channels * 4 > max_bytes:
            cause = f"declares {self.width} x {self.height} pixels, more than {max_bytes >> 20} MiB"
            raise BakeError(path, cause, "use a smaller image")
        if size * _MOST_SHRUNK < self.height * self._row:
            raise self._damaged("is cut short or declares more pixels than it holds")

    def pixels(self) -> NDArray[np.uint8]:
        """The bytes, (H, W, C), top row first. Raises BakeError."""
        expected = self.height * self._row
        unpacker = zlib.decompressobj()
        parts: list[bytes] = []
        missing = expected + 1  # one byte more, to see that there is none
        try:
            with open(self.path, "rb") as stream:
                stream.seek(33)
                for packed in self._image_data(stream):
                    while packed and missing and not unpacker.eof:
                        parts.append(unpacker.decompress(packed, missing))
                        missing -= len(parts[-1])
                        packed = unpacker.unconsumed_tail
        except zlib.error as error:
            raise self._damaged() from error
        if missing != 1 or not unpacker.eof:  # not at its end, its checksum was not compared either
            raise self._damaged()
        rows = np.frombuffer(b"".join(parts), np.uint8).reshape(self.height, self._row)
        filters, body = rows[:, 0], rows[:, 1:].reshape(self.height, self.width, self.channels)
        if filters.max() > 4:
            raise self._damaged()
        if not filters.any():
            return body
        if np.isin(filters, (_NO_FILTER, _UP)).all():  # all that we write
            return _summed(filters, body)
        if max(self.width, self.height) > _LONGEST_SIDE:
            raise BakeError(self.path, f"is longer than {_LONGEST_SIDE} pixels on a side", "use a smaller image")
        return _unfilter(filters, body)

    def _image_data(self, stream: BinaryIO) -> Iterator[bytes]:
        """Compressed pixels in pieces, up to the end chunk; every chunk of them is checked against its sum."""
        for _ in range(_MOST_CHUNKS):
            length, name = self._numbers(stream)
            if name == b"IEND" and stream.read(4) == struct.pack(">I", zlib.crc32(name)) and not length:
                return
            if name == b"IDAT":
                checksum = zlib.crc32(name)
                while length:
                    piece = stream.read(min(length, _AT_ONCE))
                    if not piece:
                        raise self._damaged()
                    checksum, length = zlib.crc32(piece, checksum), length - len(piece)
                    yield piece
                if stream.read(4) != struct.pack(">I", checksum):
                    raise self._damaged()
            elif name[0] & 0x20 or name == b"PLTE":  # ancillary, or the palette that RGB may suggest
                stream.seek(length + 4, 1)
            else:
                raise self._damaged()
        raise self._damaged()

    def _numbers(self, stream: BinaryIO) -> tuple[int, bytes]:
        head = stream.read(8)
        if len(head) < 8:
            raise self._damaged()
        length, name = struct.unpack(">I4s", head)
        return length, name

    def _damaged(self, cause: str = "is cut short or its pixels are damaged") -> BakeError:
        return BakeError(self.path, cause, _REMEDY)


def _summed(filters: NDArray[np.uint8], body: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Rows (H, W, C) that are whole or differences from the row above, (H,): sums from the last whole row on."""
    begun = np.maximum.accumulate(np.where(filters == _NO_FILTER, np.arange(len(filters)), 0))
    total = np.add.accumulate(body, 0, dtype=np.uint8)
    total -= (total - body)[begun]
    return total


def _unfilter(filters: NDArray[np.uint8], body: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Undo the row filters, (H,), of (H, W, C).

    A pixel is predicted from those to its left, above, and above to its left, so that all pixels of a diagonal
    can be restored at once. A black row above and a black column to the left stand in for what lies outside.
    """
    height, width, channels = body.shape
    padded = np.zeros((height + 1, width + 1, channels), np.uint8)
    flat, stored = padded.reshape(-1, channels), body.reshape(-1, channels)
    used = [(kind, filters == kind) for kind in np.unique(filters[filters > 0])]
    for diagonal in range(height + width - 1):
        rows = np.arange(max(0, diagonal - width + 1), min(height, diagonal + 1))
        here = (rows + 1) * (width + 1) + diagonal - rows + 1
        value = stored[rows * width + diagonal - rows]
        for kind, which in used:
            chosen = which[rows]
            at = here[chosen]
            value[chosen] += _predicted(kind, flat[at - 1], flat[at - width - 1], flat[at - width - 2])
        flat[here] = value
    return padded[1:, 1:]


def _predicted(
    kind: int, left: NDArray[np.uint8], above: NDArray[np.uint8], corner: NDArray[np.uint8]
) -> NDArray[np.uint8]:
    if kind == 1:
        return left
    if kind == 2:
        return above
    a, b, c = (part.astype(np.int16) for part in (left, above, corner))
    if kind == 3:
        return ((a + b) >> 1).astype(np.uint8)
    to_a, to_b, to_c = abs(b - c), abs(a - c), abs(a + b - 2 * c)  # Paeth: the one nearest to a + b - c
    return np.where((to_a <= to_b) & (to_a <= to_c), left, np.where(to_b <= to_c, above, corner))
