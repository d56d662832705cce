"""Scattered goniometer samples to a smooth, reciprocal, isotropic BRDF.

Every quantity here is a function of four invariants of a direction pair that exchanging wi and wo, turning
both about the normal or mirroring both leaves unchanged. So isotropy, bilateral symmetry and reciprocity hold
by construction and each sample stands for all its mirror images, without storing them.

Values are interpolated as asinh(f / scale): linear for the darkest samples, which may be 0 or slightly negative,
and logarithmic for the peak, which may be a hundred thousand times brighter. A sample lit at grazing angles
weighs less, because its radiance was small beside the instrument's offset. (In the three published paints the
values at theta_i = 80 degrees are 0.006 to 0.63 times those of the exchanged directions, at 50 degrees 0.82 to
0.97 times.) Several interpolants compete on leave-one-out error, and the winner is kept:

* `kernel`: Gaussian kernel regression with a bandwidth per sample (Nadaraya 1964, Watson 1964);
* `spline`: polyharmonic smoothing spline r^3 with a linear tail (Duchon 1977; Wahba 1990), twice
  continuously differentiable;
* `lobes`: diffuse plus GGX lobes alone, see `scattered_lobes`;
* `lobes+spline`: the same spline on what the lobes leave over.

Beyond the measured range the last measured values are held, see `invariants`: a spline in the logarithm of a
rising Fresnel peak would explode on the last degrees before grazing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...source import Array, Facts
from .scattered_coordinates import Coordinates, coordinates
from .scattered_interpolants import Interpolant, Spline, kernel_fit, spline_inverse, spread_subset
from .scattered_invariants import Invariants, invariants
from .scattered_lobes import Lobes, fit_lobes

MAX_CENTRES = 2000
"""Dense solves grow with the cube; beyond this, well-spread samples are chosen (and `facts` says so)."""

MIN_SAMPLES = 12
PEAK_WIDTHS = (0.01, 0.03, 0.1)
SMOOTHINGS = (3e-4, 3e-3)
"""Tried first, and then at the best peak width. A tenth of the first lowers the errors by some per cent, but the
spline then ripples through the noise of neighbouring samples."""

LINEAR_SHARE = 0.3
"""Scale of the asinh as a share of the median sample: at 1 the spline undershoots to 0 beside a peak."""

_LARGEST_NOISE = 1e6
_CHUNK = 2048


def sample_errors(truth: Array, guess: Array, cosine: Array, scale: float) -> dict[str, float]:
    """Errors of a guess against samples.

    Parameters
    ----------
    truth, guess : (N, C) BRDF values
    cosine : (N,) weight, the smaller of the two cosines, so that the error is reciprocal too
    scale : BRDF value below which errors count linearly, above relatively (the median sample)

    Returns
    -------
    `log_cos_rms` : RMS of log(1 + f cos / scale), after Low et al. 2012 but free of the unit;
    `cos_rms` : RMS of f cos, which one sample of a mirror-like peak can decide alone;
    `median_relative` : median of |error| / (f + scale / 10), blind to the peak;
    `overall` : geometric mean of the three, which ranks the candidates: neither the few peak samples nor the
    many others decide alone.
    """
    weight = cosine[:, None]

    def compressed(f: Array) -> Array:
        return np.log1p(np.maximum(f, 0) * weight / scale)

    relative = np.abs(guess - truth) / (np.abs(truth) + scale / 10)
    errors = {
        "log_cos_rms": float(np.sqrt(np.mean((compressed(guess) - compressed(truth)) ** 2))),
        "cos_rms": float(np.sqrt(np.mean(((guess - truth) * weight) ** 2))),
        "median_relative": float(np.median(relative)),
    }
    return errors | {"overall": float(np.prod(list(errors.values())) ** (1 / 3))}


def sample_noise(wi: Array, brightness: Array, typical: float) -> Array:
    """Relative variance of samples, (N,), for a smoothing spline: that of light at grazing is larger.

    Parameters
    ----------
    wi : (N, 3) directions to the light
    brightness : (N,) mean of the channels, absolute
    typical : the median of it
    """
    offset = typical / np.maximum(wi[:, 2], 1e-3) ** 2
    return np.minimum(1 + offset**2 / ((LINEAR_SHARE * typical) ** 2 + brightness**2), _LARGEST_NOISE)


@dataclass(frozen=True)
class ScatteredBrdf:
    """A smooth BRDF through scattered samples; build it with `fit_scattered`.

    Attributes
    ----------
    method : the interpolant that won
    facts : errors of every candidate and the parameters of the winner, JSON-ready
    scale : of the asinh, 1/sr
    ceiling : (C,) largest sample as asinh(f / scale)
    """

    method: str
    facts: Facts
    scale: float
    coordinates: Coordinates
    least_cosine: float
    ceiling: Array
    lobes: Lobes | None
    interpolant: Interpolant | None

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """BRDF of direction pairs in the channels of the samples, >= 0 and finite.

        Parameters
        ----------
        wi, wo : (..., 3) unit vectors, broadcast; on or below the horizon the value is 0

        Returns
        -------
        (..., C) float64. Works in chunks of some tens of megabytes.
        """
        wi, wo = np.broadcast_arrays(np.asarray(wi, dtype=float), np.asarray(wo, dtype=float))
        shape, wi, wo = wi.shape[:-1], wi.reshape(-1, 3), wo.reshape(-1, 3)
        result = np.zeros((len(wi), len(self.ceiling)))
        above = np.flatnonzero((wi[:, 2] > 0) & (wo[:, 2] > 0))
        for start in range(0, len(above), _CHUNK):
            part = above[start : start + _CHUNK]
            result[part] = self.scale * np.sinh(self.level(wi[part], wo[part]))
        return result.reshape(*shape, -1)

    def level(self, wi: Array, wo: Array) -> Array:
        """asinh(f / scale), (n, C), of unit vectors (n, 3); below the horizon as at its edge."""
        pair = invariants(wi, wo, self.least_cosine)
        level: Array | float = 0.0
        if self.lobes is not None:
            level = np.arcsinh(self.lobes.evaluate(pair) / self.scale)
        if self.interpolant is not None:
            level = level + self.interpolant(self.coordinates(wi, wo, pair))
        # Between samples a spline may overshoot, so no measured value is exceeded.
        return np.maximum(np.minimum(level, self.ceiling), 0.0)


def fit_scattered(wi: Array, wo: Array, values: Array, method: str | None = None) -> ScatteredBrdf:
    """Fit every candidate to the samples and keep the one of least `overall` leave-one-out error.

    Parameters
    ----------
    wi, wo : (N, 3) unit vectors above the horizon, N >= `MIN_SAMPLES`
    values : (N, C) BRDF in 1/sr, in channels that cannot be negative in truth (CIE XYZ rather than RGB)
    method : keep this candidate instead of the best

    Raises
    ------
    ValueError : too few samples, or none that differ
    """
    if len(values) < MIN_SAMPLES:
        raise ValueError(f"{len(values)} samples are too few for a fit; {MIN_SAMPLES} are needed")
    total = len(values)
    if total > MAX_CENTRES:
        keep = spread_subset(coordinates(invariants(wi, wo), PEAK_WIDTHS[0]), MAX_CENTRES)
        wi, wo, values = wi[keep], wo[keep], values[keep]
    brightness = np.abs(values).mean(-1)
    typical = max(float(np.median(brightness)) or float(brightness.mean()), 1e-9)
    scale = LINEAR_SHARE * typical
    y = np.arcsinh(values / scale)
    pair = invariants(wi, wo)
    lobes = fit_lobes(pair, values, typical)
    lobe_level = np.arcsinh(lobes.evaluate(pair) / scale)
    noise = sample_noise(wi, brightness, typical)
    try:
        candidates = _spline_candidates(pair, y, lobe_level, noise)
    except np.linalg.LinAlgError as error:
        raise ValueError("the samples do not determine a surface") from error
    candidates += _other_candidates(pair, y, lobe_level)
    cosine, ceiling = np.minimum(wi[:, 2], wo[:, 2]), y.max(0)
    ranking = []
    for candidate in candidates:
        guess = scale * np.sinh(np.maximum(np.minimum(candidate.left_out, ceiling), 0))
        ranking.append((sample_errors(values, guess, cosine, typical), candidate))
    ranking.sort(key=lambda entry: entry[0]["overall"])
    best = next(c for _, c in ranking if method in (None, c.name))
    facts: dict[str, Any] = {
        "interpolation": best.name,
        "peak_width": best.peak_width,
        "smoothing": best.smoothing,
        "samples_fitted": len(values),
        "samples_left_aside": total - len(values),
        "left_out_errors": {c.name: errors for errors, c in reversed(ranking)},
        "largest_measured_theta_deg": float(np.degrees(np.arccos(cosine.min()))),
    }
    used, place = lobes if best.name.startswith("lobes") else None, Coordinates(best.peak_width)
    return ScatteredBrdf(best.name, facts, scale, place, float(cosine.min()), ceiling, used, best.interpolant)


@dataclass(frozen=True)
class _Candidate:
    name: str
    peak_width: float
    smoothing: float
    left_out: Array  # (N, C) compressed prediction of each sample from the others
    interpolant: Interpolant | None


def _spline_candidates(pair: Invariants, y: Array, lobe_level: Array, noise: Array) -> list[_Candidate]:
    """Splines for every peak width, then more smoothing at the one that served best."""
    first = SMOOTHINGS[0]
    found = [c for width in PEAK_WIDTHS for c in _spline_pair(pair, y, lobe_level, noise, width, first)]
    best = min(found, key=lambda c: float(np.mean((c.left_out - y) ** 2)))
    for smoothing in SMOOTHINGS[1:]:
        found += _spline_pair(pair, y, lobe_level, noise, best.peak_width, smoothing)
    return found


def _spline_pair(
    pair: Invariants, y: Array, lobe_level: Array, noise: Array, peak_width: float, smoothing: float
) -> list[_Candidate]:
    """The spline with and without lobes; one matrix inverse serves both and yields the exact leave-one-out
    residual c_i / (A^-1)_ii (Wahba 1990, section 4.2)."""
    channels, found = y.shape[1], []
    x = coordinates(pair, peak_width)
    origin = x.mean(0)
    x = x - origin
    inverse = spline_inverse(x, smoothing * noise)[:, : len(x)]
    coefficients = inverse @ np.hstack([y, y - lobe_level])
    residual = coefficients[: len(x)] / np.diag(inverse)[:, None]
    for name, own in (("spline", slice(channels)), ("lobes+spline", slice(channels, None))):
        weights, tail = coefficients[: len(x), own], coefficients[len(x) :, own]
        spline = Spline(x, origin, weights, tail)
        found.append(_Candidate(name, peak_width, smoothing, y - residual[:, own], spline))
    return found


def _other_candidates(pair: Invariants, y: Array, lobe_level: Array) -> list[_Candidate]:
    """Kernel regression for each peak width, and the lobes alone (whose dozen parameters saw all samples)."""
    found = [_Candidate("lobes", PEAK_WIDTHS[0], 0.0, lobe_level, None)]
    for peak_width in PEAK_WIDTHS:
        kernel, left_out = kernel_fit(coordinates(pair, peak_width), y)
        found.append(_Candidate("kernel", peak_width, 0.0, left_out, kernel))
    return found
