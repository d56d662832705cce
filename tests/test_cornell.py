"""Scattered samples: recovery of a known BRDF, symmetries, damaged files, held-out error on real paints."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from measured_materials.bake.directions import spherical
from measured_materials.bake.errors import BakeError
from measured_materials.bake.reading import Reading
from measured_materials.bake.source import BrdfSource, luminance
from measured_materials.bake.sources import cornell, read_source
from measured_materials.bake.sources.lookup import scattered
from measured_materials.bake.sources.lookup.scattered_coordinates import coordinates
from measured_materials.bake.sources.lookup.scattered_invariants import invariants
from measured_materials.bake.sources.lookup.scattered_lobes import nonnegative_least_squares
from measured_materials.bake.spectrum import spectrum_to_rec709

LARGEST_THETA = np.radians(80)
PAINTS = ("acryl_blue", "cayman", "garnet_red")


def known_brdf(wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
    """Diffuse plus a Ward-like lobe, of no family that the candidates contain."""
    half = wi + wo
    half = half / np.linalg.norm(half, axis=-1, keepdims=True)
    tan2 = (half[..., 0] ** 2 + half[..., 1] ** 2) / half[..., 2] ** 2
    cos_d = (wi * half).sum(-1)
    lobe = np.exp(-tan2 / 0.15**2) * (0.05 + 0.95 * (1 - cos_d) ** 5)
    lobe /= np.sqrt(wi[..., 2] * wo[..., 2]) * 4 * np.pi * 0.15**2
    return np.array([0.10, 0.05, 0.02]) / np.pi + lobe[..., None]


def goniometer_directions() -> tuple[np.ndarray, np.ndarray]:
    """About 1400 pairs laid out like the published files: eight incidences times a polar grid."""
    theta_i, theta_o, phi = np.meshgrid(
        np.radians(np.arange(10, 81, 10)), np.radians(np.arange(4, 81, 8)), np.linspace(0, np.pi, 18), indexing="ij"
    )
    return spherical(theta_i.ravel(), 0.0), spherical(theta_o.ravel(), phi.ravel())


def random_pairs(count: int, largest_theta: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    cosine = rng.uniform(np.cos(largest_theta), 1, (2, count))
    phi = rng.uniform(-np.pi, np.pi, (2, count))
    return spherical(np.arccos(cosine[0]), phi[0]), spherical(np.arccos(cosine[1]), phi[1])


@pytest.fixture(scope="module")
def fit() -> scattered.ScatteredBrdf:
    wi, wo = goniometer_directions()
    return scattered.fit_scattered(wi, wo, known_brdf(wi, wo))


def test_known_brdf_is_recovered(fit: scattered.ScatteredBrdf) -> None:
    wi, wo = random_pairs(4000, LARGEST_THETA)
    truth, guess = known_brdf(wi, wo), fit.evaluate(wi, wo)
    cosine = np.minimum(wi[:, 2], wo[:, 2])[:, None]
    relative_rms = np.sqrt(np.mean(((guess - truth) * cosine) ** 2) / np.mean((truth * cosine) ** 2))
    # Samples 8 to 10 degrees apart see a lobe of 8.6 degrees; what is left is the asinh curve between them.
    assert relative_rms < 0.03
    assert np.median(np.abs(guess - truth) / truth) < 0.005


def test_symmetries_are_exact(fit: scattered.ScatteredBrdf) -> None:
    wi, wo = random_pairs(500, np.pi / 2)
    value = fit.evaluate(wi, wo)
    np.testing.assert_array_equal(value, fit.evaluate(wo, wi))
    mirror = np.array([1.0, -1.0, 1.0])
    np.testing.assert_allclose(value, fit.evaluate(wi * mirror, wo * mirror), rtol=1e-9)
    turn = np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]])
    # The peak turns rounding of the half vector (1e-16) into at most this.
    np.testing.assert_allclose(value, fit.evaluate(wi @ turn.T, wo @ turn.T), rtol=1e-7)


def test_finite_and_bounded_up_to_the_horizon(fit: scattered.ScatteredBrdf) -> None:
    theta = np.pi / 2 - np.array([0.0, 1e-12, 1e-6, 1e-3, 0.05, 0.2, np.pi / 2])
    phi = np.linspace(-np.pi, np.pi, 9)
    wi = spherical(theta, 0.0)[:, None, None]
    value = fit.evaluate(wi, spherical(theta[:, None], phi))
    wo_samples = goniometer_directions()
    assert np.isfinite(value).all() and value.min() >= 0
    assert value.max() <= known_brdf(*wo_samples).max() * (1 + 1e-9)
    below = spherical(np.array(1.6), 0.0)
    assert (fit.evaluate(below, wi[3, 0, 0]) == 0).all() and (fit.evaluate(wi[3, 0, 0], below) == 0).all()


def test_values_beyond_the_measurement_continue_the_edge(fit: scattered.ScatteredBrdf) -> None:
    wi = spherical(np.radians(30), 0.0)
    edge, beyond = (fit.evaluate(wi, spherical(np.radians(t), np.radians(90))) for t in (79.9, 88.0))
    # No black ring at grazing: 8 degrees further the diffuse side has changed by less than a tenth.
    np.testing.assert_allclose(beyond, edge, rtol=0.1)


def test_held_pairs_keep_their_half_vector_and_the_limit() -> None:
    limit = np.cos(LARGEST_THETA)
    wi, wo = random_pairs(3000, np.pi / 2, seed=3)
    free, held = invariants(wi, wo), invariants(wi, wo, limit)
    inside = np.minimum(wi[:, 2], wo[:, 2]) >= limit
    for a, b in zip(free, held):
        np.testing.assert_allclose(a[inside], b[inside], atol=1e-12)
    assert (np.minimum(held.cos_i, held.cos_o) >= limit - 1e-9).all()
    reachable = free.sin2_h < 1 - limit**2
    np.testing.assert_allclose(held.sin2_h[reachable], free.sin2_h[reachable])
    np.testing.assert_allclose(
        (held.cos_i + held.cos_o)[reachable] / 2, (np.sqrt(1 - held.sin2_h) * held.cos_d)[reachable], atol=1e-9
    )


def test_invariants_at_equal_and_at_opposite_directions() -> None:
    up, east, west = spherical(0.0, 0.0), spherical(np.pi / 2, 0.0), spherical(np.pi / 2, np.pi)
    for limit in (0.0, 0.2):
        for pair in ((up, up), (east, east), (east, west), (up, east)):
            assert np.isfinite(invariants(*pair, limit)).all()


def test_every_candidate_can_be_forced_and_reports_its_error() -> None:
    wi, wo = (v[::6] for v in goniometer_directions())
    values = known_brdf(wi, wo)
    pair = random_pairs(50, np.pi / 2)
    for method in ("kernel", "spline", "lobes", "lobes+spline"):
        fit = scattered.fit_scattered(wi, wo, values, method)
        assert fit.method == method and np.isfinite(fit.evaluate(*pair)).all()
        assert set(fit.facts["left_out_errors"]) == {"kernel", "spline", "lobes", "lobes+spline"}


def test_left_out_error_is_the_error_without_the_sample(monkeypatch: pytest.MonkeyPatch) -> None:
    """The closed form against really leaving a sample out, with one setting so that both fits agree on it."""
    monkeypatch.setattr(scattered, "PEAK_WIDTHS", (0.1,))
    wi, wo = (v[::12] for v in goniometer_directions())
    y = np.arcsinh(known_brdf(wi, wo) / 0.02)
    noise, nothing = np.linspace(1, 3, len(y)), np.zeros_like(y)
    pair = invariants(wi, wo)
    whole = scattered._spline_pair(pair, y, nothing, noise, 0.1, 1e-3)[0]
    for k in (0, 17, 60):
        rest = np.delete(np.arange(len(y)), k)
        part = scattered._spline_pair(
            type(pair)(*(v[rest] for v in pair)), y[rest], nothing[rest], noise[rest], 0.1, 1e-3
        )[0]
        assert part.interpolant is not None
        guess = part.interpolant(coordinates(pair, 0.1)[k : k + 1])
        # The ridge on the tail acts about another mean in each fit.
        np.testing.assert_allclose(guess[0], whole.left_out[k], rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("value", [0.0, 1e-30, 1e7, -0.01])
def test_degenerate_values(value: float) -> None:
    wi, wo = random_pairs(40, LARGEST_THETA)
    guess = scattered.fit_scattered(wi, wo, np.full((40, 3), value)).evaluate(*random_pairs(50, np.pi / 2))
    # A constant is reproduced, but not below the scale at which values count as dark (1e-9).
    np.testing.assert_allclose(guess, max(value, 0), rtol=1e-3, atol=1e-11)


def test_repeated_and_coplanar_samples() -> None:
    wi, wo = spherical(np.full(30, 0.5), 0.0), spherical(np.repeat(np.linspace(0, 1.2, 10), 3), 0.0)
    fit = scattered.fit_scattered(wi, wo, known_brdf(wi, wo))
    assert np.isfinite(fit.evaluate(*random_pairs(100, np.pi / 2))).all()


def test_too_many_samples_are_thinned_but_keep_the_peak(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scattered, "MAX_CENTRES", 300)
    wi, wo = goniometer_directions()
    fit = scattered.fit_scattered(wi, wo, known_brdf(wi, wo))
    assert fit.facts["samples_fitted"] == 300 and fit.facts["samples_left_aside"] == len(wi) - 300
    mirror = spherical(np.radians(40), np.pi)
    truth = known_brdf(spherical(np.radians(40), 0.0), mirror)
    # A fifth of the samples still show the lobe's height to a quarter.
    np.testing.assert_allclose(fit.evaluate(spherical(np.radians(40), 0.0), mirror), truth, rtol=0.25)


def test_nonnegative_least_squares_against_scipy() -> None:
    nnls = pytest.importorskip("scipy.optimize").nnls
    rng = np.random.default_rng(5)
    for _ in range(20):
        matrix, target = rng.normal(size=(30, 5)), rng.normal(size=30)
        # The ridge of 1e-10 of the trace moves the solution by about as much.
        np.testing.assert_allclose(nonnegative_least_squares(matrix, target), nnls(matrix, target)[0], atol=1e-7)


HEADER = "# Cornell\n# num wls\n3\n# wls\n450 550\n650\n\n"
ROW = "0.5 0.0 {theta} {phi} 0.1 0.2 0.3"


def text_file(rows: int = 20) -> str:
    lines = [ROW.format(theta=0.05 * (k % 20), phi=0.3 * k - 3) for k in range(rows)]
    return HEADER + "\n".join(lines) + "\n"


def test_small_file_is_read(tmp_path: Path) -> None:
    path = tmp_path / "grey.brdf"
    path.write_text(text_file())
    source = cornell.READER.read(path, Reading())
    assert isinstance(source, BrdfSource) and source.isotropic and source.bilateral
    assert source.name == "grey" and source.facts["comments"] == ["Cornell"]
    assert source.facts["wavelengths_nm"] == [450, 650] and source.facts["samples"] == 20
    value = source.evaluate(spherical(0.5, 0.0), spherical(0.4, 1.0))
    assert value.shape == (3,) and 0.05 < value[2] < value[0] < 0.5
    assert cornell.READER.matches(path, path.read_bytes()[:64])
    assert not cornell.READER.matches(path, b"MERL")


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("", "is empty"),
        ("  \n\n", "is empty"),
        ("# only a comment\n", "line 1: the number of wavelengths"),
        ("3 4\n", "line 1: the number of wavelengths"),
        ("-1\n", "line 1: the number of wavelengths"),
        ("2.5\n", "line 1: the number of wavelengths"),
        ("1e30\n", "line 1: the number of wavelengths"),
        ("nan\n", "line 1: 'nan' is not finite"),
        ("three\n", "line 1: 'three' is not a number"),
        ("3\n450 550\n", "line 2: ends after 2 of 3 wavelengths"),
        ("3\n450 550 650 700\n", "line 2: 4 wavelengths instead of 3"),
        ("3\n450 450 650\n", "line 2: wavelengths must increase"),
        ("2\n4500 5500\n", "line 2: wavelengths lie outside"),
        (HEADER, "holds 0 samples"),
        (text_file(11), "holds 11 samples"),
        (text_file() + "0.5 0 0.5 0 1 2\n", "line 28: 6 columns instead of 7"),
        (text_file() + "0.5 0 0.5 0 1 2 3 4\n", "line 28: 8 columns instead of 7"),
        (text_file() + "0.5 0 0.5 0 1 x 3\n", "line 28: 'x' is not a number"),
        (text_file() + "0.5 0 0.5 0 1 inf 3\n", "line 28: 'inf' is not finite"),
        (text_file() + "0.5 0 0.5 0 1 1e300 3\n", "line 28: a BRDF value exceeds"),
        (text_file() + "0.5 0 1.5708 0 1 2 3\n", "line 28: theta_s = 1.5708 is not between"),
        (text_file() + "-0.1 0 0.5 0 1 2 3\n", "line 28: theta_i = -0.1 is not between"),
        (text_file() + "0.5 0 0.5 180 1 2 3\n", "line 28: an azimuth"),
        (text_file() + "0.5 0 0.5 0 1 2 3" + " " * 70_000 + "\n", "line 28: is longer than"),
    ],
)
def test_malformed_text(tmp_path: Path, text: str, cause: str) -> None:
    path = tmp_path / "bad.brdf"
    path.write_text(text)
    with pytest.raises(BakeError) as caught:
        cornell.read_samples(path)
    assert cause in caught.value.cause and "\n" not in str(caught.value)


def test_binary_and_missing_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "junk.brdf"
    for data in (b"\x00\x01\x02" * 50, b"3\n\xff\xfe 4\n", np.random.default_rng(0).bytes(4000)):
        path.write_bytes(data)
        with pytest.raises(BakeError, match=r"line [12]"):
            cornell.read_samples(path)
    with pytest.raises(BakeError, match="cannot be read"):
        cornell.read_samples(tmp_path / "none.brdf")
    with pytest.raises(BakeError, match="cannot be read"):
        cornell.read_samples(tmp_path)
    path.write_text(text_file())
    monkeypatch.setattr(cornell, "MAX_BYTES", 100)
    with pytest.raises(BakeError, match="MiB"):
        cornell.read_samples(path)


def test_every_cut_of_a_file_is_read_or_refused(tmp_path: Path) -> None:
    path, whole = tmp_path / "cut.brdf", text_file().encode()
    for length in range(0, len(whole), 7):
        path.write_bytes(whole[:length])
        try:
            cornell.read_samples(path)
        except BakeError:
            continue


def test_held_out_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "grey.brdf"
    path.write_text(text_file(30))
    assert cornell.main([str(path)]) == 0 and "grey" in capsys.readouterr().out
    assert cornell.main([str(tmp_path / "none.brdf")]) == 1
    assert cornell.main([]) == 2


@pytest.mark.parametrize("paint", PAINTS)
def test_real_paint_predicts_held_out_samples(shared_data: Path, paint: str) -> None:
    errors = cornell.held_out_error(shared_data / "cornell" / f"{paint}.brdf")
    # Measured 1.5 to 2.9 %; these paints violate reciprocity by 3 to 18 % between incidences of 30 and 50
    # degrees, so a reciprocal fit cannot do much better.
    assert errors["median_relative"] < 0.04
    # Measured 7.6 to 10.2 %. It depends on whether a peak sample is held out; with seed 0 none of the three
    # brightest is.
    assert errors["relative_rms"] < 0.13
    assert errors["log_cos_rms"] < 0.08


def test_real_paint_source(shared_data: Path, tmp_path: Path) -> None:
    original = shared_data / "cornell" / "garnet_red.brdf"
    renamed = tmp_path / "paint.txt"
    shutil.copyfile(original, renamed)
    assert cornell.READER.matches(renamed, original.read_bytes()[:64])
    source = read_source(original)
    assert source.facts["comments"][1] == "Garnet Red" and source.facts["samples"] == 1439
    assert source.facts["interpolation"] in ("spline", "lobes+spline")
    nadir = source.evaluate(spherical(np.radians(20), 0.0), spherical(np.radians(45), np.radians(90)))
    assert nadir[0] > 1.3 * nadir[1] > 0


def test_real_paint_is_smooth_between_samples(shared_data: Path) -> None:
    """In the plane of incidence the curve must not go up and down much more than the samples on it do."""
    path = shared_data / "cornell" / "garnet_red.brdf"
    source, samples = read_source(path), cornell.read_samples(path)
    truth = luminance(spectrum_to_rec709(samples.values, samples.wavelengths))
    for degrees in (10, 30, 50):
        wi = spherical(np.radians(degrees), 0.0)
        on_slice = (np.abs(samples.wi - wi).max(-1) < 1e-3) & (np.abs(samples.wo[:, 1]) < 1e-6)
        theta = np.arctan2(samples.wo[on_slice, 0], samples.wo[on_slice, 2])
        variation = np.abs(np.diff(np.log(truth[on_slice][np.argsort(theta)]))).sum()
        fine = np.linspace(theta.min(), theta.max(), 801)
        curve = source.evaluate(wi, spherical(np.abs(fine), np.where(fine < 0, np.pi, 0)))
        # Measured 0.94 to 1.04; a bump of 10 % at each of the 20 samples would add half of the whole or more.
        assert np.abs(np.diff(np.log(luminance(curve)))).sum() < 1.15 * variation
