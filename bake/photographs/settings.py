"""What an artist may say about a stack of photographs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ..errors import BakeError
from .light_files.spheres import LEAST_RADIUS, Sphere
from .radiometry.response import parse_rule

Rectangle = tuple[int, int, int, int]
Corners = tuple[tuple[float, float], tuple[float, float], tuple[float, float], tuple[float, float]]
ALIGNMENTS = "auto", "warn", "off"
SIDES = "one", "both"
SMALLEST_SIDE = 2
LARGEST_SIDE = 16384


@dataclass(frozen=True)
class StackSettings:
    """Settings of `read_stack`; pixels count from the upper left corner of the photograph as a viewer shows it.

    Parameters
    ----------
    size : texels of the longer side after resizing by area average, never enlarging; None keeps the photographs' size
    decode : "auto", "srgb", "linear" or "gamma:2.2"; what the numbers of JPEG, PNG and TIFF files mean
    lights : lights.csv or .lp; None looks into the folder, then into the file names
    azimuth : keep the lights near the vertical plane through this azimuth (degrees, 0 = right, 90 = up); None
        chooses where the lights cover more than one plane
    spread : how far from that plane a light may lie, degrees
    sides : "one" keeps the lights on the azimuth's side of the swatch and those overhead; "both" also those opposite. A
        map sorts photographs by brightness, and would blend shadows that fall to opposite sides
    crop : x, y, width, height of the swatch
    corners : of the swatch, top left, top right, bottom right, bottom left, to make an oblique view square-on
    flat_field : photograph of an evenly white board under the same light, or a folder of them with the same names
    white_card : x, y, width, height of a diffuse card lying beside the swatch
    white_reflectance : of that card
    albedo : of the swatch as the artist states it, instead of a card
    align : "auto" corrects small movements of the camera, "warn" only reports them, "off" does not look
    spheres : x, y, radius of mirror spheres in the picture, whose highlights tell the directions of the lights
    behind : the lights stand behind the swatch, and card and albedo are a diffuser and a transmittance, as errors and
        warnings call them then

    Raises
    ------
    BakeError : a value that makes no sense
    """

    size: int | None = None
    decode: str = "auto"
    lights: Path | None = None
    azimuth: float | None = None
    spread: float = 20.0
    sides: str = "one"
    crop: Rectangle | None = None
    corners: Corners | None = None
    flat_field: Path | None = None
    white_card: Rectangle | None = None
    white_reflectance: float = 0.9
    albedo: float | None = None
    align: str = "auto"
    behind: bool = False
    spheres: tuple[Sphere, ...] = ()

    def all_around(self) -> StackSettings:
        """The same reading of photographs, with lights of every azimuth."""
        return replace(self, azimuth=None, spread=90.0, sides="both")

    @property
    def card_word(self) -> str:
        """What `white_card` shows."""
        return "diffuser" if self.behind else "white card"

    @property
    def share_word(self) -> str:
        """What `albedo` states."""
        return "transmittance" if self.behind else "albedo"

    def __post_init__(self) -> None:
        def put(name: str, value: Any) -> None:
            object.__setattr__(self, name, value)

        parse_rule(self.decode)
        if self.align not in ALIGNMENTS:
            raise _wrong(f"align is {self.align!r}", f"choose one of {', '.join(ALIGNMENTS)}")
        if self.sides not in SIDES:
            raise _wrong(f"sides is {self.sides!r}", f"choose one of {', '.join(SIDES)}")
        if self.size is not None:
            put("size", _whole("size", self.size, SMALLEST_SIDE, LARGEST_SIDE))
        if self.azimuth is not None:
            put("azimuth", _number("azimuth", self.azimuth, -360, 360))
        put("spread", _number("spread", self.spread, 0.1, 90))
        put("white_reflectance", _share("white_reflectance", self.white_reflectance))
        if self.albedo is not None:
            put("albedo", _share(self.share_word, self.albedo))
        for name, word in (("crop", "crop"), ("white_card", self.card_word)):
            if (value := getattr(self, name)) is not None:
                put(name, _rectangle(word, value))
        if self.corners is not None:
            put("corners", _corners(self.corners))
        for name in ("lights", "flat_field"):
            if (value := getattr(self, name)) is not None:
                put(name, _path(name, value))
        put("spheres", _spheres(self.spheres))
        if self.spheres and self.lights is not None:
            raise _wrong("both a lights file and spheres are given", "give one of them")
        if self.crop and self.corners:
            raise _wrong("both a crop and corners are given", "give one of them")
        if self.white_card and self.albedo is not None:
            article = "a" if self.behind else "an"
            raise _wrong(f"both a {self.card_word} and {article} {self.share_word} are given", "give one of them")


def _wrong(cause: str, remedy: str) -> BakeError:
    return BakeError("photograph settings", cause, remedy)


def _number(name: str, value: Any, low: float, high: float) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not low <= number <= high:
        raise _wrong(f"{name} is {value!r}", f"give a number from {low:g} to {high:g}")
    return number


def _share(name: str, value: Any) -> float:
    share = _number(name, value, 0, 1)
    if share == 0:
        raise _wrong(f"{name} is 0", "give a number above 0, up to 1")
    return share


def _whole(name: str, value: Any, low: int, high: int) -> int:
    number = _number(name, value, low, high)
    if number != int(number):
        raise _wrong(f"{name} is {value!r}", f"give a whole number from {low} to {high}")
    return int(number)


def _items(name: str, value: Any, what: str) -> list[Any]:
    if isinstance(value, str | bytes) or not isinstance(value, Sequence) or len(value) != 4:
        raise _wrong(f"{name} is {value!r}", f"give {what}")
    return list(value)


def _rectangle(name: str, value: Any) -> Rectangle:
    x, y, width, height = _items(name, value, "four whole numbers: x, y, width, height")
    return (
        _whole(f"x of {name}", x, 0, 1 << 24),
        _whole(f"y of {name}", y, 0, 1 << 24),
        _whole(f"width of {name}", width, 1, 1 << 24),
        _whole(f"height of {name}", height, 1, 1 << 24),
    )


def _spheres(value: Any) -> tuple[Sphere, ...]:
    if isinstance(value, str | bytes) or not isinstance(value, Sequence):
        raise _wrong(f"spheres is {value!r}", "give a list of x, y and radius each, in pixels")
    return tuple(_sphere(one) for one in value)


def _sphere(value: Any) -> Sphere:
    if isinstance(value, str | bytes) or not isinstance(value, Sequence) or len(value) != 3:
        raise _wrong(f"a sphere is {value!r}", "give x and y of its centre, and its radius, in pixels")
    return (
        _number("x of a sphere", value[0], 0, 1 << 24),
        _number("y of a sphere", value[1], 0, 1 << 24),
        _number("radius of a sphere", value[2], LEAST_RADIUS, 1 << 24),
    )


def _corners(value: Any) -> Corners:
    points = []
    for point in _items("corners", value, "four points: top left, top right, bottom right, bottom left"):
        if isinstance(point, str | bytes) or not isinstance(point, Sequence) or len(point) != 2:
            raise _wrong(f"a corner is {point!r}", "give x and y")
        points.append(
            (_number("x of a corner", point[0], -1, 1 << 24), _number("y of a corner", point[1], -1, 1 << 24))
        )
    # Walking round clockwise on the screen (y downwards) every turn of a convex frame has a positive cross product.
    for k in range(4):
        (ax, ay), (bx, by), (cx, cy) = points[k], points[(k + 1) % 4], points[(k + 2) % 4]
        lengths = math.hypot(bx - ax, by - ay) * math.hypot(cx - bx, cy - by)
        if (bx - ax) * (cy - by) - (by - ay) * (cx - bx) <= 0.02 * lengths:  # about one degree
            raise _wrong(
                "the corners do not go round a convex quadrilateral",
                "give them in the order top left, top right, bottom right, bottom left",
            )
    return (points[0], points[1], points[2], points[3])


def _path(name: str, value: Any) -> Path:
    try:
        return Path(value)
    except TypeError as error:
        raise _wrong(f"{name} is {value!r}", "give a path") from error
