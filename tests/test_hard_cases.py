"""Numerically hard cases in numpy, nodes and OSL, each against its truth; the table of them in the documentation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from measured_materials.bake import xp_numpy
from measured_materials.bake.images.storage import IMAGE_STORAGES, Storage, as_stored, scale_for
from measured_materials.bake.shading_maps.shading_map import linearise
from measured_materials.bake.shading_maps.slice_atlas import level_position
from measured_materials.bake.tables.grids import parameterization as par
from measured_materials.bake.tables.grids.half_vector_grid import HalfVectorGrid
from measured_materials.bake.tables.grids.normal_vector_grid import NormalVectorGrid
from measured_materials.bake.tables.grids.parameterization import NARROWEST_END, WIDEST_END, LogWarp
from measured_materials.nodes import expr
from support.cards import card
from support.hard.case import IMPLEMENTATIONS, Case, measure
from support.hard.points import EPS, unit_interval
from support.hard.registry import CASE_HEAD, cases, committed, is_told
from support.osl import skip_without_osl

pytestmark = pytest.mark.hard
PAGE = (Path(__file__).parents[1] / "addon" / "docs" / "hard_cases.md").read_text(encoding="utf-8")
RUNS = [(case, name) for case in cases() for name in IMPLEMENTATIONS if name in case.bounds]


@pytest.mark.parametrize("case, implementation", RUNS, ids=[f"{case}-{name}" for case, name in RUNS])
def test_case(case: Case, implementation: str, tmp_path: Path) -> None:
    """Finite, in range, no further from the truth than its bound, and as far as the documentation's page says."""
    if implementation == "osl":
        skip_without_osl()
    result = measure(case, implementation, tmp_path)
    print(f"{result.worst:.3g} of {case.bounds[implementation]:.3g}, {result.values} values")
    assert not result.fault, result.fault
    assert result.worst <= case.bounds[implementation]
    row = next(row for row in committed(CASE_HEAD, PAGE) if row[0] == str(case))
    told = float(row[CASE_HEAD.index(implementation)].split(" / ")[0])
    # Where libraries round otherwise, an error of a rounding is now none and now one.
    least = 1e-15 if implementation == "float64" else 6e-8
    assert is_told(told, result.worst, least), f"the page says {told:.1e}; write it anew by ./run bench hard"


def test_the_page_is_held_from_both_sides() -> None:
    """An error three times too large or too small is no longer what was measured."""
    assert is_told(1e-5, 1e-5, 6e-8) and is_told(1e-5, 1.9e-5, 6e-8) and is_told(1.9e-5, 1e-5, 6e-8)
    assert not is_told(1e-5, 3e-5, 6e-8) and not is_told(3e-5, 1e-5, 6e-8)


@pytest.mark.parametrize("implementation", ["float32", "nodes", "osl"])
@pytest.mark.parametrize("planted", ["offset", "infinite", "undefined"])
def test_what_is_wrong_is_found(implementation: str, planted: str, tmp_path: Path) -> None:
    """An error of 1e-5 at one input of hundreds, a quotient by 0 and a square of 1e30 do not pass."""
    if implementation == "osl":
        skip_without_osl()
    formula = {
        "offset": lambda xp, v: (1 - v) * (1 + v) + xp.where(v > 0.9999, v * 1e-5, v * 0),
        "infinite": lambda xp, v: xp.where(v > 0.9999, v * 1e30, v) * xp.where(v > 0.9999, v * 1e30, v),
        "undefined": lambda xp, v: (v * 1e38) * 1e38 - (v * 1e38) * 1e38,
    }[planted]
    body = {
        "offset": "y[0] = (1 - x) * (1 + x) + (x > 0.9999) * 1e-5;",
        "infinite": "float a = x > 0.9999 ? 1e30 : x; y[0] = a * a;",
        "undefined": "float a = x * 1e38 * 1e38; float b = x * 2e38 * 2e38; y[0] = a - b;",
    }[planted]
    good = next(case for case in cases() if case.name == "parameter of a chord, identity")
    parts = {**vars(good), "name": f"planted {planted}", "formula": formula}
    parts["osl"] = lambda folder: type(good.osl(folder))(body, 1, ("x",))  # type: ignore[misc]
    with np.errstate(all="ignore"):
        result = measure(Case(**parts), implementation, tmp_path)
    assert result.fault == "not finite" if planted != "offset" else result.worst > good.bounds[implementation]


units = st.floats(0, 1, width=32)
ends = st.floats(float(np.float32(NARROWEST_END)), WIDEST_END)


@given(units, units)
@settings(max_examples=300)
def test_bezier_returns_for_every_alpha(s: float, alpha: float) -> None:
    """Parameter to angle and back, in float32, over the whole square."""
    s32, a32 = np.array([s], np.float32), np.float32(alpha)
    v = par.bezier_inverse(xp_numpy, s32, a32)
    assert np.isfinite(v).all() and 0 <= v[0] <= 1
    # v's last bit is worth up to 2 of s; s' own is EPS / 2.
    assert abs(float(par.bezier_forward(xp_numpy, v, a32)[0]) - float(s32[0])) < 4 * EPS


