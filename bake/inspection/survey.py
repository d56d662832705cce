"""Symmetry, gaps and noise of a measurement, counted at directions of our own so that formats can be compared."""

from __future__ import annotations

import math

import numpy as np

from ..source import Array, BrdfSource, Facts, Json
from ..tables.accuracy import direction_pairs

_PAIRS = 8192
# A difference that a float32 number cannot hold is none.
RECIPROCAL = 1e-6


def survey(source: BrdfSource) -> Facts:
    """JSON-ready account of a measurement.

    Returns
    -------
    reciprocity : "rms", of f(wi, wo) - f(wo, wi) as a share of the signal's RMS, weighted as
        `bake.tables.accuracy.DirectionPairs.rms`; "median" of the difference as a share of the mean of both
    negative_share : of values below 0, each pair of directions counting by its solid angles
    invalid_share : of the file's entries above the horizon that hold no measurement; None where formats do not tell
    extrapolated_share : of the light on the surface, from everywhere to everywhere, that lies beyond the measured
        directions; None where formats do not tell
    """
    pairs = direction_pairs(_PAIRS, offset=0.375, turned=not source.isotropic)
    forward = np.asarray(source.evaluate(pairs.wi, pairs.wo), np.float64)
    backward = np.asarray(source.evaluate(pairs.wo, pairs.wi), np.float64)
    signal = max(pairs.rms(forward), 1e-300)
    level = (np.abs(forward) + np.abs(backward)).mean(-1) / 2
    relative = np.abs(forward - backward).mean(-1) / np.maximum(level, 1e-300)
    weight = pairs.weight / pairs.weight.sum()
    return {
        "reciprocity": {
            "rms": pairs.rms(forward - backward) / signal,
            "median": weighted_median(np.where(level > 0, relative, 0.0), weight),
        },
        "negative_share": float(weight @ (forward < 0).mean(-1)),
        "invalid_share": _invalid_share(source.facts),
        "extrapolated_share": _extrapolated_share(source.facts),
    }


def weighted_median(values: Array, weight: Array) -> float:
    """The value below which half of the weight lies."""
    order = np.argsort(values, kind="stable")
    reached = np.cumsum(weight[order])
    return float(values[order][np.searchsorted(reached, reached[-1] / 2)])


def _invalid_share(facts: Facts) -> float | None:
    """Of MERL's entries above the horizon; scattered samples are all of them measured."""
    invalid, entries = facts.get("invalid"), _number(facts, "entries_per_channel")
    if isinstance(invalid, list | tuple) and entries:
        above = entries - (_number(facts, "below_horizon") or 0)
        counts = [count for count in invalid if isinstance(count, int | float)]
        return float(sum(counts)) / max(above * len(counts), 1)
    return 0.0 if "samples_fitted" in facts else None


def _extrapolated_share(facts: Facts) -> float | None:
    """By the largest polar angle that was measured: of both directions where samples are scattered, else of the
    light alone, since such files hold all viewers of each."""
    largest = _number(facts, "largest_measured_theta_deg")
    if largest is None:
        return None
    within = math.sin(math.radians(min(largest, 90.0))) ** 2
    return round(1 - within * within if "samples_fitted" in facts else 1 - within, 9)


def _number(facts: Facts, key: str) -> float | None:
    value: Json = facts.get(key)
    return float(value) if isinstance(value, int | float) else None
