"""Small stacks of photographs on the disk, made of formulas."""

from __future__ import annotations

import math
import struct
import zlib
from pathlib import Path

import numpy as np
from measured_materials.bake.brdf.preview_sphere import to_srgb
from measured_materials.bake.images.image_io import write_image, write_png
from measured_materials.bake.images.storage import Storage

ELEVATIONS = (15, 35, 55, 75, 90)


def frame(elevation: float, size: tuple[int, int] = (20, 16), seed: int = 0) -> np.ndarray:
    """(H, W, 3) linear: a Lambertian of bumps that come forward under low light, in proportion to the sine."""
    width, height = size
    rng = np.random.default_rng(seed)
    k, exponent = rng.uniform(0.3, 0.9, (height, width, 3)), rng.uniform(0.7, 1.5, (height, width, 3))
    return k * math.sin(math.radians(elevation)) ** exponent


def write_stack(
    folder: Path, elevations: tuple[float, ...] = ELEVATIONS, size: tuple[int, int] = (20, 16), suffix: str = ".png"
) -> Path:
    """Photographs named by their elevation, PNG in sRGB or EXR in linear light."""
    folder.mkdir(parents=True, exist_ok=True)
    for elevation in elevations:
        write_frame(folder / f"el{elevation:02.0f}{suffix}", frame(elevation, size))
    return folder


def write_frame(path: Path, linear: np.ndarray) -> None:
    """One photograph."""
    if path.suffix == ".exr":
        write_image(path, linear, Storage.FLOAT32)
    else:
        write_png(path, np.rint(to_srgb(linear) * 255).astype(np.uint8))


def png_declaring(width: int, height: int) -> bytes:
    """A PNG of a few bytes whose header states any size."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(bytes(100))) + chunk(b"IEND", b"")
    )


def warnings_in(text: str) -> list[str]:
    """Lines of the error stream that warn."""
    return [line for line in text.splitlines() if line.startswith("measured_materials: warning: ")]


def complaints_in(text: str) -> list[str]:
    """Lines of the error stream that report a failure."""
    told = [line for line in text.splitlines() if line.startswith("measured_materials: ")]
    return [line for line in told if line not in warnings_in(text)]
