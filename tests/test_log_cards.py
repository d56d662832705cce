"""Lookups of 8-bit codes on render cards, of nodes and of OSL: the numbers that numpy has."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
from measured_materials.bake import xp_numpy
from measured_materials.bake.images.image_io import write_image
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.tables.atlas import pack
from measured_materials.bake.tables.grids.grid import Grid
from measured_materials.bake.tables.grids.half_vector_grid import HalfVectorGrid
from measured_materials.bake.tables.grids.normal_vector_grid import NormalVectorGrid
from measured_materials.bake.tables.grids.parameterization import LogWarp
from measured_materials.bake.tables.log_codes import LogCodes
from measured_materials.bake.tables.table import FILTERS, Table
from measured_materials.nodes import expr
from measured_materials.nodes.data_image import load_data_image
from measured_materials.nodes.group import call
from measured_materials.nodes.osl_parameters import grid_constants
from measured_materials.nodes.table_lookup_group import table_lookup_group
from support.cards import card
from support.osl import header_card, shader_card, skip_without_osl
from test_anisotropic_cards import GRIDS, directions
from test_anisotropic_osl import lookup_body
from test_node_cards import direction_grid, evaluate_at_horizon

CODES = LogCodes.reaching(np.array([1.0, 2.0, 0.5]), np.array([4.0, 9.0, 14.0]))
TABLES: dict[str, Grid] = {
    "normal": NormalVectorGrid(12, "bezier", 0.3, 0.15),
    "half": HalfVectorGrid((7, 20, 6), "fitted", warps=(LogWarp(), LogWarp(0.01), LogWarp())),
}


def random_table(grid: Grid) -> Table:
    """White noise of codes, from 0 to 1."""
    values = np.random.default_rng(4).random((*grid.shape, 3)).astype(np.float32)
    values[:, -1], values[-1] = values[:, -1, :1], values[-1, :, :1]
    return Table(grid, CODES.rounded(CODES.decode(xp_numpy, values)), CODES)


def written(table: Table, folder: Path) -> Path:
    """The file of a bundle's table."""
    write_image(folder / "table.png", CODES.encode(pack(table.grid, table.values)), Storage.BYTE)
    return folder / "table.png"


def off(found: np.ndarray, table: Table, filter: str) -> np.ndarray:
    """Largest difference of the channels as shares of their peaks, where the exact position is decided by numbers."""
    wi, wo = (w.astype(float) for w in direction_grid())
    difference = (np.abs(found - evaluate_at_horizon(table, wi, wo, filter)) / CODES.peaks).max(-1)
    position = np.stack(table.grid.coordinates(xp_numpy, wi, wo), -1)
    keep = np.minimum(wi[:, 2], wo[:, 2]) > 2e-4  # as in tests/test_half_cards.py
    if isinstance(table.grid, HalfVectorGrid):
        keep &= position[:, 1] < table.grid.sizes[1] - 1 - 1e-6  # in the pole itself phi_d is rounding
    if filter == "nearest":
        keep &= (np.abs(position - np.floor(position) - 0.5) > 2e-3).all(-1)
    assert np.isfinite(found).all() and keep.sum() > 3000
    return difference[keep]


# Positions are as far from numpy's as in tests/test_node_cards.py, whose tables of white noise have up to 64 samples,
# these at most 24; and the steepest channel turns a code's error into 14 times as much of its peak.
MOST, USUAL = 14 * 6e-4 * 24 / 64, 14 * 4e-5 * 24 / 64


@pytest.mark.parametrize("basis", TABLES)
@pytest.mark.parametrize("filter", FILTERS)
@pytest.mark.parametrize("pack_into_blend", [False, True])
def test_node_lookup(tmp_path: Path, basis: str, filter: str, pack_into_blend: bool) -> None:
    table = random_table(TABLES[basis])
    image = load_data_image(written(table, tmp_path), f"log {basis}", pack=pack_into_blend)
    group = table_lookup_group(f"card log {basis} {filter}", image, table.grid, filter, log=CODES)
    (found,) = card(lambda a, b: call(group, a, b, 0.5), *direction_grid())
    assert off(found, table, filter).max() < MOST and np.median(off(found, table, filter)) < USUAL


@pytest.mark.parametrize("basis", TABLES)
@pytest.mark.parametrize("filter", FILTERS)
def test_osl_lookup(tmp_path: Path, basis: str, filter: str) -> None:
    skip_without_osl()
    table = random_table(TABLES[basis])
    constants = {"Table": str(written(table, tmp_path)), "LogRange": CODES.ranges, "LogGain": CODES.gains}
    constants |= {**grid_constants(table.grid), "Filter": filter, "Stochastic": 0}
    wi, wo = direction_grid()
    (found,) = shader_card("measured_lookup.osl", ["BRDF"], constants, wi=wi, wo=wo)
    assert off(found, table, filter).max() < MOST and np.median(off(found, table, filter)) < USUAL


