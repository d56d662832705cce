"""The 'tensor_file' container: named arrays in one little-endian binary file.

It is what EPFL's Realistic Graphics Lab publishes its measured materials in (Dupuy and Jakob 2018). Layout:
magic, two version bytes, uint32 number of fields; then for each field uint16 name length, name, uint16 number
of dimensions, uint8 element type, uint64 offset from the start of the file, uint64 shape[]; then the data.
"""

from __future__ import annotations

import math
import os
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from ..errors import BakeError
from ..source import Array

MAGIC = b"tensor_file\0"
VERSION = b"\x01\x00"
ELEMENT_TYPES = {
    code: np.dtype(name) for code, name in enumerate("u1 i1 <u2 <i2 <u4 <i4 <u8 <i8 <f2 <f4 <f8".split(), start=1)
}
TYPE_CODES = {dtype: code for code, dtype in ELEMENT_TYPES.items()}
MAX_BYTES = 512 << 20
MAX_DIMENSIONS = 16
MIN_FIELD_HEADER = 13
ALIGNMENT = 8


class _Field(NamedTuple):
    name: str
    dtype: np.dtype
    offset: int
    shape: tuple[int, ...]


def _broken(path: Path, cause: str) -> BakeError:
    return BakeError(path, cause, "the file is damaged or not a tensor file, fetch it again")


class _Header:
    """Cursor over the header; every read past the end of the file is a `BakeError`."""

    def __init__(self, path: Path, stream: BinaryIO) -> None:
        self.path, self.stream = path, stream

    def take(self, size: int) -> bytes:
        """The next bytes."""
        data = self.stream.read(size)
        if len(data) != size:
            raise _broken(self.path, "the header is cut short")
        return data

    def unpack(self, layout: str) -> tuple[int, ...]:
        """The next numbers of a `struct` layout, little-endian."""
        return struct.unpack("<" + layout, self.take(struct.calcsize("<" + layout)))

    def field(self) -> _Field:
        """The next field's name, type, extents and offset."""
        raw_name = self.take(self.unpack("H")[0])
        try:
            name = raw_name.decode("utf-8")
        except UnicodeDecodeError:
            raise _broken(self.path, f"field name {raw_name[:24]!r} is not text") from None
        n_dimensions, code, offset = self.unpack("HBQ")
        if code not in ELEMENT_TYPES:
            raise _broken(self.path, f"field {name[:24]!r} has unknown element type {code}")
        if n_dimensions > MAX_DIMENSIONS:
            raise _broken(self.path, f"field {name[:24]!r} claims {n_dimensions} dimensions")
        return _Field(name, ELEMENT_TYPES[code], offset, self.unpack(f"{n_dimensions}Q"))


def _check_extents(path: Path, fields: list[_Field], data_start: int, length: int) -> None:
    """Refuse fields that leave the file, and overlapping ones, which would multiply its size in memory."""
    total = 0
    for field in fields:
        label = f"field {field.name[:24]!r}"
        size = math.prod(field.shape) * field.dtype.itemsize
        if math.prod(max(extent, 1) for extent in field.shape) > length:
            raise _broken(path, f"{label} claims more elements than the file has bytes")
        if size and (field.offset < data_start or field.offset + size > length):
            raise _broken(path, f"{label} does not lie inside the file")
        total += size
    if total > length - data_start:
        raise _broken(path, "fields overlap")


def _read_header(path: Path, stream: BinaryIO, length: int) -> list[_Field]:
    header = _Header(path, stream)
    if stream.read(len(MAGIC)) != MAGIC:
        raise BakeError(path, "not a tensor file", "choose an RGL .bsdf file")
    version = header.take(len(VERSION))
    if version != VERSION:
        raise BakeError(path, f"tensor file version {version[0]}.{version[1]} is unknown", "only version 1.0 is read")
    (n_fields,) = header.unpack("I")
    if n_fields * MIN_FIELD_HEADER > length:
        raise _broken(path, f"claims {n_fields} fields, more than the file can hold")
    fields: list[_Field] = []
    names: set[str] = set()
    for _ in range(n_fields):
        fields.append(header.field())
        if fields[-1].name in names:
            raise _broken(path, f"field {fields[-1].name[:24]!r} appears twice")
        names.add(fields[-1].name)
    _check_extents(path, fields, stream.tell(), length)
    return fields


def read_tensor_file(path: str | Path) -> dict[str, Array]:
    """Read all arrays of a tensor file, in the order of its header.

    The file is untrusted: every size is checked against the file's length before memory is taken.

    Parameters
    ----------
    path : file to read

    Returns
    -------
    field name to array, with the shape and element type the file states

    Raises
    ------
    BakeError : unreadable, larger than 512 MiB, or malformed in any way
    """
    path = Path(path)
    arrays: dict[str, Array] = {}
    try:
        # a pipe or a device would block or never end
        if not path.is_file():
            raise BakeError(path, "no such file", "check the path")
        with path.open("rb") as stream:
            length = os.fstat(stream.fileno()).st_size
            if length > MAX_BYTES:
                raise BakeError(path, f"{length >> 20} MiB is too large", f"at most {MAX_BYTES >> 20} MiB")
            for name, dtype, offset, shape in _read_header(path, stream, length):
                stream.seek(min(offset, length))
                data = np.fromfile(stream, dtype, math.prod(shape))
                if data.size != math.prod(shape):
                    raise _broken(path, f"field {name[:24]!r} is cut short")
                arrays[name] = data.reshape(shape)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "invalid path"
        raise BakeError(path, f"cannot be read ({reason})", "check the path and permissions") from error
    return arrays


def write_tensor_file(path: str | Path, fields: Mapping[str, Array | str]) -> None:
    """Write arrays as a tensor file; text is stored as its UTF-8 bytes.

    Parameters
    ----------
    path : file to write, replaced if it exists
    fields : name to array of 8 to 64 bit integers or 16 to 64 bit floats, of at most 16 dimensions

    Raises
    ------
    ValueError : an element type, a name or a number of dimensions that the format cannot hold
    """
    arrays: dict[bytes, Array] = {}
    for name, value in fields.items():
        array = np.frombuffer(value.encode(), np.uint8) if isinstance(value, str) else np.asarray(value)
        array = array.astype(array.dtype.newbyteorder("<"), order="C", copy=False)
        if array.dtype not in TYPE_CODES or array.ndim > MAX_DIMENSIONS or len(name.encode()) > 0xFFFF:
            raise ValueError(f"field {name[:24]!r} ({array.dtype}, {array.ndim} dimensions) cannot be stored")
        arrays[name.encode()] = array
    offset = len(MAGIC) + len(VERSION) + 4 + sum(MIN_FIELD_HEADER + len(n) + 8 * a.ndim for n, a in arrays.items())
    header = [MAGIC, VERSION, struct.pack("<I", len(arrays))]
    body: list[bytes] = []
    for encoded, array in arrays.items():
        padding = -offset % ALIGNMENT
        offset += padding
        layout = f"<H{len(encoded)}sHBQ{array.ndim}Q"
        code = TYPE_CODES[array.dtype]
        header.append(struct.pack(layout, len(encoded), encoded, array.ndim, code, offset, *array.shape))
        body += [bytes(padding), array.tobytes()]
        offset += array.nbytes
    Path(path).write_bytes(b"".join(header + body))
