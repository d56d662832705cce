"""Tables of logarithms within so many bytes of file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from measured_materials.addon.summary.brdf_rows import table_rows
from measured_materials.bake.brdf import part_bake
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.grids import grid_of
from measured_materials.bake.brdf.part_bake import PartBake
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.bundle.checked_json import Fields
from measured_materials.bake.errors import BakeError
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sources.analytic import Ggx, Lambert
from measured_materials.bake.tables.accuracy import direction_pairs
from measured_materials.bake.tables.atlas import AtlasLayout
from measured_materials.bake.tables.filter_choice import FilterChoice
from measured_materials.bake.tables.grids.half_vector_grid import HalfVectorGrid
from measured_materials.bake.tables.grids.normal_vector_grid import NormalVectorGrid
from measured_materials.bake.tables.grids.parameterization import LogWarp
from measured_materials.bake.tables.search import byte_limit
from measured_materials.bake.tables.search.byte_limit import (
    MOST_BYTES,
    file_bytes,
    grid_within,
    least_grid,
    resolution_for,
)
from measured_materials.bake.tables.stored_table import StoredTable, store_table
from measured_materials.bake.tables.table import Table, tabulate
from support.coarse_bakes import coarse_bakes

GGX = Ggx(alpha=0.15, f0=(0.9, 0.6, 0.3), diffuse=(0.2, 0.1, 0.05))
GRID = HalfVectorGrid((9, 12, 4), "fitted", warps=(LogWarp(), LogWarp(0.01), LogWarp()), cosine_power=2)
LIMIT = 3000


def within(most: int) -> PartBake:
    return PartBake(GGX, BakeSettings(storage=Storage.LOG, table_bytes=most), lambda stage, share: None, 4096)


@pytest.mark.slow
@pytest.mark.parametrize("start", [(5, 6, 4), (20, 30, 8)])
def test_the_limit_is_kept_and_used(start: tuple[int, int, int]) -> None:
    """Wherever the search begins, and although fitted codes take more room than those it measures by."""
    bake = within(LIMIT)
    made = bake.tabulate(HalfVectorGrid(start, "fitted", warps=GRID.warps, cosine_power=2))
    assert 0.8 * LIMIT < file_bytes(made.kept) <= LIMIT


def test_a_table_that_takes_more_than_expected_is_made_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Codes that are fitted may take any number of bytes more than those of the samples, here a half more."""

    def found(source: object, grid: HalfVectorGrid, most: float, pairs: object, truth: object) -> HalfVectorGrid:
        return replace(grid, sizes=(4, 4, max(int(most / 16), 5)))

    monkeypatch.setattr(part_bake, "grid_within", found)
    monkeypatch.setattr(part_bake, "file_bytes", lambda kept: 1.5 * np.prod(kept.table.grid.shape))
    bake = PartBake(GGX, BakeSettings(storage=Storage.LOG, table_bytes=1200), lambda stage, share: None, 512)
    assert 0.9 * 1200 < 1.5 * np.prod(bake.tabulate(GRID).kept.table.grid.shape) <= 1200
    least = least_grid(GRID)
    monkeypatch.setattr(part_bake, "file_bytes", lambda kept: 900 if kept.table.grid == least else 5000)
    assert bake.tabulate(GRID).kept.table.grid == least
    monkeypatch.setattr(part_bake, "file_bytes", lambda kept: 5000 - (kept.table.grid == least))
    with pytest.raises(BakeError, match="no table within 1200 bytes: the smallest takes 4999"):
        bake.tabulate(GRID)


