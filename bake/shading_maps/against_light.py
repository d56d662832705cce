"""Photographs of a swatch against the light, as a second stack beside those of what it reflects.

The camera stays where it is and the lamp moves along an arc behind the swatch. What Kautz et al. 2004 do for reflected
light holds for light that is let through as well: at each level r = sigma f_t cos(theta_i) the swatch has a look of its
own, f_t being the transmission of the flat material and theta_i the light's angle to the normal on its own side.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import BakeError, check_setting
from ..photographs.settings import Rectangle, StackSettings
from ..photographs.stack import PhotoStack, read_stack

_PLACE = "photographs against the light"


@dataclass(frozen=True)
class ThroughSettings:
    """Photographs against the light, and what is known of them alone; all else is as of the other stack.

    Parameters
    ----------
    source : their folder, or the photographs
    lights : file of the lights' directions; by default found as for the other stack. They stand behind the swatch,
        whether their elevations are given below the horizon or as angles to the swatch
    transmittance : share of light that the swatch lets through, stated
    diffuser : x, y, width, height in pixels of a diffuser beside the swatch, lit from behind as the swatch is
    diffuser_transmittance : share of light that it lets through
    """

    source: Path | tuple[Path, ...]
    lights: Path | None = None
    transmittance: float | None = None
    diffuser: Rectangle | None = None
    diffuser_transmittance: float = 0.5

    def __post_init__(self) -> None:
        for name in ("transmittance", "diffuser_transmittance"):
            value = getattr(self, name)
            check_setting(name, value is None or 0 < value <= 1, "a number above 0, up to 1", value)
        if self.diffuser is not None and self.transmittance is not None:
            raise BakeError(_PLACE, "have both a diffuser and a transmittance", "give one of them")

    def stack(self, beside: StackSettings) -> StackSettings:
        """How they are read, given how the other stack is."""
        return replace(
            beside,
            lights=self.lights,
            flat_field=None,
            white_card=self.diffuser,
            white_reflectance=self.diffuser_transmittance,
            albedo=self.transmittance,
            behind=True,
        )

    def facts(self) -> dict[str, Any]:
        """JSON-ready; of files the names alone."""
        files = self.source if isinstance(self.source, tuple) else ()
        return {
            "source": files[0].parent.name if isinstance(self.source, tuple) else self.source.name,
            "photographs": len(files) or None,
            "lights": self.lights.name if self.lights else None,
            "transmittance": self.transmittance,
            "diffuser": list(self.diffuser) if self.diffuser else None,
            "diffuser_transmittance": self.diffuser_transmittance,
        }


def read_through(
    settings: ThroughSettings,
    beside: PhotoStack,
    stack: StackSettings,
    progress: Callable[[str, float], None] | None = None,
    decoder: Any = None,
) -> tuple[PhotoStack, PhotoStack]:
    """Both stacks, of one frame: the photographs against the light, read, and those beside them, cut alike.

    Raises
    ------
    BakeError : as `read_stack`, or the two do not show the same frame
    """
    source: Path | Sequence[Path] = settings.source
    through = read_stack(source, settings.stack(stack), progress, decoder)
    return cut_alike(beside, through)


def cut_alike(beside: PhotoStack, through: PhotoStack) -> tuple[PhotoStack, PhotoStack]:
    """The two stacks without the borders that either of them lacks. Raises BakeError where their frames differ."""
    sizes, borders = zip(*(_whole(stack) for stack in (beside, through)), strict=True)
    if sizes[0] != sizes[1]:
        told = " and ".join(f"{width} x {height}" for width, height in sizes)
        remedy = "photograph both with the camera fixed, and crop them alike"
        raise BakeError(_PLACE, f"are of another frame than the others: {told} texels", remedy)
    kept = np.max(borders, 0)
    return _cut(beside, kept - borders[0]), _cut(through, kept - borders[1])


def _whole(stack: PhotoStack) -> tuple[tuple[int, int], NDArray[np.intp]]:
    """Width and height before the border (left, top, right, bottom) was cut off, and the border."""
    border = np.array(stack.facts.get("frame", {}).get("border_cut", (0, 0, 0, 0)), np.intp)
    height, width = stack.images.shape[1:3]
    return (int(width + border[0] + border[2]), int(height + border[1] + border[3])), border


def _cut(stack: PhotoStack, border: NDArray[np.intp]) -> PhotoStack:
    if not border.any():
        return stack
    left, top, right, bottom = border
    height, width = stack.images.shape[1:3]
    return replace(stack, images=np.ascontiguousarray(stack.images[:, top : height - bottom, left : width - right]))
