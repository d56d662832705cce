"""Coefficients of a map over azimuth whose means are means of light, for a swatch seen from far away.

S = x max(sum_j c_j B_j, 0) is linear in the coefficients but where it is held at 0: there the sum of mean coefficients
lies below the mean of S, for light that one texel reflects is then taken off by another's that would be below black.
What was held back, d = max(-sum_j c_j B_j, 0) at all nodes, is put into the coefficients as far as the curves can
hold it: those of least squares, which are linear in d, so that they are averaged like the others.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .azimuth_basis import BLOCK, AzimuthBasis


def light_coefficients(basis: AzimuthBasis) -> NDArray[np.float32]:
    """Coefficients (H, W, 3, rank) without the hold at 0: where texels are averaged, the sum's mean is S's."""
    nodes = basis.nodes()
    # B^T (B B^T)^-1; curves that hardly differ on the nodes share what is held back.
    project = (np.linalg.pinv((nodes @ nodes.T).astype(np.float64), hermitian=True) @ nodes).T.astype(np.float32)
    flat = basis.coefficients.reshape(-1, basis.rank)
    found = flat.copy()
    for start in range(0, len(flat), BLOCK):
        held = flat[start : start + BLOCK] @ nodes
        np.negative(held, out=held)
        np.maximum(held, 0, out=held)
        found[start : start + BLOCK] += held @ project
    return found.reshape(basis.coefficients.shape)
