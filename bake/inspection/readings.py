"""Which direction of a pair is the light? What the three readings predict of samples that were left out.

A file that is not reciprocal can be read in three ways (`bake.reading.Reciprocity`). It cannot say which of its two
directions was the light's: with the names exchanged it would hold the same numbers. What it can say is which reading
predicts what it holds for incident directions that were left out, from what it holds for the others:

* "measured" interpolates between neighbouring incident directions;
* "exchanged" looks the same pair up from the other side, as reciprocity has it;
* "mean" takes the mean of both, and errs by half their difference where that is no noise.

All are asked where the light stands at an elevation that was left out: only there is the truth a sample of the file.
On the twelve genuine RGL files "measured" errs least in the median, but least of all on five only: on the other seven
the mean does, by up to 17 %, on two of them by a hundredth or less (`./run bench readings`). That decides little. A
mean averages out noise, but errors of interpolation too, whether or not a material is reciprocal; and "measured" is
asked in the middle between two kept elevations, where interpolation errs most, "exchanged" anywhere. Only where the
mean errs more by a quarter or more, as on two files, is it plain that the measurement itself differs and no noise. The
numbers of a file are taken as they are because nothing tells against it, and each file's errors are told.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..source import Array, BrdfSource, Facts
from ..tables.accuracy import direction_pairs

_PAIRS = 8192
READINGS: Mapping[str, Callable[[BrdfSource, Array, Array], Array]] = {
    "measured": lambda source, wi, wo: source.evaluate(wi, wo),
    "exchanged": lambda source, wi, wo: source.evaluate(wo, wi),
    "mean": lambda source, wi, wo: (source.evaluate(wi, wo) + source.evaluate(wo, wi)) / 2,
}


def held_out(source: BrdfSource) -> Facts | None:
    """Errors at samples that were left out, JSON-ready; None where a format cannot be halved.

    Parameters
    ----------
    source : as it is read by itself, not `bake.sources.exchanged.Exchanged`

    Returns
    -------
    "how" in words, and of each reading the error as a share: of grids of incident directions the RMS over that of the
    signal; of scattered samples, whose fit is reciprocal so that all readings are one, the median of the relative error
    """
    halved = getattr(source, "halved", None)
    found = halved() if halved is not None else None
    if found is not None:
        return {"how": "every second incident elevation left out", **_of_halves(source, *found)}
    errors: Any = source.facts.get("left_out_errors")
    best = errors.get(source.facts.get("interpolation")) if isinstance(errors, dict) else None
    if best is None:
        return None
    return {"how": "each sample left out in turn, median", **dict.fromkeys(READINGS, float(best["median_relative"]))}


def _of_halves(source: BrdfSource, half: BrdfSource, elevations: Array) -> dict[str, float]:
    """RMS of each reading of half a file, at the elevations (n,) of the light that it lacks."""
    pairs = direction_pairs(_PAIRS, offset=0.375, turned=not source.isotropic, elevations=elevations)
    wi, wo = pairs.wo, pairs.wi
    truth = np.asarray(source.evaluate(wi, wo), np.float64)
    signal = max(pairs.rms(truth), 1e-300)
    return {name: pairs.rms(read(half, wi, wo) - truth) / signal for name, read in READINGS.items()}
