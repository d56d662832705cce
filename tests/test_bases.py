"""Tables in the half-vector basis, fitted warps, and the choice among all grids by measured error."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from measured_materials.addon.summary.brdf_rows import table_rows
from measured_materials.bake import xp_numpy
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.directions import half_difference, spherical
from measured_materials.bake.errors import BakeError
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sources import analytic
from measured_materials.bake.tables.accuracy import direction_pairs, linear_estimate
from measured_materials.bake.tables.atlas import AtlasLayout, pack, unpack
from measured_materials.bake.tables.grids.half_vector_grid import HalfVectorGrid
from measured_materials.bake.tables.grids.normal_vector_grid import NormalVectorGrid
from measured_materials.bake.tables.grids.parameterization import PARAMETERIZATIONS, LogWarp
from measured_materials.bake.tables.search.grid_fit import fit_warps
from measured_materials.bake.tables.search.grid_search import choose_grid
from measured_materials.bake.tables.search.isotropic_search import half_sizes
from measured_materials.bake.tables.table import FILTERS, Table, tabulate
from support.bundle_files import edit

WARPS = (LogWarp(4.0, 0.1), LogWarp(0.003, 4.0), LogWarp(0.1, 0.4))
SMALL = {"resolution": 12, "sampler": SamplerLayout(n_o=16, n_h=16, n_phi=8)}


def index_grid(shape: tuple[int, ...]) -> list[np.ndarray]:
    return [a.ravel() for a in np.meshgrid(*map(np.arange, shape), indexing="ij")]


@pytest.mark.parametrize("kind", PARAMETERIZATIONS)
@pytest.mark.parametrize("reciprocal", [True, False])
def test_grey_lambert_is_reproduced_exactly(kind: str, reciprocal: bool) -> None:
    """Constant in, the same constant out: at the poles, at the horizon and between, by every filter."""
    table = tabulate(analytic.Lambert(), HalfVectorGrid((8, 16, 6), kind, warps=WARPS, reciprocal=reciprocal))
    pairs = direction_pairs(3000)
    for filter in FILTERS:
        assert np.abs(table.evaluate(pairs.wi, pairs.wo, filter) * np.pi / 0.5 - 1).max() < 3e-7


@pytest.mark.parametrize("kind", PARAMETERIZATIONS)
@pytest.mark.parametrize("reciprocal", [True, False])
def test_every_sample_lies_above_the_horizon_and_is_met(kind: str, reciprocal: bool) -> None:
    """No entry is wasted: all pairs are unit vectors above the horizon, and come back to their own index."""
    grid = HalfVectorGrid((9, 12, 7), kind, warps=WARPS, reciprocal=reciprocal)
    index = index_grid(grid.shape)
    wi, wo = grid.directions(*index)
    assert min(wi[:, 2].min(), wo[:, 2].min()) > 0
    assert np.abs(np.linalg.norm([wi, wo], axis=-1) - 1).max() < 1e-12
    found = grid.coordinates(xp_numpy, wi, wo)
    # Samples at the horizon are taken short of it, those at a pole beside it, where phi_d has few digits.
    inner = (index[0] > 0) & (index[1] > 0) & (index[0] < 8) & (index[1] < 11)
    for position, i in zip(found, index, strict=True):
        assert np.abs(position - i)[inner].max() < 1e-6


def test_axes_are_rusinkiewicz_angles() -> None:
    """Against the definition by rotations: theta_h and phi_d of the samples, theta_d below its largest."""
    grid = HalfVectorGrid((9, 12, 7), "uniform", reciprocal=False)
    i_d, i_h, i_phi = index_grid(grid.shape)
    theta_h, theta_d, phi_d = half_difference(*grid.directions(i_d, i_h, i_phi))
    inner = (i_d > 0) & (i_h > 0) & (i_d < 8) & (i_h < 11)
    assert np.allclose(theta_h[inner], (np.pi / 2 * (1 - i_h / 11))[inner], atol=1e-7)
    assert np.allclose(np.abs(phi_d)[inner], (np.pi * (1 - i_phi / 6))[inner], atol=1e-6)
    limit = np.arctan(1 / (np.tan(theta_h[inner]) * np.maximum(np.abs(np.cos(phi_d[inner])), 1e-300)))
    chord = np.sqrt(2) * np.sin(theta_d[inner] / 2) / (np.sqrt(2) * np.sin(limit / 2))
    # Uniform in the angle whose chord is that share.
    assert np.allclose(1 - 4 / np.pi * np.arcsin(chord / np.sqrt(2)), (i_d / 8)[inner], atol=1e-7)


@pytest.mark.parametrize("filter", ["trilinear", "bspline"])
def test_no_star_at_the_poles_and_no_black_edge(filter: str) -> None:
    """One value round the mirror direction and round wi = wo, and light up to the horizon."""
    table = tabulate(analytic.Ggx(alpha=0.3), HalfVectorGrid((24, 48, 12), "fitted", warps=WARPS))
    phi = np.linspace(0, 2 * np.pi, 50)
    for theta in (0.2, 0.8):
        wo = np.broadcast_to(spherical(theta, 0.0), (50, 3))
        for centre in (np.pi, 0.0):
            axis = spherical(theta, centre)
            u = spherical(theta + np.pi / 2, centre)
            ring = axis + 1e-6 * (np.cos(phi)[:, None] * u + np.sin(phi)[:, None] * np.cross(axis, u))
            values = table.evaluate(ring / np.linalg.norm(ring, axis=-1, keepdims=True), wo, filter)[:, 0]
            assert np.isfinite(values).all() and np.ptp(values) < 1e-3 * values.mean()
    grazing = spherical(np.radians([80, 85, 88, 89, 89.9])[:, None], np.linspace(0, np.pi, 9))
    for theta in (0.1, 1.0, 1.5):
        wo = np.broadcast_to(spherical(theta, 0.0), grazing.shape)
        assert table.evaluate(grazing, wo, filter).min() > 0


def test_atlas_round_trip() -> None:
    """Slices of any shape."""
    for shape in ((5, 40, 8), (33, 16, 6), (128, 128, 32)):
        values = np.random.default_rng(0).random((*shape, 3)).astype(np.float32)
        grid = HalfVectorGrid(shape, "uniform")
        assert (unpack(grid, pack(grid, values)) == values).all()


@pytest.mark.parametrize("n", [4, 12, 64, 256])
def test_half_tables_take_no_more_texels(n: int) -> None:
    """Equal bytes, gutters and empty places included, except where a table can be no smaller."""
    most = np.prod(AtlasLayout((n, n, 2 * n)).size)
    for reciprocal in (True, False):
        for sizes in half_sizes(n, reciprocal):
            assert min(sizes) >= 4
            texels = np.prod(AtlasLayout(sizes).size)
            assert n == 4 or 0.85 * most < texels <= most


@pytest.mark.parametrize("reciprocal", [True, False])
def test_estimate_without_the_table_is_the_tables_own(reciprocal: bool) -> None:
    """The search's shortcut equals evaluating the finished trilinear table."""
    source, pairs = analytic.Ggx(alpha=0.2), direction_pairs(3000)
    grid = HalfVectorGrid((16, 24, 8), "fitted", warps=WARPS, reciprocal=reciprocal)
    full = tabulate(source, grid).evaluate(pairs.wi, pairs.wo)
    # The finished table is float32 and averages over phi_d at the poles.
    assert pairs.rms(full - linear_estimate(source, grid, pairs)) < 2e-3 * pairs.rms(full)


