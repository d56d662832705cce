"""Where samples of a BRDF lie for an interpolant: coordinates along which a material varies about equally fast."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...source import Array
from .scattered_invariants import Invariants, invariants

ANY_TURN, WHOLE, HALF, MIRROR, TWO_MIRRORS = "any turn", "none", "half a turn", "a mirror plane", "two mirror planes"
"""Symmetries of a surface: isotropic, none at all, half a turn about the normal, one or two planes through it."""

_GRAZING_OFFSET = 0.03
_RETRO_WIDTH = 0.01
# Two azimuths closer than half of this are one; light steeper than one degree has none.
_BIN_DEG, _STEEP = 0.5, np.sin(np.radians(1.0))
# How far measured azimuths may miss a quarter, a half or a whole turn, and how many there must be.
_SLACK_DEG, _LEAST_AZIMUTHS = 1.0, 3
_SYMMETRIES = {90: (TWO_MIRRORS,), 180: (MIRROR, HALF, TWO_MIRRORS), 360: (WHOLE, HALF)}


def coordinates(pair: Invariants, peak_width: float) -> Array:
    """Invariants stretched so that a BRDF varies about equally fast along each.

    Parameters
    ----------
    pair : of shape (...)
    peak_width : theta_h in radians below which the first coordinate is quadratic, above logarithmic: there
        the logarithm of a GGX lobe of that alpha is a straight line

    Returns
    -------
    (..., 4): distance to the peak (theta_h), Fresnel term (theta_d), difference of the cosines, and the
    product of the cosines, in whose logarithm grazing shadowing is smooth. Weights chosen once by
    leave-one-out error on gonioreflectometer paints.
    """
    return np.stack(
        [
            3.0 * np.log1p(pair.sin2_h / peak_width**2) / np.log1p(1 / peak_width**2),
            1.0 - pair.cos_d,
            (pair.cos_i - pair.cos_o) ** 2,
            np.log(np.maximum(pair.cos_i * pair.cos_o, 0.0) + _GRAZING_OFFSET) / 3,
        ],
        -1,
    )


@dataclass(frozen=True)
class Coordinates:
    """The four coordinates of every BRDF, one more for peaks towards the lamp, and those of the azimuth.

    All are the same for (wi, wo) and (wo, wi), and for directions that the symmetry takes into each other; so an
    interpolant in them is reciprocal and has that symmetry by construction.

    Parameters
    ----------
    peak_width : see `coordinates`
    retro : also the logarithm of theta_d, in which the peak of a retroreflector is as wide as a mirror's in theta_h
    symmetry : of the surface
    axis : azimuth of a mirror plane, radians
    weight : of the azimuth's coordinates, against those of theta_h and theta_d
    """

    peak_width: float
    retro: bool = False
    symmetry: str = ANY_TURN
    axis: float = 0.0
    weight: float = 1.0

    @property
    def isotropic(self) -> bool:
        """Whether a turn about the normal changes nothing."""
        return self.symmetry == ANY_TURN

    def __call__(self, wi: Array, wo: Array, pair: Invariants | None = None) -> Array:
        """(n, 4 to 9) of unit vectors (n, 3), where `pair` are their invariants as they are held at the edge."""
        pair = invariants(wi, wo) if pair is None else pair
        found = coordinates(pair, self.peak_width)
        columns = [found]
        if self.retro:
            spread = np.maximum(1 - pair.cos_d**2, 0) / _RETRO_WIDTH**2
            columns.append(np.log1p(spread)[:, None] / np.log1p(1 / _RETRO_WIDTH**2))
        if not self.isotropic:
            columns.append(self.weight * self._azimuths(wi, wo, found[:, 0], 1 - pair.cos_d**2))
        return np.concatenate(columns, -1) if len(columns) > 1 else found

    def _azimuths(self, wi: Array, wo: Array, peak: Array, spread: Array) -> Array:
        """Azimuths of the half vector and of the line between light and viewer, each 0 where it has none.

        That line has no sense, so its azimuth counts twice; at a half vector along the normal and at theta_d = 0 an
        azimuth means nothing, hence the factors `peak` (n,) and `spread` (n,).
        """
        half, line = _azimuth(wi + wo, self.axis), _azimuth(wi - wo, self.axis)
        line2 = _doubled(line)
        if self.symmetry == WHOLE:
            return np.concatenate([peak[:, None] * half, spread[:, None] * line2], -1)
        half2 = _doubled(half)
        if self.symmetry == HALF:
            return np.concatenate([peak[:, None] * half2, spread[:, None] * line2], -1)
        # A mirror plane turns both signs of the y components: their product stays.
        even, odd = (half[:, 0], half[:, 1]) if self.symmetry == MIRROR else (half2[:, 0], half2[:, 1])
        both = np.sqrt(np.maximum(peak * spread, 0)) * odd * line2[:, 1]
        return np.stack([peak * even, spread * line2[:, 0], both], -1)


def _azimuth(vector: Array, axis: float) -> Array:
    """Cosine and sine of the azimuth from `axis`, (n, 2); (0, 0) along the normal."""
    c, s = np.cos(axis), np.sin(axis)
    x, y = c * vector[:, 0] + s * vector[:, 1], c * vector[:, 1] - s * vector[:, 0]
    length = np.hypot(x, y)
    return np.stack([x, y], -1) / np.where(length > 1e-12, length, np.inf)[:, None]


def _doubled(azimuth: Array) -> Array:
    """Cosine and sine of twice the angle, (n, 2)."""
    x, y = azimuth[:, 0], azimuth[:, 1]
    return np.stack([x * x - y * y, 2 * x * y], -1)


@dataclass(frozen=True)
class AzimuthCover:
    """Azimuths that the light came from: how many, the arc that they cover, its start, and the widest step in it.

    All but the count in degrees.
    """

    count: int
    covered: float
    start: float
    step: float

    @classmethod
    def of(cls, wi: Array) -> AzimuthCover:
        """Of the directions to the light, (N, 3)."""
        tilted = np.hypot(wi[:, 0], wi[:, 1]) > _STEEP
        phi = np.degrees(np.arctan2(wi[tilted, 1], wi[tilted, 0]))
        bins = np.unique(np.round(np.remainder(phi, 360) / _BIN_DEG).astype(int) % round(360 / _BIN_DEG)) * _BIN_DEG
        if bins.size < 2:
            return cls(int(bins.size), 0.0, float(bins[0]) if bins.size else 0.0, 0.0)
        gaps = np.diff(np.append(bins, bins[0] + 360))
        widest = int(np.argmax(gaps))
        others = np.delete(gaps, widest)
        return cls(
            int(bins.size), float(360 - gaps[widest]), float(bins[(widest + 1) % bins.size]), float(others.max())
        )

    def symmetries(self) -> tuple[str, ...]:
        """What a surface can be taken for whose light came from here; none if too few azimuths say anything.

        A quarter or a half of a turn was measured because the rest is its mirror image (as pabopto2bsdf of Radiance
        takes it); a half turn may also repeat itself.
        """
        turn = self._turn()
        return _SYMMETRIES[turn] if turn else ()

    def axes(self) -> tuple[float, ...]:
        """Azimuths in degrees where a mirror plane may lie.

        One, the first azimuth, where the cover reaches from plane to plane. Where it falls short of that, azimuths may
        be the centres of cells, half the shortfall off the planes at both ends, or one end was left out as the other's
        image; only samples tell which.
        """
        short = (self._turn() or self.covered) - self.covered
        return (self.start,) if short <= _SLACK_DEG else (self.start - short / 2, self.start, self.start - short)

    def _turn(self) -> int | None:
        """Degrees of the part of a turn that was measured; None where too few azimuths say anything."""
        if self.count < _LEAST_AZIMUTHS:
            return None
        for turn in _SYMMETRIES:
            if self.covered <= turn + _SLACK_DEG and self.covered + self.step >= turn - _SLACK_DEG:
                return turn
        return None
