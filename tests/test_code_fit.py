"""Codes of tables as logarithms: fitted to many directions, on grids whose samples lie where codes need them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from measured_materials.bake import xp_numpy
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.sources.analytic import Ggx
from measured_materials.bake.tables.accuracy import direction_pairs
from measured_materials.bake.tables.code_fit import FITTED_FILTERS, Reading, can_be_fitted, fitted_values
from measured_materials.bake.tables.grids.anisotropic_grids import AnisotropicHalfGrid
from measured_materials.bake.tables.grids.half_vector_grid import HalfVectorGrid
from measured_materials.bake.tables.grids.normal_vector_grid import NormalVectorGrid
from measured_materials.bake.tables.grids.parameterization import LogWarp
from measured_materials.bake.tables.log_codes import LogCodes
from measured_materials.bake.tables.search.coded_grid import CodedErrors, coded_estimate, coded_grid, traded
from measured_materials.bake.tables.stored_table import StoredTable, store_table
from measured_materials.bake.tables.table import Filter, Table, tabulate

PAIRS = direction_pairs(8192)
GGX = Ggx(alpha=0.15, f0=(0.9, 0.6, 0.0), diffuse=(0.2, 0.1, 0.0))
TRUTH = GGX.evaluate(PAIRS.wi, PAIRS.wo)
GRID = HalfVectorGrid((9, 12, 4), "fitted", warps=(LogWarp(), LogWarp(0.01), LogWarp()))


def rms(table: Table) -> float:
    return PAIRS.rms(table.evaluate(PAIRS.wi, PAIRS.wo) - TRUTH)


@cache
def kept(fitted: bool, power: int = 0, filter: Filter = "trilinear") -> StoredTable:
    table = replace(tabulate(GGX, replace(GRID, cosine_power=power)), filter=filter)
    return store_table(table, Storage.LOG, PAIRS, TRUTH, GGX if fitted else None)


@pytest.mark.parametrize("power", [0, 2])
def test_fitted_codes_are_closer_at_directions_that_fitted_none(power: int) -> None:
    """At least a fifth less of the RMS, with the same ranges, and codes are of 8 bits."""
    sampled, fitted = kept(False, power).table, kept(True, power).table
    assert rms(fitted) < 0.8 * rms(sampled)
    assert fitted.log is not None and fitted.log == sampled.log
    np.testing.assert_array_equal(fitted.log.rounded(fitted.values), fitted.values)


def test_a_spline_of_fitted_codes_is_closer_than_straight_lines_are() -> None:
    """Through samples it smooths, and errs more than lines do; fitted it errs less."""
    lines, fitted = kept(True, 2).table, kept(True, 2, "bspline").table
    sampled = kept(False, 2, "bspline").table
    assert rms(sampled) > 1.5 * rms(lines) and rms(fitted) < 0.9 * rms(lines)
    assert fitted.log is not None
    np.testing.assert_array_equal(fitted.log.rounded(fitted.values), fitted.values)


@pytest.mark.parametrize("filter", ["trilinear", "bspline"])
def test_the_transposes_are_those_of_what_pairs_read(filter: Filter) -> None:
    """Or conjugate gradients would not meet the least sum."""
    random = np.random.default_rng(7)
    pairs = direction_pairs(512)
    table = replace(tabulate(GGX, GRID), filter=filter)
    reading = Reading(table, pairs.wi, pairs.wo)
    codes, texels = random.normal(size=len(reading.tied)), random.normal(size=reading.texels)
    shares = random.normal(size=reading.share.shape)
    assert reading.moved(codes) @ texels == pytest.approx(codes @ reading.gathered(texels))
    assert (reading.interpolated(texels) * shares).sum() == pytest.approx(texels @ reading.spread(shares))


def test_what_a_code_moves_is_what_the_continued_table_changes_by() -> None:
    """Also beyond poles, where values continue as 2 mean - value. By finite differences of values near 1."""
    reading = Reading(Table(GRID, np.ones((*GRID.shape, 3), np.float32)), PAIRS.wi[:8], PAIRS.wo[:8])
    change = 1e-6 * np.random.default_rng(8).normal(size=len(reading.tied))
    found = reading.continued(1 + change) - reading.continued(np.ones(len(change)))
    # Beyond both a slice's and a row's pole, in corners that no pair reads, one turn undoes the other.
    close = np.abs(found - reading.moved(change)) < 1e-9
    assert close.mean() > 0.97 and close[np.unique(reading.index)].all()


def test_pairs_read_what_the_table_returns() -> None:
    """Of values that are codes already: the sum over slices of what the filter makes of each is the table's own."""
    pairs = direction_pairs(512)
    for filter in FITTED_FILTERS:
        table = replace(tabulate(GGX, GRID), filter=filter)
        reading = Reading(table, pairs.wi, pairs.wo)
        texels = reading.continued(table.values[..., 0].reshape(-1).astype(float))
        found = (reading.share * reading.interpolated(texels)).sum(0)
        np.testing.assert_allclose(found, table.evaluate(pairs.wi, pairs.wo)[:, 0], rtol=1e-5)


