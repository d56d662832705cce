"""Tables in bytes: 8 bits of each channel's logarithm, interpolated as they are and decoded in the shader.

    value = gain * (exp(range * code) - 1),   code = byte / 255

Code 0 is exactly 0 and code 1 the channel's largest value; far above the gain steps are even in the logarithm, below it
even in the value. The range is that of least measured error, of the values times of their roots: a wide one reaches
darker values with coarser steps.

The image's own filter interpolates codes. What it gives is decoded, and only then are slices blended, so that the mean
over one slice chosen at random is the blend of all. A highlight is closer to a line in its logarithm than in its value:
coarse tables gain more by that than they lose by rounding; those whose error is below about 1 % of the signal, or of
materials without a highlight, do not (`./run bench bytes`, `./run bench cost`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from .. import xp_numpy
from ..errors import BakeError
from ..images.storage import BYTE_STEP
from ..source import Array, Facts

Triple = tuple[float, float, float]

# exp(x) - 1 in float32 has an error of 1e-7: with these ranges at most 3e-5 of a step, without any special form of it.
LEAST_RANGE, MOST_RANGE = 1.0, 24.0
# Between them everything that is computed, the gain included, is an ordinary float32 number.
LEAST_PEAK, MOST_PEAK = 1e-24, 1e37
_COARSE = np.arange(2.0, MOST_RANGE, 2.0)
_FINE = np.array([-1.0, -0.5, 0.5, 1.0])


@dataclass(frozen=True)
class LogCodes:
    """Ranges and gains of the codes of a table, by channel; a gain of 0 where it is black."""

    ranges: Triple
    gains: Triple

    @classmethod
    def reaching(cls, peaks: Array, ranges: Array) -> LogCodes:
        """Code 1 standing for each channel's peak; black where that is below `LEAST_PEAK`.

        Raises BakeError for peaks above `MOST_PEAK`.
        """
        if not (np.asarray(peaks) <= MOST_PEAK).all():
            raise BakeError("storage log", f"cannot hold values above {MOST_PEAK:.6g}", "choose float32")
        gains = np.where(np.asarray(peaks) >= LEAST_PEAK, peaks / np.expm1(ranges), 0)
        return cls(cast(Triple, tuple(map(float, ranges))), cast(Triple, tuple(map(float, gains))))

    @property
    def peaks(self) -> Array:
        """Values that code 1 stands for, (3,)."""
        peaks: Array = np.array(self.gains) * np.expm1(self.ranges)
        return peaks

    def encode(self, values: Array) -> Array:
        """The nearest codes of values (..., 3) >= 0, float32, as they come back from an 8-bit file."""
        gains, ranges = np.array(self.gains, np.float32), np.array(self.ranges, np.float32)
        seen = gains > 0
        codes = np.log1p(values / np.where(seen, gains, 1)) * (seen / ranges)
        rounded: Array = np.rint(np.clip(codes, 0, 1) * np.float32(255)).astype(np.float32) * BYTE_STEP
        return rounded

    def decode(self, xp: Any, codes: Any) -> Any:
        """Values of codes, a vector in numpy or nodes."""
        exponents = xp.components(codes * xp.vec(*self.ranges))
        gains = xp.vec(*self.gains)
        return xp.vec(*map(xp.exp, exponents)) * gains - gains

    def rounded(self, values: Array) -> Array:
        """The float32 values that come back for these."""
        back: Array = self.decode(xp_numpy, self.encode(values).astype(np.float64)).astype(np.float32)
        return back

    def facts(self) -> Facts:
        """JSON-ready."""
        return {"range": list(self.ranges), "gain": list(self.gains)}


def fit_codes(peaks: Array, channel_errors: Callable[[LogCodes], Array]) -> LogCodes:
    """The ranges of least error, of each channel its own.

    Parameters
    ----------
    peaks : (3,), largest value of each channel
    channel_errors : of a choice, (3,)

    Raises BakeError for peaks that cannot be stored.
    """
    best, least = np.full(3, _COARSE[0]), np.full(3, np.inf)

    def attempt(ranges: Array) -> None:
        nonlocal best, least
        ranges = np.clip(ranges, LEAST_RANGE, MOST_RANGE)
        errors = channel_errors(LogCodes.reaching(peaks, ranges))
        best, least = np.where(errors < least, ranges, best), np.minimum(errors, least)

    for wide in _COARSE:
        attempt(np.full(3, wide))
    around = best
    for step in _FINE:
        attempt(around + step)
    return LogCodes.reaching(peaks, best)
