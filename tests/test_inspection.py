"""What `inspect` finds in measurements: reciprocity, gaps, readings by held-out samples; and the figures it draws."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured_materials.addon.cli import inspect
from measured_materials.addon.cli.main import main
from measured_materials.addon.plots import figure
from measured_materials.addon.plots.brdf_plots import FIGURES, draw_brdf, figure_files
from measured_materials.addon.summary.survey_rows import survey_rows
from measured_materials.bake.bundle.origin import file_origin, mark_of
from measured_materials.bake.images.png import png_about
from measured_materials.bake.inspection.curves import albedo_curves, angles_picture, reciprocity_map, slices
from measured_materials.bake.inspection.readings import READINGS, held_out
from measured_materials.bake.inspection.survey import survey, weighted_median
from measured_materials.bake.reading import Reading
from measured_materials.bake.source import Array
from measured_materials.bake.sources.analytic import Ggx, Lambert, ModifiedPhong
from measured_materials.bake.sources.exchanged import Exchanged
from measured_materials.bake.sources.rgl import read_rgl
from measured_materials.bake.tables.accuracy import direction_pairs
from support.rgl_writer import write_anisotropic_rgl


@dataclass(frozen=True)
class Made:
    """An isotropic source of a function of wi and wo."""

    value: Callable[[Array, Array], Array]
    facts: dict[str, Any] = field(default_factory=dict)
    name: str = "made"
    isotropic: bool = True
    bilateral: bool = True

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """BRDF in 1/sr, grey."""
        wi, wo = np.broadcast_arrays(wi, wo)
        return np.repeat(self.value(wi, wo)[..., None], 3, -1)


LEANING = Made(lambda wi, wo: (1 + 0.5 * wi[..., 2]) / np.pi)


# --- survey -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("source", [Lambert(), Ggx(alpha=0.1), Ggx(alpha=0.1, alpha_y=0.3)], ids=str)
def test_reciprocal_materials_are_told_to_be(source: Any) -> None:
    found: Any = survey(source)
    assert found["reciprocity"]["rms"] < 1e-9 and found["negative_share"] == 0
    assert dict(survey_rows(found, None, Reading()))["Reciprocity"] == "light and viewer may change places"


def test_reciprocity_of_a_material_that_leans_on_the_light() -> None:
    """f = (1 + a cos theta_i) / pi: the mean square of a (cos_i - cos_o) cos_i cos_o over that of (1 + a cos_i) cos_i
    cos_o, of uniform cosines, in closed form."""
    a = 0.5
    difference = a * a * 2 * (1 / 5 * 1 / 3 - (1 / 4) ** 2)
    signal = (1 / 3 + 2 * a / 4 + a * a / 5) / 3
    found: Any = survey(LEANING)
    assert found["reciprocity"]["rms"] == pytest.approx(math.sqrt(difference / signal), rel=0.01)
    turned: Any = survey(Exchanged(LEANING, "exchanged"))
    assert turned["reciprocity"]["median"] == pytest.approx(found["reciprocity"]["median"], rel=0.05)
    assert "changes" in dict(survey_rows(found, None, Reading()))["Reciprocity"]


def test_shares_of_negative_invalid_and_extrapolated() -> None:
    """Negative where the light is below 30 degrees from the horizon: half of the hemisphere's solid angle."""
    low = Made(lambda wi, wo: np.where(wi[..., 2] < 0.5, -0.1, 1.0))
    found: Any = survey(low)
    assert found["negative_share"] == pytest.approx(0.5, abs=0.02)
    assert found["invalid_share"] is None and found["extrapolated_share"] is None

    def told(**facts: Any) -> Any:
        return survey(Made(lambda wi, wo: wi[..., 2], facts))

    merl = told(invalid=[10, 20, 30], entries_per_channel=150, below_horizon=50)
    assert merl["invalid_share"] == pytest.approx(0.2)
    assert told(largest_measured_theta_deg=60)["extrapolated_share"] == pytest.approx(0.25)
    scattered = told(largest_measured_theta_deg=60, samples_fitted=99)
    assert scattered["extrapolated_share"] == pytest.approx(1 - 0.75**2) and scattered["invalid_share"] == 0
    assert told(largest_measured_theta_deg=90)["extrapolated_share"] == 0