def test_fitted_warp_is_better_than_even_and_found_by_the_error() -> None:
    """In the normal-vector basis too, on a lobe that calls for it."""
    source, pairs = analytic.Ggx(alpha=0.05), direction_pairs(4096, offset=0.1)
    truth = source.evaluate(pairs.wi, pairs.wo)

    def rms(grid: NormalVectorGrid) -> float:
        return pairs.rms(linear_estimate(source, grid, pairs) - truth)

    start = NormalVectorGrid(32, "fitted")
    assert rms(fit_warps(start, rms)) < 0.6 * rms(start)
    # Two ends of 4 are nearly even in the chord, and so in the angle.
    assert rms(start) == pytest.approx(rms(NormalVectorGrid(32, "uniform")), rel=0.1)


def test_auto_takes_the_half_vector_for_gloss_and_is_never_worse() -> None:
    """Five times below the best Bezier table in the normal-vector basis, at directions that chose nothing."""
    source, pairs = analytic.Ggx(alpha=0.05), direction_pairs(8192)
    truth = source.evaluate(pairs.wi, pairs.wo)
    auto = choose_grid(source, 32)
    bezier = choose_grid(source, 32, ("normal",), "bezier")
    rms = [pairs.rms(linear_estimate(source, c.grid, pairs) - truth) for c in (auto, bezier)]
    assert isinstance(auto.grid, HalfVectorGrid) and auto.grid.reciprocal and rms[0] < rms[1] / 5
    assert auto.reciprocity_error < 1e-6 and bezier.search is not None
    ranked = [c["rms"] for c in auto.facts()["candidates"]]
    assert ranked == sorted(ranked) and 4 <= len(ranked) <= 6


