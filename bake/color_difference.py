"""How different two colours look: CIEDE2000, of linear Rec.709 as a display shows it."""

from __future__ import annotations

import numpy as np

from .source import Array

# Linear Rec.709 to CIE XYZ (ITU-R BT.709, primaries and D65). Lab wants shares of the white's: the rows' sums.
_XYZ = np.array(
    [
        [0.4123908, 0.3575843, 0.1804808],
        [0.2126390, 0.7151687, 0.0721923],
        [0.0193308, 0.1191948, 0.9505322],
    ]
)
_SHARES = _XYZ / _XYZ.sum(1, keepdims=True)
_LINEAR_END = (6 / 29) ** 3
_TWENTY_FIVE = 25.0**7
# Opposite hues count as not beyond half a turn, whatever they are rounded to.
_HALF_TURN = np.pi + 1e-9


def lab_of(linear: Array) -> Array:
    """CIE 1976 L*a*b* under D65 (ISO/CIE 11664-4) of linear Rec.709, (..., 3) both; white is (1, 1, 1)."""
    share = np.maximum(np.asarray(linear, np.float64), 0) @ _SHARES.T
    f = np.where(share > _LINEAR_END, np.cbrt(share), share / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.stack([116 * f[..., 1] - 16, 500 * (f[..., 0] - f[..., 1]), 200 * (f[..., 1] - f[..., 2])], -1)


def ciede2000(first: Array, second: Array) -> Array:
    """Colour difference (...) of L*a*b* colours (..., 3); about 1 is what an observer just sees side by side.

    Source: G. Sharma, W. Wu, E. N. Dalal, "The CIEDE2000 Color-Difference Formula: Implementation Notes,
    Supplementary Test Data, and Mathematical Observations", Color Research and Application 30(1), 2005, equations 2 to
    22, with the weights k_L, k_C, k_H at 1.
    """
    (l_1, c_1, h_1), (l_2, c_2, h_2) = _with_adjusted_chroma(first, second)
    both = c_1 * c_2 > 0
    turn = h_2 - h_1
    turn = np.where(both, turn - np.where(np.abs(turn) > _HALF_TURN, 2 * np.pi * np.sign(turn), 0), 0)
    d_l, d_c, d_h = l_2 - l_1, c_2 - c_1, 2 * np.sqrt(c_1 * c_2) * np.sin(turn / 2)
    mean_l, mean_c = (l_1 + l_2) / 2, (c_1 + c_2) / 2
    mean_h = _mean_hue(h_1, h_2, both)
    t = (
        1
        - 0.17 * np.cos(mean_h - np.radians(30))
        + 0.24 * np.cos(2 * mean_h)
        + 0.32 * np.cos(3 * mean_h + np.radians(6))
        - 0.20 * np.cos(4 * mean_h - np.radians(63))
    )
    away = (mean_l - 50) ** 2
    s_l, s_c, s_h = 1 + 0.015 * away / np.sqrt(20 + away), 1 + 0.045 * mean_c, 1 + 0.015 * mean_c * t
    angle = np.radians(60) * np.exp(-(((np.degrees(mean_h) - 275) / 25) ** 2))
    rotation = -np.sin(angle) * 2 * _saturation(mean_c)
    lightness, chroma, hue = d_l / s_l, d_c / s_c, d_h / s_h
    squared = lightness**2 + chroma**2 + hue**2 + rotation * chroma * hue
    difference: Array = np.sqrt(np.maximum(squared, 0))
    return difference


def _saturation(chroma: Array) -> Array:
    """sqrt(C^7 / (C^7 + 25^7)), which equations 4 and 19 share."""
    seventh = chroma**7
    return np.sqrt(seventh / (seventh + _TWENTY_FIVE))


def _with_adjusted_chroma(*colours: Array) -> list[tuple[Array, Array, Array]]:
    """Lightness, chroma and hue in [0, 2 pi) of both, a* stretched near grey (equations 2 to 7)."""
    plain = [np.hypot(lab[..., 1], lab[..., 2]) for lab in colours]
    stretch = 1 + 0.5 * (1 - _saturation((plain[0] + plain[1]) / 2))
    found = []
    for lab in colours:
        a, b = stretch * lab[..., 1], lab[..., 2]
        found.append((lab[..., 0], np.hypot(a, b), np.arctan2(b, a) % (2 * np.pi)))
    return found


def _mean_hue(h_1: Array, h_2: Array, both: Array) -> Array:
    """Mean of the hues across the smaller angle; their sum where one of the colours is grey (equation 14)."""
    total = h_1 + h_2
    across = np.abs(h_1 - h_2) > _HALF_TURN
    far = np.where(total < 2 * np.pi, total + 2 * np.pi, total - 2 * np.pi)
    return np.where(both, np.where(across, far, total) / 2, total)
