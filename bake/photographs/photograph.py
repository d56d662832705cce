"""One photograph: its header and its pixels, read with OpenImageIO, or with numpy alone for EXR and HDR."""

from __future__ import annotations

import math
import stat
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import BakeError
from ..images.image_io import load_openimageio, read_header, read_image, same_exr_reader
from .radiometry.color_marks import NOTHING, ColorMarks, read_color_marks
from .radiometry.tiff_tags import choose_page

MAX_PIXELS = 120_000_000
"""Of one photograph; a header that declares more is refused before memory is taken."""

FLOAT_FORMATS = "openexr", "hdr"
FORMATS = ("jpeg", "png", "tiff", *FLOAT_FORMATS)
IMAGE_SUFFIXES = frozenset({".jpg", ".jpeg", ".jpe", ".png", ".tif", ".tiff", ".exr", ".hdr"})
_MAX_CHANNELS = 256
_MAX_PARTS = 64
_ORIENTATIONS = range(1, 9)
_ISO_NAMES = "Exif:PhotographicSensitivity", "Exif:ISOSpeedRatings", "Exif:ISOSpeed"
# What libjpeg reports although every pixel is there.
_HARMLESS = ("extraneous bytes before marker",)


@dataclass(frozen=True)
class Exposure:
    """Exposure as the camera noted it; None where it noted nothing."""

    seconds: float | None = None
    f_number: float | None = None
    iso: float | None = None


@dataclass(frozen=True)
class PhotoInfo:
    """Header of a photograph; `channels` counts those of the file, `color` is what it says of its colours.

    `orientation` is the Exif one, 1 to 8. `automatic_white` says that the camera chose the white balance itself.
    `pages` is what to report of files that hold several pictures.
    """

    format: str
    width: int
    height: int
    channels: int = 3
    is_float: bool = False
    color: ColorMarks = NOTHING
    exposure: Exposure = Exposure()
    orientation: int = 1
    automatic_white: bool = False
    pages: str = ""


@dataclass(frozen=True, eq=False)
class Photograph:
    """Header and pixels (H, W, 1 or 3) as stored: uint8 or uint16 codes, or float32; row 0 at the top."""

    info: PhotoInfo
    pixels: NDArray[Any]


Decoder = Callable[[Path], Photograph]


def read_info(path: Path, decoder: Decoder | None = None) -> PhotoInfo:
    """Header of a photograph, checked against `MAX_PIXELS`. Raises BakeError."""
    return _read(path, decoder, pixels=False).info


def read_photograph(path: Path, decoder: Decoder | None = None) -> Photograph:
    """A photograph; `decoder` reads it where neither OpenImageIO nor numpy can. Raises BakeError."""
    return _read(path, decoder, pixels=True)


def _read(path: Path, decoder: Decoder | None, pixels: bool) -> Photograph:
    head = _head(path)
    try:
        page, doubt = choose_page(path) if head[:2] in (b"II", b"MM") else (0, "")
        photo = _opened(path, head, page, decoder, pixels)
        color = read_color_marks(path, page)
    except OSError as error:
        raise BakeError(path, f"cannot be read ({error.strerror or error})", "try again") from error
    return replace(photo, info=replace(photo.info, color=color, pages=doubt or photo.info.pages))


def _opened(path: Path, head: bytes, page: int, decoder: Decoder | None, pixels: bool) -> Photograph:
    try:
        if head.startswith(b"#?"):  # OpenImageIO does not divide the EXPOSURE of an .hdr out
            return _plain(path, "hdr", pixels)
        if oiio := load_openimageio():
            return _with_openimageio(oiio, path, page, pixels)
        if head == b"\x76\x2f\x31\x01":
            return _plain(path, "openexr", pixels)
        if decoder is not None:
            if page:
                cause = f"opens with a small picture, and its photograph is number {page + 1}"
                raise BakeError(path, cause, "save the photograph alone")
            return _decoded(path, decoder)
    except MemoryError as error:
        raise BakeError(path, "does not fit into memory", "use a smaller photograph") from error
    raise BakeError(path, "cannot be read without OpenImageIO, which is not here", "save it as .exr or .hdr")


