"""Tables in 8-bit codes of the logarithm: what comes back, how the range is chosen, and what a bundle must not say."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from measured_materials.bake import xp_numpy
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.errors import BakeError
from measured_materials.bake.images.image_io import read_image
from measured_materials.bake.images.storage import IMAGE_STORAGES, Storage
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sources import analytic
from measured_materials.bake.tables.accuracy import direction_pairs
from measured_materials.bake.tables.grids.half_vector_grid import HalfVectorGrid
from measured_materials.bake.tables.grids.normal_vector_grid import NormalVectorGrid
from measured_materials.bake.tables.grids.parameterization import LogWarp
from measured_materials.bake.tables.log_codes import LEAST_PEAK, MOST_PEAK, MOST_RANGE, LogCodes
from measured_materials.bake.tables.padding import pad_slices
from measured_materials.bake.tables.stored_table import store_table
from measured_materials.bake.tables.table import FILTERS, Table, tabulate

SMALL: dict[str, Any] = {"resolution": 12, "alpha": (0.5, 0.3), "sampler": SamplerLayout(n_o=8, n_h=8, n_phi=4)}
PAIRS = direction_pairs(4096)
GGX = analytic.Ggx(alpha=0.3, f0=(0.5, 0.5, 0.5), diffuse=(0.2, 0.1, 0.0))


def stored(values: np.ndarray) -> Table:
    """A table of these values as it comes back, its codes fitted for its steps: no range could meet those exactly."""
    table = Table(NormalVectorGrid(values.shape[0], "uniform"), values)
    truth = table.evaluate(PAIRS.wi, PAIRS.wo, "nearest")
    return store_table(table, Storage.LOG, PAIRS, truth).table


def random_values(low: float = 0.0, n: int = 6) -> np.ndarray:
    return np.random.default_rng(2).uniform(low, 1, (n, n, 2 * n, 3)).astype(np.float32)


@settings(max_examples=60, deadline=None)
@given(
    ranges=st.tuples(*[st.floats(1, MOST_RANGE)] * 3),
    peak=st.floats(float(np.log(LEAST_PEAK)) + 0.01, float(np.log(MOST_PEAK)) - 0.01),
)
def test_every_code_comes_back(ranges: tuple[float, float, float], peak: float) -> None:
    """All 256 codes of any range and peak survive decoding to float32 and encoding again; they rise from exactly 0."""
    codes = LogCodes.reaching(np.full(3, np.exp(peak)), np.array(ranges))
    steps = np.repeat(np.arange(256, dtype=np.float32)[:, None], 3, 1) * np.float32(1 / 255)
    values = codes.decode(xp_numpy, steps.astype(float)).astype(np.float32)
    assert (values[0] == 0).all() and np.isfinite(values).all() and (np.diff(values, axis=0) > 0).all()
    assert np.allclose(values[-1], np.exp(peak), rtol=1e-5)
    np.testing.assert_array_equal(codes.encode(values), steps)


def test_steps_are_even_in_the_logarithm() -> None:
    codes = LogCodes.reaching(np.ones(3), np.full(3, 12.0))
    values = np.geomspace(1e-4, 1, 5000)[:, None] * np.ones(3)
    ratio = codes.rounded(values) / values
    # Half a step of 12 / 255 in the logarithm; what the 1 in exp(x) - 1 adds to it is e^-12 / 1e-4 of it at most.
    assert np.abs(np.log(ratio)).max() < 0.5 * 12 / 255 * 1.07


@pytest.mark.parametrize("scale", [1e-36, 1e-20, 1.0, 1e30])
def test_scale_changes_nothing(scale: float) -> None:
    """Equal codes at any scale; below 1e-24 1/sr a table is black."""
    values = random_values() * np.float32(scale)
    back = stored(values)
    assert back.log is not None and np.isfinite(back.values).all()
    if scale < LEAST_PEAK:
        assert not back.values.any() and back.log.gains == (0, 0, 0)
    else:
        usual = stored(random_values())
        assert usual.log is not None and back.log.ranges == usual.log.ranges
        assert np.allclose(back.values / scale, usual.values, rtol=1e-5)


def test_too_large_is_refused() -> None:
    with pytest.raises(BakeError, match="cannot hold values above 1e\\+37"):
        LogCodes.reaching(np.array([1, 2e37, 1]), np.full(3, 8.0))


def test_black_and_even_tables() -> None:
    """A black channel stays exactly black beside others; equal values come back alike and within their precision."""
    values = random_values()
    values[..., 1] = 0
    assert not stored(values).values[..., 1].any()
    assert not stored(np.zeros_like(values)).evaluate(PAIRS.wi, PAIRS.wo).any()
    even = stored(np.full_like(values, 0.3)).values
    assert np.ptp(even) == 0 and even.max() == pytest.approx(0.3, rel=1e-6)


def test_one_bright_texel() -> None:
    """A peak of 1e4 over a table of 1: neither is lost."""
    values = random_values(0.5)
    values[3, 3, 5] = 1e4
    back = stored(values)
    assert back.values[3, 3, 5] == pytest.approx([1e4] * 3, rel=1e-4)
    rest = values < 2
    # Even in the logarithm, the steps of ranges from ln(1e4 / 0.5) to the widest would be 4 to 9 %. A narrower range
    # has coarser ones here and finer ones at the peak: that trade may be made, but not the one that loses the rest.
    assert np.abs(np.log(back.values[rest] / values[rest])).max() < 0.3


@pytest.mark.parametrize("filter", FILTERS)
def test_evaluation_interpolates_codes_and_then_blends_slices(filter: str) -> None:
    """Against the same table of codes read with the plain filter, where slices matter and where they do not."""
    table = stored(random_values())
    assert table.log is not None
    plain = Table(table.grid, table.log.encode(table.values))
    found = table.evaluate(PAIRS.wi, PAIRS.wo, filter)  # type: ignore[arg-type]
    position = table.grid.coordinates(xp_numpy, PAIRS.wi, PAIRS.wo)[0]
    whole = np.abs(position - np.round(position)) < 0.02 if filter != "bspline" else np.zeros(len(position), bool)
    if filter == "nearest":
        assert np.allclose(found, table.log.decode(xp_numpy, plain.evaluate(PAIRS.wi, PAIRS.wo, "nearest")))
    elif filter == "trilinear":
        # Beside a slice there is hardly anything to blend with, and the order does not matter.
        expected = table.log.decode(xp_numpy, plain.evaluate(PAIRS.wi, PAIRS.wo))
        assert whole.sum() > 50 and np.allclose(found[whole], expected[whole], atol=0.03)
        assert not np.allclose(found, expected, atol=0.03)
    constant = replace(table, values=np.full_like(table.values, 0.25))
    back = constant.evaluate(PAIRS.wi, PAIRS.wo, filter)  # type: ignore[arg-type]
    # Of 256 codes one serves everywhere, whatever the filter.
    assert np.ptp(back, axis=0).max() < 1e-6


def test_the_range_is_that_of_least_error() -> None:
    """No other range is better by the measure that chose it."""
    source = analytic.Ggx(alpha=0.15)
    truth = source.evaluate(PAIRS.wi, PAIRS.wo)
    table = tabulate(source, NormalVectorGrid(16, "bezier", 0.5, 0.2))
    kept = store_table(table, Storage.LOG, PAIRS, truth).table
    assert kept.log is not None

    def product(candidate: Table) -> float:
        found, light = (v[:, 0] * PAIRS.cosines[:, 0] for v in (candidate.evaluate(PAIRS.wi, PAIRS.wo), truth))
        roots = np.abs(np.sqrt(found) - np.sqrt(light))
        return float(np.sqrt((PAIRS.weight * (found - light) ** 2).sum()) * (PAIRS.weight * roots).sum())

    least, peaks = product(kept), pad_slices(table.grid, table.values).reshape(-1, 3).max(0)
    for k in np.arange(4.0, 24.0, 2.0):
        codes = LogCodes.reaching(peaks, np.full(3, k))
        assert product(Table(table.grid, codes.rounded(table.values), codes)) >= least


def test_a_coarse_table_gains_by_it() -> None:
    """In the half-vector basis, where a highlight runs along one axis: 3 bytes a texel, not 6, and a smaller error."""
    source = analytic.Ggx(alpha=0.15)
    truth = source.evaluate(PAIRS.wi, PAIRS.wo)
    table = tabulate(source, HalfVectorGrid((12, 16, 6), "fitted", warps=(LogWarp(), LogWarp(0.01), LogWarp())))
    rms = {
        storage: PAIRS.rms(store_table(table, storage, PAIRS, truth).table.evaluate(PAIRS.wi, PAIRS.wo) - truth)
        for storage in (Storage.HALF, Storage.LOG)
    }
    assert rms[Storage.LOG] < 0.9 * rms[Storage.HALF]


def test_log_is_no_format_of_images() -> None:
    assert Storage.LOG not in IMAGE_STORAGES and Storage.LOG.image is Storage.BYTE and Storage.LOG.suffix == ".png"
    assert Storage.LOG.render_bytes(3) == 4 and Storage.LOG.render_bytes(3, packed=True) == 4
    assert Storage.LOG.file_bytes(3) == 3


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    return read_bundle(
        bake_source(GGX, tmp_path_factory.mktemp("log") / "b", BakeSettings(storage="log", **SMALL)).path
    )


def test_round_trip(bundle: Bundle) -> None:
    """The files hold the codes of the table; its errors are those of the table read back; the residual has its own."""
    assert all(bundle.image_path(name).name.endswith(f"_{name}.png") for name in ("table", "residual"))
    table, residual = BrdfRecord.read(bundle).load_table(), BrdfRecord.read(bundle).load_table("residual")
    assert table.log is not None and residual.log is not None and table.log != residual.log
    texels = read_image(bundle.image_path("table"))
    assert set(np.unique(np.rint(texels * 255))) <= set(range(256))
    pairs = direction_pairs(32768)
    rms = pairs.rms(table.evaluate(pairs.wi, pairs.wo) - GGX.evaluate(pairs.wi, pairs.wo))
    assert rms == pytest.approx(bundle.material["errors"]["rms"], rel=1e-4)


def test_anisotropic_round_trip(tmp_path: Path) -> None:
    source = analytic.Ggx(alpha=0.3, alpha_y=0.5)
    path = bake_source(source, tmp_path / "a", BakeSettings(storage="log", envelope=False, **SMALL)).path
    bundle = read_bundle(path)
    table = BrdfRecord.read(bundle).load_table()
    assert table.log is not None and bundle.image_path("table").suffix == ".png"
    half = read_bundle(bake_source(source, tmp_path / "h", BakeSettings(envelope=False, **SMALL)).path)
    assert bundle.material["errors"]["rms"] < 1.2 * half.material["errors"]["rms"]


def changed(bundle: Bundle, change: Callable[[dict[str, Any]], None]) -> Bundle:
    material = json.loads(json.dumps(bundle.material))
    change(material)
    return Bundle(bundle.path, material)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda m: m["table"].pop("log"), "'log' is missing"),
        (lambda m: m["table"].update(log=3), "'log' is not"),
        (lambda m: m["table"]["log"].update(range=[0, 8, 8]), "below 1"),
        (lambda m: m["table"]["log"].update(range=[8, 8, 99]), "above 24"),
        (lambda m: m["table"]["log"].update(range=[8, 8]), "length of 'range'"),
        (lambda m: m["table"]["log"].update(gain=[1, -1, 1]), "below 0"),
        (lambda m: m["table"]["log"].update(gain=[1, 1e36, 1]), "stands for values above 1e\\+37"),
        (lambda m: m["table"]["log"].update(gain=[1, "1", 1]), "'gain' is not"),
        (lambda m: m["table"].update(storage="half"), "is stored as byte, and the table as half"),
        (lambda m: m["table"].update(storage="byte"), "not one of"),
    ],
)
def test_bad_facts_are_refused(bundle: Bundle, change: Callable[[dict[str, Any]], None], words: str) -> None:
    with pytest.raises(BakeError, match=words) as caught:
        BrdfRecord.read(changed(bundle, change)).load_table()
    assert "\n" not in str(caught.value)
