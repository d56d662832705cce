"""From a measurement file to a bundle and back: what is written is what was measured and what will be rendered."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from measured_materials.bake.brdf.bake import bake_file, bake_source
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.errors import BakeError
from measured_materials.bake.images.storage import TABLE_STORAGES
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sources import analytic
from measured_materials.bake.sources.merl import write_merl
from measured_materials.bake.tables.accuracy import direction_pairs
from measured_materials.bake.tables.log_codes import MOST_RANGE
from support.bundle_files import edit

SMALL = {"resolution": 16, "alpha": (0.4, 0.2), "sampler": SamplerLayout(n_o=16, n_h=16, n_phi=8), "envelope": False}


@pytest.fixture(scope="module")
def measurement(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A rough metal on the MERL grid."""
    path = tmp_path_factory.mktemp("merl") / "rough.binary"
    write_merl(path, analytic.Ggx(alpha=0.3))
    return path


@pytest.mark.parametrize("storage", TABLE_STORAGES)
def test_the_bundle_holds_the_measurement(measurement: Path, tmp_path: Path, storage: str) -> None:
    """The error stated in the bundle is the error of the stored table against the analytic truth, storage included."""
    result = bake_file(
        measurement, tmp_path / "rough", BakeSettings(storage=storage, resolution=32, alpha=(0.4, 0.2), envelope=False)
    )
    bundle = read_bundle(result.path)
    table = BrdfRecord.read(bundle).load_table()
    pairs = direction_pairs(4000, offset=0.7)
    keep = (pairs.wi[:, 2] > 0.2) & (pairs.wo[:, 2] > 0.2)
    truth = analytic.Ggx(alpha=0.3).evaluate(pairs.wi, pairs.wo)
    found = table.evaluate(pairs.wi, pairs.wo)
    # MERL's own grid (1 degree) and a 32 x 32 x 64 table: a few per cent of the lobe.
    assert np.abs(found - truth)[keep].mean() < 0.02 * truth[keep].mean()
    errors = bundle.material["errors"]
    assert 0 < errors["rms"] < 0.1 * errors["rms_of_signal"]
    assert bundle.material["table"]["storage"] == storage
    assert bundle.material["source"]["sha256"] and bundle.material["source"]["file"] == measurement.name
    assert bundle.preview is not None


@pytest.mark.parametrize("storage", TABLE_STORAGES)
def test_stored_values_are_the_quantised_ones(tmp_path: Path, storage: str) -> None:
    """Peaks of 1e5 and dark values survive in every storage to its stated precision."""
    source = analytic.Ggx(alpha=0.01)
    result = bake_source(source, tmp_path / "peak", BakeSettings(storage=storage, **SMALL))
    bundle = read_bundle(result.path)
    table = BrdfRecord.read(bundle).load_table()
    plain = bake_source(source, tmp_path / "exact", BakeSettings(storage="float32", **SMALL))
    exact = BrdfRecord.read(read_bundle(plain.path)).load_table()
    # Of "log" half a step of the widest range.
    precision = {"float32": 1e-7, "half": 2**-11, "rgbe": 2**-8, "log": np.expm1(0.5 * MOST_RANGE / 255)}[storage]
    large = exact.values > 1e-3 * exact.values.max()
    assert np.abs(table.values / np.maximum(exact.values, 1e-30) - 1)[large].max() <= precision
    assert exact.values.max() > 1e4


def test_lambert_bakes_to_its_albedo(tmp_path: Path) -> None:
    """Grey Lambert: albedo 0.5 in the facts, the same value in every texel."""
    result = bake_source(analytic.Lambert(), tmp_path / "grey", BakeSettings(storage="float32", **SMALL))
    bundle = read_bundle(result.path)
    assert np.allclose(BrdfRecord.read(bundle).load_table().values, 0.5 / np.pi, rtol=2e-7)
    assert np.allclose(bundle.material["albedo"]["white_sky"], 0.5, atol=1e-4)
    assert bundle.material["errors"]["rms"] < 1e-7


