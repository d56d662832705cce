"""From the numbers in a photograph's file to linear light.

8 and 16-bit files follow a transfer function. Which one is a convention, not a measurement: a camera's JPEG adds a
tone curve of its own that no maker publishes, so decoding it as sRGB is an assumption, and is reported as one.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import BakeError
from .photograph import FLOAT_FORMATS, PhotoInfo

_GAMMA = re.compile(r"gamma[: ]?(\d+(?:\.\d+)?)", re.IGNORECASE)
_CODED_GAMMA = re.compile(r"g(\d)(\d)(?:_.*)?")


@dataclass(frozen=True)
class Response:
    """A transfer function: `name` is "linear", "srgb" or "gamma:2.2"."""

    name: str
    gamma: float = 1.0

    def linear(self, values: NDArray[Any]) -> NDArray[np.float32]:
        """Linear light of encoded values, 1 being full scale, any shape; negative values pass mirrored."""
        if self.name == "linear":
            return np.asarray(values, np.float32)
        x = np.abs(np.asarray(values, np.float64))
        if self.name == "srgb":  # IEC 61966-2-1
            y = np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)
        else:
            y = x**self.gamma
        return np.copysign(y, values).astype(np.float32)

    def table(self, dtype: np.dtype[Any]) -> NDArray[np.float32]:
        """Linear light of every code of uint8 or uint16, (256,) or (65536,)."""
        levels = np.iinfo(dtype).max
        return self.linear(np.arange(levels + 1, dtype=np.float64) / levels)


LINEAR, SRGB = Response("linear"), Response("srgb")


def parse_rule(rule: str) -> Response | None:
    """The response a user asks for; None is "auto". Raises BakeError."""
    if isinstance(rule, str):
        text = rule.strip().lower()
        if text == "auto":
            return None
        if text in ("srgb", "linear"):
            return Response(text)
        found = _GAMMA.fullmatch(text)
        if found and 0.1 <= (gamma := float(found[1])) <= 10:
            return LINEAR if gamma == 1 else Response(f"gamma:{gamma:g}", gamma)
    cause = f"decode is {rule!r}"
    raise BakeError("photograph settings", cause, "choose auto, srgb, linear or gamma:2.2 (0.1 to 10)")


def choose_response(info: PhotoInfo, rule: str) -> tuple[Response, str]:
    """Response of one photograph and the reason for it, by the rule the user gave."""
    asked = parse_rule(rule)
    if info.format in FLOAT_FORMATS:
        return LINEAR, f"{info.format} holds linear values"
    if asked is not None:
        return asked, "as the user said"
    if info.is_float:
        return LINEAR, "floating-point values are linear"
    name = info.color_space.strip().lower()
    if name in ("linear", "scene_linear") or name.startswith("lin_") or "linear" in info.profile.lower():
        return LINEAR, "the file's metadata says linear"
    found = _CODED_GAMMA.fullmatch(name) or _GAMMA.fullmatch(name)
    if found:
        gamma = float(".".join(found.groups())) if found.re is _CODED_GAMMA else float(found[1])
        if abs(gamma - 1) < 0.01:
            return LINEAR, "the file's metadata says linear"
        if 1 < gamma < 4:
            return Response(f"gamma:{gamma:g}", gamma), f"the file's metadata says gamma {gamma:g}"
    if name.startswith("srgb"):
        return SRGB, f"sRGB by the metadata of the file or the convention of {info.format}"
    return SRGB, "assumed: nothing in the file says otherwise"
