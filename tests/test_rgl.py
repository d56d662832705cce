"""RGL measurements: Mitsuba's values, closed forms, and files that lie."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from measured_materials.bake.directions import spherical
from measured_materials.bake.errors import BakeError
from measured_materials.bake.reading import Reading
from measured_materials.bake.source import BrdfSource
from measured_materials.bake.sources.rgl import READER, read_rgl
from measured_materials.bake.sources.tensor_file import MAGIC, write_tensor_file
from measured_materials.bake.spectrum import spectrum_to_rec709

CHANNELS = np.array([0.2, 0.5, 0.9])

# Mitsuba 3.9.1 `measured`, scalar_rgb, divided by cos(theta_o); see test_anisotropic_matches_mitsuba
MITSUBA_HALF_CIRCLE = [
    [0.410490, 1.026224, 1.847204],
    [0.344417, 0.861043, 1.549877],
    [1.419016, 3.547540, 6.385572],
    [3.003672, 7.509180, 13.516522],
]


def grid(height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    """u along the last axis, v along the first."""
    v, u = np.meshgrid(np.linspace(0, 1, height), np.linspace(0, 1, width), indexing="ij")
    return u, v


def closed_form_fields(phi_i=(0.0,), jacobian: int = 1, heights=(9, 5)) -> dict[str, np.ndarray | str]:
    """A file whose every table is bilinear, so that the reader must return the closed form exactly.

    The density 2u (1/2 + v) warps (u, v) from s = u^2, t = (v + v^2) / 2; D = 2 - u, sigma = 1 - u/2 and
    S = (1 + s + 2 t) (1 + slice's theta) (1 + slice's number / 10) times a factor per channel.
    """
    theta_i = np.array([0.0, 0.4, 1.1, np.pi / 2])
    u, v = grid(heights[0], 12)
    s, t = grid(heights[1], 6)
    factor = (1 + theta_i) * (1 + np.arange(len(phi_i)) / 10)[:, None]
    density = np.broadcast_to(2 * u * (0.5 + v), (*factor.shape, *u.shape))
    rgb = factor[..., None, None, None] * CHANNELS[:, None, None] * (1 + s + 2 * t)
    return {
        "description": "closed form\nof a test",
        "phi_i": np.asarray(phi_i),
        "theta_i": theta_i,
        "ndf": 2 - grid(2, 7)[0],
        "sigma": 1 - grid(2, 4)[0] / 2,
        # each slice has its own scale, which the reader has to take out
        "vndf": density * factor[..., None, None],
        "luminance": rgb.mean(2),
        "rgb": rgb,
        "jacobian": np.array([jacobian], np.uint8),
    }


def closed_form(theta_i, phi_i, wi, wo, factor=1.0, isotropic=True, jacobian=True):
    half = (wi + wo) / np.linalg.norm(wi + wo, axis=-1, keepdims=True)
    u = np.sqrt(np.arccos(half[..., 2]) * 2 / np.pi)
    phi_h = np.arctan2(half[..., 1], half[..., 0])
    v = np.remainder((phi_h - (phi_i if isotropic else 0) + np.pi) / (2 * np.pi), 1)
    value = factor * (1 + theta_i) * (1 + u**2 + v + v**2) / wo[..., 2]
    if jacobian:
        value = value * (2 - u) / (4 * (1 - np.sqrt(theta_i * 2 / np.pi) / 2))
    return value[..., None] * CHANNELS


def random_pairs(count: int, phi_range: tuple[float, float] = (-np.pi, np.pi)):
    rng = np.random.default_rng(7)
    theta_i, theta_o = np.arccos(rng.uniform(0.05, 0.95, (2, count)))
    phi_i, phi_o = rng.uniform(*phi_range, count), rng.uniform(-np.pi, np.pi, count)
    return theta_i, phi_i, spherical(theta_i, phi_i), spherical(theta_o, phi_o)


@pytest.fixture
def synthetic(tmp_path: Path):
    def write(**fields) -> Path:
        path = tmp_path / "synthetic.bsdf"
        write_tensor_file(path, {**closed_form_fields(), **fields})
        return path

    return write


def test_matches_mitsuba_on_every_measurement(shared_data: Path):
    folder = shared_data / "rgl"
    with (folder / "mitsuba_reference_fr.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    names = {row["file"] for row in rows}
    assert names == {path.name for path in folder.glob("*.bsdf")}
    for name in sorted(names):
        table = np.array([[float(x) for x in list(r.values())[1:]] for r in rows if r["file"] == name])
        theta_i, theta_o, phi_delta = np.radians(table[:, :3].T)
        value = read_rgl(folder / name).evaluate(spherical(theta_i, 0), spherical(theta_o, phi_delta))
        # the reference is float32; on the sharpest peak that costs 3e-4, elsewhere 1e-5
        np.testing.assert_allclose(value, table[:, 3:], rtol=1e-3, atol=1e-4, err_msg=name)


def test_facts_of_a_measurement(shared_data: Path):
    source = READER.read(shared_data / "rgl" / "chm_orange_rgb.bsdf", Reading())
    assert isinstance(source, BrdfSource)
    assert source.name == "chm_orange_rgb" and source.isotropic and not source.bilateral
    assert source.facts["description"] == "TeckWrap vinyl wrapping film (Orange CHM11E)"
    assert 0 < source.facts["negative_share"] < 0.5 and source.facts["most_negative"] < 0


@pytest.mark.parametrize("jacobian", [0, 1])
def test_closed_form(synthetic, jacobian):
    source = read_rgl(synthetic(jacobian=np.array([jacobian], np.uint8)))
    theta_i, phi_i, wi, wo = random_pairs(5000)
    expected = closed_form(theta_i, phi_i, wi, wo, jacobian=bool(jacobian))
    # all tables are bilinear and float64: only rounding is left
    np.testing.assert_allclose(source.evaluate(wi, wo), expected, rtol=1e-9)
    assert source.facts["description"] == "closed form of a test"
    assert source.facts["negative_share"] == 0


@pytest.mark.parametrize("span", [(-np.pi, np.pi), (0, np.pi), (1.0, 2.0)])
def test_two_azimuths_are_isotropic(tmp_path: Path, span):
    """As in Mitsuba and pbrt: half vectors count from wi. Of two that differ the mean is read."""
    path = tmp_path / "two.bsdf"
    write_tensor_file(path, closed_form_fields(span))
    source = read_rgl(path)
    theta_i, phi_i, wi, wo = random_pairs(2000)
    assert source.isotropic
    # The second is a tenth brighter.
    np.testing.assert_allclose(source.evaluate(wi, wo), closed_form(theta_i, phi_i, wi, wo, 1.05), rtol=1e-9)


def test_isotropic_values_turn_with_the_azimuth(synthetic):
    source = read_rgl(synthetic())
    theta, phi = np.radians([0.001, 20, 89]), np.arange(0.3, 6, 0.7)
    wi = spherical(theta[:, None, None], phi)
    wo = spherical(theta[:, None], phi + 2.0)
    value = source.evaluate(wi, wo)
    np.testing.assert_allclose(value, np.broadcast_to(value[..., :1, :], value.shape), rtol=1e-6)


@pytest.mark.parametrize("span", [(-np.pi, np.pi), (-np.pi, 0), (0, np.pi), (-np.pi, -np.pi / 2), (0, np.pi / 2)])
def test_anisotropic_closed_form(tmp_path: Path, span):
    path = tmp_path / "anisotropic.bsdf"
    nodes = np.linspace(*span, 5)
    write_tensor_file(path, closed_form_fields(nodes))
    source = read_rgl(path)
    assert not source.isotropic and not source.bilateral
    theta_i, phi_i, wi, wo = random_pairs(2000, span)
    factor = 1 + 0.4 * (phi_i - span[0]) / (span[1] - span[0])
    value = source.evaluate(wi, wo)
    # the slices differ in scale only, which the normalised density must not see
    np.testing.assert_allclose(value, closed_form(theta_i, phi_i, wi, wo, factor, False), rtol=1e-9)
    if span[1] - span[0] < 6:
        half_turn = np.array([-1, -1, 1])
        np.testing.assert_allclose(source.evaluate(wi * half_turn, wo * half_turn), value, rtol=1e-9)
    if span[1] - span[0] < 3:
        for mirror in ([-1, 1, 1], [1, -1, 1]):
            np.testing.assert_allclose(source.evaluate(wi * mirror, wo * mirror), value, rtol=1e-9)


def test_anisotropic_matches_mitsuba(tmp_path: Path):
    path = tmp_path / "half_circle.bsdf"
    # Mitsuba takes square tables only; the closed form does not depend on their size
    fields = closed_form_fields(np.linspace(-np.pi, 0, 5), heights=(12, 6))
    write_tensor_file(path, as_float32(fields))
    wi = spherical(np.radians([20, 50, 70, 35]), np.radians([-100, 40, 170, -10]))
    wo = spherical(np.radians([40, 10, 60, 80]), np.radians([30, -160, 100, 75]))
    np.testing.assert_allclose(read_rgl(path).evaluate(wi, wo), MITSUBA_HALF_CIRCLE, rtol=2e-5)


def as_float32(fields):
    """Mitsuba accepts no other float."""
    return {k: v.astype("f4") if getattr(v, "dtype", "") == "f8" else v for k, v in fields.items()}


def test_lambertian_surface_comes_back(tmp_path: Path):
    """Density 2u puts the node s at theta_h = s pi / 2; there the table holds the Lambertian radiance."""
    albedo, n_theta, size = 0.6, 24, 64
    theta_i = np.linspace(0, np.pi / 2, n_theta)
    s, t = grid(size, size)
    half = spherical(s * np.pi / 2, t * 2 * np.pi - np.pi)
    wi = spherical(theta_i, 0)[:, None, None]
    cos_o = 2 * (wi * half).sum(-1) * half[..., 2] - wi[..., 2]
    table = np.maximum(cos_o, 0) * albedo / np.pi
    path = tmp_path / "lambert.bsdf"
    fields = closed_form_fields(jacobian=0) | {
        "theta_i": theta_i,
        "vndf": np.broadcast_to(2 * grid(16, 16)[0], (1, n_theta, 16, 16)),
        "rgb": np.repeat(table[None, :, None], 3, 2),
    }
    fields["ndf"] = fields["sigma"] = np.ones((2, 2))
    write_tensor_file(path, fields)
    source = read_rgl(path)
    assert source.bilateral
    angle = np.radians(np.arange(5, 76, 10))
    value = source.evaluate(spherical(angle[:, None, None], 0), spherical(angle[:, None], np.arange(0.1, 6.2, 0.5)))
    # linear between slices 4 degrees apart; the error is 1 - cos(2 degrees), divided by cos(75 degrees)
    np.testing.assert_allclose(value, albedo / np.pi, rtol=1e-2)


def test_horizon_and_edges_are_finite(synthetic):
    source = read_rgl(synthetic())
    theta = np.concatenate([np.geomspace(1e-12, 1, 9), np.pi / 2 - np.geomspace(1e-12, 0.5, 9), [0, np.pi / 2]])
    phi = np.array([0, 1e-9, np.pi / 2, np.pi, -np.pi, 5.0])
    wi = spherical(theta[:, None, None], 0)
    for light in (wi, wi * [1, -1, 1]):
        assert np.isfinite(source.evaluate(light, spherical(theta[:, None], phi))).all()
    above, below = spherical(0.3, 1.0), spherical(np.array([np.pi / 2, 1.6, np.pi]), 0.5)
    assert not source.evaluate(above, below).any() and not source.evaluate(below, above).any()
    assert source.evaluate(above, above).shape == (3,)
    assert source.evaluate(np.zeros((0, 3)), above).shape == (0, 3)
    assert source.evaluate(above.astype("f4"), np.broadcast_to(above, (2, 1, 3))).shape == (2, 1, 3)


def test_genuine_measurement_is_finite_everywhere(shared_data: Path):
    source = read_rgl(shared_data / "rgl" / "irid_flake_paint1_rgb.bsdf")
    theta = np.radians(np.linspace(0, 90, 31))
    wi, wo = spherical(theta[:, None, None], 0), spherical(theta[:, None], np.linspace(-np.pi, np.pi, 25))
    value = source.evaluate(wi, wo)
    assert np.isfinite(value).all()
    assert not value[-1].any() and not value[:, -1].any()
    assert value[:-1, :-1].any()


def test_row_without_density(synthetic):
    density = np.ones((1, 4, 9, 12))
    density[..., 3:6, :] = 0
    wi, wo = random_pairs(500)[2:]
    assert np.isfinite(read_rgl(synthetic(vndf=density)).evaluate(wi, wo)).all()


def spoiled(name: str, value: float) -> dict[str, np.ndarray]:
    table = np.array(closed_form_fields()[name])
    table.flat[-1] = value
    return {name: table}


UNUSABLE = {
    "no ndf": ({"ndf": np.zeros((0, 2))}, "'ndf' has shape"),
    "ndf of one row": ({"ndf": np.ones((1, 8))}, "fewer than two"),
    "vndf of whole numbers": ({"vndf": np.ones((1, 4, 9, 12), int)}, "int64"),
    "vndf of fewer slices": ({"vndf": np.ones((1, 3, 9, 12))}, "do not fit"),
    "four channels": ({"rgb": np.ones((1, 4, 4, 5, 6))}, "do not fit"),
    "flat rgb": ({"rgb": np.ones(480)}, "'rgb' has shape"),
    "NaN": (spoiled("rgb", np.nan), "not finite"),
    "infinite": (spoiled("rgb", -np.inf), "not finite"),
    "overflow to come": (spoiled("rgb", 1e300), "out of range"),
    "negative density": (spoiled("vndf", -0.1), "out of range"),
    "sigma of 0": (spoiled("sigma", 0), "out of range"),
    "empty slice": ({"vndf": np.ones((1, 4, 9, 12)) * np.array([1, 1, 0, 1])[:, None, None]}, "any density"),
    "theta_i descends": ({"theta_i": np.array([0, 0.4, 0.3, 1.0])}, "does not ascend"),
    "theta_i repeats": ({"theta_i": np.array([0, 0.4, 0.4 + 1e-300, 1.0])}, "does not ascend"),
    "theta_i in degrees": ({"theta_i": np.array([0, 30.0, 60.0, 90.0])}, "does not ascend"),
    "jacobian missing": ({"jacobian": np.zeros(0, np.uint8)}, "'jacobian'"),
    "azimuths of a third": (closed_form_fields((0.0, 1.0, 2.0)), "whole, half or quarter"),
    "nearly one azimuth": (closed_form_fields((0.0, 1e-5, 2e-5)), "whole, half or quarter"),
}


@pytest.mark.parametrize("case", UNUSABLE)
def test_unusable_contents(synthetic, case):
    fields, cause = UNUSABLE[case]
    with pytest.raises(BakeError, match=cause) as caught:
        read_rgl(synthetic(**fields))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["phi_i", "theta_i", "ndf", "sigma", "vndf", "rgb", "jacobian"])
def test_missing_field_is_named(tmp_path: Path, name):
    fields = closed_form_fields()
    del fields[name]
    write_tensor_file(tmp_path / "x.bsdf", fields)
    with pytest.raises(BakeError, match=f"'{name}' is missing"):
        read_rgl(tmp_path / "x.bsdf")


def spectral_fields(illuminated=lambda nm: np.ones_like(nm)):
    """A file of the same BRDF in every wavelength, times a spectrum."""
    fields = closed_form_fields()
    grey = fields.pop("rgb")[:, :, :1]
    wavelengths = np.arange(360.0, 1000.0, 4.0)
    fields["spectra"] = (grey * illuminated(wavelengths)[:, None, None]).astype(np.float32)
    fields["wavelengths"] = wavelengths.astype(np.float32)
    return fields, grey


def test_a_flat_spectrum_is_grey_under_every_illuminant(tmp_path: Path):
    fields, grey = spectral_fields()
    write_tensor_file(tmp_path / "x.bsdf", fields)
    rgb = closed_form_fields() | {"rgb": np.repeat(grey, 3, 2)}
    write_tensor_file(tmp_path / "grey.bsdf", rgb)
    wi, wo = random_pairs(200)[2:]
    truth = read_rgl(tmp_path / "grey.bsdf").evaluate(wi, wo)
    for illuminant in ("D65", "E", "A", "LED-B3"):
        source = read_rgl(tmp_path / "x.bsdf", Reading(illuminant=illuminant))
        np.testing.assert_allclose(source.evaluate(wi, wo), truth, rtol=1e-5)
        assert source.facts["illuminant"] == illuminant and source.facts["wavelength_count"] == 160


def test_a_red_spectrum_has_the_colour_of_its_sum(tmp_path: Path):
    """Beside the spectrum summed over the observer here: a step at 600 nm, under D65 and under A."""

    def step(nm):
        return (nm >= 600).astype(float)

    fields, grey = spectral_fields(step)
    write_tensor_file(tmp_path / "red.bsdf", fields)
    write_tensor_file(tmp_path / "grey.bsdf", closed_form_fields() | {"rgb": np.repeat(grey, 3, 2)})
    wi, wo = random_pairs(50)[2:]
    flat = read_rgl(tmp_path / "grey.bsdf").evaluate(wi, wo)
    reds = []
    for illuminant in ("D65", "A", "LED-B3"):
        colour = spectrum_to_rec709(step(fields["wavelengths"]), fields["wavelengths"], illuminant)
        found = read_rgl(tmp_path / "red.bsdf", Reading(illuminant=illuminant)).evaluate(wi, wo)
        np.testing.assert_allclose(found, flat * colour, rtol=1e-4, atol=1e-6)
        reds.append(colour[0])
    # Lamplight has more red than daylight.
    assert reds[1] > 1.2 * reds[0]


def test_spectra_and_wavelengths_have_to_agree(tmp_path: Path):
    fields, _ = spectral_fields()
    write_tensor_file(tmp_path / "x.bsdf", fields | {"wavelengths": fields["wavelengths"][:-1]})
    with pytest.raises(BakeError, match="differ: 160 and 159"):
        read_rgl(tmp_path / "x.bsdf")
    write_tensor_file(tmp_path / "x.bsdf", fields | {"wavelengths": fields["wavelengths"][::-1].copy()})
    with pytest.raises(BakeError, match="increase"):
        read_rgl(tmp_path / "x.bsdf")


def test_every_truncation_is_refused(synthetic):
    path = synthetic()
    whole = path.read_bytes()
    for size in [*range(0, 420, 7), *np.linspace(420, len(whole) - 1, 60).astype(int)]:
        path.write_bytes(whole[:size])
        with pytest.raises(BakeError):
            read_rgl(path)


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.tuples(st.integers(0, 419), st.integers(0, 255)), min_size=1, max_size=6))
def test_only_bake_error_escapes_a_spoiled_header(synthetic, changes):
    path = synthetic()
    data = bytearray(path.read_bytes())
    for position, value in changes:
        data[position] = value
    path.write_bytes(data)
    wi, wo = random_pairs(20)[2:]
    try:
        source = READER.read(path, Reading())
    except BakeError as error:
        assert "\n" not in str(error)
    else:
        assert np.isfinite(source.evaluate(wi, wo)).all()


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.tuples(st.floats(0, 1), st.binary(min_size=8, max_size=8)), min_size=1, max_size=4))
def test_only_bake_error_escapes_spoiled_numbers(synthetic, changes):
    path = synthetic()
    data = bytearray(path.read_bytes())
    for where, value in changes:
        position = 424 + int(where * (len(data) - 432)) // 8 * 8
        data[position : position + 8] = value
    path.write_bytes(data)
    wi, wo = random_pairs(20)[2:]
    try:
        assert np.isfinite(READER.read(path, Reading()).evaluate(wi, wo)).all()
    except BakeError as error:
        assert "\n" not in str(error)


def test_reader_recognises_its_format(tmp_path: Path):
    assert READER.matches(tmp_path / "x", MAGIC + bytes(52))
    assert not READER.matches(tmp_path / "x.bsdf", b"\x5a\0\0\0" + bytes(60))
    assert ".bsdf" in READER.suffixes
