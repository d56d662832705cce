"""Images on disk: OpenEXR, Radiance .hdr and 8-bit PNG in and out.

Arrays are (H, W, C) float32 with row 0 at the top of the file and C = 1, 3 or 4. Values pass through bit by
bit: no colour management, no premultiplication by alpha. EXR goes through the Python package OpenEXR (3.3 or
newer) or OpenImageIO, which the Blender of blender.org brings; without either, numpy reads and writes what
bundles hold. .hdr and PNG need numpy alone. PNG data are linear: `read_image` gives the byte / 255 that
Blender sees in Non-Color.
"""

from __future__ import annotations

import importlib
import importlib.machinery
import importlib.util
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..atomic_write import replacing_file
from ..errors import BakeError
from . import exr_writer
from .exr_header import CHANNELS, ExrHeader, read_exr_header
from .png import PngFile, png_bytes
from .radiance_hdr import HdrFile, hdr_bytes
from .storage import BYTE_STEP, Storage, quantize, to_bytes

MAX_IMAGE_BYTES = 1 << 30
_PREFIX = "mmat:"


@dataclass(frozen=True)
class ImageHeader:
    """Declarations of an image file; `attributes` are the strings that `write_image` was given."""

    width: int
    height: int
    channels: int
    storage: Storage
    attributes: Mapping[str, str]


@cache
def load_openexr() -> ModuleType | None:
    """The package OpenEXR with its numpy interface, None where it is absent or older than 3.3."""
    try:
        module = importlib.import_module("OpenEXR")
    except ImportError:
        return None
    return module if hasattr(module, "File") else None


@cache
def load_openimageio() -> ModuleType | None:
    """OpenImageIO as installed, or else the one inside the bpy wheel, which lies off Python's path; or None.

    bpy itself is not imported.
    """
    try:
        return importlib.import_module("OpenImageIO")
    except ImportError:
        pass
    for folder in _wheel_packages():
        spec = importlib.machinery.PathFinder.find_spec("OpenImageIO", [str(folder)])
        if spec is None or spec.loader is None:
            continue
        module = importlib.util.module_from_spec(spec)
        sys.modules["OpenImageIO"] = module
        try:
            spec.loader.exec_module(module)
        except ImportError:
            sys.modules.pop("OpenImageIO", None)
            continue
        return module
    return None


@contextmanager
def same_exr_reader(oiio: ModuleType) -> Iterator[None]:
    """Files opened inside are read by that of OpenImageIO's two OpenEXR readers which Blender chooses at its start.

    The other (of OpenImageIO 2.5.3 and newer, the default in 3.0) refuses luminance-chroma files, so that what can be
    read would depend on whether `bpy` was imported.
    """
    before = oiio.get_int_attribute("openexr:core", 0)
    oiio.attribute("openexr:core", 0)
    try:
        yield
    finally:
        oiio.attribute("openexr:core", before)


def _wheel_packages() -> list[Path]:
    try:
        spec = importlib.util.find_spec("bpy")
    except (ImportError, ValueError):  # blocked, or a stand-in without a spec
        return []
    if spec is None or not spec.origin:
        return []
    root = Path(spec.origin).parent
    patterns = "*/python/lib/python*/site-packages", "*/python/lib/site-packages"  # the latter on Windows
    return sorted(folder for pattern in patterns for folder in root.glob(pattern))


def read_header(path: str | Path, max_bytes: int = MAX_IMAGE_BYTES) -> ImageHeader:
    """Size, channels and storage of an .exr, .hdr or .png, without its pixels. Raises BakeError."""
    path = Path(path)
    try:
        if _is_png(path):
            png = PngFile(path, max_bytes)
            return ImageHeader(png.width, png.height, png.channels, Storage.BYTE, {})
        if _is_hdr(path):
            hdr = HdrFile(path, max_bytes)
            return ImageHeader(hdr.width, hdr.height, 3, Storage.RGBE, {})
        exr = read_exr_header(path, max_bytes)
    except OSError as error:
        raise _unreadable(path, error) from error
    storage = Storage.HALF if exr.half else Storage.FLOAT32
    attributes = {
        name.removeprefix(_PREFIX): value for name, value in exr.attributes.items() if name.startswith(_PREFIX)
    }
    return ImageHeader(exr.width, exr.height, len(exr.channels), storage, attributes)