class OneSided:
    """Glossier seen from grazing angles than lit from them: no reciprocity, as genuine RGL files lack it."""

    name, isotropic, bilateral, facts = "one-sided", True, True, {}

    def evaluate(self, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
        wi, wo = np.broadcast_arrays(wi, wo)
        return analytic.Ggx(alpha=0.1).evaluate(wi, wo) * (1 + wo[..., 2:])


def test_without_reciprocity_phi_d_is_kept_up_to_pi() -> None:
    """A table that folds phi_d misses the antisymmetric part; the choice says how large it is."""
    choice = choose_grid(OneSided(), 24, ("half",), "fitted")
    assert isinstance(choice.grid, HalfVectorGrid) and not choice.grid.reciprocal
    assert 0.01 < choice.reciprocity_error < 0.5


@pytest.mark.parametrize("basis", ["normal", "half"])
@pytest.mark.parametrize("kind", PARAMETERIZATIONS)
def test_bundles_of_every_grid(tmp_path: Path, basis: str, kind: str) -> None:
    """Written and read back: the same grid and values, and words about it."""
    settings = BakeSettings(basis=basis, parameterization=kind, envelope=False, **SMALL)
    bundle = read_bundle(bake_source(analytic.Ggx(alpha=0.3), tmp_path / "b", settings).path)
    table, facts = BrdfRecord.read(bundle).load_table(), bundle.material
    assert facts["table"]["basis"] == basis and facts["table"]["parameterization"] == kind
    assert table.grid.facts() == {k: facts["table"][k] for k in table.grid.facts()}
    expected = tabulate(analytic.Ggx(alpha=0.3), table.grid).values
    # Half floats.
    assert np.abs(table.values / np.maximum(expected, 1e-6) - 1).max() < 2**-10
    words = dict(table_rows(BrdfRecord.read(bundle)))
    assert basis in words["Table"] and kind in words["Table"]


def test_residual_has_a_grid_of_its_own(tmp_path: Path) -> None:
    """E depends on the viewer alone: what it leaves has no reciprocity, and is not folded."""
    settings = BakeSettings(resolution=24, basis="half", sampler=SMALL["sampler"])
    source = analytic.MetallicPaint((0.05, 0.1, 0.3), (0.1, 0.2, 0.4), flake_alpha=0.3, coat_alpha=0.1)
    bundle = read_bundle(bake_source(source, tmp_path / "paint", settings).path)
    grid = BrdfRecord.read(bundle).stored("residual").grid
    assert isinstance(grid, HalfVectorGrid) and not grid.reciprocal and grid != BrdfRecord.read(bundle).table.grid
    assert isinstance(BrdfRecord.read(bundle).load_table("residual"), Table)
    errors = bundle.material["residual"]["errors"]
    assert errors["envelope_and_residual"]["relative"] < 0.02


def test_bundles_without_a_residual_grid_have_the_tables(tmp_path: Path) -> None:
    """As version 0 wrote them: neither "choice" nor the residual's "grid"."""
    settings = BakeSettings(alpha=(0.5, 0.3), **SMALL)
    path = bake_source(analytic.Ggx(alpha=0.3), tmp_path / "old", settings).path
    document = json.loads((path / "material.json").read_text())
    del document["residual"]["grid"], document["choice"]
    (path / "material.json").write_text(json.dumps(document))
    record = BrdfRecord.read(read_bundle(path))
    grid = record.table.grid
    assert record.stored("residual").grid == grid == NormalVectorGrid(12, "bezier", 0.5, 0.3, grid.horizon_share)
    assert table_rows(record)


@pytest.mark.parametrize(
    "key, value",
    [
        ("sizes", [8, 8]),
        ("sizes", [8, 8, 100000]),
        ("sizes", [9, 8, 8]),
        ("sizes", "big"),
        ("warps", [[1, 1], [1, 1]]),
        ("warps", [[1, 1], [1, 0], [1, 1]]),
        ("warps", [[1, 1], [1, 99], [1, 1]]),
        ("warps", [[1, 1], 3, [1, 1]]),
        ("reciprocal", 1),
        ("basis", "other"),
    ],
)
def test_lying_grids_are_refused(tmp_path: Path, key: str, value: object) -> None:
    """One clear error when the table is used."""
    settings = BakeSettings(basis="half", parameterization="fitted", envelope=False, **SMALL)
    path = bake_source(analytic.Lambert(), tmp_path / "grey", settings).path
    edit(path, lambda document: document["table"].update({key: value}))
    with pytest.raises(BakeError):
        BrdfRecord.read(read_bundle(path)).load_table()


def test_a_given_alpha_means_bezier_in_the_normal_basis() -> None:
    """Two numbers, and the paper's metric, speak of its axes."""
    assert BakeSettings(alpha=(0.5, 0.5)).bases == ("normal",) and BakeSettings(alpha=(0.5, 0.5)).spacing == "bezier"
    assert BakeSettings(alpha="intensity").spacing == "bezier"
    assert len(BakeSettings().bases) == 2 and BakeSettings().spacing == "auto"
