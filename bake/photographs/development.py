"""The exposures of one light, decoded to linear light and merged, strip by strip."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import BakeError
from .brackets import merge, trust
from .encoding import Encoding
from .frame import Placement, resample, upright
from .photograph import Photograph
from .settings import Rectangle

CLIPPED = 0.99
"""Share of full scale from which on an 8 or 16-bit value counts as clipped; JPEG ripples a little below it."""
_GRAY = 1e-4
"""Of the brightest value; channels that differ by less everywhere, which is rounding, hold no colour."""
LARGEST_VALUE = 1e30
"""Above anything a photograph can mean; sums of such values would leave float32."""


@dataclass
class Counts:
    """Pixels seen, clipped in every exposure, negative channel values set to 0; the same of texels after conversion."""

    pixels: int = 0
    clipped: int = 0
    negative: int = 0
    texels: int = 0
    outside: int = 0
    gray: bool = False

    @property
    def clipped_share(self) -> float:
        """Share of the pixels that are clipped in every exposure."""
        return self.clipped / max(self.pixels, 1)

    @property
    def outside_share(self) -> float:
        """Share of the texels' values that lie outside Rec.709."""
        return self.outside / max(self.texels, 1)


@dataclass
class Development:
    """Photographs of one light, of one size, with their encodings and relative exposures."""

    paths: list[Path]
    photographs: list[Photograph]
    encodings: list[Encoding]
    exposures: list[float]
    turn_upright: bool = True
    counts: Counts = field(default_factory=Counts)

    def __post_init__(self) -> None:
        self._pixels = [
            upright(photo.pixels, photo.info.orientation if self.turn_upright else 1) for photo in self.photographs
        ]
        self._tables = [
            []
            if pixels.dtype == np.float32
            else [table / np.float32(exposure) for table in encoding.tables(pixels.dtype)]
            for pixels, encoding, exposure in zip(self._pixels, self.encodings, self.exposures)
        ]
        self._full = [_clipping_level(pixels) for pixels in self._pixels]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the frame, upright."""
        return self._pixels[0].shape[1], self._pixels[0].shape[0]

    def swatch(self, placement: Placement) -> NDArray[np.float32]:
        """Linear values (height, width, 3), exposure divided out; fills `counts`. Raises BakeError on NaN."""
        x, y, width, _ = placement.region
        image = resample(lambda start, stop: self._strip((x, y + start, width, stop - start), self.counts), placement)
        self.counts.gray = bool(np.ptp(image, axis=-1).max() <= _GRAY * float(np.abs(image).max()))
        outside = image < 0  # beyond what Rec.709's primaries can mix; the average over a texel may still lie inside
        self.counts.texels += outside.size
        self.counts.outside += int(outside.sum())
        return np.maximum(image, 0, out=image)

    def mean(self, region: Rectangle) -> tuple[NDArray[np.float64], float]:
        """Mean (3,) over a rectangle of the frame, and the share of it that is clipped. Raises BakeError."""
        x, y, width, height = region
        counts, total = Counts(), np.zeros(3)
        step = max(1, (1 << 20) // width)
        for start in range(0, height, step):
            strip = self._strip((x, y + start, width, min(step, height - start)), counts)
            total += strip.sum(axis=(0, 1), dtype=np.float64)
        return total / (width * height), counts.clipped_share

    def check_repeats(self, region: Rectangle) -> None:
        """Raises BakeError where photographs of one light and exposure differ in brightness."""
        x, y, width, height = region
        means = []
        for k in range(len(self.photographs)):
            step = max(1, int((width * height / 1e5) ** 0.5))
            means.append(float(self._linear(k, (x, y, width, height), Counts(), step).mean(dtype=np.float64)))
        if max(means) > 1.15 * min(means) + 1e-6:
            brightest = self.paths[int(np.argmax(means))].name
            cause = f"is lit as {brightest} and exposed alike, but is darker"
            raise BakeError(
                self.paths[int(np.argmin(means))], cause, "name brackets _ev-2, _ev0, or correct the lights"
            )

    def _strip(self, region: Rectangle, counts: Counts) -> NDArray[np.float32]:
        parts = [self._linear(k, region, counts) for k in range(len(self.photographs))]
        clipped = [self._clipped(k, region) for k in range(len(parts))]
        counts.pixels += clipped[0].size
        counts.clipped += int(np.logical_and.reduce(clipped).sum())
        if len(parts) == 1:
            values = parts[0]
        else:
            weights = [
                trust(self._codes(k, region), self.exposures[k], self._full[k]) * ~clipped[k] for k in range(len(parts))
            ]
            values = merge(parts, weights, self.exposures)
        return values

    def _linear(self, k: int, region: Rectangle, counts: Counts, step: int = 1) -> NDArray[np.float32]:
        pixels, tables = self._cut(k, region)[::step, ::step], self._tables[k]
        if not tables:
            values = self._floats(k, pixels, counts)
        elif len(tables) == 1 or pixels.shape[-1] == 1:
            values = tables[0].take(pixels)
        else:
            values = np.stack([table.take(pixels[..., channel]) for channel, table in enumerate(tables)], axis=-1)
        matrix = self.encodings[k].matrix
        if values.shape[-1] == 1:  # grey, which all primaries share
            return np.repeat(values, 3, axis=-1)
        return values if matrix is None else values @ matrix.T.astype(np.float32)

    def _floats(self, k: int, pixels: NDArray[Any], counts: Counts) -> NDArray[np.float32]:
        values = self.encodings[k].linear(pixels)
        if not np.isfinite(values).all():
            raise BakeError(self.paths[k], "holds values that are not finite (NaN or infinite)", "export it again")
        negative = int((values < 0).sum())
        if negative and self.encodings[k].matrix is None:
            counts.negative += negative
            values = np.maximum(values, 0)
        with np.errstate(over="ignore"):
            values = values / np.float32(self.exposures[k])
        if values.size and not float(values.max()) < LARGEST_VALUE:
            raise BakeError(self.paths[k], f"holds values above {LARGEST_VALUE:g}", "export it again")
        return values

    def _clipped(self, k: int, region: Rectangle) -> NDArray[np.bool_]:
        pixels = self._cut(k, region)
        full: Any = self._full[k]
        if pixels.dtype != np.float32:
            full = pixels.dtype.type(np.ceil(full * np.iinfo(pixels.dtype).max))
        reached = pixels[..., 0] >= full
        for channel in range(1, pixels.shape[-1]):
            reached |= pixels[..., channel] >= full
        return reached

    def _codes(self, k: int, region: Rectangle) -> NDArray[np.float32]:
        pixels = self._cut(k, region)
        if pixels.dtype == np.float32:
            return pixels
        return pixels.astype(np.float32) / np.float32(np.iinfo(pixels.dtype).max)

    def _cut(self, k: int, region: Rectangle) -> NDArray[Any]:
        x, y, width, height = region
        return self._pixels[k][y : y + height, x : x + width]


def _clipping_level(pixels: NDArray[Any]) -> float:
    """Encoded value from which on a pixel counts as clipped; floating-point files clip only at a plateau of 1."""
    if pixels.dtype != np.float32:
        return CLIPPED
    with np.errstate(invalid="ignore"):
        if pixels.max() == 1 and 0.001 < float((pixels == 1).mean()) < 0.999:
            return 1.0
    return float("inf")