def read_image(path: str | Path, max_bytes: int = MAX_IMAGE_BYTES) -> NDArray[np.float32]:
    """Pixels of an untrusted .exr, .hdr or .png file, (H, W, C) float32, top row first.

    The header is checked against `max_bytes` and the file's length before memory is taken. Takes one part of
    scan lines with channels R, G, B and A, or a single one of any name; of PNG 8-bit grey, RGB and RGBA, whose
    gamma and profiles are ignored. The EXPOSURE of a foreign .hdr is divided out. Raises BakeError.
    """
    path = Path(path)
    try:
        if _is_png(path):
            return PngFile(path, max_bytes).pixels() * BYTE_STEP
        if _is_hdr(path):
            return HdrFile(path, max_bytes).pixels()
        header = read_exr_header(path, max_bytes)
        pixels = _read_exr(path, header)
    except OSError as error:
        raise _unreadable(path, error) from error
    except MemoryError as error:
        raise BakeError(path, "does not fit into memory", "use a smaller image") from error
    if pixels is None or pixels.shape != (header.height, header.width, len(header.channels)):
        raise BakeError(path, "has damaged or missing pixels", "export it again")
    return np.ascontiguousarray(pixels, np.float32)


def write_image(
    path: str | Path, pixels: NDArray[Any], storage: Storage, attributes: Mapping[str, str] | None = None
) -> None:
    """Write (H, W, C) values so that `read_image` gives back `quantize(pixels, storage)` bit by bit.

    EXR is ZIP-compressed and repeats `attributes` in its header under the prefix "mmat:"; the others have no
    place for them. An older file is replaced only by a complete new one. Raises BakeError.
    """
    path, storage = Path(path), Storage(storage)
    if path.suffix.lower() != storage.suffix:
        raise BakeError(path, f"does not end in {storage.suffix} as {storage} needs", "rename it")
    pixels = np.asarray(pixels)
    if pixels.ndim != 3 or not pixels.size or pixels.shape[2] not in (1, 3, 4):
        raise BakeError(path, f"cannot hold an array of shape {pixels.shape}", "give (H, W, 1, 3 or 4)")
    try:
        values = quantize(pixels, storage)
    except ValueError as error:
        raise BakeError(path, str(error), "choose float32 or fix the values") from error
    try:
        with replacing_file(path) as temporary:
            if storage is Storage.RGBE:
                with open(temporary, "wb") as stream:
                    stream.writelines(hdr_bytes(values))
            elif storage is Storage.BYTE:
                temporary.write_bytes(png_bytes(to_bytes(values)))
            else:
                kept = values.astype(np.float16) if storage is Storage.HALF else values
                _write_exr(temporary, kept, {_PREFIX + k: v for k, v in (attributes or {}).items()})
    except BakeError as error:
        raise BakeError(path, error.cause, error.remedy) from error
    except OSError as error:
        raise _unwritable(path, error) from error


def write_png(path: str | Path, pixels: NDArray[np.uint8] | NDArray[np.uint16], about: str = "") -> None:
    """Write (H, W, 1, 3 or 4) pixels of 8 or 16 bits, as they are to be shown, top row first, making folders.

    Raises BakeError.

    `about` is kept in the file, see `png.png_bytes`.
    """
    path = Path(path)
    fits = pixels.dtype in (np.uint8, np.uint16)
    if not fits or pixels.ndim != 3 or not pixels.size or pixels.shape[2] not in (1, 3, 4):
        cause = f"cannot hold {pixels.dtype} of shape {pixels.shape}"
        raise BakeError(path, cause, "give 8 or 16-bit values of shape (H, W, 1, 3 or 4)")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing_file(path) as temporary:
            temporary.write_bytes(png_bytes(pixels, about))
    except OSError as error:
        raise _unwritable(path, error) from error


