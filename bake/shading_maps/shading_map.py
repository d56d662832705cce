"""From photographs to a shading map: averages, order, slices linear in reflected light (Kautz et al. 2004).

A photograph's average over the swatch is what the flat material reflects; sorted by it, the photographs say how
the mesostructure looks at every level x = r / a_max of reflected light. A shading map holds them resampled to
levels x_i = i / (N - 1), relative to a_max, the largest average; slice 0 is black and slice i has the mean x_i.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ..errors import BakeError
from ..images.bilinear import texels_around

Above = Literal["clamp", "scale"]
ABOVE: tuple[str, ...] = get_args(Above)
MIN_SLICES, MAX_SLICES = 2, 64
# Averages closer than this, relative to the largest, are one level of light: between them there is only noise.
SAME_LEVEL = 1e-4
# Knots, even in the cosine of the light's angle to the normal.
ANGLE_KNOTS = 9
# The smallest number of full precision; what is divided by less would leave float32.
_DARKEST = float(np.finfo(np.float32).tiny)


@dataclass(frozen=True, eq=False)
class ShadingMap:
    """Slices (N, H, W, 3) float32 at levels i / (N - 1) of a_max, relative to a_max; row 0 on top, slice 0 black."""

    slices: NDArray[np.float32]

    @property
    def levels(self) -> NDArray[np.float64]:
        """x of each slice, (N,)."""
        return np.linspace(0.0, 1.0, len(self.slices))

    def evaluate(self, uv: NDArray[Any], x: NDArray[Any], above: Above = "clamp") -> NDArray[np.float64]:
        """Reflected light relative to a_max, linear between texels and slices, periodic in uv.

        Parameters
        ----------
        uv : (..., 2), v upwards; the swatch covers [0, 1]
        x : (...) or (..., 3) for channels that reach different levels; r / a_max, >= 0
        above : beyond x = 1, stay with the last slice or scale it in proportion to x
        """
        x = np.asarray(x, np.float64)
        x = x if x.ndim == np.ndim(uv) else np.repeat(x[..., None], 3, -1)
        position = np.minimum(x, 1.0) * (len(self.slices) - 1)
        base = np.minimum(position.astype(np.intp), len(self.slices) - 2)
        t = position - base
        value = np.zeros(x.shape)
        for index, weight in texels_around(self.slices.shape[1:3], np.asarray(uv, np.float64)):
            for channel in range(3):
                k = base[..., channel]
                low, high = (self.slices[(j, *index)][..., channel] for j in (k, k + 1))
                share = t[..., channel]
                value[..., channel] += weight * ((1 - share) * low + share * high)
        return value * np.maximum(x, 1.0) if above == "scale" else value


@dataclass(frozen=True, eq=False)
class Linearised:
    """A shading map with what it came from: `averages` (n,) as given, `order` (n,) that sorts them, `a_max`."""

    map: ShadingMap
    averages: NDArray[np.float64]
    order: NDArray[np.intp]
    a_max: float


def averages_of(images: NDArray[np.float32]) -> NDArray[np.float64]:
    """Average radiance of each photograph over texels and channels: (n, H, W, 3) to (n,)."""
    # Per row in float32, across rows in float64: as exact as needed and without a second copy of the stack.
    return images.mean(axis=(2, 3), dtype=np.float32).mean(axis=1, dtype=np.float64)


def linearise(images: NDArray[np.float32], slices: int = 8, name: str = "stack") -> Linearised:
    """Photographs (n, H, W, 3) in any order to slices at equal steps of average radiance (Kautz et al. 2004, eq. 1).

    Every slice interpolates the two photographs whose averages bracket its level, black being one of them; read
    literally, the paper's "two nearest" may lie on the same side. Photographs whose averages differ by less than
    `SAME_LEVEL` are merged first.

    Raises
    ------
    BakeError : fewer than two levels of light, or values that are negative, not finite or denormal throughout
    """
    _check_count(slices)
    averages = averages_of(images)
    if not np.isfinite(averages).all() or images.min() < 0:
        raise BakeError(name, "holds values that are negative or not finite", "check the photographs")
    order = np.argsort(averages, kind="stable")
    levels, members = _levels(averages, order)
    if levels[-1] <= 0:
        raise BakeError(name, "is black in every photograph", "expose longer or check that the lamp was on")
    if levels[-1] < _DARKEST:
        raise BakeError(name, f"is too dark, {levels[-1]:.1g} at most", "scale the values; float32 ends at 1e-38")
    if len(levels) < 2:
        cause = f"shows {len(averages)} photograph{'s' if len(averages) > 1 else ''} of the same average brightness"
        raise BakeError(name, cause, "photograph the swatch with the light at several elevations")
    a_max = float(levels[-1])
    result = np.zeros((slices, *images.shape[1:]), np.float32)
    for i in range(1, slices):
        for weight, k in _bracket(levels, a_max * i / (slices - 1)):
            for member in members[k]:
                share = np.float32(weight / (a_max * len(members[k])))
                result[i] += share * images[member]
    return Linearised(ShadingMap(result), averages, order, a_max)


def _check_count(slices: int) -> None:
    if not MIN_SLICES <= slices <= MAX_SLICES:
        raise BakeError("slices", f"cannot be {slices}", f"choose {MIN_SLICES} to {MAX_SLICES}")


def _levels(averages: NDArray[np.float64], order: NDArray[np.intp]) -> tuple[NDArray[np.float64], list[list[int]]]:
    """Distinct averages in rising order, each with the photographs that show it."""
    members: list[list[int]] = []
    for k in order:
        if members and averages[k] - averages[members[-1][0]] <= SAME_LEVEL * averages[order[-1]]:
            members[-1].append(int(k))
        else:
            members.append([int(k)])
    return np.array([averages[group].mean() for group in members]), members


def _bracket(levels: NDArray[np.float64], level: float) -> list[tuple[float, int]]:
    """(weight, photograph) of the one or two that a level lies between; black has no photograph."""
    high = min(int(np.searchsorted(levels, level * (1 - 1e-12))), len(levels) - 1)
    low = levels[high - 1] if high else 0.0
    t = min((level - low) / (levels[high] - low), 1.0)
    return [(t, high)] + ([(1 - t, high - 1)] if high and t < 1 else [])


def held_out_errors(images: NDArray[np.float32], slices: int = 8) -> list[dict[str, float]]:
    """Errors of predicting each photograph by a map made without it, at its own average.

    Photographs that are alone darkest or brightest are left out: without them the map would have to extrapolate.

    Returns
    -------
    per photograph "index", "level" (average / a_max), "rms" of the difference relative to a_max, and "relative",
    the same relative to the photograph's own RMS; ordered by level
    """
    averages = averages_of(images)
    order = np.argsort(averages, kind="stable")
    rows = []
    for place in range(1, len(order) - 1):
        k = int(order[place])
        rest = order[order != k]
        levels, members = _levels(averages[rest], np.arange(len(rest)))
        if levels[-1] <= 0 or len(levels) < 2 or averages[k] > levels[-1]:
            continue
        predicted = _predicted(images, rest, levels, members, slices, averages[k] / levels[-1])
        rms = _rms(predicted - images[k])
        rows.append(
            {
                "index": k,
                "level": float(averages[k] / averages[order[-1]]),
                "rms": rms / float(levels[-1]),
                "relative": rms / max(_rms(images[k]), 1e-30),
            }
        )
    return rows


def _predicted(
    images: NDArray[np.float32],
    rest: NDArray[np.intp],
    levels: NDArray[np.float64],
    members: list[list[int]],
    slices: int,
    x: float,
) -> NDArray[np.float32]:
    """The swatch at level x of a map of `images[rest]`; only the two slices beside it are made."""
    position = x * (slices - 1)
    base = min(int(position), slices - 2)
    result = np.zeros(images.shape[1:], np.float32)
    for i, share in ((base, 1 - (position - base)), (base + 1, position - base)):
        if i == 0 or share == 0:
            continue
        for weight, group in _bracket(levels, levels[-1] * i / (slices - 1)):
            for member in members[group]:
                result += np.float32(share * weight / len(members[group])) * images[rest[member]]
    return result


def at_level(shading_map: ShadingMap, x: float) -> NDArray[np.float32]:
    """The whole swatch at one level x in [0, 1]: (H, W, 3)."""
    position = min(max(x, 0.0), 1.0) * (len(shading_map.slices) - 1)
    base = min(int(position), len(shading_map.slices) - 2)
    t = np.float32(position - base)
    return (1 - t) * shading_map.slices[base] + t * shading_map.slices[base + 1]


def level_by_cosine(directions: NDArray[Any] | None, levels: NDArray[np.float64]) -> list[float]:
    """Level x of the photograph taken with the light at each of `ANGLE_KNOTS` cosines from 0 to 1, for "angular".

    Between the photographs it is interpolated, and from the lowest one down to 0 at the horizon. Without known
    directions the swatch is taken for a Lambertian.
    """
    knots = np.linspace(0, 1, ANGLE_KNOTS)
    if directions is None:
        return knots.tolist()
    cosines = np.clip(directions[:, 2], 0, 1)
    order = np.argsort(cosines, kind="stable")
    x, y = np.concatenate([[0.0], cosines[order]]), np.concatenate([[0.0], levels[order]])
    return np.clip(np.interp(knots, x, y), 0, 1).tolist()


def _rms(difference: NDArray[np.float32]) -> float:
    return float(np.sqrt(np.mean(np.square(difference, dtype=np.float32), dtype=np.float64)))
