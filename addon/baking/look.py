"""A look at photographs before they are baked: small pictures, brightness against elevation, and what is doubtful."""

from __future__ import annotations

import base64
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...bake.brdf.preview_sphere import to_srgb
from ...bake.photographs.settings import StackSettings
from ...bake.photographs.stack import PhotoStack, read_stack

# Texels of the longer side of what is looked at, and of the small pictures.
_LOOKED_AT, _SMALL = 256, 64
_FEW = 5
# Where one photograph is darker than the one under a lower light by more than this, the order is doubtful.
_DARKER = 0.9


@dataclass(frozen=True)
class Look:
    """Photographs in the order of elevation, or of brightness where that is not known.

    Parameters
    ----------
    names : of the files
    elevations : degrees; None where they are not known
    brightness : mean of each, in parts of the brightest
    pictures : (n, H, W, 3) uint8, sRGB, row 0 at the top
    doubts : what speaks against a bake, in whole sentences
    """

    names: tuple[str, ...]
    elevations: tuple[float, ...] | None
    brightness: tuple[float, ...]
    pictures: NDArray[np.uint8]
    doubts: tuple[str, ...]

    def as_event(self) -> dict[str, Any]:
        """JSON-ready."""
        return {
            "names": self.names,
            "elevations": self.elevations,
            "brightness": self.brightness,
            "shape": self.pictures.shape,
            "pictures": base64.b64encode(self.pictures.tobytes()).decode(),
            "doubts": self.doubts,
        }

    @classmethod
    def of_event(cls, event: dict[str, Any]) -> Look:
        """Undo `as_event`."""
        pixels = np.frombuffer(base64.b64decode(event["pictures"]), np.uint8).reshape(event["shape"])
        elevations = None if event["elevations"] is None else tuple(event["elevations"])
        return cls(tuple(event["names"]), elevations, tuple(event["brightness"]), pixels, tuple(event["doubts"]))


def look_at(
    source: Path | Sequence[Path],
    settings: StackSettings,
    progress: Callable[[str, float], None] | None = None,
    decoder: Any = None,
) -> Look:
    """Read photographs as a bake would, but small. Raises BakeError where a bake would."""
    size = min(settings.size or _LOOKED_AT, _LOOKED_AT)
    return look_of(read_stack(source, replace(settings, size=size), progress, decoder))


def look_of(stack: PhotoStack) -> Look:
    """The look at photographs that have been read."""
    averages = stack.images.mean(axis=(1, 2, 3), dtype=np.float64)
    elevations = None
    if stack.directions is not None:
        elevations = np.degrees(np.arcsin(np.clip(stack.directions[:, 2], -1, 1)))
    order = np.argsort(averages if elevations is None else elevations, kind="stable")
    step = max(1, -(-max(stack.images.shape[1:3]) // _SMALL))
    small = stack.images[order, ::step, ::step]
    # As bright as a photograph would be that shows the brightest of them well.
    shown = small / max(float(np.quantile(small, 0.99)), 1e-30)
    return Look(
        tuple(stack.names[k] for k in order),
        None if elevations is None else tuple(round(float(e), 1) for e in elevations[order]),
        tuple(round(float(a), 4) for a in averages[order] / averages.max()),
        np.rint(255 * to_srgb(np.broadcast_to(shown, (*shown.shape[:3], 3)).astype(np.float64))).astype(np.uint8),
        (*_doubts(elevations, averages), *(sentence(words) for words in stack.warnings)),
    )


def _doubts(elevations: NDArray[np.float64] | None, averages: NDArray[np.float64]) -> list[str]:
    """What the numbers themselves say."""
    if elevations is None:
        return [
            "There is no file of lights, and the file names hold no angles: the photographs are put in order by their "
            "brightness, and the base reflection cannot be fitted."
        ]
    found = []
    different = len(np.unique(np.round(elevations)))
    if different < _FEW:
        found.append(f"There are only {different} elevations of the light; five or more show how the swatch shines.")
    order = np.argsort(elevations, kind="stable")
    falls = averages[order][1:] < _DARKER * averages[order][:-1]
    if falls.any():
        k = int(np.flatnonzero(falls)[0])
        low, high = elevations[order][k : k + 2]
        found.append(
            f"The photograph lit from {high:.0f}° is darker than that from {low:.0f}°: check the elevations, and "
            "that exposure stayed the same."
        )
    return found


def sentence(words: str) -> str:
    """Words of a warning as a whole sentence; one that begins with a file's name stays so."""
    words = words.strip()
    begin = words[:1] if "." in words.split(" ", 1)[0] else words[:1].upper()
    return begin + words[1:] + ("" if words.endswith((".", "!", "?")) else ".")