def _head(path: Path) -> bytes:
    try:
        if not stat.S_ISREG(path.stat().st_mode):  # a pipe would block
            raise BakeError(path, "is not a file", "give photographs or one folder of them")
        with open(path, "rb") as stream:
            head = stream.read(4)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise BakeError(path, f"cannot be read ({reason})", "check that the file exists and may be read") from error
    if not head:
        raise BakeError(path, "is empty", "copy it again from the camera")
    return head


def _check_size(path: Path, width: int, height: int, channels: int) -> None:
    if width < 1 or height < 1 or not 1 <= channels <= _MAX_CHANNELS:
        raise BakeError(path, f"declares {width} x {height} pixels of {channels} channels", "export it again")
    if width * height > MAX_PIXELS:
        cause = f"declares {width} x {height} pixels, more than {MAX_PIXELS / 1e6:g} megapixels"
        raise BakeError(path, cause, "use a smaller photograph")


def _plain(path: Path, kind: str, pixels: bool) -> Photograph:
    header = read_header(path, MAX_PIXELS * 16)
    _check_size(path, header.width, header.height, header.channels)
    info = PhotoInfo(kind, header.width, header.height, header.channels, is_float=True)
    if not pixels:
        return Photograph(info, np.zeros((0, 0, 3), np.float32))
    values = read_image(path, MAX_PIXELS * 16)
    return Photograph(info, values[..., : 3 if header.channels >= 3 else 1])


def _decoded(path: Path, decoder: Decoder) -> Photograph:
    try:
        photo = decoder(path)
    except BakeError:
        raise
    except (OSError, RuntimeError, ValueError, TypeError) as error:
        raise BakeError(path, f"cannot be read ({_line(error)})", "export it again") from error
    pixels = photo.pixels
    if pixels.ndim != 3 or pixels.dtype not in (np.uint8, np.uint16, np.float32):
        raise BakeError(path, f"was decoded to {pixels.dtype} of shape {pixels.shape}", "export it again")
    _check_size(path, pixels.shape[1], pixels.shape[0], pixels.shape[2])
    return Photograph(photo.info, pixels[..., : 3 if pixels.shape[2] >= 3 else 1])


def _with_openimageio(oiio: ModuleType, path: Path, page: int, pixels: bool) -> Photograph:
    try:
        hints = oiio.ImageSpec()
        hints.attribute("oiio:UnassociatedAlpha", 1)  # else colours come multiplied by alpha
        with same_exr_reader(oiio):
            stream = oiio.ImageInput.open(str(path), hints)
        if stream is None:
            raise BakeError(path, f"is not an image ({_line(oiio.geterror())})", "export it again or take it out")
        try:
            first, told = stream.spec(), ""
            if stream.format_name() == "openexr":
                page, told = _exr_part(stream)
            if page and not stream.seek_subimage(page, 0):
                raise BakeError(path, f"has a damaged page {page + 1}", "export it again")
            spec = stream.spec()
            _check_size(path, spec.width, spec.height, spec.nchannels)
            info = replace(_info(path, stream.format_name(), spec, first), pages=told)
            values = _pixels(oiio, path, stream, spec, page) if pixels else np.zeros((0, 0, 3), np.uint8)
        finally:
            stream.close()
    except (RuntimeError, ValueError, TypeError) as error:  # ValueError: also a message that is not UTF-8
        raise BakeError(path, f"cannot be read ({_line(error)})", "export it again") from error
    return Photograph(info, values)


def _exr_part(stream: Any) -> tuple[int, str]:
    """The first part of an OpenEXR file that holds colours, and what to report of the others."""
    kinds: list[bool] = []
    while len(kinds) < _MAX_PARTS and stream.seek_subimage(len(kinds), 0):
        kinds.append(bool(_colors_among(stream.spec().channelnames)))
    stream.geterror()  # that there is no further part
    stream.seek_subimage(0, 0)
    if len(kinds) < 2:
        return 0, ""
    return kinds.index(True) if any(kinds) else 0, "files hold several parts, the first with colours is read"


