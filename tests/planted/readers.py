"""Readers of measurements."""

from __future__ import annotations

from .mistake import Mistake

COLOURS = "tests/test_reader_colours.py"
CORNELL = f"{COLOURS}::test_cornell_spectra_have_their_published_colour"

MISTAKES = (
    Mistake(
        "merl-zeros-are-holes",
        "bake/sources/merl.py",
        "plane > 0, plane >= 0)",
        "plane > 0, plane > 0)",
        (f"{COLOURS}::test_genuine_zeros_of_merl_stay_zero",),
        "a channel that a paint absorbs is filled from its neighbours",
    ),
    Mistake(
        "merl-zeros-below-the-horizon-are-values",
        "bake/sources/merl.py",
        "plane > 0, plane >= 0)",
        "plane >= 0, plane >= 0)",
        ("tests/test_merl.py::test_zeros_below_the_horizon_draw_no_black_ring",),
        "a black ring at grazing angles",
    ),
    Mistake(
        "merl-green-scale",
        "bake/sources/merl.py",
        "1.15 / 1500",
        "1.0 / 1500",
        (f"{COLOURS}::test_merl_numbers_have_their_published_scale",),
        "green 13 % too dark in every MERL material",
    ),
    Mistake(
        "merl-small-negatives-are-values",
        "bake/sources/merl.py",
        "finite & np.where(below, plane > 0, plane >= 0)",
        "finite & np.where(below, plane > 0, plane >= -1e-3)",
        (f"{COLOURS}::test_holes_of_merl_are_filled_and_zeros_beside_them_not",),
        "marks of missing entries are read as light",
    ),
    Mistake(
        "merl-mirror-half-one-off",
        "bake/sources/merl.py",
        "else -np.arange(steps // 2 + 1) % steps",
        "else (-1 - np.arange(steps // 2 + 1)) % steps",
        (
            "tests/test_merl.py::test_mirror_halves_are_averaged_and_their_difference_told",
            "tests/test_merl.py::test_round_trip",
        ),
        "each highlight is smeared by a degree of phi_d",
    ),
    Mistake(
        "merl-holes-across-theta-h-first",
        "bake/sources/merl.py",
        "(((0, 1), (0, -1), (1, 1), (1, -1)), ((2, 1), (2, -1)))",
        "(((2, 1), (2, -1)), ((0, 1), (0, -1), (1, 1), (1, -1)))",
        ("tests/test_merl.py::test_holes_are_filled_close_to_truth",),
        "holes in a highlight are filled with what lies beside it",
    ),
    Mistake(
        "cornell-white-of-equal-energy",
        "bake/sources/cornell.py",
        "xyz_weights(samples.wavelengths, illuminant)",
        'xyz_weights(samples.wavelengths, "E")',
        (CORNELL,),
        "20 % of red: every Cornell paint is too warm",
    ),
    Mistake(
        "cornell-matrix-untransposed",
        "bake/sources/cornell.py",
        "xyz_to_rec709(white_point(illuminant)).T",
        "xyz_to_rec709(white_point(illuminant))",
        (CORNELL,),
        "colours of another world",
    ),
    Mistake(
        "observer-without-daylight",
        "bake/spectrum.py",
        "observer *= np.interp(_GRID, D65_WAVELENGTHS, D65)[:, None]",
        "observer *= 1",
        (CORNELL,),
        "spectra are lit by equal energy and called daylight",
    ),
    Mistake(
        "daylight-table-one-off",
        "bake/spectrum.py",
        "D65_WAVELENGTHS = np.arange(380.0, 781.0, 10.0)",
        "D65_WAVELENGTHS = np.arange(390.0, 791.0, 10.0)",
        (CORNELL, "tests/test_spectrum.py::test_white_chromaticity"),
        "the illuminant is shifted by 10 nm: hues of saturated paints",
    ),
    Mistake(
        "green-primary",
        "bake/spectrum.py",
        "[0.30, 0.60]",
        "[0.21, 0.71]",
        (CORNELL,),
        "colours are Adobe RGB and called Rec.709",
    ),
    Mistake(
        "rgl-negatives-cut",
        "bake/sources/rgl.py",
        "value = self._rgb.evaluate(*self._warp(u_h, v_h, slices), slices)",
        "value = np.maximum(self._rgb.evaluate(*self._warp(u_h, v_h, slices), slices), 0)",
        (f"{COLOURS}::test_zeros_and_negatives_of_rgl_stay_what_they_are",),
        "noise about 0 becomes light, and no fact reports it",
    ),
    Mistake(
        "rgl-projected-area-forgotten",
        "bake/sources/rgl.py",
        "(ndf / (4 * sigma * cosine))",
        "(ndf / (4 * cosine))",
        ("tests/test_rgl.py::test_closed_form",),
        "too dark at grazing light",
    ),
)
