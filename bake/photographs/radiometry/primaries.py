"""Primaries of RGB spaces and their conversion to linear Rec.709."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .color_marks import Chromaticities

Matrix = NDArray[np.float64]

_D65 = (0.3127, 0.3290)
_C = (0.310, 0.316)
_ACES_WHITE = (0.32168, 0.33767)
REC709: Chromaticities = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, *_D65)
KNOWN: dict[str, Chromaticities] = {
    "Rec.709": REC709,
    "Adobe RGB (1998)": (0.64, 0.33, 0.21, 0.71, 0.15, 0.06, *_D65),
    "Display P3": (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, *_D65),
    "DCI-P3": (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.314, 0.351),
    "BT.2020": (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, *_D65),
    "BT.470 M": (0.67, 0.33, 0.21, 0.71, 0.14, 0.08, *_C),
    "BT.601 625 lines": (0.64, 0.33, 0.29, 0.60, 0.15, 0.06, *_D65),
    "BT.601 525 lines": (0.630, 0.340, 0.310, 0.595, 0.155, 0.070, *_D65),
    "film, illuminant C": (0.681, 0.319, 0.243, 0.692, 0.145, 0.049, *_C),
    "EBU Tech. 3213": (0.630, 0.340, 0.295, 0.605, 0.155, 0.077, *_D65),
    "ACES2065-1 (AP0)": (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, *_ACES_WHITE),
    "ACEScg (AP1)": (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, *_ACES_WHITE),
    "ProPhoto RGB": (0.734699, 0.265301, 0.159597, 0.840403, 0.036598, 0.000105, 0.345704, 0.358540),
}
_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
_NEGLIGIBLE = 0.003
_SAME_PLACE = 0.0015


def matrix_to_xyz(space: Chromaticities) -> Matrix:
    """(3, 3) from linear RGB to XYZ with Y of white 1 (SMPTE RP 177)."""
    columns: Matrix = np.array([_xyz(space[k], space[k + 1]) for k in (0, 2, 4)]).T
    white = _xyz(space[6], space[7])
    matrix: Matrix = columns @ np.diag(np.linalg.solve(columns, white / white[1]))
    return matrix


def to_rec709(to_xyz: Matrix, adapt: bool = True) -> Matrix | None:
    """(3, 3) from linear values to linear Rec.709, given their matrix to XYZ; None where nothing would change.

    With `adapt` their neutral becomes Rec.709's neutral (linear Bradford transform, ICC.1:2022 annex E).
    """
    matrix = np.linalg.solve(matrix_to_xyz(REC709), (_adaptation(to_xyz.sum(axis=1)) if adapt else np.eye(3)) @ to_xyz)
    return None if np.abs(matrix - np.eye(3)).max() < _NEGLIGIBLE else matrix


def name_of(space: Chromaticities) -> str:
    """The usual name of primaries and white, else the numbers."""
    for name, known in KNOWN.items():
        if np.abs(np.subtract(known, space)).max() < _SAME_PLACE:
            return name
    return "primaries at x, y " + ", ".join(f"{space[k]:.4g} {space[k + 1]:.4g}" for k in (0, 2, 4, 6))


def _adaptation(white: NDArray[Any]) -> Matrix:
    """(3, 3) that takes XYZ seen under `white` to D65."""
    target = _xyz(*_D65)
    gains = (_BRADFORD @ (target / target[1])) / (_BRADFORD @ (white / white[1]))
    return np.linalg.solve(_BRADFORD, gains[:, None] * _BRADFORD)


def _xyz(x: float, y: float) -> NDArray[np.float64]:
    return np.array([x, y, 1 - x - y])
