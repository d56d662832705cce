"""Spectra in texts of goniometers become colours under the light that was chosen."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from measured_materials.bake.directions import spherical
from measured_materials.bake.reading import Reading
from measured_materials.bake.sources import read_source
from measured_materials.bake.spectrum import spectrum_to_rec709

WAVELENGTHS = np.arange(700.0, 399.0, -20.0)
# Bright at the red end, in steps that a lamp's own spectrum tells apart.
RED = 0.1 + 0.3 * (WAVELENGTHS > 590)


def write(path: Path, spectrum: np.ndarray) -> Path:
    """A diffuse surface of this spectrum, as ASTM or as a table by the suffix."""
    names = ",".join(f"{w:g}nm" for w in WAVELENGTHS)
    rows = []
    for theta_i in (0.1, 0.5, 0.9):
        for theta_o in (0.1, 0.4, 0.8):
            for phi in (0.0, 1.0, 3.0):
                rows.append(",".join(f"{v:.9g}" for v in (theta_i, 0.0, theta_o, phi, *(spectrum / np.pi))))
    if path.suffix == ".astm":
        head = [f"NUM_POINTS {len(rows)}", f"VARS theta_i,phi_i,theta_s,phi_s,{names}", ""]
    else:
        head = [f"theta_i_rad,phi_i_rad,theta_o_rad,phi_o_rad,{names}"]
    path.write_text("\n".join([*head, *rows]))
    return path


@pytest.mark.parametrize("suffix", [".astm", ".csv"])
@pytest.mark.parametrize("illuminant", ["D65", "E", "A", "LED-B3"])
def test_a_spectrum_has_its_colour_under_the_chosen_light(suffix: str, illuminant: str, tmp_path: Path) -> None:
    source = read_source(write(tmp_path / f"red{suffix}", RED), Reading(illuminant=illuminant))
    expected = spectrum_to_rec709(RED[::-1], WAVELENGTHS[::-1], illuminant) / np.pi
    found = source.evaluate(spherical(0.4, 0.0), spherical(0.3, 2.0))
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    # Another light gives another red: by 2 % and more between all four.
    others = {"D65", "E", "A", "LED-B3"} - {illuminant}
    for other in others:
        assert abs(spectrum_to_rec709(RED[::-1], WAVELENGTHS[::-1], other)[0] / np.pi / found[0] - 1) > 0.01
    white = read_source(write(tmp_path / f"white{suffix}", np.full(RED.size, 0.5)), Reading(illuminant=illuminant))
    np.testing.assert_allclose(white.evaluate(spherical(0.4, 0.0), spherical(0.3, 2.0)), 0.5 / np.pi, rtol=1e-6)
