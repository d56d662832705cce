"""Spectra to linear Rec.709 through the CIE 1931 2-degree observer.

A reflectance spectrum has no colour until it is lit. Here it is lit by D65, the white of Rec.709, so that a
flat reflectance of 1 gives RGB (1, 1, 1). Colours outside Rec.709 keep their negative component: clipping it
would change the luminance, and whoever stores the result counts negatives anyway.

Data: CIE 15:2018, tables T.4 (observer, 5 nm), T.1 (D65, 10 nm; the CIE defines D65 between these
points by linear interpolation, so the shorter table loses nothing) and T.12 (LED-B3, 5 nm).
"""

from __future__ import annotations

import numpy as np

from .reading import Illuminant
from .source import Array

OBSERVER_WAVELENGTHS = np.arange(380.0, 781.0, 5.0)
OBSERVER = np.array(
    [
        """
        0.001368 0.002236 0.004243 0.00765 0.01431 0.02319 0.04351 0.07763 0.13438 0.21477
        0.2839 0.3285 0.34828 0.34806 0.3362 0.3187 0.2908 0.2511 0.19536 0.1421
        0.09564 0.05795 0.03201 0.0147 0.0049 0.0024 0.0093 0.0291 0.06327 0.1096
        0.1655 0.22575 0.2904 0.3597 0.43345 0.51205 0.5945 0.6784 0.7621 0.8425
        0.9163 0.9786 1.0263 1.0567 1.0622 1.0456 1.0026 0.9384 0.85445 0.7514
        0.6424 0.5419 0.4479 0.3608 0.2835 0.2187 0.1649 0.1212 0.0874 0.0636
        0.04677 0.0329 0.0227 0.01584 0.011359 0.008111 0.00579 0.004109 0.002899 0.002049
        0.00144 0.001 0.00069 0.000476 0.000332 0.000235 0.000166 0.000117 8.3e-05 5.9e-05
        4.2e-05
        """.split(),
        """
        3.9e-05 6.4e-05 0.00012 0.000217 0.000396 0.00064 0.00121 0.00218 0.004 0.0073
        0.0116 0.01684 0.023 0.0298 0.038 0.048 0.06 0.0739 0.09098 0.1126
        0.13902 0.1693 0.20802 0.2586 0.323 0.4073 0.503 0.6082 0.71 0.7932
        0.862 0.91485 0.954 0.9803 0.99495 1 0.995 0.9786 0.952 0.9154
        0.87 0.8163 0.757 0.6949 0.631 0.5668 0.503 0.4412 0.381 0.321
        0.265 0.217 0.175 0.1382 0.107 0.0816 0.061 0.04458 0.032 0.0232
        0.017 0.01192 0.00821 0.005723 0.004102 0.002929 0.002091 0.001484 0.001047 0.00074
        0.00052 0.000361 0.000249 0.000172 0.00012 8.5e-05 6e-05 4.2e-05 3e-05 2.1e-05
        1.5e-05
        """.split(),
        """
        0.00645 0.01055 0.02005 0.03621 0.06785 0.1102 0.2074 0.3713 0.6456 1.03905
        1.3856 1.62296 1.74706 1.7826 1.77211 1.7441 1.6692 1.5281 1.28764 1.0419
        0.81295 0.6162 0.46518 0.3533 0.272 0.2123 0.1582 0.1117 0.07825 0.05725
        0.04216 0.02984 0.0203 0.0134 0.00875 0.00575 0.0039 0.00275 0.0021 0.0018
        0.00165 0.0014 0.0011 0.001 0.0008 0.0006 0.00034 0.00024 0.00019 0.0001
        5e-05 3e-05 2e-05 1e-05
        """.split()
        + ["0"] * 27,
    ],
    dtype=float,
).T
"""x-bar, y-bar, z-bar at `OBSERVER_WAVELENGTHS`, (81, 3)."""

D65_WAVELENGTHS = np.arange(380.0, 781.0, 10.0)
D65 = np.array(
    """
    49.9755 54.6482 82.7549 91.486 93.4318 86.6823 104.865 117.008 117.812 114.861
    115.923 108.811 109.354 107.802 104.79 107.689 104.405 104.046 100 96.3342
    95.788 88.6856 90.0062 89.5991 87.6987 83.2886 83.6992 80.0268 80.2146 82.2778
    78.2842 69.7213 71.6091 74.349 61.604 69.8856 75.087 63.5927 46.4182 66.8054
    63.3828
    """.split(),
    dtype=float,
)
"""Relative power of illuminant D65 at `D65_WAVELENGTHS`, (41,)."""

LED_B3 = np.array(
    """
    0 0 0.01 0.02 0.05 0.11 0.25 0.56 1.2 2.37
    4.24 7.17 12.11 17.7 18.87 14.58 9.9 7.53 6.02 5.11
    5.17 5.82 6.77 7.88 8.94 9.82 10.52 11.06 11.51 11.93
    12.37 12.83 13.31 13.79 14.26 14.68 15.08 15.42 15.72 15.97
    16.18 16.37 16.5 16.55 16.5 16.32 16 15.54 14.96 14.27
    13.48 12.62 11.71 10.78 9.85 8.93 8.04 7.2 6.42 5.69
    5.02 4.42 3.88 3.39 2.95 2.56 2.22 1.92 1.65 1.43
    1.23 1.06 0.91 0.78 0.68 0.58 0.5 0.43 0.37 0.32
    0.28
    """.split(),
    dtype=float,
)
"""Relative power of illuminant LED-B3 at `OBSERVER_WAVELENGTHS`, (81,): a blue LED under a phosphor, 4103 K.

The numbers are those of the data sets of colour-science 0.4.7 (BSD-3-Clause), which cite CIE 15:2018; they give the
chromaticity that the CIE publishes for it, x = 0.3756 and y = 0.3723.
"""