def _line(message: object) -> str:
    """First line of a library's message without the path, which the error names already."""
    text = str(message).strip().splitlines()
    return text[0].split(' ("')[0][:120] if text else "no reason given"


def _pixels(oiio: ModuleType, path: Path, stream: Any, spec: Any, page: int) -> NDArray[Any]:
    chosen = _color_channels(path, stream.format_name(), spec.channelnames)
    kind = spec.format.basetype
    if kind in (oiio.UINT8, oiio.UINT16):
        wanted = kind
    elif kind in (oiio.HALF, oiio.FLOAT, oiio.DOUBLE):
        wanted = oiio.FLOAT
    else:
        raise BakeError(path, f"holds {spec.format} values", "export it with 8 or 16 bits or as floating point")
    first, last = min(chosen), max(chosen) + 1
    values = stream.read_image(page, 0, first, last, wanted)
    message = stream.geterror()
    if values is None or (message and not any(harmless in message for harmless in _HARMLESS)):
        raise BakeError(path, f"is damaged or cut short ({_line(message)})", "copy it again from the camera")
    values = np.asarray(values)
    if values.ndim == 2:
        values = values[..., None]
    if values.shape != (spec.height, spec.width, last - first):
        raise BakeError(path, "has damaged or missing pixels", "copy it again from the camera")
    picked = [channel - first for channel in chosen]
    return values if picked == list(range(last - first)) else values[..., picked]


def _color_channels(path: Path, kind: str, names: tuple[str, ...]) -> list[int]:
    if kind != "openexr":
        return [0, 1, 2] if len(names) >= 3 else [0]
    if found := _colors_among(names):
        return found
    raise BakeError(path, f"has channels {', '.join(names[:8])}, not R, G and B", "export its colour as R, G, B")


def _colors_among(names: tuple[str, ...]) -> list[int]:
    """Places of the channels R, G, B of the first layer that has them, or X, Y, Z, or one of brightness; or none."""
    if len(names) == 1:
        return [0]
    upper = [name.upper() for name in names]
    for layer in dict.fromkeys(name.rpartition(".")[0] for name in upper):
        wanted = [f"{layer}.{c}" if layer else c for c in "RGB"]
        if all(name in upper for name in wanted):
            return [upper.index(name) for name in wanted]
    if all(name in upper for name in "XYZ"):
        return [upper.index(name) for name in "XYZ"]
    return [upper.index("Y")] if "Y" in upper else []


def _info(path: Path, kind: str, spec: Any, first: Any) -> PhotoInfo:
    """Of a page; what the camera noted may stand on the first page alone."""
    if kind not in FORMATS:
        raise BakeError(path, f"holds the format {kind}", "export it as JPEG, PNG, TIFF, EXR or HDR")

    def noted(name: str) -> float | None:
        return _positive(spec, name) or _positive(first, name)

    orientation = noted("Orientation")
    iso = next((value for name in _ISO_NAMES if (value := noted(name))), None)
    return PhotoInfo(
        format=kind,
        width=spec.width,
        height=spec.height,
        channels=spec.nchannels,
        is_float=str(spec.format) in ("half", "float", "double"),
        exposure=Exposure(noted("ExposureTime"), noted("FNumber"), iso),
        orientation=int(orientation) if orientation and orientation in _ORIENTATIONS else 1,
        automatic_white=spec.getattribute("Exif:WhiteBalance") == 0,
    )


def _positive(spec: Any, name: str) -> float | None:
    value = spec.getattribute(name)
    if isinstance(value, tuple | list) and value:
        value = value[0]
    if not isinstance(value, int | float) or not math.isfinite(value) or value <= 0:
        return None
    return float(value)
