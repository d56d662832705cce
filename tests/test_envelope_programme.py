"""The linear programme of an envelope against scipy's HiGHS."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from measured_materials.bake.envelope.closures import BASIS, closure_values
from measured_materials.bake.envelope.linear_program import feasible_share, solve
from measured_materials.bake.envelope.views import sample_views
from measured_materials.bake.source import BrdfSource
from measured_materials.bake.sources import analytic, read_source
from measured_materials.bake.tables.treated_source import TreatedSource
from scipy import sparse
from scipy.optimize import linprog

Problem = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def highs(values: np.ndarray, bounds: np.ndarray, areas: np.ndarray, gains: np.ndarray, budget: float, price: float):
    """Optimum of one programme; its rows and columns scaled, since HiGHS' tolerances are absolute."""
    binds = areas > 0
    values, bounds, areas = values[binds], bounds[binds], areas[binds]
    largest = bounds + budget / areas
    closed = largest <= 0
    allowed = ~(values[closed] > 0).any(0)
    values, largest = values[~closed], largest[~closed]
    a = values / largest[:, None]
    scale = np.maximum(a.max(0), 1e-300)
    columns, cost = [sparse.csr_matrix(a / scale)], [-gains / scale]
    right = (bounds[~closed] / largest).tolist()
    limits = [(0, None if ok else 0) for ok in allowed]
    if budget > 0:
        columns.append(-sparse.diags(budget / areas[~closed] / largest))
        cost.append(np.full(len(largest), price * budget))
        limits += [(0, None)] * len(largest)
    rows = sparse.hstack(columns)
    if budget > 0:
        rows = sparse.vstack([rows, np.r_[np.zeros(len(gains)), np.ones(len(largest))][None]])
        right.append(1.0)
    options = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}
    found = linprog(np.concatenate(cost), rows.tocsr(), right, bounds=limits, method="highs", options=options)
    assert found.status == 0
    return -found.fun


