"""What is wrong with the photographs once they are read, reported in single lines."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import BakeError
from ..source import Facts
from .development import Counts
from .folder import list_names
from .shifts import Shifts

_CLIPPED_WARNING = 0.05
_CLIPPED_ERROR = 0.9
_OUTSIDE_WARNING = 0.001
_CLOSE_DEG = 4.0
_UNLIKE = 1.5
_BLACK = 1e-20


def judge_brightness(
    origin: Path, names: list[str], images: NDArray[np.float32], counts: list[Counts], warnings: list[str]
) -> dict[str, Any]:
    """Facts about clipping, black and negative values. Raises BakeError where the whole stack is black or clipped."""
    clipped = [count.clipped_share for count in counts]
    if np.mean(clipped) > _CLIPPED_ERROR:
        raise BakeError(origin, f"is clipped in {np.mean(clipped):.0%} of its pixels", "expose more shortly")
    averages = images.mean(axis=(1, 2, 3), dtype=np.float64)
    black = [name for name, average in zip(names, averages) if not average > _BLACK]
    if len(black) == len(names):
        raise BakeError(origin, "is entirely black", "check the exposure and the crop")
    if black:
        warnings.append(f"entirely black: {list_names(black)}")
    warnings += [
        f"{name} is clipped in {share:.0%} of its pixels, which makes highlights too dark"
        for name, share in zip(names, clipped)
        if share > _CLIPPED_WARNING
    ]
    negative = {name: count.negative for name, count in zip(names, counts) if count.negative}
    if negative:
        total = sum(negative.values())
        warnings.append(f"{total} negative values were set to 0 in {list_names(list(negative))}")
    gray = [name for name, count in zip(names, counts) if count.gray and name not in black]
    if 0 < len(gray) < len(names) - len(black):
        told = list_names(gray)
        warnings.append(f"grey photographs among coloured ones (leave them out, or export them in colour): {told}")
    outside = {name: round(count.outside_share, 6) for name, count in zip(names, counts) if count.outside}
    if (most := max(outside.values(), default=0.0)) > _OUTSIDE_WARNING:
        told = list_names([name for name, share in outside.items() if share > _OUTSIDE_WARNING])
        warnings.append(f"up to {most:.1%} of the values lie outside Rec.709's colours and were set to 0 in {told}")
    return {
        "clipped_share": [round(share, 6) for share in clipped],
        "negative_values": negative,
        "without_color": gray if len(gray) < len(names) - len(black) else [],
        "outside_rec709_share": outside,
    }


def judge_elevations(images: NDArray[np.float32], directions: NDArray[np.float64]) -> list[str]:
    """A warning where brightness differs as no surface does between lights that stand so close together.

    That is how angles in another unit, or lights of another scale of z, show.
    """
    averages = images.mean(axis=(1, 2, 3), dtype=np.float64)
    elevations = np.degrees(np.arcsin(np.clip(directions[:, 2], -1, 1)))
    low, high = float(elevations.min()), float(elevations.max())
    together = float(np.degrees(np.arccos(np.clip((directions @ directions.T).min(), -1, 1))))
    if together > _CLOSE_DEG or not averages.min() > 0 or averages.max() < _UNLIKE * averages.min():
        return []
    return [
        f"brightness goes from {averages.min() / averages.max():.0%} to 100 % between elevations of {low:.3g} to "
        f"{high:.3g} degrees: check the lights' units"
    ]


def shift_report(names: list[str], found: Shifts, corrects: bool, warnings: list[str]) -> Facts:
    """Facts about the camera's movement, texels; what moved is reported in a warning."""
    near = found.moved & ~found.too_far
    if near.any():
        size = np.hypot(*found.displacement[near].T).max()
        done = "moved back" if corrects else "not corrected"
        moved = list_names([names[k] for k in np.flatnonzero(near)])
        warnings.append(f"the camera moved by up to {size:.2f} texels, {done}: {moved}")
    for k in np.flatnonzero(found.too_far):
        x, y = found.displacement[k]
        warnings.append(f"{names[k]} is displaced by {x:.0f}, {y:.0f} texels, too far to correct: take it again or out")
    return {
        "displacement": [
            None if np.isnan(x) else [round(float(x), 3), round(float(y), 3)] for x, y in found.displacement
        ],
        "uncertainty": [None if np.isnan(value) else round(float(value), 3) for value in found.uncertain],
        "corrected": [bool(value) and corrects for value in near],
        "unmeasured": [name for name, shift in zip(names, found.displacement) if np.isnan(shift[0])],
    }
