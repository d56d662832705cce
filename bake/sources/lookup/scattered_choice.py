"""Scattered samples whose coordinates have to be found: more than one solve takes, or from several azimuths,
or of a surface that shines back to the lamp.

`scattered` interpolates up to `MAX_CENTRES` samples in the four coordinates of an isotropic BRDF. Here it is also found
whether the azimuth matters, which symmetry the surface has, and whether it shines back to the lamp, all by the error
at samples left out, on a subset that takes a fraction of a second to solve; the best is then fitted to as many samples
as one solve takes. Where more are left, their error is told too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...source import Array, Json
from .scattered import (
    LINEAR_SHARE,
    MAX_CENTRES,
    MIN_SAMPLES,
    PEAK_WIDTHS,
    SMOOTHINGS,
    ScatteredBrdf,
    fit_scattered,
    sample_errors,
    sample_noise,
)
from .scattered_coordinates import ANY_TURN, MIRROR, TWO_MIRRORS, WHOLE, AzimuthCover, Coordinates
from .scattered_grid import GriddedBrdf, gridded
from .scattered_interpolants import Interpolant, kernel_fit, spline_fit, spline_inverse, spread_subset
from .scattered_invariants import invariants
from .scattered_lobes import fit_lobes

SEARCH_SAMPLES = 700
"""A solve of so many takes a thirtieth of one of `MAX_CENTRES`."""

MOST_SPREAD = 20_000
"""From so many a subset is spread, whose time grows with both numbers."""

WEIGHTS = (0.3, 1.0)
BETTER = 0.9
"""Of the error without: below this the azimuth, or a peak towards the lamp, is said to matter."""

_CHECKED = 2000


def fit_samples(wi: Array, wo: Array, values: Array) -> ScatteredBrdf | GriddedBrdf:
    """The interpolant of least error at samples left out, isotropic or not; parameters and errors as `fit_scattered`.

    Raises
    ------
    ValueError : too few samples, or none that differ
    """
    if len(values) < MIN_SAMPLES:
        raise ValueError(f"{len(values)} samples are too few for a fit; {MIN_SAMPLES} are needed")
    cover = AzimuthCover.of(wi)
    symmetries = cover.symmetries()
    try:
        search = _Search(wi, wo, values, anisotropic=bool(symmetries))
        best = search.isotropic()
        errors = {"isotropic": best.errors}
        for symmetry in symmetries:
            turned = search.turned(best.coordinates, symmetry, cover.axes())
            errors[f"symmetry: {symmetry}"] = turned.errors
            if turned.overall < BETTER * errors["isotropic"]["overall"] and turned.overall < best.overall:
                best = turned
        if best.coordinates == Coordinates(best.coordinates.peak_width) and len(values) <= MAX_CENTRES:
            # Its four coordinates are enough: it tries more interpolants in them, each at all the samples.
            fit = fit_scattered(wi, wo, values)
            own: Any = fit.facts["left_out_errors"]
            errors["isotropic"] = own[fit.method]
        else:
            fit = search.final(search.smoothed(best))
    except np.linalg.LinAlgError as error:
        raise ValueError("the samples do not determine a surface") from error
    told: dict[str, Json] = {
        "azimuths": cover.count,
        "azimuths_cover_deg": cover.covered,
        "symmetry": best.coordinates.symmetry,
        "symmetry_errors": errors,
    }
    if not symmetries:
        return fit
    if best.coordinates.symmetry in (MIRROR, TWO_MIRRORS):
        told["symmetry_axis_deg"] = float(np.degrees(best.coordinates.axis))
    fit = replace(fit, facts={**fit.facts, **told})
    return fit if fit.coordinates.isotropic else gridded(fit)


@dataclass(frozen=True)
class _Trial:
    """Coordinates with the interpolant that served them best, and its errors at samples left out."""

    coordinates: Coordinates
    name: str
    smoothing: float
    errors: dict[str, float]

    @property
    def overall(self) -> float:
        """What ranks them."""
        return self.errors["overall"]


class _Search:
    """Trials on a subset of the samples, and the fit to more of them."""

    def __init__(self, wi: Array, wo: Array, values: Array, anisotropic: bool) -> None:
        brightness = np.abs(values).mean(-1)
        self.typical = max(float(np.median(brightness)) or float(brightness.mean()), 1e-9)
        self.scale = LINEAR_SHARE * self.typical
        self.wi, self.wo, self.values = wi, wo, values
        self.y = np.arcsinh(values / self.scale)
        self.ceiling = self.y.max(0)
        self.noise = sample_noise(wi, brightness, self.typical)
        usual = Coordinates(PEAK_WIDTHS[0], retro=True, symmetry=WHOLE if anisotropic else ANY_TURN)
        self.subset = self._spread(usual, SEARCH_SAMPLES)
        pair = invariants(wi[self.subset], wo[self.subset])
        self.lobes = fit_lobes(pair, values[self.subset], self.typical)
        self.lobe_level = np.arcsinh(self.lobes.evaluate(invariants(wi, wo)) / self.scale)

    def _spread(self, coordinates: Coordinates, count: int) -> Array:
        """Indices of so many samples, well spread in these coordinates."""
        if len(self.values) <= count:
            return np.arange(len(self.values))
        every = np.unique(np.linspace(0, len(self.values) - 1, min(len(self.values), MOST_SPREAD)).astype(int))
        x = coordinates(self.wi[every], self.wo[every])
        return every[spread_subset(x, count)]

    def isotropic(self) -> _Trial:
        """The best peak width, with a coordinate for retroreflection where that serves."""
        plain, retro = (
            min(
                (self._trial(Coordinates(w, back), SMOOTHINGS[0]) for w in PEAK_WIDTHS), key=lambda trial: trial.overall
            )
            for back in (False, True)
        )
        return retro if retro.overall < BETTER * plain.overall else plain

    def turned(self, start: Coordinates, symmetry: str, axes: tuple[float, ...]) -> _Trial:
        """The best weight of the azimuth and, of these in degrees, the best axis where there is a mirror plane."""
        trials = [
            self._trial(replace(start, symmetry=symmetry, axis=float(np.radians(axis)), weight=weight), SMOOTHINGS[0])
            for axis in (axes if symmetry in (MIRROR, TWO_MIRRORS) else axes[:1])
            for weight in WEIGHTS
        ]
        return min(trials, key=lambda trial: trial.overall)

    def smoothed(self, best: _Trial) -> _Trial:
        """With more smoothing, where that serves."""
        trials = [best, *(self._trial(best.coordinates, smoothing) for smoothing in SMOOTHINGS[1:])]
        return min(trials, key=lambda trial: trial.overall)

    def _trial(self, coordinates: Coordinates, smoothing: float) -> _Trial:
        """Leave-one-out errors of a spline, one on lobes and a kernel (Wahba 1990, section 4.2)."""
        at, channels = self.subset, self.values.shape[1]
        x, y, lobes = coordinates(self.wi[at], self.wo[at]), self.y[at], self.lobe_level[at]
        inverse = spline_inverse(x - x.mean(0), smoothing * self.noise[at])[: len(x), : len(x)]
        residual = inverse @ np.hstack([y, y - lobes]) / np.diag(inverse)[:, None]
        left_out = {"spline": y - residual[:, :channels], "lobes+spline": y - residual[:, channels:]}
        left_out["kernel"] = kernel_fit(x, y)[1]
        errors = {name: self._errors(guess, at) for name, guess in left_out.items()}
        best = min(errors, key=lambda name: errors[name]["overall"])
        return _Trial(coordinates, best, smoothing, errors[best])

    def _errors(self, guess: Array, at: Array) -> dict[str, float]:
        value = self.scale * np.sinh(np.maximum(np.minimum(guess, self.ceiling), 0))
        return sample_errors(self.values[at], value, np.minimum(self.wi[at, 2], self.wo[at, 2]), self.typical)

    def final(self, best: _Trial) -> ScatteredBrdf:
        """The best trial's interpolant through as many samples as one solve takes."""
        at = self._spread(best.coordinates, MAX_CENTRES)
        x, used = best.coordinates(self.wi[at], self.wo[at]), best.name.startswith("lobes")
        y = self.y[at] - self.lobe_level[at] if used else self.y[at]
        interpolant: Interpolant
        if best.name == "kernel":
            interpolant, _ = kernel_fit(x, y)
        else:
            interpolant = spline_fit(x, y, best.smoothing * self.noise[at])
        least = float(np.minimum(self.wi[:, 2], self.wo[:, 2]).min())
        facts: dict[str, Any] = {
            "interpolation": best.name,
            "peak_width": best.coordinates.peak_width,
            "retroreflection": best.coordinates.retro,
            "smoothing": best.smoothing,
            "samples_fitted": len(at),
            "samples_left_aside": len(self.values) - len(at),
            "samples_searched": len(self.subset),
            "left_out_errors": {best.name: best.errors},
            "largest_measured_theta_deg": float(np.degrees(np.arccos(least))),
        }
        lobes = self.lobes if used else None
        fit = ScatteredBrdf(best.name, facts, self.scale, best.coordinates, least, self.ceiling, lobes, interpolant)
        aside = np.setdiff1d(np.arange(len(self.values)), at)
        if aside.size:
            seen = aside[:: -(-aside.size // _CHECKED)]
            guess, cosine = fit.evaluate(self.wi[seen], self.wo[seen]), np.minimum(self.wi[seen, 2], self.wo[seen, 2])
            told = sample_errors(self.values[seen], guess, cosine, self.typical)
            fit = replace(fit, facts={**facts, "left_aside_errors": told})
        return fit