def test_weighted_median() -> None:
    assert weighted_median(np.array([3.0, 1, 2]), np.array([1.0, 1, 1])) == 2
    assert weighted_median(np.array([3.0, 1, 2]), np.array([5.0, 1, 1])) == 3


# --- readings ---------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def leaning(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file of a material that is not reciprocal."""
    path = tmp_path_factory.mktemp("rgl") / "leaning.bsdf"
    write_anisotropic_rgl(path, LEANING, (0.5, 0.5), azimuths=5, elevations=9, size=12)
    return path


def test_half_a_file_lacks_every_second_elevation(leaning: Path) -> None:
    source = read_rgl(leaning)
    found = source.halved()
    assert found is not None
    half, left_out = found
    np.testing.assert_allclose(np.degrees(left_out), np.linspace(0, 85, 9)[1::2], atol=1e-4)
    assert half.facts["incident_directions"] == [5, 5] and source.facts["incident_directions"] == [5, 9]
    third = half.halved()
    assert third is not None and third[0].halved() is not None
    last = third[0].halved()
    assert last is not None and last[0].halved() is None


def test_what_breaks_reciprocity_by_itself_is_read_as_measured(leaning: Path) -> None:
    """The material is smooth in the light's angle: half a file predicts the rest, and the exchanged one does not."""
    found: Any = held_out(read_rgl(leaning))
    assert found["measured"] < 0.04 < 0.05 < found["mean"] < 0.6 * found["exchanged"]
    rows = dict(survey_rows(survey(read_rgl(leaning)), found, Reading()))
    assert rows["Read as"] == "measured, the light is the file's incident direction"
    rows = dict(survey_rows(survey(read_rgl(leaning)), found, Reading(reciprocity="mean")))
    assert rows["Read as"] == "mean of both directions; measured errs least"


@dataclass(frozen=True)
class Noisy(Made):
    """A matte material with noise that is another one in every sample, and in every measurement of it."""

    def halved(self) -> tuple[Made, Array]:
        """Measured again."""
        return _noisy(2), np.radians([20.0, 50])


def _noisy(seed: int) -> Noisy:
    weights = np.random.default_rng(seed).uniform(1e4, 1e5, (2, 3))
    return Noisy(lambda wi, wo: 1 + 0.1 * np.sqrt(2) * np.sin(wi @ weights[0] + wo @ weights[1]))


def test_noise_is_read_best_as_the_mean() -> None:
    """Noise of s in each: the truth's and the reading's make s sqrt 2, and s sqrt 1.5 where the reading is a mean."""
    found: Any = held_out(_noisy(1))
    signal = math.sqrt(1 + 0.01)
    assert found["measured"] * signal == pytest.approx(0.1 * math.sqrt(2), rel=0.05)
    assert found["exchanged"] * signal == pytest.approx(0.1 * math.sqrt(2), rel=0.05)
    assert found["mean"] * signal == pytest.approx(0.1 * math.sqrt(1.5), rel=0.05)


@dataclass(frozen=True)
class Listening(Made):
    """Takes down at which polar angles of the light it is asked."""

    asked: list[Array] = field(default_factory=list)

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """The same, taken down."""
        self.asked.append(np.arccos(wi[..., 2]))
        return super().evaluate(wi, wo)

    def halved(self) -> tuple[Made, Array]:
        """Reciprocal, and of a light at 20 and 50 degrees."""
        return Made(lambda wi, wo: wi[..., 2] * wo[..., 2]), LEFT_OUT


LEFT_OUT = np.radians([20.0, 50])


@pytest.mark.parametrize("isotropic", [True, False])
def test_the_light_stands_where_it_was_left_out(isotropic: bool) -> None:
    """Elsewhere the whole file interpolates too, or half of it is exact: no truth to hold a reading to."""
    source = Listening(lambda wi, wo: 2 * wi[..., 2] * wo[..., 2], isotropic=isotropic)
    found: Any = held_out(source)
    (asked,) = source.asked
    assert len(asked) > 4000
    np.testing.assert_allclose(np.abs(asked[:, None] - LEFT_OUT).min(1), 0, atol=1e-7)
    assert [found[name] for name in READINGS] == pytest.approx([0.5] * 3)