def compare(problem: Problem, budget: float, price: float, gap: float = 1e-8) -> None:
    values, bounds, areas, gains = problem
    found = solve(*problem, budget, price)
    assert (found.weights >= 0).all() and (found.gap <= gap).all()
    overshoot = (areas * np.maximum(np.einsum("nmk,nk->nm", values, found.weights) - bounds, 0)).sum(-1)
    # Inside the bounds by construction, up to rounding of rows whose numbers span ten powers.
    assert (overshoot <= budget + 1e-9 * (areas * bounds).sum(-1)).all()
    for k in range(len(gains)):
        expected = highs(*(array[k] for array in problem), budget, price)
        assert found.objective[k] == pytest.approx(expected, rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("price", [0.0, 10.0])
@pytest.mark.parametrize("budget", [0.0, 1e-3, 0.1])
@pytest.mark.parametrize("m, k", [(20, 1), (300, 3), (120, 12)])
def test_random_problems(m: int, k: int, budget: float, price: float) -> None:
    """Values and areas over many powers of ten, some directions of area 0, some closures 0 in places."""
    rng = np.random.default_rng(m + k)
    values = 10 ** rng.normal(0, 1.5, (8, m, k)) * (rng.random((8, m, k)) < 0.8)
    bounds = 10 ** rng.normal(0, 1, (8, m))
    areas = 10 ** rng.normal(-2, 1, (8, m)) * (rng.random((8, m)) < 0.9)
    compare((values, bounds, areas, np.einsum("nm,nmk->nk", areas, values)), budget, price)


@pytest.mark.parametrize("budget", [0.0, 1e-2])
def test_bounds_of_zero(budget: float) -> None:
    """Measurements are 0 in places: with no budget a closure seen there gets no weight, with one it may get some."""
    rng = np.random.default_rng(5)
    values = rng.random((6, 100, 4))
    values[:, :20, 2] = 0
    bounds = rng.random((6, 100))
    bounds[:, :20] = 0
    areas = np.full((6, 100), 0.01)
    gains = values.sum(1)
    compare((values, bounds, areas, gains), budget, 0.0)
    weights = solve(values, bounds, areas, gains, budget).weights
    assert (weights[:, 2] > 0).all()
    assert (weights[:, [0, 1, 3]] == 0).all() == (budget == 0)


def test_a_black_channel_gets_nothing() -> None:
    """All bounds 0, or nothing to gain."""
    values = np.ones((2, 10, 2))
    bounds = np.stack([np.zeros(10), np.ones(10)])
    gains = np.array([[1.0, 1.0], [0.0, 0.0]])
    found = solve(values, bounds, np.ones((2, 10)), gains, 0.0)
    assert (found.weights == 0).all() and (found.objective == 0).all()


@pytest.mark.parametrize("budget", [0.0, 1e-3])
def test_closures_that_are_the_same(budget: float) -> None:
    """Two alike, or one the sum of others, leave the weights undetermined but not the objective."""
    rng = np.random.default_rng(6)
    values = rng.random((4, 80, 4)) ** 2
    values[..., 1] = values[..., 0]
    values[..., 3] = values[..., 0] + values[..., 2]
    areas = np.full((4, 80), 1 / 80)
    compare((values, 0.1 + rng.random((4, 80)), areas, values.mean(1)), budget, 0.0, gap=5e-7)


@pytest.mark.parametrize("scale", [1e-30, 1e30])
def test_units_do_not_matter(scale: float) -> None:
    rng = np.random.default_rng(7)
    values, bounds, areas = rng.random((3, 60, 3)), rng.random((3, 60)), np.full((3, 60), 1 / 60)
    plain = solve(values, bounds, areas, values.mean(1), 1e-3).weights
    scaled = solve(values * scale, bounds, areas, values.mean(1), 1e-3).weights * scale
    assert np.allclose(plain, scaled, rtol=1e-4)


def test_price_keeps_the_budget_unspent() -> None:
    """One closure under a bound with a single dip of area 0.1: raising it costs 0.1 overshoot for a gain of 1."""
    values, areas = np.ones((1, 10, 1)), np.full((1, 10), 0.1)
    bounds = np.ones((1, 10))
    bounds[0, 3] = 0.5
    gains = np.array([[1.0]])
    assert solve(values, bounds, areas, gains, 0.04, price=9).weights[0, 0] == pytest.approx(0.9, rel=1e-6)
    assert solve(values, bounds, areas, gains, 0.04, price=11).weights[0, 0] == pytest.approx(0.5, rel=1e-6)


def problem_of(source: BrdfSource) -> Problem:
    """The programmes of a material as `fit_envelope` states them, all closures at nine viewers."""
    views = sample_views(TreatedSource(source), np.linspace(0, 1, 9), 28, 16)
    values = np.repeat(closure_values(BASIS, views.wi, views.wo), 3, 0)
    energy = views.energy.reshape(-1)
    bounds = np.moveaxis(views.values, -1, 1).reshape(len(energy), -1) / energy[:, None]
    values = values / energy[:, None, None]
    areas = np.repeat(views.areas, 3, 0)
    return values, bounds, areas, np.einsum("nm,nmk->nk", areas, values)


@pytest.mark.parametrize("budget, price", [(0.0, 0.0), (1e-3, 0.0), (1e-3, 10.0)])
def test_problems_of_an_analytic_paint(budget: float, price: float) -> None:
    compare(problem_of(analytic.MetallicPaint()), budget, price)


@pytest.mark.parametrize("name", ["satin_rosaline_rgb", "irid_flake_paint1_rgb"])
def test_problems_of_measurements(shared_data: Path, name: str) -> None:
    """Noise, and values of 0 at the horizon."""
    problem = problem_of(read_source(shared_data / "rgl" / f"{name}.bsdf"))
    compare(problem, 1e-3, 10.0)
    compare(problem, 0.0, 0.0)


def test_feasible_share() -> None:
    """Largest factors under increasing functions, 1 where all fits and 0 where nothing does."""
    slope = np.array([0.5, 2.0, 8.0, 1.0])
    allowed = np.array([1.0, 1.0, 1.0, 0.0])
    found = feasible_share(lambda t: slope * t, allowed)
    assert found == pytest.approx([1.0, 0.5, 0.125, 0.0], abs=1e-11)
    assert (slope * found <= allowed).all()
