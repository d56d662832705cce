"""Scattered samples of any text format as a smooth BRDF, with an account of what was left out."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np

from ...reading import Illuminant
from ...source import Array
from ...spectrum import white_point, xyz_to_rec709, xyz_weights
from ..lookup.lookup_source import LookupSource, negative_facts
from ..lookup.scattered import MIN_SAMPLES
from ..lookup.scattered_choice import fit_samples
from ..lookup.text_file import NamedFile, TextFile

Colour = Literal["grey", "rgb", "xyz"]
WAVELENGTH = re.compile(r"(\d+(?:\.\d+)?)\s*nm$")
"""In the name of a column of a spectrum."""

_HORIZON_COS = 1e-6
# Samples of one geometry, to this many radians, are compared to find what a turn about the normal changes.
_SAME = 0.02


def spectral_colour(
    file: TextFile, wavelengths: Sequence[float], table: Array, illuminant: Illuminant
) -> tuple[Colour, Array, Illuminant]:
    """Columns of wavelengths in nm, in any order, as CIE XYZ under an illuminant. Raises BakeError."""
    order = np.argsort(wavelengths)
    try:
        return "xyz", table[:, order] @ xyz_weights(np.array(wavelengths)[order], illuminant), illuminant
    except ValueError as error:
        raise file.error(str(error)) from error


def scattered_source(
    file: NamedFile,
    wi: Array,
    wo: Array,
    values: Array,
    colour: Colour,
    facts: dict[str, Any],
    illuminant: Illuminant = "D65",
) -> LookupSource:
    """Fit the samples above the horizon; the interpolation is chosen by how well each is predicted by the others.

    Parameters
    ----------
    wi, wo : (N, 3) unit vectors, both away from the surface
    values : (N, 1) for "grey", else (N, 3): BRDF in 1/sr
    colour : what the channels are
    illuminant : whose white CIE XYZ is taken with; of D65 (0.95, 1, 1.09)
    facts : of the format; the account of the fit is added

    Raises
    ------
    BakeError : too few samples above the horizon
    """
    above = (wi[:, 2] > _HORIZON_COS) & (wo[:, 2] > _HORIZON_COS)
    if np.count_nonzero(above) < MIN_SAMPLES:
        cause = f"holds {np.count_nonzero(above)} samples above the horizon, {MIN_SAMPLES} are needed"
        raise file.error(cause, "give a measurement of more directions, of reflection")
    wi, wo, values = wi[above], wo[above], values[above]
    white = None if illuminant == "D65" else white_point(illuminant)
    matrix = xyz_to_rec709(white).T if colour == "xyz" else np.eye(3)
    try:
        fit = fit_samples(wi, wo, values)
    except ValueError as error:
        raise file.error(str(error)) from error

    def lookup(light: Array, viewer: Array) -> Array:
        found = fit.evaluate(light, viewer)
        return np.repeat(found, 3, -1) if colour == "grey" else found @ matrix

    isotropic = fit.coordinates.isotropic
    facts |= {
        "samples": len(values),
        "samples_below_horizon": int(np.count_nonzero(~above)),
        "zero_share": float((values == 0).mean()),
        **({"anisotropy_averaged": _anisotropy(wi, wo, values)} if isotropic else {}),
        **negative_facts(values),
        **fit.facts,
    }
    return LookupSource(file.path.stem, lookup, facts, isotropic, isotropic)


def _anisotropy(wi: Array, wo: Array, values: Array) -> float:
    """Mean deviation, as a share of the mean, among samples that only a turn about the normal tells apart."""
    turn = np.arctan2(wi[:, 0] * wo[:, 1] - wi[:, 1] * wo[:, 0], wi[:, 0] * wo[:, 0] + wi[:, 1] * wo[:, 1])
    geometry = np.round(np.stack([np.arccos(wi[:, 2]), np.arccos(wo[:, 2]), np.abs(turn)], -1) / _SAME).astype(int)
    azimuth = np.round(np.arctan2(wi[:, 1], wi[:, 0]) / _SAME).astype(int)
    _, group = np.unique(geometry, axis=0, return_inverse=True)
    group = group.reshape(-1)
    level = values.mean(-1)
    count, total = np.bincount(group), np.bincount(group, level)
    low, high = np.full(len(count), np.iinfo(int).max), np.full(len(count), np.iinfo(int).min)
    np.minimum.at(low, group, azimuth)
    np.maximum.at(high, group, azimuth)
    turned = (high > low)[group]
    if not turned.any():
        return 0.0
    deviation = np.abs(level - (total / count)[group])[turned].sum()
    return float(deviation / max(np.abs(level[turned]).sum(), 1e-30))