REC709_PRIMARIES = np.array([[0.64, 0.33], [0.30, 0.60], [0.15, 0.06]])
"""Chromaticities x, y of red, green and blue (ITU-R BT.709-6, table 1)."""

_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
_GRID = np.arange(380.0, 781.0, 1.0)


def xyz_weights(wavelengths: Array, illuminant: Illuminant = "D65") -> Array:
    """Weights that turn a sampled reflectance into CIE XYZ under an illuminant.

    The spectrum is taken as linear between its samples and constant beyond the first and the last
    (CIE 15:2018, 7.2.3, nearest value), then summed over the observer at 1 nm.

    Parameters
    ----------
    wavelengths : (L,) strictly increasing, nm
    illuminant : "D65"; "E", equal energy; "A", incandescent light; or "LED-B3", a white LED of 4103 K

    Returns
    -------
    (L, 3) weights W; `spectra @ W` is XYZ with Y = 1 for the perfect reflector. All weights are >= 0.

    Raises
    ------
    ValueError : wavelengths are not strictly increasing finite numbers, or miss 380 to 780 nm altogether
    """
    wavelengths = np.asarray(wavelengths, dtype=float)
    if wavelengths.ndim != 1 or not wavelengths.size or not np.isfinite(wavelengths).all():
        raise ValueError("wavelengths must be a list of finite numbers")
    if (np.diff(wavelengths) <= 0).any():
        raise ValueError("wavelengths must increase strictly")
    if wavelengths[0] > _GRID[-1] or wavelengths[-1] < _GRID[0]:
        raise ValueError("wavelengths lie outside 380 to 780 nm")
    observer = np.stack([np.interp(_GRID, OBSERVER_WAVELENGTHS, OBSERVER[:, c]) for c in range(3)], -1)
    if illuminant == "D65":
        observer *= np.interp(_GRID, D65_WAVELENGTHS, D65)[:, None]
    elif illuminant == "A":
        observer *= illuminant_a(_GRID)[:, None]
    elif illuminant == "LED-B3":
        observer *= np.interp(_GRID, OBSERVER_WAVELENGTHS, LED_B3)[:, None]
    observer /= observer[:, 1].sum()
    inside = np.clip(_GRID, wavelengths[0], wavelengths[-1])
    lower = np.clip(np.searchsorted(wavelengths, inside, side="right") - 1, 0, max(wavelengths.size - 2, 0))
    upper = np.minimum(lower + 1, wavelengths.size - 1)
    span = wavelengths[upper] - wavelengths[lower]
    share = (inside - wavelengths[lower]) / np.where(span > 0, span, 1.0)
    weights = np.zeros((wavelengths.size, 3))
    np.add.at(weights, lower, (1 - share)[:, None] * observer)
    np.add.at(weights, upper, share[:, None] * observer)
    return weights


def illuminant_a(wavelengths: Array) -> Array:
    """Relative power of illuminant A, 100 at 560 nm: Planck's law at 2848 K by the older c2 (CIE 15:2018, eq. 2.2)."""
    second = 1.435e7
    ratio = np.expm1(second / (2848 * 560)) / np.expm1(second / (2848 * wavelengths))
    power: Array = 100 * (560 / wavelengths) ** 5 * ratio
    return power


def white_point(illuminant: Illuminant = "D65") -> Array:
    """XYZ of the perfect reflector, (3,), Y = 1."""
    return xyz_weights(np.array([560.0]), illuminant)[0]


def xyz_to_rec709(white: Array | None = None) -> Array:
    """Matrix from XYZ to linear Rec.709, the given white mapped to (1, 1, 1).

    Parameters
    ----------
    white : (3,) XYZ of the white the spectra are lit by; default that of the D65 table itself, which differs
        from the standard's rounded (0.3127, 0.3290) by 7e-5 and makes flat reflectances exactly grey. Another
        white is adapted to D65 by the Bradford transform.

    Returns
    -------
    (3, 3) matrix M for column vectors: rgb = M @ xyz, or xyz @ M.T for rows.
    """
    d65 = white_point("D65")
    x, y = REC709_PRIMARIES.T
    primaries = np.stack([x / y, np.ones(3), (1 - x - y) / y])
    from_xyz: Array = np.linalg.inv(primaries * np.linalg.solve(primaries, d65))
    if white is not None:
        cone_gain = (_BRADFORD @ d65) / (_BRADFORD @ np.asarray(white, dtype=float))
        from_xyz = from_xyz @ np.linalg.solve(_BRADFORD, cone_gain[:, None] * _BRADFORD)
    return from_xyz


def spectrum_to_rec709(spectra: Array, wavelengths: Array, illuminant: Illuminant = "D65") -> Array:
    """Linear Rec.709 of reflectance or BRDF spectra lit by an illuminant, D65 by default.

    Parameters
    ----------
    spectra : (..., L) values at the wavelengths
    wavelengths : (L,) strictly increasing, nm

    Returns
    -------
    (..., 3) in the unit of the spectra; a flat spectrum v gives (v, v, v). Not clipped.

    Raises
    ------
    ValueError : see `xyz_weights`
    """
    matrix = xyz_to_rec709(white_point(illuminant))
    return np.asarray(spectra, dtype=float) @ (xyz_weights(wavelengths, illuminant) @ matrix.T)
