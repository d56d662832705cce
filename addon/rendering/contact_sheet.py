"""Pictures to look at: tone curve, PNG files, labelled contact sheets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...bake.atomic_write import replacing_file
from ...bake.brdf.preview_sphere import to_srgb
from ...bake.errors import BakeError
from ...bake.images.image_io import write_png

Array = NDArray[Any]

_SHOULDER = 0.8  # linear value from which highlights are compressed
_MARGIN, _LINE = 12, 20  # pixels
_BACKGROUND, _INK, _FAINT = (26, 26, 28), (235, 235, 235), (160, 160, 165)


@dataclass(frozen=True)
class Cell:
    """One picture of a sheet: uint8 sRGB or linear float (H, W, 3), row 0 on top, and its caption."""

    pixels: Array
    label: str
    sublabel: str = ""


def to_display(linear: Array, exposure: float = 0.0) -> NDArray[np.uint8]:
    """Linear Rec.709 (..., 3) as sRGB bytes; colours stay exact below 0.8, brighter ones keep their hue.

    The shoulder is that of the Khronos PBR Neutral tone mapper without its offset, which would darken
    measured colours by a supposed Fresnel reflection. Pixels that are not finite become magenta.

    Parameters
    ----------
    exposure : stops
    """
    rgb = np.asarray(linear, np.float32) * np.float32(2.0**exposure)
    broken = ~np.isfinite(rgb).all(axis=-1, keepdims=True)
    rgb = np.where(broken, np.float32(0), np.maximum(rgb, 0))
    peak = rgb.max(axis=-1, keepdims=True)
    room = 1 - _SHOULDER
    excess = np.maximum(peak - _SHOULDER, 0)
    compressed = np.minimum(peak, 1 - room * room / (excess + room))
    rgb = rgb * np.where(excess > 0, compressed / np.maximum(peak, _SHOULDER), 1)
    toward_white = 1 - 1 / (0.15 * (peak - compressed) + 1)
    rgb = rgb + (compressed - rgb) * toward_white
    encoded = np.where(broken, np.array([1, 0, 1], np.float32), to_srgb(rgb))
    return np.rint(255 * encoded).astype(np.uint8)


def write_sheet(path: Path, cells: Sequence[Cell], columns: int, title: str = "") -> None:
    """Lay out cells row by row, each with its label and sublabel beneath, and write a PNG.

    Without Pillow, which Blender does not bring, the sheet has no lettering and a text file beside it
    (`path` with suffix .txt) says what each cell shows.

    Raises
    ------
    ValueError : no cell
    BakeError : a file cannot be written
    """
    if not cells:
        raise ValueError("a sheet needs at least one cell")
    path = Path(path)
    pictures = [c.pixels if c.pixels.dtype == np.uint8 else to_display(c.pixels) for c in cells]
    columns = min(columns, len(cells))
    wide = max(picture.shape[1] for picture in pictures)
    high = max(picture.shape[0] for picture in pictures)
    caption = _LINE * (2 if any(c.sublabel for c in cells) else 1) + 4
    top = _MARGIN + (_LINE + 12 if title else 0)
    rows = -(-len(cells) // columns)
    step_x, step_y = wide + _MARGIN, high + caption + _MARGIN
    sheet = np.empty((top + rows * step_y, _MARGIN + columns * step_x, 3), np.uint8)
    sheet[:] = _BACKGROUND
    corners = [(_MARGIN + k % columns * step_x, top + k // columns * step_y) for k in range(len(cells))]
    for (x, y), picture in zip(corners, pictures):
        sheet[y : y + picture.shape[0], x : x + picture.shape[1]] = picture[..., :3]
    texts = [(_MARGIN, _MARGIN, title, 20, _INK)] if title else []
    for (x, y), cell in zip(corners, cells):
        texts.append((x, y + high + 4, cell.label, 15, _INK))
        texts.append((x, y + high + 4 + _LINE, cell.sublabel, 13, _FAINT))
    lettered = _draw_texts(sheet, texts, wide)
    if lettered is None:
        _write(path.with_suffix(".txt"), _listing(cells, columns, title).encode())
    write_png(path, sheet if lettered is None else lettered)


def _draw_texts(sheet: Array, texts: Sequence[tuple[int, int, str, int, Any]], width: int) -> Array | None:
    """The sheet with its lettering, None without Pillow. Captions too long for a cell are set smaller."""
    try:
        from PIL import Image, ImageDraw, ImageFont
    except ImportError:
        return None
    image = Image.fromarray(sheet)
    draw = ImageDraw.Draw(image)
    for x, y, text, size, ink in texts:
        font = ImageFont.load_default(size)
        room = sheet.shape[1] - x if y < _LINE else width
        while size > 8 and draw.textlength(text, font=font) > room:
            size -= 1
            font = ImageFont.load_default(size)
        draw.text((x, y), text, fill=ink, font=font)
    return np.asarray(image)


def _listing(cells: Sequence[Cell], columns: int, title: str) -> str:
    lines = [title, ""] if title else []
    for k, cell in enumerate(cells):
        note = f" ({cell.sublabel})" if cell.sublabel else ""
        lines.append(f"row {k // columns + 1}, column {k % columns + 1}: {cell.label}{note}")
    return "\n".join(lines) + "\n"


def _write(path: Path, data: bytes) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing_file(path) as temporary:
            temporary.write_bytes(data)
    except OSError as error:
        raise BakeError(path, f"cannot be written ({error.strerror})", "choose another place for it") from error
