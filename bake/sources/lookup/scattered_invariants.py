"""What an isotropic, bilateral, reciprocal BRDF can depend on, and where the measurement ended."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...source import Array


class Invariants(NamedTuple):
    """Quantities of direction pairs, each (...); all functions of them used here are symmetric in cos_i, cos_o.

    sin2_h : squared sine of theta_h, from the half vector's tangential part so that the peak keeps its digits
    cos_d : cosine of theta_d
    cos_i, cos_o : cosines to the normal
    """

    sin2_h: Array
    cos_d: Array
    cos_i: Array
    cos_o: Array


def invariants(wi: Array, wo: Array, least_cosine: float = 0.0) -> Invariants:
    """Invariants of direction pairs, held at the edge of the measured range.

    A pair with a direction lower than any measured one is drawn together about its half vector, theta_h and
    phi_d kept, until both directions are measured ones. So a specular peak stays where it is and as wide
    as it is, and everything else keeps its last measured value. A half vector that is itself too low is
    raised to `least_cosine`.

    Parameters
    ----------
    wi, wo : (..., 3) unit vectors above the horizon; shapes broadcast
    least_cosine : smallest cosine to the normal that was measured
    """
    total, difference = wi + wo, wi - wo
    length = np.sqrt(np.maximum((total**2).sum(-1), 1e-24))
    sin2_h = np.minimum((total[..., 0] ** 2 + total[..., 1] ** 2) / length**2, 1 - least_cosine**2)
    cos_d = np.minimum(length / 2, 1.0)
    chord = np.sqrt((difference**2).sum(-1))
    # Unit vector along wi - wo: its z says how fast the two directions part in height when theta_d grows.
    tilt = np.abs(difference[..., 2]) / np.where(chord > 0, chord, 1.0)
    cos_h = np.maximum(total[..., 2] / length, least_cosine)
    radius = np.maximum(np.hypot(cos_h, tilt), 1e-12)
    theta_d = np.arctan2(chord, length)
    reachable = np.arccos(np.minimum(least_cosine / radius, 1.0)) - np.arctan2(tilt, cos_h)
    low = np.minimum(wi[..., 2], wo[..., 2]) < least_cosine
    held = np.where(low, np.clip(reachable, 0.0, theta_d), theta_d)
    cos_d = np.where(low, np.cos(held), cos_d)
    rise = tilt * np.sin(held)
    high, deep = cos_h * np.cos(held) + rise, cos_h * np.cos(held) - rise
    larger, smaller = np.maximum(wi[..., 2], wo[..., 2]), np.minimum(wi[..., 2], wo[..., 2])
    return Invariants(sin2_h, cos_d, np.where(low, high, larger), np.where(low, deep, smaller))
