"""Photographs made to waste time or memory: what a header claims is not taken at its word."""

from __future__ import annotations

import struct
import tracemalloc
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured_materials.bake.photographs.radiometry.color_marks import read_color_marks
from measured_materials.bake.photographs.radiometry.icc_profile import parse_icc
from measured_materials.bake.photographs.radiometry.primaries import KNOWN, REC709
from measured_materials.bake.photographs.radiometry.tiff_tags import TiffTags, choose_page
from support.color_files import SRGB_ICC, chunk, icc, icc_chunk, write_png

_LARGE = 4 << 20


def test_only_the_first_profile_of_a_png_is_unpacked(tmp_path: Path) -> None:
    """Thousands of small chunks, each of 16 MiB when unpacked, would take hours."""
    profile = icc("first", SRGB_ICC, "srgb")
    bomb = chunk(b"iCCP", b"x\0\0" + zlib.compress(bytes(16 << 20)))
    path = write_png(tmp_path / "a.png", np.zeros((2, 2, 3), np.uint8), icc_chunk(profile), bomb, bomb)
    assert read_color_marks(path).icc == profile


def test_tags_of_a_tiff_that_nobody_asks_for_are_not_loaded(tmp_path: Path) -> None:
    """A previewer's or a maker's block may have any size, and a hostile directory points to one many times."""
    tags = [(256, 4, 1, 30), (257, 4, 1, 20)]
    tags += [(1000 + k, kind, _LARGE // size, 8) for k, (kind, size) in enumerate([(3, 2), (7, 1), (12, 8), (2, 1)])]
    directory = struct.pack("<H", len(tags)) + b"".join(struct.pack("<HHII", *tag) for tag in tags) + bytes(4)
    path = tmp_path / "a.tif"
    path.write_bytes(b"II*\0" + struct.pack("<I", 8) + directory + bytes(_LARGE + 64))
    tracemalloc.start()
    try:
        assert choose_page(path) == (0, "")
        with open(path, "rb") as stream:
            assert TiffTags(stream, 0).page == {256: (30,), 257: (20,)}
        assert tracemalloc.get_traced_memory()[1] < 1 << 20
    finally:
        tracemalloc.stop()


def test_a_profile_with_many_large_tags_takes_no_memory() -> None:
    data = icc("small", SRGB_ICC, "srgb", **{f"x{k:03d}": bytes(_LARGE) for k in range(3)})
    tracemalloc.start()
    try:
        found = parse_icc(data)
        assert tracemalloc.get_traced_memory()[1] < 1 << 20
    finally:
        tracemalloc.stop()
    assert found is not None and found.name == "small" and len(found.curves) == 1


@pytest.mark.parametrize(
    ("space", "sound"),
    [
        *((space, True) for space in KNOWN.values()),
        ((1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1 / 3, 1 / 3), True),
        (REC709[2:4] + REC709[:2] + REC709[4:], True),  # turning the other way
        ((*REC709[:6], 0.60, 0.50), False),
        ((*REC709[:6], 0.0, 1.0), False),
        ((*REC709[6:], *REC709[:6]), False),  # the white first, as some write it
        ((0.64, 0.33) * 3 + (0.3127, 0.3290), False),
    ],
)
def test_primaries_that_mix_no_such_white_are_as_good_as_not_said(space: Any, sound: bool, tmp_path: Path) -> None:
    """They would give a matrix of large and negative numbers, and colours that nobody photographed."""
    path = tmp_path / "a.hdr"
    path.write_bytes(b"#?RADIANCE\nPRIMARIES=" + " ".join(map(str, space)).encode() + b"\n\n-Y 1 +X 1\n")
    assert read_color_marks(path).chromaticities == (space if sound else None)