@pytest.mark.parametrize("filter", ["trilinear", "bspline"])
def test_stochastic_slice_averages_to_the_blend(tmp_path: Path, filter: str) -> None:
    """Slices are decoded before they are blended: one chosen at random has the blend as its mean."""
    table = random_table(TABLES["normal"])
    image = load_data_image(written(table, tmp_path), "log stochastic")
    group = table_lookup_group(f"card log stochastic {filter}", image, table.grid, filter, stochastic=True, log=CODES)
    wi, wo = (w[-60:] for w in direction_grid())
    steps = 400
    u = np.tile((np.arange(steps) + 0.5) / steps, len(wi)).astype(np.float32)
    (found,) = card(lambda a, b, r: call(group, a, b, r), np.repeat(wi, steps, 0), np.repeat(wo, steps, 0), u)
    mean = found.reshape(len(wi), steps, 3).mean(1)
    difference = np.abs(mean - table.evaluate(wi.astype(float), wo.astype(float), filter)) / CODES.peaks
    # An even grid of 400 numbers misses each of at most 3 jumps by half a step.
    assert difference.max() < 3 * 0.5 / steps + USUAL


@pytest.mark.parametrize("name", ["normal", "half, folded"])
@pytest.mark.parametrize("filter", FILTERS)
@pytest.mark.parametrize("language", ["nodes", "osl"])
def test_anisotropic_lookup(tmp_path: Path, name: str, filter: str, language: str) -> None:
    grid = GRIDS[name]
    noise = np.random.default_rng(3).random((*grid.shape, 3)).astype(np.float32)
    table = Table(grid, CODES.rounded(CODES.decode(xp_numpy, noise)), CODES, filter)
    write_image(tmp_path / "table.png", CODES.encode(pack(grid, table.values)), Storage.BYTE)
    wi, wo = directions(3000)
    if language == "nodes":
        image = load_data_image(tmp_path / "table.png", f"log {name}")
        group = table_lookup_group(f"card log {name} {filter}", image, grid, filter, log=CODES)
        (found,) = card(lambda a, b: call(group, a, b, 0.5), wi, wo)
    else:
        skip_without_osl()
        log = ", ".join("vector({:.9g}, {:.9g}, {:.9g})".format(*ends) for ends in (CODES.ranges, CODES.gains))
        body = lookup_body(tmp_path / "table.png", grid, filter, log)
        (found,) = header_card(body, {"value": "vector"}, wi=wi, wo=wo)
    wi, wo = wi.astype(float), wo.astype(float)
    factor = np.broadcast_to(grid.factor(xp_numpy, wi, wo), len(wi))
    difference = (np.abs(found - table.evaluate(wi, wo)) / CODES.peaks).max(-1) * factor
    if filter == "nearest":
        position = np.stack(grid.coordinates(xp_numpy, wi, wo), -1)
        difference = difference[(np.abs(position - np.floor(position) - 0.5) > 1e-3).all(-1)]
    # As in tests/test_anisotropic_cards.py, times 14.
    assert np.quantile(difference, 0.995) < 14 * 3e-4 and np.median(difference) < 14 * 2e-5


@pytest.mark.parametrize("interpolation", ["Closest", "Linear", "Cubic"])
@pytest.mark.parametrize("pack_into_blend", [False, True])
def test_bytes_0_and_255_are_exactly_0_and_1(tmp_path: Path, interpolation: str, pack_into_blend: bool) -> None:
    """In Cycles: no conversion raises black, as that of half floats does, and a table's peak is kept."""
    # Inside either half, away from the other.
    u = np.concatenate([np.linspace(0.01, 0.3, 30), np.linspace(0.7, 0.99, 30)]).astype(np.float32)
    pixels = np.repeat(np.repeat(np.array([0.0, 1.0], np.float32), 8)[None, :, None], 3, 2)
    write_image(tmp_path / "ends.png", pixels, Storage.BYTE)
    image = load_data_image(tmp_path / "ends.png", "ends", pack=pack_into_blend)

    def decoded(x: object) -> tuple[object, object]:
        texel = expr.image_tap(image, x, 0.5, interpolation)[0]
        return texel, CODES.decode(expr, texel)

    texel, value = card(decoded, u)
    assert (texel[:30] == 0).all() and (value[:30] == 0).all()
    if interpolation == "Cubic":
        # The four weights of a B-spline sum to 1 but for their rounding.
        assert np.abs(texel[30:] - 1).max() < 4e-7
    else:
        assert (texel[30:] == 1).all()
    assert np.abs(value[30:] / CODES.peaks - 1).max() < 14 * 4e-7 + 2e-6
    bpy.data.images.remove(image)


@pytest.mark.parametrize("ranges", [(1.0, 2.0, 4.0), (8.0, 16.0, 24.0)])
def test_decoding(ranges: tuple[float, float, float]) -> None:
    """All codes and what lies between them, of nodes and OSL; exactly 0 at 0."""
    skip_without_osl()
    codes = LogCodes.reaching(np.array([1.0, 1e30, 1e-20]), np.array(ranges))
    steps = np.concatenate([np.arange(256) / 255, np.random.default_rng(1).random(2000), [1e-7]])
    x = np.repeat(steps[:, None], 3, 1).astype(np.float32)
    expected = codes.decode(xp_numpy, x.astype(float))
    body = "value = mm_decode(color(x), r, g);"
    ends = {
        name: np.tile(np.array(v, np.float32), (len(x), 1)) for name, v in (("r", codes.ranges), ("g", codes.gains))
    }
    (nodes,) = card(lambda c: codes.decode(expr, c), x)
    (osl,) = header_card(body, {"value": "color"}, x=x, **ends)
    # Relative to value + gain: exp is good to 1e-7 and its argument, up to 24, to as much of itself; OSL's is fast, and
    # by OpenImageIO's own account up to 232 ulp off.
    for found, most in ((nodes, 24 * 2e-7), (osl, 232 * 6e-8)):
        assert not found[0].any()
        assert (np.abs(found - expected) / (expected + codes.gains)).max() < most
