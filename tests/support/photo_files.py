"""Photographs written for tests: any format OpenImageIO writes, with Exif, and headers written byte by byte."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured_materials.bake.images.image_io import load_openimageio

_TYPES = {"uint8": "uint8", "uint16": "uint16", "float32": "float", "float16": "half"}


def write_photo(path: Path, pixels: np.ndarray, channels: tuple[str, ...] = (), **attributes: Any) -> Path:
    """Write (H, W, C) pixels in the format of the suffix; `Exif__ISOSpeed` stands for the name `Exif:ISOSpeed`."""
    oiio = load_openimageio()
    if oiio is None:
        pytest.skip("OpenImageIO is not here")
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], _TYPES[str(pixels.dtype)])
    spec.attribute("CompressionQuality", 100)
    if channels:
        spec.channelnames = channels
    for name, value in attributes.items():
        spec.attribute(name.replace("__", ":"), value)
    stream = oiio.ImageOutput.create(str(path))
    assert stream.open(str(path), spec), stream.geterror()
    assert stream.write_image(np.ascontiguousarray(pixels)), stream.geterror()
    assert stream.close(), stream.geterror()
    return path


def encode_srgb(linear: np.ndarray, dtype: type = np.uint8) -> np.ndarray:
    """Codes of linear values in [0, 1], rounded."""
    x = np.clip(np.asarray(linear, float), 0, 1)
    y = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
    return np.round(y * np.iinfo(dtype).max).astype(dtype)


def gray_frames(values: list[float], shape: tuple[int, int] = (6, 8)) -> list[np.ndarray]:
    """Even frames (H, W, 3) float32."""
    return [np.full((*shape, 3), value, np.float32) for value in values]


def weave(height: int, width: int, seed: int = 3) -> np.ndarray:
    """A surface to align by: smooth noise of about three pixels, (H, W) in 0.2 to 0.8."""
    noise = np.random.default_rng(seed).standard_normal((height, width))
    fy, fx = np.fft.fftfreq(height)[:, None], np.fft.rfftfreq(width)
    smooth = np.fft.irfft2(np.fft.rfft2(noise) * np.exp(-2 * np.pi**2 * 1.5**2 * (fx * fx + fy * fy)), s=noise.shape)
    return 0.5 + 0.1 * np.clip(smooth / smooth.std(), -3, 3)


def _png_chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def png_bytes(width: int, height: int, rows: bytes, gamma: int | None = None) -> bytes:
    """An 8-bit RGB PNG whose header need not agree with its rows; `gamma` is the gAMA number, 100000 = linear."""
    header = _png_chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
    middle = b"" if gamma is None else _png_chunk(b"gAMA", struct.pack(">I", gamma))
    return b"\x89PNG\r\n\x1a\n" + header + middle + _png_chunk(b"IDAT", zlib.compress(rows)) + _png_chunk(b"IEND", b"")


def tiff_bytes(width: int, height: int) -> bytes:
    """A tiny 8-bit RGB TIFF that declares this size."""
    tags = [
        (256, 4, 1, width), (257, 4, 1, height), (258, 3, 1, 8), (259, 3, 1, 1), (262, 3, 1, 2),
        (273, 4, 1, 200), (277, 3, 1, 3), (278, 4, 1, height), (279, 4, 1, 60), (284, 3, 1, 1),
    ]  # fmt: skip
    body = struct.pack("<H", len(tags)) + b"".join(struct.pack("<HHII", *tag) for tag in tags) + struct.pack("<I", 0)
    return (b"II*\0" + struct.pack("<I", 8) + body).ljust(300, b"\0")


def exr_bytes(width: int, height: int) -> bytes:
    """The header of an uncompressed half RGB EXR that declares this size, and no pixels."""

    def attribute(name: bytes, kind: bytes, data: bytes) -> bytes:
        return name + b"\0" + kind + b"\0" + struct.pack("<i", len(data)) + data

    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    channels = b"".join(c + b"\0" + struct.pack("<4i", 1, 0, 1, 1) for c in (b"B", b"G", b"R")) + b"\0"
    return b"".join(
        [
            b"\x76\x2f\x31\x01" + struct.pack("<I", 2),
            attribute(b"channels", b"chlist", channels),
            attribute(b"compression", b"compression", b"\0"),
            attribute(b"dataWindow", b"box2i", window),
            attribute(b"displayWindow", b"box2i", window),
            attribute(b"lineOrder", b"lineOrder", b"\0"),
            attribute(b"pixelAspectRatio", b"float", struct.pack("<f", 1)),
            attribute(b"screenWindowCenter", b"v2f", struct.pack("<2f", 0, 0)),
            attribute(b"screenWindowWidth", b"float", struct.pack("<f", 1)),
            b"\0" * 64,
        ]
    )


def jpeg_with_size(data: bytes, width: int, height: int) -> bytes:
    """A baseline JPEG whose frame header declares another size."""
    place = data.index(b"\xff\xc0") + 5
    return data[:place] + struct.pack(">HH", height, width) + data[place + 4 :]
