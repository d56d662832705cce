"""Closed-form transmission of a thin sheet."""

from __future__ import annotations

import math

import numpy as np

from .. import xp_numpy
from ..source import Array
from .cosine_lobes import cosine_lobe

Rgb = tuple[float, float, float]
_HORIZON = 1e-12


def forward_btdf(wi: Array, wo: Array, diffuse: Rgb, forward: Rgb, exponent: float) -> Array:
    """diffuse / pi + forward (n + 2) / (2 pi) cos^n of the angle between wo and -wi, which goes straight on.

    Lewis' modified Phong model (1994, "Making shaders more physically plausible") about -wi in place of the mirror
    direction: reciprocal; the lobe lets `forward` through at normal incidence, and less elsewhere.

    Parameters
    ----------
    wi, wo : (..., 3) unit vectors; shapes broadcast

    Returns
    -------
    (..., 3) in 1/sr without the cosine; 0 where both are on the same side
    """
    wi, wo = np.broadcast_arrays(np.asarray(wi, np.float64), np.asarray(wo, np.float64))
    one_minus_cos = 0.5 * ((wi + wo) ** 2).sum(-1)
    curve = cosine_lobe(xp_numpy, "power", one_minus_cos, np.float64(max(exponent, 1e-12)))
    lobe = (exponent + 2) / (2 * math.pi) * np.where(one_minus_cos < 1, curve, 0)
    value = np.array(diffuse) / math.pi + np.array(forward) * lobe[..., None]
    heights = wi[..., 2:], wo[..., 2:]
    opposite = (np.minimum(*map(np.abs, heights)) > _HORIZON) & (heights[0] * heights[1] < 0)
    return np.where(opposite, value, 0)
