"""Readers end to end in colour, of small synthetic files: what a measurement's numbers have to become, and its zeros.

The files are written here byte by byte, and the colours computed from published data, so that neither a writer nor a
formula of the package stands on both sides.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from measured_materials.bake.directions import spherical
from measured_materials.bake.sources import read_source
from measured_materials.bake.sources.tensor_file import write_tensor_file
from numpy.typing import NDArray
from test_rgl import closed_form_fields

Array = NDArray[np.float64]

# CIE 15:2018, table T.4 (2-degree observer) at every 20 nm from 400 on, and table T.1 (D65) there.
NM = np.arange(400, 701, 20)
X_BAR = [0.01431, 0.13438, 0.34828, 0.2908, 0.09564, 0.0049, 0.06327, 0.2904]
X_BAR += [0.5945, 0.9163, 1.0622, 0.85445, 0.4479, 0.1649, 0.04677, 0.011359]
Y_BAR = [0.000396, 0.004, 0.023, 0.06, 0.13902, 0.323, 0.71, 0.954]
Y_BAR += [0.995, 0.87, 0.631, 0.381, 0.175, 0.061, 0.017, 0.004102]
Z_BAR = [0.06785, 0.6456, 1.74706, 1.6692, 0.81295, 0.272, 0.07825, 0.0203]
Z_BAR += [0.0039, 0.00165, 0.0008, 0.00019, 2e-5, 0, 0, 0]
D65 = [82.7549, 93.4318, 104.865, 117.812, 115.923, 107.802, 104.79, 104.405, 100.0, 95.788, 90.0062, 87.6987]
D65 += [83.6992, 80.2146, 78.2842, 71.6091]
# IEC 61966-2-1.
TO_RGB = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])


WHITE = np.array([0.95047, 1.0, 1.08883])


def published_colour(reflectance: Callable[[Array], Array]) -> Array:
    """Linear Rec.709 (3,) of a smooth reflectance under D65, by the sum over 20 nm (CIE 15:2018, 7.2).

    The sum of so few misses the white by up to 1.6 %; what is left of that in parts of the white is half a per cent.
    """
    lit = np.array([X_BAR, Y_BAR, Z_BAR]) * np.array(D65)
    return TO_RGB @ (lit @ reflectance(NM.astype(float)) / lit.sum(1) * WHITE)


# Smooth, and as broad as paints' are.
SPECTRA: dict[str, Callable[[Array], Array]] = {
    "white": lambda nm: np.ones_like(nm),
    "grey": lambda nm: np.full_like(nm, 0.2),
    "blue": lambda nm: 0.1 + 0.6 * np.exp(-(((nm - 450) / 60) ** 2)),
    "green": lambda nm: 0.1 + 0.5 * np.exp(-(((nm - 540) / 60) ** 2)),
    "red": lambda nm: 0.05 + 0.8 / (1 + np.exp(-(nm - 600) / 25)),
    "falling": lambda nm: 0.9 - 0.7 * (nm - 400) / 300,
}


def cornell_file(path: Path, reflectance: Callable[[Array], Array], step: int) -> Path:
    """About 100 pairs of a Lambertian of this reflectance at 400 to 700 nm, in the format's own words."""
    nm = np.arange(400.0, 701.0, step)
    values = " ".join(f"{v:.9g}" for v in reflectance(nm) / np.pi)
    lines = [f"{len(nm)}", " ".join(f"{v:g}" for v in nm)]
    for theta_i in (0.2, 0.6, 1.0):
        for theta_o in (0.1, 0.4, 0.7, 1.0, 1.2):
            lines += [f"{theta_i} 0 {theta_o} {phi:.3f} {values}" for phi in np.linspace(0, 3.1, 7)]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("step", [5, 20])
@pytest.mark.parametrize("name", SPECTRA)
def test_cornell_spectra_have_their_published_colour(tmp_path: Path, name: str, step: int) -> None:
    source = read_source(cornell_file(tmp_path / f"{name}.brdf", SPECTRA[name], step))
    wi, wo = spherical(np.array([0.3, 0.7, 0.9]), 0.0), spherical(np.array([0.5, 0.2, 1.1]), np.array([0.3, 1.4, 2.6]))
    found = source.evaluate(wi, wo) * np.pi
    expected = published_colour(SPECTRA[name])
    assert np.abs(found - expected).max() < 0.015 * expected.max(), (found[0], expected)
    if name in ("white", "grey"):
        level = SPECTRA[name](np.ones(1))[0]
        # Grey stays grey: the observer's white is the colour space's. The samples' interpolation leaves 1e-3.
        assert np.abs(found / level - 1).max() < 2e-3
        assert np.ptp(found, axis=-1).max() < 1e-6 * level