@given(units, ends, ends)
@settings(max_examples=300)
def test_fitted_warps_return(s: float, near: float, far: float) -> None:
    warp = LogWarp(near, far)
    v = par.fitted_inverse(xp_numpy, np.array([s]), warp)
    assert 0 <= v[0] <= 1
    # In float64; the slope is at most 1 / 3e-4.
    assert abs(par.fitted_forward(xp_numpy, v, warp)[0] - s) < 1e-11


components = st.floats(-1, 1, width=32)


@given(st.lists(components, min_size=6, max_size=6), st.booleans())
@settings(max_examples=300)
def test_coordinates_of_anything_stay_in_the_table(numbers: list[float], reciprocal: bool) -> None:
    """Any two vectors, zero and below the horizon among them: finite coordinates within [0, 1]."""
    vectors = np.array(numbers, np.float32).reshape(2, 1, 3)
    length = np.linalg.norm(vectors.astype(float), axis=-1, keepdims=True)
    wi, wo = (vectors / np.where(length > 0, length, 1)).astype(np.float32)
    warps = (LogWarp(4.0, 0.1), LogWarp(NARROWEST_END, 4.0), LogWarp(0.1, 0.4))
    grids = (
        HalfVectorGrid((8, 8, 8), "fitted", warps=warps, reciprocal=reciprocal),
        NormalVectorGrid(8, "bezier", 0.0, 1.0),
    )
    for grid in grids:
        for u in grid.unit_coordinates(xp_numpy, wi, wo):
            assert np.isfinite(u).all() and -4 * EPS <= u[0] <= 1 + 4 * EPS


@given(st.lists(components, min_size=6, max_size=6))
@settings(max_examples=300)
def test_half_vectors_are_reciprocal_to_the_last_bit(numbers: list[float]) -> None:
    wi, wo = np.array(numbers, np.float32).reshape(2, 1, 3)
    grid = HalfVectorGrid((8, 8, 8), "fitted")
    forth, back = grid.unit_coordinates(xp_numpy, wi, wo), grid.unit_coordinates(xp_numpy, wo, wi)
    assert all(a == b for a, b in zip(forth, back))


positive = st.one_of(st.just(0.0), st.floats(1e-44, 1e36), st.integers(-40, 36).map(lambda k: 10.0**k))


@given(st.lists(positive, min_size=3, max_size=12), st.sampled_from(IMAGE_STORAGES))
@settings(max_examples=300)
def test_storages_hold_whatever_a_table_may(values: list[float], storage: Storage) -> None:
    """Never an overflow, never a negative value, and the largest within half a step."""
    texels = np.resize(np.array(values, np.float32), (1, len(values), 3))
    scale = scale_for(texels, storage)
    assert np.isfinite(np.float32(scale)) and np.isfinite(np.float32(1 / scale)) and scale > 0
    if storage is Storage.BYTE:
        return
    back = as_stored(texels, scale, storage)
    largest = float(texels.max())
    assert np.isfinite(back).all() and back.min() >= 0
    # RGBE's step is the widest, 2^-8; below 2^-126 a number has fewer digits.
    assert abs(float(back.max()) - largest) <= largest * 2.0**-8 + 2.0**-126


@given(st.floats(0, 4, width=32), st.integers(2, 64))
@settings(max_examples=300)
def test_levels_stay_among_the_slices(x: float, slices: int) -> None:
    base, t = level_position(xp_numpy, slices, np.float32(x))
    assert 0 <= base <= slices - 2 and 0 <= t <= 1
    assert abs((base + t) / (slices - 1) - min(x, 1)) < 2 * EPS


@given(st.lists(st.floats(1e-6, 1e6), min_size=3, max_size=6))
@settings(max_examples=100)
def test_slices_of_any_averages_lie_at_their_levels(averages: list[float]) -> None:
    """Photographs as far apart, or as close, as they may be."""
    levels = np.array([*averages, 2 * max(averages)])
    images = (np.random.default_rng(1).uniform(0.5, 1.5, (len(levels), 2, 3, 3)) * levels[:, None, None, None]).astype(
        np.float32
    )
    found = linearise(images, 6).map.slices
    assert np.isfinite(found).all() and found.min() >= 0
    # Merged photographs differ by up to 1e-4 of a_max.
    assert np.abs(found.mean((1, 2, 3)) - np.linspace(0, 1, 6)).max() < 2e-4


def test_nodes_compute_what_numpy_computes_in_float32() -> None:
    """The identity parameterisation is three exact roundings: bit by bit the same."""
    (v,) = unit_interval()
    normal = v[(v == 0) | (v > 1e-37)]
    (found,) = card(lambda x: par.identity_forward(expr, x), normal)
    assert (found == par.identity_forward(xp_numpy, normal)).all()
