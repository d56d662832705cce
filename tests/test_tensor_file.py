"""The tensor file container: round trip, and headers that lie."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from measured_materials.bake.errors import BakeError
from measured_materials.bake.sources.tensor_file import (
    ELEMENT_TYPES,
    MAGIC,
    MAX_BYTES,
    read_tensor_file,
    write_tensor_file,
)


def test_round_trip_of_every_element_type(tmp_path: Path):
    fields = {dtype.str: np.arange(6).reshape(2, 1, 3).astype(dtype) for dtype in ELEMENT_TYPES.values()}
    fields |= {"scalar": np.float32(2.5), "empty": np.zeros((0, 3)), "": np.array([1], ">i4")}
    path = tmp_path / "any.bsdf"
    write_tensor_file(path, {**fields, "text": "häh"})
    back = read_tensor_file(path)
    assert list(back) == [*fields, "text"]
    assert back["text"].tobytes().decode() == "häh"
    for name, array in fields.items():
        np.testing.assert_array_equal(back[name], array)
        assert back[name].dtype == np.asarray(array).dtype.newbyteorder("<")


def test_writer_refuses_what_the_format_cannot_hold(tmp_path: Path):
    for value in (np.zeros(2, complex), np.array(["text"]), np.zeros((1,) * 17)):
        with pytest.raises(ValueError, match="cannot be stored"):
            write_tensor_file(tmp_path / "x.bsdf", {"field": value})


def header(*fields: bytes, count: int | None = None, version: bytes = b"\1\0") -> bytes:
    return MAGIC + version + struct.pack("<I", len(fields) if count is None else count) + b"".join(fields)


def field(name: bytes = b"a", code: int = 1, offset: int = 64, shape: tuple[int, ...] = (4,)) -> bytes:
    layout = f"<H{len(name)}sHBQ{len(shape)}Q"
    return struct.pack(layout, len(name), name, len(shape), code, offset, *shape)


BIG = 1 << 63
MALFORMED = {
    "empty file": (b"", "not a tensor file"),
    "half the magic": (MAGIC[:6], "not a tensor file"),
    "other magic": (b"sensor_file\0" + bytes(200), "not a tensor file"),
    "no version": (MAGIC + b"\1", "cut short"),
    "version 2.0": (header(version=b"\2\0"), "version 2.0"),
    "no count": (MAGIC + b"\1\0\1", "cut short"),
    "too many fields": (header(count=2**32 - 1) + bytes(200), "claims 4294967295 fields"),
    "one field missing": (header(field(), count=2) + b"\1" * 40, "cut short"),
    "name beyond the end": (header(b"\xff\xffabc") + bytes(64), "cut short"),
    "name is not text": (header(field(b"\xff\xfe")) + bytes(64), "not text"),
    "name twice": (header(field(), field()) + bytes(64), "appears twice"),
    "type 0": (header(field(code=0)) + bytes(64), "element type 0"),
    "type 12": (header(field(code=12)) + bytes(64), "element type 12"),
    "65535 dimensions": (header(struct.pack("<H1sHBQ", 1, b"a", 65535, 1, 64)) + bytes(64), "65535 dim"),
    "offset beyond the end": (header(field(offset=BIG)) + bytes(64), "inside the file"),
    "offset in the header": (header(field(offset=0)) + bytes(64), "inside the file"),
    "last element outside": (header(field(offset=105, code=10)) + bytes(80), "inside the file"),
    "2^63 elements": (header(field(shape=(BIG,))) + bytes(64), "more elements"),
    "product overflows to 0": (header(field(shape=(1 << 32, 1 << 32))) + bytes(64), "more elements"),
    "product overflows to 4": (header(field(shape=(BIG + 2, 2))) + bytes(64), "more elements"),
    "empty but huge": (header(field(shape=(0, BIG, BIG))) + bytes(64), "more elements"),
    "overlap": (header(field(b"a", 1, 80, (60,)), field(b"b", 1, 80, (60,))) + bytes(80), "overlap"),
}


@pytest.mark.parametrize("case", MALFORMED)
def test_malformed_container(tmp_path: Path, case):
    data, cause = MALFORMED[case]
    path = tmp_path / "bad.bsdf"
    path.write_bytes(data)
    with pytest.raises(BakeError, match=cause) as caught:
        read_tensor_file(path)
    assert caught.value.file == str(path) and "\n" not in str(caught.value)


def test_container_that_cannot_be_opened(tmp_path: Path):
    huge = tmp_path / "huge.bsdf"
    with huge.open("wb") as stream:
        stream.truncate(MAX_BYTES + 1)
    for path in (tmp_path, tmp_path / "absent.bsdf", tmp_path / "nul\0.bsdf", huge):
        with pytest.raises(BakeError):
            read_tensor_file(path)