@pytest.mark.parametrize("best", [0, 1])
def test_a_table_that_leaves_room_is_made_again_and_the_better_kept(best: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the filter and the reason that belong to it, whichever came last."""
    rooms: list[float] = []

    def found(source: object, grid: HalfVectorGrid, room: float, pairs: object, truth: object) -> HalfVectorGrid:
        rooms.append(room)
        return replace(grid, sizes=(4, 4, 4 + len(rooms)))

    def made(bake: PartBake, grid: HalfVectorGrid) -> part_bake._Tabulated:
        bake.filter, weighed = ("bspline", "trilinear")[len(rooms) - 1], FilterChoice("bspline", {}, str(len(rooms)))
        error = 0.1 + (len(rooms) - 1 != best)
        values = np.full((*grid.shape, 3), error, np.float32)
        table = Table(grid, values, filter=bake.filter)
        return part_bake._Tabulated(StoredTable(table, Storage.FLOAT32), "none", 1.0, weighed)

    monkeypatch.setattr(part_bake, "grid_within", found)
    monkeypatch.setattr(PartBake, "_tabulated", made)
    monkeypatch.setattr(part_bake, "file_bytes", lambda kept: (1000, 1190)[kept.table.grid.shape[2] - 5])
    bake = PartBake(Lambert(), BakeSettings(storage=Storage.LOG, table_bytes=1200), lambda stage, share: None, 512)
    kept = bake.tabulate(GRID).kept
    assert len(rooms) == 2 and rooms[1] == pytest.approx(min(rooms[0] * 0.99 * 1.2, 1200))
    assert kept.table.grid.shape[2] == 5 + best
    assert bake.filter == kept.table.filter == ("bspline", "trilinear")[best]
    assert bake.weighed is not None and bake.weighed.why == str(best + 1)


@pytest.mark.slow
def test_more_bytes_err_less() -> None:
    bakes = [within(most) for most in (2000, 8000)]
    errors = []
    for bake in bakes:
        table = bake.tabulate(GRID).kept.table
        errors.append(bake.pairs.rms(table.evaluate(bake.pairs.wi, bake.pairs.wo) - bake.truth))
    assert errors[1] < 0.6 * errors[0]


@pytest.mark.parametrize("grid", [GRID, NormalVectorGrid(9, "uniform")], ids=["half", "normal"])
def test_no_more_samples_would_fit(grid: HalfVectorGrid | NormalVectorGrid) -> None:
    """In the normal-vector basis, whose axes have one number, of one more along each of them; else of a tenth more."""
    pairs = direction_pairs(2048)
    truth = GGX.evaluate(pairs.wi, pairs.wo)

    def needed(grid: HalfVectorGrid | NormalVectorGrid) -> int:
        return file_bytes(store_table(tabulate(GGX, grid), Storage.LOG, pairs, truth))

    found = grid_within(GGX, grid, LIMIT, pairs, truth)
    if isinstance(found, HalfVectorGrid):
        assert found.warps == GRID.warps
        d, h, phi = found.sizes
        more: HalfVectorGrid | NormalVectorGrid = replace(found, sizes=(d + 1, round(h * 1.1), phi))
    else:
        more = replace(found, n=found.n + 1)
    assert needed(found) <= LIMIT < needed(more)


@pytest.mark.parametrize("most", [1.0, MOST_BYTES, 1e12], ids=["too few", "most", "no limit"])
@pytest.mark.parametrize(
    "grid",
    [GRID, NormalVectorGrid(9, "uniform"), HalfVectorGrid((4, 2000, 4), "uniform")],
    ids=["half", "normal", "too long"],
)
def test_the_search_ends_at_what_can_be_read(
    grid: HalfVectorGrid | NormalVectorGrid, most: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By files that hold a thousand texels a byte, as those of a constant BRDF: no size may be tried, or found, that a
    bundle's reader or a texture refuses.
    """
    codes = SimpleNamespace(log=SimpleNamespace(ranges=(8.0,) * 3))
    tried: list[HalfVectorGrid | NormalVectorGrid] = []

    def tabulated(source: object, grid: HalfVectorGrid | NormalVectorGrid) -> HalfVectorGrid | NormalVectorGrid:
        tried.append(grid)
        return grid

    monkeypatch.setattr(byte_limit, "tabulate", tabulated)
    monkeypatch.setattr(byte_limit, "store_table", lambda grid, *_: SimpleNamespace(table=codes, grid=grid))
    monkeypatch.setattr(byte_limit, "file_bytes", lambda kept: 90 + np.prod(kept.grid.shape) / 1000)
    pairs = direction_pairs(64)
    found = grid_within(Lambert(), grid, most, pairs, Lambert().evaluate(pairs.wi, pairs.wo))
    assert all(grid_of(Fields(one.facts(), "here"), anisotropic=False) == one for one in tried)
    assert all(AtlasLayout.of(one) for one in tried)
    if most == 1:
        assert found == least_grid(grid)
    else:
        assert found in tried and np.prod(found.shape) == max(np.prod(one.shape) for one in tried) <= 16 * most


def test_samples_of_a_constant_brdf_are_bounded_by_the_bytes() -> None:
    """Its codes take a few bytes, however many they are."""
    settings = BakeSettings(storage=Storage.LOG, table_bytes=1024)
    made = PartBake(Lambert(), settings, lambda stage, share: None, 512).tabulate(NormalVectorGrid(9, "uniform"))
    assert 8 * 1024 < np.prod(made.kept.table.grid.shape) <= 16 * 1024
    assert file_bytes(made.kept) < 512


@pytest.mark.slow
@pytest.mark.parametrize("basis", ["normal", "half"])
def test_a_bundle_of_a_constant_brdf_is_read_again(basis: Any, tmp_path: Path) -> None:
    settings = BakeSettings(storage=Storage.LOG, table_bytes=8192, basis=basis)
    with coarse_bakes():
        record = BrdfRecord.read(read_bundle(bake_source(Lambert(), tmp_path / "white", settings).path))
    assert record.load_table().values == pytest.approx(0.5 / np.pi, rel=0.01)
    assert record.load_table("residual").values.max() < 1e-3


def test_both_tables_of_a_bundle_have_so_many_bytes(tmp_path: Path) -> None:
    """Also of what Cycles' own shaders leave, half as many unless they were counted. Its settings, read again and told,
    are those it was made with.
    """
    settings = BakeSettings(storage=Storage.LOG, table_bytes=LIMIT, basis="half", sampler=SamplerLayout(16, 16, 8))
    with coarse_bakes():
        bundle = read_bundle(bake_source(Ggx(alpha=0.4), tmp_path / "small", settings, pairs=4096).path)
    sizes = [bundle.image_path(name).stat().st_size for name in ("table", "residual")]
    assert all(0.8 * LIMIT < size <= LIMIT + 200 for size in sizes), sizes  # the name of its bundle
    record = BrdfRecord.read(bundle)
    assert record.settings == settings and ("Table limit", "3,000 bytes of each table's file") in table_rows(record)
    assert record.load_table("residual").values.any()


def test_what_has_no_such_table_is_refused() -> None:
    with pytest.raises(BakeError, match="storage log"):
        BakeSettings(table_bytes=2700)
    for most in (500, 2 * MOST_BYTES):
        with pytest.raises(BakeError, match=f"from 1024 to {MOST_BYTES}"):
            BakeSettings(storage=Storage.LOG, table_bytes=most)
    settings = BakeSettings(storage=Storage.LOG, table_bytes=2700)
    with pytest.raises(BakeError, match="anisotropic"):
        PartBake(Ggx(alpha=0.1, alpha_y=0.3), settings, lambda stage, share: None, 1024)


def test_resolutions_are_those_that_take_about_so_many_bytes() -> None:
    assert [resolution_for(most) for most in (1024, 2700, 48 * 1024)] == [5, 8, 28]
