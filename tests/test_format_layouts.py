"""Every format is read as its layout says: files written by it from a known BRDF give that BRDF back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from measured_materials.bake.directions import spherical
from measured_materials.bake.errors import BakeError
from measured_materials.bake.reading import Reading
from measured_materials.bake.source import Array, BrdfSource
from measured_materials.bake.sources import READERS, neural_brdf, read_source
from measured_materials.bake.sources.analytic import by_name
from support import format_files as files
from support.format_files import GLOSSY, GREY, error, pairs

TURNED = by_name("ggx", alpha=0.3, alpha_y=0.6, f0=(0.9, 0.5, 0.2))

# RMS of f cos cos over RMS of the signal, of pairs between the written directions. What limits each: steps of 10
# degrees and more (around the mirror, or of samples), cells without interpolation (Klems, trees), 15 degrees (UTIA).
LIMITS = {
    "NVIDIA MBSDF": 0.01,
    "Zemax BSDF": 0.06,
    "Integra DDR": 0.06,
    "LightTools": 0.06,
    "FRED": 0.06,
    "ASTM E2387": 0.06,
    "ALTA": 0.06,
    "table of samples": 0.06,
    "pab-opto": 0.06,
    "UTIA": 0.25,
    "WINDOW or Radiance XML": 0.25,
    "numpy array": 0.01,
}


@pytest.mark.parametrize("name", [name for name in files.WRITERS if name in LIMITS])
def test_a_known_brdf_comes_back(name: str, tmp_path: Path) -> None:
    suffix, write = files.WRITERS[name]
    source = read_source(write(tmp_path / f"sample{suffix}", GLOSSY))
    assert isinstance(source, BrdfSource)
    found = error(source, GLOSSY, name in GREY)
    assert found < LIMITS[name], found
    wi, wo = pairs(50)
    assert (source.evaluate(wi * [1, 1, -1], wo) == 0).all() and source.evaluate(wi[0], wo[0]).shape == (3,)


@pytest.mark.parametrize("name", files.WRITERS)
def test_content_decides_and_not_the_suffix(name: str, tmp_path: Path) -> None:
    suffix, write = files.WRITERS[name]
    path = write(tmp_path / f"sample{suffix}", GLOSSY)
    known = [reader.name for reader in READERS if reader.matches(path, path.read_bytes()[:64])]
    assert known == [name]


def test_every_reader_has_a_writer_here() -> None:
    elsewhere = {"MERL", "RGL", "Cornell goniometer"}  # tests/test_merl.py, test_rgl.py, test_cornell.py
    assert {reader.name for reader in READERS} == set(files.WRITERS) | elsewhere


@pytest.mark.parametrize(
    ("suffix", "write", "limit"),
    [
        (".bin", files.write_utia, 0.2),
        (".npy", files.write_npy, 0.05),
        (".xml", files.write_klems, 0.25),
        (".xml", files.write_tree, 0.35),
        (".bsdf", lambda path, source: files.write_zemax(path, source, np.arange(0.0, 360.0, 15.0)), 0.1),
    ],
    ids=["UTIA", "numpy", "Klems", "tree", "Zemax"],
)
def test_an_anisotropic_brdf_keeps_its_azimuths(suffix: str, write: files.Writer, limit: float, tmp_path: Path) -> None:
    source = read_source(write(tmp_path / f"brushed{suffix}", TURNED))
    grey = suffix in (".xml", ".bsdf")
    assert not source.isotropic
    found = error(source, TURNED, grey)
    assert found < limit, found
    # A quarter turn is another material: what would be seen if light or viewer had the wrong azimuth.
    quarter = by_name("ggx", alpha=0.6, alpha_y=0.3, f0=(0.9, 0.5, 0.2))
    assert error(source, quarter, grey) > 1.5 * limit


class _OneWay:
    """A BRDF that is not reciprocal: it tells the light from the viewer."""

    name, isotropic, bilateral = "one way", False, False
    facts = {"format": "test"}

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """Brighter where the light is low, and towards +x of the light and +y of the viewer."""
        wi, wo = np.broadcast_arrays(wi, wo)
        value = 0.06 + 0.15 * (1 - wi[..., 2]) + 0.045 * wi[..., 0] + 0.03 * wo[..., 1]
        above = (wi[..., 2] > 0) & (wo[..., 2] > 0)
        return np.repeat((value * above)[..., None], 3, -1)


@pytest.mark.parametrize(
    ("suffix", "write"),
    [
        (".bin", files.write_utia),
        (".npy", files.write_npy),
        (".xml", files.write_klems),
        (".xml", lambda path, source: files.write_klems(path, source, structure="Rows")),
        (".xml", lambda path, source: files.write_tree(path, source, 4)),
    ],
    ids=["UTIA", "numpy", "Klems columns", "Klems rows", "tree"],
)
def test_light_and_viewer_are_not_exchanged(suffix: str, write: files.Writer, tmp_path: Path) -> None:
    source = read_source(write(tmp_path / f"one_way{suffix}", _OneWay()))
    # Cells are up to 15 degrees wide; exchanged roles or a mirrored axis give at least 0.2.
    assert error(source, _OneWay()) < 0.08


def test_mbsdf_and_zemax_tell_their_channels(tmp_path: Path) -> None:
    wi, wo = spherical(0.4, 0.0), spherical(0.4, np.pi)
    rgb = read_source(files.write_mbsdf(tmp_path / "a.mbsdf", GLOSSY)).evaluate(wi, wo)
    assert rgb[0] > 1.5 * rgb[1] > 2 * rgb[2]
    xyz = read_source(files.write_zemax(tmp_path / "x.bsdf", by_name("lambert", diffuse=(0.2, 0.2, 0.2)), None, "XYZ"))
    # Equal X, Y, Z are bluish under D65, whose X is 0.95 and Z 1.09.
    assert xyz.evaluate(wi, wo)[0] > xyz.evaluate(wi, wo)[2]


@pytest.mark.parametrize(("side", "told"), [("Reflection Front", "back"), ("Reflection Back", "front")])
def test_the_side_of_a_window_layer_is_told(side: str, told: str, tmp_path: Path) -> None:
    source = read_source(files.write_klems(tmp_path / "a.xml", GLOSSY, side))
    assert str(source.facts["side"]).startswith(told) and side in str(source.facts["side"])


def test_a_network_is_what_its_layers_compute(tmp_path: Path) -> None:
    source = read_source(files.write_network(tmp_path / "rubber.npy"))
    assert source.name == "rubber"
    wi, wo = pairs(200)
    half = wi + wo
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    # By rotations instead of projections: about z by -phi_h, then about y by -theta_h.
    theta, phi = np.arccos(half[:, 2]), np.arctan2(half[:, 1], half[:, 0])
    expected = []
    for w, t, p in zip(wi, theta, phi, strict=True):
        about_z = np.array([[np.cos(p), np.sin(p), 0], [-np.sin(p), np.cos(p), 0], [0, 0, 1]])
        about_y = np.array([[np.cos(t), 0, -np.sin(t)], [0, 1, 0], [np.sin(t), 0, np.cos(t)]])
        x = np.concatenate([[np.sin(t), 0, np.cos(t)], about_y @ about_z @ w])
        for kernel, bias in files.network_weights()[:2]:
            x = np.maximum(x @ kernel + bias, 0)
        kernel, bias = files.network_weights()[2]
        expected.append(np.maximum(np.exp(x @ kernel + bias) - 1, 0))
    np.testing.assert_allclose(source.evaluate(wi, wo), expected, rtol=1e-5, atol=1e-6)


def test_a_network_without_one_of_its_parts_names_it(tmp_path: Path) -> None:
    path = files.write_network(tmp_path / "rubber.npy")
    (tmp_path / "rubber_b2.npy").unlink()
    with pytest.raises(BakeError, match=r"rubber_b2\.npy: is missing"):
        read_source(path)


def test_utia_says_how_its_numbers_were_read(tmp_path: Path) -> None:
    white = by_name("lambert", diffuse=(0.5, 0.5, 0.5))
    source = read_source(files.write_utia(tmp_path / "m.bin", white))
    albedos = source.facts["largest_albedo_of_readings"]
    assert source.facts["values_read_as"] == "linear" and isinstance(albedos, dict)
    np.testing.assert_allclose(albedos["linear"], 0.5, rtol=0.02)
    np.testing.assert_allclose(albedos["scaled"], 0.5 / 18.09, rtol=0.03)
    bright = np.fromfile(tmp_path / "m.bin") * 30
    bright.tofile(tmp_path / "m.bin")
    assert read_source(tmp_path / "m.bin").facts["values_read_as"] == "scaled"
    assert read_source(tmp_path / "m.bin", Reading(utia="linear")).facts["values_read_as"] == "linear"


@pytest.mark.parametrize(
    ("head", "unit"),
    [
        ("theta_i_deg,phi_i_deg,theta_o_deg,phi_o_deg,brdf", "deg"),
        ("Theta_I (rad); phi_i (rad); theta_r (rad); phi_r (rad); f", "rad"),
        ("# angles in degrees\ntheta_i,theta_o,phi_o,value", "deg"),
    ],
)
def test_a_table_states_its_units(head: str, unit: str, tmp_path: Path) -> None:
    scale = 1.0 if unit == "deg" else np.pi / 180
    mark = ";" if ";" in head else ","
    columns = len(head.splitlines()[-1].split(mark))
    rows = []
    for a in (0, 15, 30, 45, 60):
        for b in (0, 20, 40, 60):
            cells = [a * scale, 0.0, b * scale, 90 * scale, 0.3]
            rows.append(mark.join(f"{c:.8f}" for c in (cells if columns == 5 else [cells[0], *cells[2:]])))
    path = tmp_path / "t.csv"
    path.write_text("\n".join([head, *rows]))
    source = read_source(path)
    assert str(source.facts["units"]).startswith(unit)
    np.testing.assert_allclose(source.evaluate(spherical(0.5, 0.0), spherical(0.3, 1.0)), 0.3, rtol=0.01)


def test_a_table_without_units_is_not_guessed(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("theta_i,phi_i,theta_o,phi_o,brdf\n" + "0.5,0,0.5,1,0.3\n" * 20)
    with pytest.raises(BakeError, match="degrees or radians"):
        read_source(path)


def test_a_cosine_in_a_table_is_divided_out(tmp_path: Path) -> None:
    path, rows = tmp_path / "t.csv", []
    for a in (5, 20, 40, 60):
        for b in (5, 30, 50, 70):
            rows += [f"{a},0,{b},{p},{0.3 * np.cos(np.radians(b)):.9f}" for p in (0, 90, 180)]
    path.write_text("\n".join(["theta_i_deg,phi_i_deg,theta_o_deg,phi_o_deg,brdf_cos", *rows]))
    source = read_source(path)
    wi, wo = pairs(100, 60)
    np.testing.assert_allclose(source.evaluate(wi, wo), 0.3, rtol=0.01)


def test_an_anisotropic_set_of_samples_is_averaged_and_told(tmp_path: Path) -> None:
    rows = []
    for a in (10, 30, 50):
        for b in (10, 30, 50):
            for p in (0, 90, 180):
                rows += [f"{a},{turn},{b},{p + turn},{0.3 + 0.1 * (turn > 0)}" for turn in (0, 90)]
    path = tmp_path / "t.csv"
    path.write_text("\n".join(["theta_i_deg,phi_i_deg,theta_o_deg,phi_o_deg,brdf", *rows]))
    anisotropy = read_source(path).facts["anisotropy_averaged"]
    np.testing.assert_allclose(anisotropy, 0.05 / 0.35, rtol=1e-6)


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"<!DOCTYPE html><html><body>Not found</body>", "is a web page"),
        (b"\n  <html>", "is a web page"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:0", "pointer of Git LFS"),
        (b"/annex/objects/SHA256E-s1--0.bsdf", "pointer of git-annex"),
        (b"PK\x03\x04abcd", "zip archive"),
        (b"\x1f\x8b\x08abc", "gzip archive"),
        (b"\x89PNG\r\n\x1a\n", "PNG picture"),
        (b"v/1\x01\x02\0\0\0", "OpenEXR picture"),
        (b"SCATFUN\x01", "Fourier BSDF"),
    ],
)
@pytest.mark.parametrize("suffix", [".binary", ".bsdf", ".txt"])
def test_a_file_of_another_kind_is_named_for_what_it_is(data: bytes, says: str, suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"sample{suffix}"
    path.write_bytes(data + b"\n" + b"x" * 100)
    with pytest.raises(BakeError, match=says):
        read_source(path)


def test_networks_of_other_shapes_are_refused(tmp_path: Path) -> None:
    path = files.write_network(tmp_path / "n.npy")
    np.save(path, np.zeros((5, 21), np.float32))
    with pytest.raises(BakeError, match="6 inputs are expected"):
        neural_brdf.read(path)


def test_light_and_viewer_are_exchanged_or_averaged_by_choice(tmp_path: Path) -> None:
    path = files.write_npy(tmp_path / "one_way.npy", _OneWay())
    measured, exchanged, mean = (
        read_source(path, Reading(reciprocity=how)) for how in ("measured", "exchanged", "mean")
    )
    wi, wo = pairs(500)
    np.testing.assert_allclose(exchanged.evaluate(wi, wo), measured.evaluate(wo, wi))
    np.testing.assert_allclose(mean.evaluate(wi, wo), (measured.evaluate(wi, wo) + measured.evaluate(wo, wi)) / 2)
    np.testing.assert_allclose(mean.evaluate(wi, wo), mean.evaluate(wo, wi))
    assert "reciprocity" not in measured.facts and mean.facts["reciprocity"] == "mean"


@pytest.mark.parametrize(
    ("name", "value"),
    [("illuminant", "D50"), ("merl", "cells"), ("reciprocity", "both"), ("side", "top"), ("utia", "")],
)
def test_a_reading_that_does_not_exist_is_refused(name: str, value: str) -> None:
    with pytest.raises(BakeError, match=f"{name}: cannot be"):
        Reading(**{name: value})


def test_a_side_is_chosen_and_missing_ones_are_named(tmp_path: Path) -> None:
    path = files.write_klems(tmp_path / "a.xml", GLOSSY, "Reflection Front")
    assert str(read_source(path, Reading(side="back")).facts["side"]).startswith("back")
    with pytest.raises(BakeError, match="no reflection of its front"):
        read_source(path, Reading(side="front"))


@pytest.mark.parametrize(("suffix", "write"), [(".bsdf", files.write_zemax), (".ddr", files.write_integra)])
def test_no_black_rim_where_files_pad_with_zeros(suffix: str, write: files.Writer, tmp_path: Path) -> None:
    """Around the mirror direction, half of the angles lie below the horizon, where files hold 0."""
    source = read_source(write(tmp_path / f"white{suffix}", by_name("lambert", diffuse=(0.5, 0.5, 0.5))))
    phi = np.linspace(0, 2 * np.pi, 37)
    for theta_i in (20.0, 50.0, 74.0):
        wi, wo = spherical(np.radians(theta_i), 0.3), spherical(np.radians(86.0), phi)
        np.testing.assert_allclose(source.evaluate(wi, wo), 0.5 / np.pi, rtol=1e-3)
