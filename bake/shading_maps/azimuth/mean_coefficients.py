"""Coefficients of a map over azimuth whose means are means of light, for a swatch seen from far away.

S = x max(sum_j c_j B_j, 0) is linear in the coefficients but where it is held at 0: there the sum of mean coefficients
lies below the mean of S, for light that one place reflects is then taken off by another's that would be below black.
What is held back, d = max(-sum_j c_j B_j, 0), is put into the coefficients as far as the curves can hold it: by those
of least squares over levels and azimuths, which are linear in d, so that they are averaged like the others.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .azimuth_basis import BLOCK, AzimuthBasis

# Of two nodes in a row one is asked, in level and azimuth: curves are smooth, and there are up to two thousand.
_EVERY = 2


def light_coefficients(basis: AzimuthBasis) -> NDArray[np.float32]:
    """Coefficients (H, W, 3, rank) of which a mean over some texels gives about the mean of S there.

    Between texels coefficients are interpolated before they are held at 0, as the shader does it: a fourth of what is
    held back is that at a texel, a fourth each that halfway to the next across, down, and both.
    """
    # From x = 1 down, in parts of the level; at x = 0 there is no light.
    nodes = basis.curves[:, ::_EVERY, :0:-_EVERY].reshape(basis.rank, -1)
    # B^T (B B^T)^-1; curves that hardly differ on the nodes share what is held back.
    inverse = np.linalg.pinv((nodes @ nodes.T).astype(np.float64), hermitian=True)
    project = (inverse @ nodes).T.astype(np.float32)
    found = basis.coefficients.copy()
    flat = found.reshape(-1, basis.rank)
    for axes in ((), (0,), (1,), (0, 1)):
        between = basis.coefficients
        for axis in axes:
            between = (between + np.roll(between, -1, axis)) * np.float32(0.5)
        places = between.reshape(-1, basis.rank)
        for start in range(0, len(flat), BLOCK):
            here = slice(start, start + BLOCK)
            held = places[here] @ nodes
            np.negative(held, out=held)
            np.maximum(held, 0, out=held)
            flat[here] += (held @ project) * np.float32(0.25)
    return found
