"""Exposures of the photographs, and the merging of several exposures under one light."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import BakeError
from ..source import Facts
from .folder import list_names
from .photograph import Exposure, PhotoInfo

_EV = re.compile(r"[_ -]ev[_ ]?([-+]?\d+(?:\.\d+)?)$", re.IGNORECASE)
_NUMBERED = re.compile(r"[_ -](?:b|bracket)[_ -]?\d+$", re.IGNORECASE)
_SAME_LIGHT = 1e-4
_SAME_EXPOSURE = 0.01


@dataclass(frozen=True)
class Exposures:
    """Relative exposure of every photograph (the first has 1), how it was found, in words."""

    relative: list[float]
    rule: str


def bracket_stem(stem: str) -> str:
    """Stem of a file name without the mark of its exposure (`_ev-2`, `_b1`)."""
    return _NUMBERED.sub("", _EV.sub("", stem))


def group_by_light(paths: list[Path], directions: NDArray[np.float64] | None) -> list[list[int]]:
    """Indices of photographs of the same light, in order: equal directions, or equal stems up to an exposure mark."""
    groups: list[list[int]] = []
    for index, path in enumerate(paths):
        for group in groups:
            if directions is not None:
                same = bool(np.linalg.norm(directions[index] - directions[group[0]]) < _SAME_LIGHT)
            else:
                first = paths[group[0]]
                same = first.parent == path.parent and bracket_stem(first.stem) == bracket_stem(path.stem)
            if same:
                group.append(index)
                break
        else:
            groups.append([index])
    return groups


def find_exposures(paths: list[Path], infos: list[PhotoInfo], groups: list[list[int]]) -> Exposures:
    """Relative exposures t ISO / N^2 from Exif, or 2^EV from the names where Exif does not distinguish a bracket.

    Raises BakeError where a quantity is noted in some photographs only and differs there, or where a name marks a
    bracket whose exposure is not to be found.
    """
    noted = _noted(paths, infos)
    values = [float(found[1]) if (found := _EV.search(path.stem)) else None for path in paths]
    told = all(_differ([noted[k] for k in group]) for group in groups if len(group) > 1)
    if any(value is not None for value in values) and not (told and _differ(noted)):
        if any(value is not None and abs(value) > 30 for value in values):
            raise BakeError(paths[0].parent, "a file name holds an exposure beyond 30 EV", "correct the names")
        relative = [2.0 ** (value or 0.0) * factor for value, factor in zip(values, noted)]
        return Exposures([value / relative[0] for value in relative], "EV in the file names")
    for group in groups:
        if len(group) > 1 and not _differ([noted[k] for k in group]):
            marked = [paths[k].name for k in group if _NUMBERED.search(paths[k].stem)]
            if marked:
                cause = f"the exposures of {list_names(marked)} are not known"
                raise BakeError(paths[0].parent, cause, "keep their Exif data or name them _ev-2, _ev0, _ev+2")
    if _differ(noted):
        return Exposures([value / noted[0] for value in noted], "Exif: exposure time x ISO / f-number^2")
    return Exposures(
        [1.0] * len(paths), "all alike by Exif" if any(_known(info.exposure) for info in infos) else "not noted"
    )


def _known(exposure: Exposure) -> bool:
    return any(value is not None for value in (exposure.seconds, exposure.f_number, exposure.iso))


def _noted(paths: list[Path], infos: list[PhotoInfo]) -> list[float]:
    factors = np.ones(len(paths))
    for name, power in (("seconds", 1), ("f_number", -2), ("iso", 1)):
        values = [getattr(info.exposure, name) for info in infos]
        known = [value for value in values if value is not None]
        if len(known) == len(values):
            with np.errstate(all="ignore"):
                factors *= np.array(values, float) ** power
        elif known and _differ(known):
            cause = f"only {len(known)} of {len(values)} photographs note their exposure, and it differs"
            raise BakeError(paths[0].parent, cause, "keep the Exif data of all photographs, or of none")
    if not (1e-30 < factors.min() and factors.max() < 1e30 and factors.max() < 1e9 * factors.min()):
        raise BakeError(paths[0].parent, "the exposures in the Exif data cannot be true", "correct or remove them")
    return [float(value) for value in factors]


def _differ(values: list[float]) -> bool:
    return max(values) > min(values) * (1 + _SAME_EXPOSURE)


def trust(codes: NDArray[np.float32], exposure: float, full: float) -> NDArray[np.float32]:
    """Weight of a pixel in a merge, (..., 3) encoded values -> (...); 0 where a channel is clipped.

    In proportion to the exposure, as photon noise has it, falling off towards the two ends of the scale, where
    clipping and read-out noise set in (after Debevec and Malik 1997, whose weight is a hat).

    Parameters
    ----------
    codes : encoded values, 1 being full scale
    exposure : relative
    full : code from which on a pixel counts as clipped
    """
    brightest, darkest = codes.max(axis=-1), codes.min(axis=-1)
    high = np.clip((full - brightest) / 0.13, 0, 1)
    low = np.clip(darkest / 0.1, 0.02, 1)
    return (high * low * np.float32(exposure)).astype(np.float32)


def merge(
    linear: list[NDArray[np.float32]], weights: list[NDArray[np.float32]], exposures: list[float]
) -> NDArray[np.float32]:
    """Weighted mean of images (H, W, 3), each divided by its exposure before; the shortest where none is trusted."""
    total = np.sum(weights, axis=0)
    merged = np.zeros_like(linear[0])
    for values, weight in zip(linear, weights):
        merged += values * weight[..., None]
    untrusted = total <= 1e-12
    merged /= np.where(untrusted, 1, total)[..., None]
    shortest = int(np.argmin(exposures))
    merged[untrusted] = linear[shortest][untrusted]
    return merged


def report(paths: list[Path], groups: list[list[int]], exposures: Exposures, infos: list[PhotoInfo]) -> Facts:
    """JSON-ready facts about exposures and merges."""
    noted = [
        {"seconds": info.exposure.seconds, "f_number": info.exposure.f_number, "iso": info.exposure.iso}
        for info in infos
        if _known(info.exposure)
    ]
    merged = [[paths[k].name for k in group] for group in groups if len(group) > 1]
    return {
        "exposure_rule": exposures.rule,
        "exposures": [round(value, 6) for value in exposures.relative],
        "exif": noted if any(entry != noted[0] for entry in noted) else noted[:1],
        "brackets": merged,
    }