def test_pairs_at_elevations_stand_for_the_solid_angle_next_to_them() -> None:
    """Means over both hemispheres: of cos^2 theta_o over three rings, of cos theta_i, and of 1."""
    elevations = np.radians([15.0, 40, 70])
    pairs = direction_pairs(1 << 16, elevations=elevations)
    cosine = np.cos(np.radians([0, 27.5, 55, 90]))
    assert (pairs.weight * pairs.wo[:, 2] ** 2).mean() == pytest.approx(
        (-np.diff(cosine) * np.cos(elevations) ** 2).sum(), rel=5e-3
    )
    assert pairs.weight.mean() == pytest.approx(1, rel=0.01)
    assert (pairs.weight * pairs.wi[:, 2]).mean() == pytest.approx(0.5, rel=0.01)


def test_formats_that_cannot_be_halved_and_scattered_samples() -> None:
    assert held_out(Lambert()) is None
    errors = {"spline": {"median_relative": 0.04}, "kernel": {"median_relative": 0.09}}
    found: Any = held_out(Made(LEANING.value, {"interpolation": "spline", "left_out_errors": errors}))
    assert (found["measured"], found["exchanged"], found["mean"]) == (0.04, 0.04, 0.04)
    told = dict(survey_rows(survey(LEANING), found, Reading()))
    assert told["Left-out error"].startswith("4 %") and "Read as" not in told
    assert dict(survey_rows(survey(LEANING), None, Reading()))["Left-out error"] == "not told by this format"


def test_genuine_files_leave_the_reading_open(shared_data: Path) -> None:
    """What is told beside the default of `Reading`: it errs least in the median, and on five of twelve files; on the
    others the mean does."""
    files = sorted((shared_data / "rgl").glob("*.bsdf"))
    found: list[Any] = [held_out(read_rgl(file)) for file in files]
    assert len(found) == 12 and Reading().reciprocity == "measured"
    medians = {name: np.median([entry[name] for entry in found]) for name in READINGS}
    assert medians["measured"] < medians["mean"] < medians["exchanged"]
    best = [min(READINGS, key=entry.__getitem__) for entry in found]
    assert (best.count("measured"), best.count("mean")) == (5, 7)


# --- curves and figures -----------------------------------------------------------------------------------


def test_slices_peak_at_the_mirror_direction() -> None:
    cut = slices(ModifiedPhong(exponent=200))
    peaks = cut.viewer_deg[cut.values.argmax(1)]
    np.testing.assert_allclose(peaks, -cut.incidence_deg, atol=0.6)
    assert list(cut.up_to(45).incidence_deg) == [0, 30, 45] and len(cut.up_to(45).values) == 3


def test_albedo_of_a_sky_and_of_a_beam() -> None:
    """(1 + a cos theta_i) / pi: to a viewer 1 + 2 a / 3 of an even sky from everywhere, of a beam 1 + a cos theta."""
    curves = albedo_curves(LEANING)
    np.testing.assert_allclose(curves.towards, 1 + 0.5 * 2 / 3, rtol=1e-4)
    beam = 1 + 0.5 * np.cos(np.radians(curves.degrees))
    np.testing.assert_allclose(curves.of_beam, np.repeat(beam[:, None], 3, 1), rtol=1e-4)


def test_map_of_reciprocity_is_antisymmetric() -> None:
    degrees, difference = reciprocity_map(LEANING)
    np.testing.assert_allclose(difference, -difference.T, atol=1e-12)
    high, low = np.cos(np.radians([degrees[45], degrees[0]]))
    assert difference[45, 0] == pytest.approx(0.5 * (high - low) / (2 + 0.5 * (high + low)))
    assert np.isnan(reciprocity_map(Made(lambda wi, wo: 0 * wi[..., 2]))[1]).all()