def _is_png(path: Path) -> bool:
    return path.suffix.lower() == Storage.BYTE.suffix


def _is_hdr(path: Path) -> bool:
    with open(path, "rb") as stream:
        return stream.read(2) == b"#?"


def _unreadable(path: Path, error: OSError) -> BakeError:
    return BakeError(path, f"cannot be read ({error.strerror or error})", "check that the file exists")


def _unwritable(path: Path, error: OSError) -> BakeError:
    cause = f"cannot be written ({error.strerror or error})"
    return BakeError(path, cause, "check the folder, its permissions and the free space")


def _no_library(path: Path) -> BakeError:
    cause = "this compression needs the Python package OpenEXR or OpenImageIO, and neither is here"
    return BakeError(path, cause, "save it with ZIP compression, or 'pip install OpenEXR'")


def _read_exr(path: Path, header: ExrHeader) -> NDArray[Any] | None:
    if openexr := load_openexr():
        try:
            channels = openexr.File(str(path), separate_channels=True).channels()
            return np.stack([channels[name].pixels for name in header.channels], axis=-1)
        except (RuntimeError, ValueError, KeyError, TypeError):  # what the binding raises on damage
            return None
    oiio = load_openimageio()
    if oiio is None:
        if not exr_writer.can_read(path):
            raise _no_library(path)
        return exr_writer.read_exr(path, header)
    try:
        return _read_with_openimageio(oiio, path, len(header.channels))
    except (RuntimeError, ValueError, TypeError):  # ValueError: also a message that is not UTF-8
        return None


def _read_with_openimageio(oiio: ModuleType, path: Path, channels: int) -> NDArray[Any] | None:
    with same_exr_reader(oiio):
        stream = oiio.ImageInput.open(str(path))
    if stream is None:
        oiio.geterror()  # OpenImageIO prints errors nobody has fetched when the process ends
        return None
    try:
        if stream.format_name() != "openexr":
            return None
        pixels: NDArray[Any] = stream.read_image(0, 0, 0, channels, oiio.FLOAT)
        return None if stream.geterror() else pixels
    finally:
        stream.close()


def _write_exr(path: Path, pixels: NDArray[Any], attributes: Mapping[str, str]) -> None:
    names = CHANNELS[: pixels.shape[2]]
    strings = {k: v.encode("ascii", "backslashreplace").decode() for k, v in attributes.items()}
    if openexr := load_openexr():
        header = {"compression": openexr.ZIP_COMPRESSION, "type": openexr.scanlineimage, **strings}
        planes = {name: np.ascontiguousarray(pixels[..., k]) for k, name in enumerate(names)}
        try:
            openexr.File(header, planes).write(str(path))
        except (RuntimeError, ValueError, TypeError) as error:
            raise OSError(str(error)) from error
        return
    oiio = load_openimageio()
    if oiio is None:
        exr_writer.write_exr(path, pixels, names, strings)
        return
    kind = "half" if pixels.dtype == np.float16 else "float"
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], len(names), kind)
    spec.channelnames = tuple(names)
    # An empty date stands in for the time of day, which would make equal bakes differ.
    for name, value in {"compression": "zip", "DateTime": "", **strings}.items():
        spec.attribute(name, value)
    stream = oiio.ImageOutput.create("openexr")
    if stream is None:
        raise OSError(oiio.geterror())
    good = stream.open(str(path), spec) and stream.write_image(np.ascontiguousarray(pixels))
    good = stream.close() and good
    if message := stream.geterror() or ("" if good else "OpenImageIO gave no reason"):
        raise OSError(message)