@pytest.mark.parametrize("filter", ["trilinear", "bspline"])
def test_poles_stay_one_value(filter: Filter) -> None:
    """At theta_h = 0 and theta_d = 0 an azimuth means nothing: else there would be a star in the picture."""
    values = kept(True, filter=filter).table.values
    np.testing.assert_array_equal(values[:, -1], np.broadcast_to(values[:, -1, :1], values[:, -1].shape))
    np.testing.assert_array_equal(values[-1], np.broadcast_to(values[-1, :, :1], values[-1].shape))


def test_samples_that_are_right_stay() -> None:
    """A material that is a table itself has nothing to gain."""
    codes = LogCodes((6.0, 6.0, 6.0), (0.01, 0.01, 0.01))
    values = np.repeat(np.random.default_rng(4).uniform(0, 1, (6, 6, 1, 3)), 12, 2).astype(np.float32)
    grid = NormalVectorGrid(6, "uniform")
    grid.settle_poles(values)
    itself = Table(grid, codes.rounded(values), codes)
    found = fitted_values(itself, itself, codes)
    np.testing.assert_allclose(codes.encode(found), codes.encode(itself.values), atol=1.01 / 255)


def test_what_cannot_be_fitted_is_left_as_sampled() -> None:
    table = tabulate(GGX, GRID)
    assert can_be_fitted(table) and not can_be_fitted(replace(table, filter="nearest"))
    assert not can_be_fitted(Table(NormalVectorGrid(40, "uniform"), np.zeros((40, 40, 80, 3), np.float32)))
    assert not can_be_fitted(Table(AnisotropicHalfGrid((4, 4, 8, 8)), np.zeros((4, 4, 8, 8, 3), np.float32)))
    same = store_table(replace(table, filter="nearest"), Storage.LOG, PAIRS, TRUTH, GGX).table
    assert same.log is not None
    np.testing.assert_array_equal(same.values, same.log.rounded(table.values))


def test_codes_times_cosines_reach_less_far_and_err_less() -> None:
    """The peak at grazing, which hardly any light meets, is none in what is stored."""
    plain, times_cosines = kept(False).table, kept(False, 2).table
    assert plain.log is not None and times_cosines.log is not None
    assert max(times_cosines.log.ranges[:2]) < 0.5 * min(plain.log.ranges[:2])  # the third channel is nearly black
    assert rms(times_cosines) < 0.9 * rms(plain)


@pytest.mark.parametrize(
    "grid",
    [GRID, replace(GRID, cosine_power=2), NormalVectorGrid(12, "fitted")],
    ids=["half", "half times cosines", "normal"],
)
def test_the_estimate_is_the_table_but_for_rounding(grid: HalfVectorGrid | NormalVectorGrid) -> None:
    """Whose gain is of the largest sample anywhere, and not near the pairs only: they are all over the grid."""
    pairs, table = direction_pairs(4096, 0.25), tabulate(GGX, grid)
    peaks = table.values.reshape(-1, 3).max(0).astype(float)
    codes = LogCodes.reaching(np.maximum(peaks, 1e-20), np.full(3, 8.0))
    built = Table(grid, table.values, codes).evaluate(pairs.wi, pairs.wo)
    estimate = coded_estimate(GGX, grid, pairs, 8.0)
    # Both round by half a step of a logarithm of range 8 in 255, from peaks that differ, and below the largest code 0.
    factor = np.reshape(grid.factor(xp_numpy, pairs.wi, pairs.wo), (-1, 1))
    np.testing.assert_allclose(estimate * factor, built * factor, rtol=0.05, atol=2e-3)


def test_a_grid_for_codes_is_better_for_codes() -> None:
    """The grid that values are best on was fitted to values; the other kinds of spacing are left as they are."""
    pairs = direction_pairs(4096, 0.75)
    truth = GGX.evaluate(pairs.wi, pairs.wo)
    found = coded_grid(GGX, GRID, 8)
    assert isinstance(found, HalfVectorGrid) and found.reciprocal == GRID.reciprocal
    errors = [min(CodedErrors(GGX, pairs, truth, r)(g) for r in (6.0, 8.0, 10.0, 12.0)) for g in (found, GRID)]
    assert errors[0] < 0.9 * errors[1]
    plain = NormalVectorGrid(8, "uniform")
    assert coded_grid(GGX, plain, 8) is plain
    brushed = AnisotropicHalfGrid((4, 4, 8, 8))
    assert coded_grid(Ggx(alpha=0.1, alpha_y=0.4), brushed, 8) is brushed


def test_samples_are_given_to_the_axis_that_needs_them() -> None:
    """Of about as many samples in all, wherever it starts; and never fewer than four of an axis."""
    wanted = np.log([40.0, 50.0, 20.0])

    def measure(grid: HalfVectorGrid) -> float:
        return 0.01 + float(np.abs(np.log(grid.sizes) - wanted).max())

    for sizes in ((64, 32, 20), (20, 20, 100), (100, 100, 4)):
        found = traded(HalfVectorGrid(sizes), measure)
        assert 0.8 < np.prod(found.sizes) / np.prod(sizes) < 1.25
        assert measure(found) < 0.25
    small = HalfVectorGrid((4, 5, 4))
    assert traded(small, measure) == small