def merl_file(path: Path, planes: Array) -> Path:
    """(3, 90, 90, 180) float64 numbers as they stand in a file."""
    path.write_bytes(np.array([90, 90, 180], "<i4").tobytes() + planes.astype("<f8").tobytes())
    return path


# Of the authors' BRDFRead.cpp: what a stored number is multiplied by.
MERL_SCALES = np.array([1.00 / 1500, 1.15 / 1500, 1.66 / 1500])


def pairs_in_cells(theta_h_rows: tuple[int, int]) -> tuple[Array, Array]:
    """Directions whose half vectors lie well between two rows of MERL's theta_h, theta_d from 5 to 40 degrees."""
    rng = np.random.default_rng(3)
    row = rng.uniform(theta_h_rows[0] + 1, theta_h_rows[1] - 2, 500)
    theta_h, theta_d, phi_d = (row / 90) ** 2 * np.pi / 2, np.radians(rng.uniform(5, 40, 500)), rng.uniform(0, 3, 500)
    local = spherical(theta_d, phi_d)
    cosine, sine = np.cos(theta_h), np.sin(theta_h)
    wi = np.stack(
        [cosine * local[:, 0] + sine * local[:, 2], local[:, 1], cosine * local[:, 2] - sine * local[:, 0]], -1
    )
    half = spherical(theta_h, 0.0)
    return wi, 2 * np.sum(wi * half, -1, keepdims=True) * half - wi


def test_merl_numbers_have_their_published_scale(tmp_path: Path) -> None:
    planes = np.empty((3, 90, 90, 180))
    planes[0], planes[1], planes[2] = 30.0, 60.0, 90.0
    source = read_source(merl_file(tmp_path / "even.binary", planes))
    wi, wo = pairs_in_cells((10, 40))
    np.testing.assert_allclose(
        source.evaluate(wi, wo), np.broadcast_to([30, 60, 90] * MERL_SCALES, wi.shape), rtol=1e-6
    )


@pytest.mark.parametrize("channel", [0, 1, 2])
def test_genuine_zeros_of_merl_stay_zero(tmp_path: Path, channel: int) -> None:
    """A channel that a paint absorbs was measured as 0: it is no hole, and its neighbours say nothing about it."""
    planes = np.full((3, 90, 90, 180), 45.0)
    planes[channel, 20:40] = 0
    source = read_source(merl_file(tmp_path / "black.binary", planes))
    wi, wo = pairs_in_cells((20, 40))
    found = source.evaluate(wi, wo)
    assert not found[:, channel].any()
    others = [c for c in range(3) if c != channel]
    np.testing.assert_allclose(found[:, others], np.broadcast_to(45 * MERL_SCALES[others], (len(wi), 2)), rtol=1e-6)
    assert source.facts["invalid"] == [0, 0, 0] and source.facts["filled_from_neighbours"] == 0


def test_a_black_channel_of_merl_stays_black(tmp_path: Path) -> None:
    planes = np.full((3, 90, 90, 180), 45.0)
    planes[1] = 0
    planes[1, 60] = 1.0
    source = read_source(merl_file(tmp_path / "black.binary", planes))
    wi, wo = pairs_in_cells((10, 50))
    assert not source.evaluate(wi, wo)[:, 1].any()


@pytest.mark.parametrize("mark", [-1.0, -1e-6, np.nan, np.inf])
def test_holes_of_merl_are_filled_and_zeros_beside_them_not(tmp_path: Path, mark: float) -> None:
    """A hole between zeros is 0, one between values is their mean: both by their own neighbours."""
    planes = np.full((3, 90, 90, 180), 45.0)
    planes[:, 20:40] = 0
    planes[:, 30, 20:22] = mark
    planes[:, 60, 20:22] = mark
    source = read_source(merl_file(tmp_path / "holes.binary", planes))
    table = source.table
    assert not table[30].any()
    np.testing.assert_allclose(table[60, 10:30], np.broadcast_to(45 * MERL_SCALES, (20, 91, 3)), rtol=1e-6)
    assert source.facts["invalid"] == [720, 720, 720]


def test_zeros_and_negatives_of_rgl_stay_what_they_are(tmp_path: Path) -> None:
    """Red as in the closed form, green 0, blue below 0: a measurement minus its dark frame."""
    fields = closed_form_fields(jacobian=0)
    rgb = np.array(fields["rgb"])
    rgb[:, :, 1] = 0
    rgb[:, :, 2] = -rgb[:, :, 0]
    write_tensor_file(tmp_path / "zeros.bsdf", {**fields, "rgb": rgb})
    source = read_source(tmp_path / "zeros.bsdf")
    wi, wo = spherical(np.array([0.3, 0.8]), 0.4), spherical(np.array([0.6, 0.2]), np.array([2.0, 3.0]))
    found = source.evaluate(wi, wo)
    assert (found[:, 0] > 0).all() and not found[:, 1].any()
    np.testing.assert_array_equal(found[:, 2], -found[:, 0])
