"""Photographs of a swatch against the light, as a second stack beside those of what it reflects.

The camera stays where it is and the lamp moves along an arc behind the swatch. What Kautz et al. 2004 do for reflected
light holds for light that is let through as well: at each level r = sigma f_t cos(theta_i) the swatch has a look of its
own, f_t being the transmission of the flat material and theta_i the light's angle to the normal on its own side.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import BakeError, check_setting
from ..photographs import shifts
from ..photographs.settings import Rectangle, StackSettings
from ..photographs.stack import PhotoStack, plan_stack, read_planned

STAGE = " against the light"
"""After a stage's name, of the second stack."""
_PLACE = "photographs against the light"


@dataclass(frozen=True)
class ThroughSettings:
    """Photographs against the light, and what is known of them alone; all else is as of the other stack.

    Parameters
    ----------
    source : their folder, or the photographs; a name alone, as a bundle keeps it, is also looked for beside the folder
        of the others
    lights : file of the lights' directions; by default found as for the other stack, and a name alone also beside the
        photographs. They stand behind the swatch, whether their elevations are given below the horizon or as angles to
        the swatch
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
            spheres=(),
            flat_field=None,
            white_card=self.diffuser,
            white_reflectance=self.diffuser_transmittance,
            albedo=self.transmittance,
            behind=True,
        )

    def found(self, beside: Path) -> ThroughSettings:
        """The same with names alone looked for, given the folder of the other photographs. Raises BakeError."""
        if isinstance(self.source, tuple):
            return self
        source = _found(self.source, beside.absolute().parent, _PLACE)
        lights = None if self.lights is None else _found(self.lights, source, "their lights")
        return replace(self, source=source, lights=lights)

    @classmethod
    def told(cls, facts: Mapping[str, Any]) -> ThroughSettings:
        """Undo `facts`. Raises BakeError, TypeError, ValueError or KeyError where they are not as written."""
        diffuser, lights = facts["diffuser"], facts["lights"]
        return cls(
            Path(_name(facts["source"])),
            None if lights is None else Path(_name(lights)),
            facts["transmittance"],
            None if diffuser is None else tuple(diffuser),
            facts["diffuser_transmittance"],
        )

    def facts(self) -> dict[str, Any]:
        """JSON-ready; of files the names alone."""
        files = self.source if isinstance(self.source, tuple) else ()
        return {
            "source": (files[0].parent if isinstance(self.source, tuple) else self.source).resolve().name,
            "photographs": len(files) or None,
            "lights": self.lights.name if self.lights else None,
            "transmittance": self.transmittance,
            "diffuser": list(self.diffuser) if self.diffuser else None,
            "diffuser_transmittance": self.diffuser_transmittance,
        }


def _found(path: Path, folder: Path, what: str) -> Path:
    """A path, or where it is a name alone of nothing here, that in the folder. BakeError if none is there."""
    alone = len(path.parts) == 1
    try:
        for place in (path, folder / path) if alone else (path,):
            if place.exists():
                return place
    except (OSError, ValueError):  # ValueError: a null character in the path
        return path  # whose reader tells more
    cause = f"is neither here nor in {folder}" if alone else "does not exist"
    raise BakeError(path, cause, f"give the path of {what}")


def _name(told: Any) -> str:
    """The last part of a path; ValueError where there is none."""
    if not isinstance(told, str) or Path(told).name in ("", ".."):
        raise ValueError(told)
    return Path(told).name


def read_both(
    source: Path | Sequence[Path],
    stack: StackSettings,
    settings: ThroughSettings,
    progress: Callable[[str, float], None] | None = None,
    decoder: Any = None,
) -> tuple[PhotoStack, PhotoStack]:
    """Photographs and those against the light, of one frame. No pixel is read before the headers of all are.

    Parameters
    ----------
    source, stack : of the photographs of reflected light, as for `read_stack`
    progress : called with the stage and its share done; those of the second stack end in `STAGE`

    Raises
    ------
    BakeError : as `read_stack`, or the two do not show the same frame
    """
    say = progress or (lambda stage, share: None)
    say("reading", 0.0)
    plans = plan_stack(source, stack, decoder), plan_stack(settings.source, settings.stack(stack), decoder)
    _check_frames([(planned.plan.placement.width, planned.plan.placement.height) for planned in plans])
    beside = read_planned(plans[0], progress, decoder)
    through = read_planned(plans[1], lambda stage, share: say(stage + STAGE, share), decoder)
    return aligned(*cut_alike(beside, through), stack.align)


def _check_frames(sizes: Sequence[tuple[int, int]]) -> None:
    """Raise BakeError where the two sizes, whole, are not the same."""
    if sizes[0] != sizes[1]:
        told = " and ".join(f"{width} x {height}" for width, height in sizes)
        remedy = "photograph both with the camera fixed, and crop them alike"
        raise BakeError(_PLACE, f"are of another frame than the others: {told} texels", remedy)


def aligned(beside: PhotoStack, through: PhotoStack, align: str) -> tuple[PhotoStack, PhotoStack]:
    """The two stacks, of one size, with the second moved to where the first shows the swatch, and a warning of that.

    Parameters
    ----------
    align : of `StackSettings`; "warn" only warns, "off" does not look
    """
    if align == "off":
        return beside, through
    found = shifts.between(*(_plainest(stack) for stack in (beside, through)))
    (x, y), moved, far = found.displacement[1], bool(found.moved[1]), bool(found.too_far[1])
    corrects = moved and not far and align == "auto"
    told = {"displacement": None if np.isnan(x) else [round(float(x), 3), round(float(y), 3)], "corrected": corrects}
    through = replace(through, facts={**through.facts, "alignment_to_reflection": told})
    if not moved:
        return beside, through
    done = "too far to correct: take them again" if far else "moved back" if corrects else "not corrected"
    warning = f"the camera moved by {np.hypot(x, y):.2f} texels before these photographs were taken, {done}"
    through = replace(through, warnings=(*through.warnings, warning))
    if not corrects:
        return beside, through
    images, border = shifts.correct(through.images.copy(), found.of_all(1, len(through.images)))
    return _cut(beside, np.array(border)), _framed(through, images, np.array(border))


def _plainest(stack: PhotoStack) -> NDArray[np.float32]:
    """The photograph with the fewest shadows: the lamp highest, or where that is not known the brightest."""
    height = stack.images.mean(axis=(1, 2, 3)) if stack.directions is None else stack.directions[:, 2]
    image: NDArray[np.float32] = stack.images[int(np.argmax(height))]
    return image


def cut_alike(beside: PhotoStack, through: PhotoStack) -> tuple[PhotoStack, PhotoStack]:
    """The two stacks without the borders that either of them lacks. Raises BakeError where their frames differ."""
    sizes, borders = zip(*(_whole(stack) for stack in (beside, through)), strict=True)
    _check_frames(sizes)
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
    images = np.ascontiguousarray(stack.images[:, top : height - bottom, left : width - right])
    return _framed(stack, images, border)


def _framed(stack: PhotoStack, images: NDArray[np.float32], border: NDArray[np.intp]) -> PhotoStack:
    """The stack with images that lack a further border, which its facts tell of."""
    size = [images.shape[2], images.shape[1]]
    frame = {**stack.facts.get("frame", {}), "border_cut": (_whole(stack)[1] + border).tolist(), "size": size}
    return replace(stack, images=images, facts={**stack.facts, "frame": frame})
