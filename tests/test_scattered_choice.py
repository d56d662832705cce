"""Scattered samples of anisotropic materials and of tapes: coordinates are found by what is left out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.directions import spherical
from measured_materials.bake.source import Array
from measured_materials.bake.sources import read_source
from measured_materials.bake.sources.analytic import by_name
from measured_materials.bake.sources.goniometer import alta
from measured_materials.bake.sources.lookup import scattered_choice
from measured_materials.bake.sources.lookup.scattered import MAX_CENTRES, sample_errors
from measured_materials.bake.sources.lookup.scattered_choice import fit_samples
from measured_materials.bake.sources.lookup.scattered_coordinates import (
    ANY_TURN,
    HALF,
    MIRROR,
    TWO_MIRRORS,
    WHOLE,
    AzimuthCover,
    Coordinates,
)
from support.format_files import BRUSHED, GLOSSY, error, pairs
from support.format_variants import write_goniometer

TURNS = {
    "whole": np.arange(0.0, 360.0, 30.0),
    "half": np.arange(0.0, 181.0, 30.0),
    "quarter": np.arange(0.0, 91.0, 30.0),
}


@pytest.mark.parametrize(("turn", "suffix"), [("whole", ".csv"), ("half", ".csv"), ("quarter", ".astm")])
def test_an_anisotropic_set_of_samples_keeps_its_azimuths(turn: str, suffix: str, tmp_path: Path) -> None:
    """Seen 1 to 2 %, the fit itself 0.3 to 0.9 %; the material turned by a quarter differs by 30 % and more."""
    source = read_source(write_goniometer(tmp_path / f"brushed{suffix}", BRUSHED, TURNS[turn]))
    assert not source.isotropic and not source.bilateral and "anisotropy_averaged" not in source.facts
    found = error(source, BRUSHED)
    assert found < 0.025, found
    quarter = by_name("ggx", alpha=0.6, alpha_y=0.3, f0=(0.9, 0.5, 0.2))
    assert error(source, quarter) > 0.3
    wi, wo = pairs(200)
    np.testing.assert_allclose(source.evaluate(wi, wo), source.evaluate(wo, wi), rtol=1e-6)


def test_samples_of_an_isotropic_material_stay_isotropic(tmp_path: Path) -> None:
    source = read_source(write_goniometer(tmp_path / "paint.csv", GLOSSY, TURNS["half"]))
    assert source.isotropic and source.facts["symmetry"] == ANY_TURN
    assert error(source, GLOSSY) < 0.03


@pytest.mark.slow
def test_a_surface_without_any_symmetry_is_not_given_one(tmp_path: Path) -> None:
    class Shingles:
        """Brighter where the half vector leans to +x: half a turn changes it."""

        name, isotropic, bilateral = "shingles", False, False
        facts = {"format": "test"}

        def evaluate(self, wi: Array, wo: Array) -> Array:
            """Reciprocal."""
            half = np.add(wi, wo)
            half /= np.linalg.norm(half, axis=-1, keepdims=True)
            value = 0.3 + 0.2 * half[..., 0] + 0.1 * half[..., 1]
            above = (np.asarray(wi)[..., 2] > 0) & (np.asarray(wo)[..., 2] > 0)
            return np.repeat((value * above)[..., None], 3, -1)

    source = read_source(write_goniometer(tmp_path / "shingles.csv", Shingles(), TURNS["whole"]))
    assert source.facts["symmetry"] == WHOLE
    assert error(source, Shingles()) < 0.02


@pytest.mark.parametrize(
    ("azimuths", "expected"),
    [
        ([0.0], ()),
        ([0.0, 90.0], ()),
        ([10.0, 55.0, 100.0], (TWO_MIRRORS,)),
        ([350.0, 20.0, 50.0, 80.0], (TWO_MIRRORS,)),
        (list(range(0, 181, 30)), (MIRROR, HALF, TWO_MIRRORS)),
        (list(range(0, 360, 45)), (WHOLE, HALF)),
        (list(range(0, 361, 10)), (WHOLE, HALF)),
        ([0.0, 5.0, 10.0, 15.0], ()),
    ],
)
def test_the_azimuths_of_the_light_say_what_a_surface_may_be(azimuths: list[float], expected: tuple[str, ...]) -> None:
    wi = spherical(0.5, np.radians(azimuths))
    cover = AzimuthCover.of(np.concatenate([wi, spherical(np.zeros(3), np.array([0.0, 1.0, 2.0]))]))
    assert cover.symmetries() == expected


@pytest.mark.parametrize("symmetry", [WHOLE, HALF, MIRROR, TWO_MIRRORS])
def test_coordinates_have_their_symmetry_and_tell_all_else_apart(symmetry: str) -> None:
    axis = 0.4
    place = Coordinates(0.1, symmetry=symmetry, axis=axis)
    wi, wo = pairs(300)

    def turned(angle: float, flip: float = 1.0) -> Array:
        c, s = np.cos(axis), np.sin(axis)
        frame = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
        a = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        rotation: Array = frame.T @ a @ np.diag([1.0, flip, 1.0]) @ frame
        return place(wi @ rotation.T, wo @ rotation.T)

    here = place(wi, wo)
    np.testing.assert_allclose(place(wo, wi), here, atol=1e-9)
    same = {"half": symmetry in (HALF, TWO_MIRRORS), "mirror": symmetry in (MIRROR, TWO_MIRRORS)}
    for name, other in {"half": turned(np.pi), "mirror": turned(0.0, -1.0), "quarter": turned(np.pi / 2)}.items():
        away = np.abs(other - here).max(-1)
        assert (away < 1e-6).all() if same.get(name) else (away > 1e-3).mean() > 0.95, name


@pytest.mark.parametrize(
    ("azimuths", "expected"),
    [
        ([0.0, 30.0, 60.0, 90.0], (0.0,)),
        ([15.0, 45.0, 75.0], (0.0, 15.0, -15.0)),
        ([30.0, 60.0, 90.0], (15.0, 30.0, 0.0)),
        (list(np.arange(7.5, 180.0, 15.0)), (0.0, 7.5, -7.5)),
    ],
)
def test_mirror_planes_are_looked_for_where_the_azimuths_allow(
    azimuths: list[float], expected: tuple[float, ...]
) -> None:
    assert AzimuthCover.of(spherical(0.5, np.radians(azimuths))).axes() == expected


@pytest.mark.parametrize("azimuths", [[15.0, 45.0, 75.0], [30.0, 60.0, 90.0], list(np.arange(15.0, 180.0, 30.0))])
def test_a_mirror_plane_need_not_be_at_a_measured_azimuth(azimuths: list[float], tmp_path: Path) -> None:
    """At cell centres, or with one end left out as the other's image.

    Seen up to 0.9 %; with the plane at the first azimuth 20 % and 35 % of a quarter, and no mirror found in a half.
    """
    source = read_source(write_goniometer(tmp_path / "brushed.csv", BRUSHED, np.array(azimuths)))
    assert np.remainder(source.facts["symmetry_axis_deg"], 90.0) == pytest.approx(0.0, abs=1e-6)
    found = error(source, BRUSHED)
    assert found < 0.02, found


def _tape(wi: Array, wo: Array) -> Array:
    apart = np.linalg.norm(wi - wo, axis=-1)
    return (0.1 + 5 / (1 + (apart / 0.05) ** 2))[:, None]


def _around_the_lamp(count: int, seed: int) -> tuple[Array, Array]:
    """Directions at random, many close to the light; from all azimuths without a gap: isotropy is a finding."""
    rng = np.random.default_rng(seed)
    wi = spherical(rng.random(count) * 1.2, rng.random(count) * 2 * np.pi)
    wo = wi + rng.normal(0, 1, wi.shape) * 10 ** rng.uniform(-2.5, 0, (count, 1))
    wo /= np.linalg.norm(wo, axis=-1, keepdims=True)
    above = wo[:, 2] > 0.1
    return wi[above], wo[above]


@pytest.mark.parametrize("turned", [True, False], ids=["all azimuths", "one azimuth"])
def test_a_retroreflector_of_few_samples_keeps_its_peak(turned: bool) -> None:
    """Fewer samples than one solve takes: seen 0.2 % at fresh directions; in theta_h alone the peak is lost."""
    wi, wo = _around_the_lamp(600, seed=4)
    fresh = _around_the_lamp(2000, seed=5)
    if not turned:
        turn = np.arctan2(wi[:, 1], wi[:, 0])
        wi, wo = (_turned_back(w, turn) for w in (wi, wo))
    assert len(wi) < MAX_CENTRES and bool(AzimuthCover.of(wi).symmetries()) == turned
    fit = fit_samples(wi, wo, _tape(wi, wo))
    assert fit.facts["retroreflection"] and fit.coordinates.isotropic
    off = np.abs(fit.evaluate(*fresh) / _tape(*fresh) - 1)
    print(np.median(off))
    assert np.median(off) < 0.02


def _turned_back(w: Array, turn: Array) -> Array:
    c, s = np.cos(turn), np.sin(turn)
    return np.stack([c * w[:, 0] + s * w[:, 1], c * w[:, 1] - s * w[:, 0], w[:, 2]], -1)


def test_the_error_told_of_an_isotropic_fit_is_its_own(tmp_path: Path) -> None:
    facts = read_source(write_goniometer(tmp_path / "paint.csv", GLOSSY, TURNS["half"])).facts
    own: Any = facts["left_out_errors"]
    told: Any = facts["symmetry_errors"]
    assert told["isotropic"] == own[facts["interpolation"]]


def test_a_retroreflector_is_found_among_many_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    """A peak towards the lamp, which theta_h does not know, in more samples than one solve takes here."""
    monkeypatch.setattr(scattered_choice, "MAX_CENTRES", 600)
    wi, wo = _around_the_lamp(1500, seed=4)
    fit = fit_samples(wi, wo, _tape(wi, wo))
    assert fit.facts["retroreflection"] and fit.coordinates.isotropic
    assert fit.facts["samples_fitted"] == 600 and fit.facts["left_aside_errors"]["median_relative"] < 0.02


@pytest.mark.slow
def test_an_anisotropic_set_of_samples_is_baked(tmp_path: Path) -> None:
    """With its grid chosen by error; a minute on a busy machine. So small a table errs by 11 %."""
    source = read_source(write_goniometer(tmp_path / "brushed.astm", BRUSHED, TURNS["quarter"]))
    facts: Any = bake_source(source, tmp_path / "brushed.mmat", BakeSettings(8, envelope=False)).facts
    assert facts["table"]["anisotropic"] and facts["source"]["facts"]["tabulated"] == [24, 24, 22, 18]
    assert facts["errors"]["relative"] < 0.2
    table = BrdfRecord.read(read_bundle(tmp_path / "brushed.mmat")).load_table()
    assert error(table, BRUSHED) < 0.3 < error(table, by_name("ggx", alpha=0.6, alpha_y=0.3, f0=(0.9, 0.5, 0.2)))


@pytest.mark.slow
def test_a_published_tape_is_predicted_where_it_was_not_fitted(
    shared_data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A tenth of the samples held out: 0.127 in the measure that ranks; with theta_h alone it was 0.541."""
    kept: list[Array] = []

    def keep(wi: Array, wo: Array, values: Array) -> object:
        kept[:] = wi, wo, values
        raise ValueError("kept")

    monkeypatch.setattr("measured_materials.bake.sources.goniometer.scattered_source.fit_samples", keep)
    with pytest.raises(Exception, match="kept"):
        alta.read(shared_data / "alta" / "retro-gray-tape.dat")
    wi, wo, values = kept
    out = np.random.default_rng(0).random(len(values)) < 0.1
    fit = fit_samples(wi[~out], wo[~out], values[~out])
    cosine, typical = np.minimum(wi[out, 2], wo[out, 2]), float(np.median(values))
    found = sample_errors(values[out], fit.evaluate(wi[out], wo[out]), cosine, typical)
    print(found)
    assert found["overall"] < 0.2 and fit.facts["samples_fitted"] == MAX_CENTRES