def test_search_is_reported(tmp_path: Path) -> None:
    """Both metrics' choices and which wins are in the bundle; the table uses the one that was asked for."""
    for metric in ("error", "intensity"):
        settings = BakeSettings(resolution=16, basis="normal", parameterization="bezier", alpha=metric, envelope=False)
        facts = bake_source(analytic.Ggx(alpha=0.15), tmp_path / metric, settings).facts
        chosen = facts["search"][f"by_{metric}"]
        assert facts["table"]["alpha_theta"] == chosen["alpha_theta"]
        assert facts["table"]["alpha_phi"] == chosen["alpha_phi"]
        assert facts["search"]["trials"] >= 25


@pytest.mark.parametrize("spline", ["plain", "fitted"])
def test_spline_tables_say_what_they_hold(tmp_path: Path, spline: str) -> None:
    """A B-spline bundle states its coefficients."""
    settings = BakeSettings(filter="bspline", spline=spline, resolution=32, alpha=(0.4, 0.2), envelope=False)
    facts = bake_source(analytic.Ggx(alpha=0.3), tmp_path / "spline", settings).facts
    assert facts["table"]["filter"] == "bspline" and facts["table"]["spline"] == spline


def test_fitted_spline_is_closer_than_plain(tmp_path: Path) -> None:
    """By the measured error that the bundle states."""
    rms = {}
    for spline in ("plain", "fitted"):
        settings = BakeSettings(filter="bspline", spline=spline, resolution=32, alpha=(0.4, 0.2), envelope=False)
        rms[spline] = bake_source(analytic.Ggx(alpha=0.3), tmp_path / spline, settings).facts["errors"]["rms"]
    assert rms["fitted"] < 0.7 * rms["plain"]


def test_sampler_in_the_bundle_is_complete(tmp_path: Path) -> None:
    """Read back, it draws directions of positive density for every viewer."""
    result = bake_source(analytic.Ggx(alpha=0.2), tmp_path / "s", BakeSettings(**SMALL))
    bundle = read_bundle(result.path)
    sampler = BrdfRecord.read(bundle).load_sampler()
    rng = np.random.default_rng(0)
    wo = np.stack([np.sin(t := rng.uniform(0, 1.57, 5000)), 0 * t, np.cos(t)], -1)
    wi, pdf = sampler.sample(wo, rng.random((5000, 4)))
    assert np.isfinite(wi).all() and (pdf > 0).all()
    assert BrdfRecord.read(bundle).table.grid.n == 16


def test_anisotropic_sources_get_a_table_of_their_own(tmp_path: Path) -> None:
    """An anisotropic BRDF must not be flattened in silence."""
    settings = BakeSettings(resolution=8, envelope=False)
    result = bake_source(analytic.Ggx(alpha=0.2, alpha_y=0.5), tmp_path / "brushed", settings)
    assert result.facts["table"]["anisotropic"] is True and len(result.facts["table"]["shape"]) == 4


@pytest.mark.parametrize(
    "wrong",
    [
        {"resolution": 3},
        {"resolution": 1000},
        {"parameterization": "cubic"},
        {"basis": "spherical"},
        {"basis": "half", "alpha": (0.5, 0.5)},
        {"alpha": (0.5, 1.5)},
        {"alpha": "best"},
        {"filter": "lanczos"},
        {"storage": "jpeg"},
        {"spline": "loose"},
    ],
)
def test_wrong_settings_are_refused(wrong: dict) -> None:
    """Each names the setting and the choices."""
    with pytest.raises(BakeError) as caught:
        BakeSettings(**wrong)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "key, value",
    [
        ("n", 64),
        ("n", -1),
        ("n", "x"),
        ("alpha_theta", 2),
        ("scale", 0),
        ("parameterization", "spiral"),
        ("basis", "half"),
    ],
)
def test_lying_table_facts_are_refused(tmp_path: Path, key: str, value: object) -> None:
    """A material.json that does not fit its images, or the format, is one clear error when it is used."""
    path = bake_source(analytic.Lambert(), tmp_path / "grey", BakeSettings(**SMALL)).path
    edit(path, lambda document: document["table"].update({key: value}))
    with pytest.raises(BakeError):
        BrdfRecord.read(read_bundle(path)).load_table()
