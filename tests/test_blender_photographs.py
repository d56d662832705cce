"""Photographs read by Blender itself, against OpenImageIO; damaged headers."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
from measured_materials.addon.photographs.blender_decoder import decode
from measured_materials.addon.photographs.image_headers import read_photo_header
from measured_materials.bake.errors import BakeError
from measured_materials.bake.images.image_io import load_openimageio
from measured_materials.bake.photographs import photograph
from measured_materials.bake.photographs.stack import read_stack
from support.stacks import png_declaring, write_stack


def photographs(folder: Path) -> list[Path]:
    """Of every format and depth, with and without alpha."""
    oiio = load_openimageio()
    rng = np.random.default_rng(1)
    exposure = {"ExposureTime": 0.02, "FNumber": 5.6, "Orientation": 6}
    made = []
    for suffix, kinds in ((".png", ("uint8", "uint16")), (".tif", ("uint8", "uint16", "float")), (".jpg", ("uint8",))):
        for kind in kinds:
            noted = exposure if suffix != ".png" else {}  # where cameras write none
            for channels in (1, 3) if suffix == ".jpg" else (1, 3, 4):
                path = folder / f"{kind}_{channels}{suffix}"
                values = rng.random((12, 15, channels), dtype=np.float32)
                if kind != "float":
                    values = (values * np.iinfo(kind).max).astype(kind)
                spec = oiio.ImageSpec(15, 12, channels, kind)
                for key, value in noted.items():
                    spec.attribute(key, value)
                stream = oiio.ImageOutput.create(str(path))
                assert stream.open(str(path), spec) and stream.write_image(values) and stream.close()
                made.append(path)
    return made


def test_blender_reads_the_codes_that_are_stored(tmp_path: Path) -> None:
    images = len(bpy.data.images)
    for path in photographs(tmp_path):
        truth, found = photograph.read_photograph(path), decode(path)
        assert found.pixels.dtype == truth.pixels.dtype and np.array_equal(found.pixels, truth.pixels), path.name
        for key in ("format", "width", "height", "channels", "is_float", "orientation"):
            assert getattr(found.info, key) == getattr(truth.info, key), (path.name, key)
        seconds = truth.info.exposure.seconds
        assert found.info.exposure.seconds == (seconds if seconds is None else pytest.approx(seconds)), path.name
    assert len(bpy.data.images) == images


def test_blender_takes_over_where_openimageio_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stack = write_stack(tmp_path / "felt")
    truth = read_stack(stack, decoder=decode).images
    monkeypatch.setattr(photograph, "load_openimageio", lambda: None)
    assert np.array_equal(read_stack(stack, decoder=decode).images, truth)
    with pytest.raises(BakeError, match="without OpenImageIO"):
        read_stack(stack)


def test_damaged_photographs_are_refused_before_blender_sees_them(tmp_path: Path) -> None:
    path = tmp_path / "huge.png"
    path.write_bytes(png_declaring(25000, 20000))
    with pytest.raises(BakeError, match="megapixels"):
        decode(path)
    for original in photographs(tmp_path):
        data = original.read_bytes()
        # A TIFF has its directory at the end, and after that only what it need not have.
        for length in (0, 1, 9, 20, len(data) // 3, *((len(data) - 13,) if original.suffix != ".tif" else ())):
            cut = tmp_path / f"cut{original.suffix}"
            cut.write_bytes(data[:length])
            with pytest.raises(BakeError):
                decode(cut)
    rng = np.random.default_rng(0)
    for original in photographs(tmp_path):
        data = bytearray(original.read_bytes())
        for _ in range(40):
            data[rng.integers(min(len(data), 400))] = rng.integers(256)
            original.write_bytes(bytes(data))
            try:
                read_photo_header(original)
            except BakeError:
                pass


def test_text_is_no_photograph(tmp_path: Path) -> None:
    (tmp_path / "notes.jpg").write_text("not a photograph")
    with pytest.raises(BakeError, match="not an image"):
        decode(tmp_path / "notes.jpg")