def test_picture_by_angles_has_its_peak_on_the_left() -> None:
    picture, white = angles_picture(Ggx(alpha=0.2, f0=(0.9, 0.5, 0.2)))
    assert picture.min() >= 0 and picture.max() == 1 and white > 0
    assert (picture[80:120, 0] > 5 * picture[80:120, 100]).all()
    assert picture[120, 40, 0] > picture[120, 40, 1] > picture[120, 40, 2]


@pytest.fixture(scope="module")
def gold(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A baked bundle, envelope included."""
    folder = tmp_path_factory.mktemp("gold")
    quick = ["--resolution", "8", "--basis", "half", "--parameterization", "squared"]
    assert main(["bake", "brdf", "--analytic", "ggx", "alpha=0.3", *quick, "--out", str(folder)]) == 0
    return folder / "ggx.mmat"


def test_command_line_draws_measurements_and_bundles(
    leaning: Path, gold: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Files of each figure, of some thousand pixels and not of one colour."""
    pyplot = pytest.importorskip("matplotlib.image")
    for path in (leaning, gold):
        assert main(["inspect", str(path), "--plots", str(tmp_path / "figures"), "--json"]) == 0
        found = json.loads(capsys.readouterr().out)
        assert [Path(plot).name for plot in found["plots"]] == [f"{path.stem}_{name}.png" for name in FIGURES]
        for plot in found["plots"]:
            picture = pyplot.imread(plot)[..., :3]
            assert picture.shape[0] > 500 and picture.shape[1] > 700
            assert 0.01 < (picture.min(-1) < 0.9).mean() < 0.9
    measured = json.loads(json.dumps(found))
    assert measured["color_difference"].keys() == {"exact", "table"}


def test_figures_of_another_source_are_not_replaced(
    leaning: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two files of one name would draw to the same names; those of the same source are drawn again."""
    image = pytest.importorskip("matplotlib.image")

    def draw(source: Any, shown: Any, name: str, folder: Path, about: str) -> list[Path]:
        files = figure_files(name, folder)[:1]
        return [figure.save_png(figure.new_figure(1, 1), file, about=about) for file in files]

    monkeypatch.setattr(inspect, "draw_brdf", draw)
    other, folder = tmp_path / "other" / leaning.name, tmp_path / "figures"
    other.parent.mkdir()
    other.write_bytes(leaning.read_bytes() + b"\n")
    assert main(["inspect", str(leaning), "--plots", str(folder)]) == 0
    (file,) = folder.iterdir()
    before = file.read_bytes()
    assert main(["inspect", str(other), "--plots", str(folder)]) == 1
    assert "is no known figure of this source, and is not replaced" in capsys.readouterr().err
    assert file.read_bytes() == before and image.imread(file).size
    assert main(["inspect", str(leaning), "--plots", str(folder)]) == 0
    assert main(["inspect", str(other), "--plots", str(folder), "--replace"]) == 0
    assert png_about(file) == mark_of(file_origin(other))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("value", [0.0, -0.1])
def test_what_reflects_nothing_is_drawn_too(tmp_path: Path, value: float) -> None:
    """A black front of a sheet, or noise below 0 alone: neither has a peak that axes could follow."""
    pytest.importorskip("matplotlib")
    black = Made(lambda wi, wo: np.full(wi.shape[:-1], value))
    assert [path.is_file() for path in draw_brdf(black, {"measurement": black}, "black", tmp_path)] == [True] * 5


def test_command_line_tells_what_was_found(leaning: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect", str(leaning), "--reciprocity", "mean"]) == 0
    text = capsys.readouterr().out
    assert "light and viewer may change places" in text and "mean of both directions; measured errs least" in text
    assert main(["inspect", str(leaning), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["held_out"]["measured"] < found["held_out"]["mean"] and found["survey"]["reciprocity"]["rms"] > 0.05


def test_figures_need_matplotlib_and_something_to_draw(
    leaning: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["inspect", str(tmp_path), "--plots", str(tmp_path)]) == 1
    assert "of which nothing is drawn" in capsys.readouterr().err

    def absent(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(figure.importlib, "import_module", absent)
    assert main(["inspect", str(leaning), "--plots", str(tmp_path / "new")]) == 1
    assert "pip install matplotlib" in capsys.readouterr().err and not (tmp_path / "new").exists()
