"""Apparent movement that is the light's: lit flanks and shadows of relief shift along the light's azimuth as it rises.

A camera's movement knows nothing of the light; this one is smooth in its angle theta to the normal:

    d = c + h (a theta + b theta^2),   h = horizontal unit direction to the light, y down.

The powers, and how many photographs may miss the fit, were chosen on photographed and rendered stacks (a cubic, or a
quarter of misses, explains true movements away). Of fewer than seven photographs the square is left out, which could
bend to any that moved.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_POWERS = (1, 2)
_POWERS_OF_FEW = (1,)
_FEW = 7
_LEAST_PHOTOGRAPHS = 4
_ITERATIONS = 50
_LEAST_UNCERTAIN = 0.02

_F64 = NDArray[np.float64]


def light_drift(displacement: _F64, uncertain: _F64, directions: _F64 | None, bounds: _F64) -> _F64:
    """Part (n, 2) of the displacements that follows the light, 0 where the light does not explain nearly all of them.

    Parameters
    ----------
    displacement, uncertain : (n, 2) and (n,), of `shifts.Shifts`
    directions : (n, 3) to the light
    bounds : (n,) beyond which a displacement counts as movement; at most one in six photographs may miss the fit by
        more, or one where they are few
    """
    nothing = np.zeros_like(displacement)
    known = np.isfinite(displacement).all(axis=1)
    if directions is None or known.sum() < _LEAST_PHOTOGRAPHS:
        return nothing
    powers = _POWERS if known.sum() >= _FEW else _POWERS_OF_FEW
    rows, wanted = _rows(directions, powers)[known], displacement[known]
    sigma = np.maximum(uncertain[known], _LEAST_UNCERTAIN)
    misfit = np.zeros(len(wanted))
    for _ in range(_ITERATIONS):
        # Least absolute misfit by reweighting, so that photographs that did move do not bend the fit.
        weight = 1 / np.sqrt(sigma * (sigma + misfit))
        left = (rows * weight[:, None, None]).reshape(-1, rows.shape[2])
        solution = np.linalg.lstsq(left, (wanted * weight[:, None]).ravel(), rcond=None)[0]
        misfit = np.hypot(*(rows @ solution - wanted).T)
    if (misfit > bounds[known]).sum() > max(1, len(wanted) // 6):
        return nothing
    nothing[known] = rows @ solution
    return nothing


def _rows(directions: _F64, powers: tuple[int, ...]) -> _F64:
    """(n, 2, powers + 2) design matrix: along the light in powers of theta, and the common position."""
    flat = directions[:, :2] * [1, -1]
    length = np.hypot(*flat.T)
    towards = np.divide(flat, length[:, None], out=np.zeros_like(flat), where=length[:, None] > 1e-6)
    theta = np.arctan2(length, directions[:, 2])
    rows = np.zeros((len(theta), 2, len(powers) + 2))
    for k, power in enumerate(powers):
        rows[:, :, k] = towards * (theta**power)[:, None]
    rows[:, 0, -2] = rows[:, 1, -1] = 1
    return rows
