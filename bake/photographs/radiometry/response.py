"""Transfer functions: from the numbers in a photograph's file to linear light."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import BakeError

GAMMA = re.compile(r"gamma[: ]?(\d+(?:\.\d+)?)", re.IGNORECASE)
DIFFUSE_WHITE = 203.0
"""cd/m^2 that a signal of BT.2100 shows for a white surface (ITU-R BT.2408); it becomes 1."""


@dataclass(frozen=True)
class Response:
    """A transfer function: "linear", "srgb", "gamma:2.2", "bt709", "pq", "hlg", or "profile", of an ICC profile.

    `parameters` are g, a, b, c, d, e, f of (a x + b)^g + e from d on, c x + f below; `samples` stand at even distances.
    """

    name: str
    gamma: float = 1.0
    parameters: tuple[float, ...] = ()
    samples: tuple[float, ...] = ()

    def linear(self, values: NDArray[Any]) -> NDArray[np.float32]:
        """Linear light of encoded values, 1 being full scale, any shape; negative values pass mirrored."""
        if self.name == "linear":
            return np.asarray(values, np.float32)
        x = np.abs(np.asarray(values, np.float64))
        return np.copysign(self._decoded(x), values).astype(np.float32)

    def _decoded(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        if self.name == "srgb":  # IEC 61966-2-1
            return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)
        if self.name == "bt709":  # ITU-R BT.709, BT.601 and BT.2020: the camera's curve inverted
            return np.where(x < 0.081, x / 4.5, ((x + 0.099) / 1.099) ** (1 / 0.45))
        if self.name == "pq":
            return _pq(np.minimum(x, 1)) / DIFFUSE_WHITE
        if self.name == "hlg":
            return _hlg(x)
        if self.samples:
            return np.interp(x, np.linspace(0, 1, len(self.samples)), self.samples)
        if self.parameters:
            g, a, b, c, d, e, f = self.parameters
            return np.where(x >= d, np.maximum(a * x + b, 0) ** g + e, c * x + f)
        return x**self.gamma

    def table(self, dtype: np.dtype[Any]) -> NDArray[np.float32]:
        """Linear light of every code of uint8 or uint16, (256,) or (65536,)."""
        levels = np.iinfo(dtype).max
        return self.linear(np.arange(levels + 1, dtype=np.float64) / levels)


LINEAR, SRGB = Response("linear"), Response("srgb")


def _pq(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Luminance in cd/m^2 of the perceptual quantizer, SMPTE ST 2084, ITU-R BT.2100 table 4."""
    m1, m2 = 2610 / 16384, 2523 / 4096 * 128
    c1, c2, c3 = 3424 / 4096, 2413 / 4096 * 32, 2392 / 4096 * 32
    root = x ** (1 / m2)
    return 10_000 * (np.maximum(root - c1, 0) / (c2 - c3 * root)) ** (1 / m1)


def _hlg(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Light of the scene, 1 at its peak, by the inverse of hybrid log-gamma's camera curve, ITU-R BT.2100 table 5."""
    a, b, c = 0.17883277, 0.28466892, 0.55991073
    return np.where(x <= 0.5, x * x / 3, (np.exp((x - c) / a) + b) / 12)


def parse_rule(rule: str) -> Response | None:
    """The response a user asks for; None is "auto". Raises BakeError."""
    if isinstance(rule, str):
        text = rule.strip().lower()
        if text == "auto":
            return None
        if text in ("srgb", "linear"):
            return Response(text)
        found = GAMMA.fullmatch(text)
        if found and 0.1 <= (gamma := float(found[1])) <= 10:
            return LINEAR if gamma == 1 else Response(f"gamma:{gamma:g}", gamma)
    cause = f"decode is {rule!r}"
    raise BakeError("photograph settings", cause, "choose auto, srgb, linear or gamma:2.2 (0.1 to 10)")
