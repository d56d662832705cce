"""Half-vector tables and fitted warps in nodes and OSL against float64 numpy, on render cards."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from measured_materials.bake import xp_numpy
from measured_materials.bake.directions import spherical
from measured_materials.bake.images.image_io import write_image
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.tables.atlas import pack
from measured_materials.bake.tables.grids import parameterization as par
from measured_materials.bake.tables.grids.grid import Grid
from measured_materials.bake.tables.grids.half_vector_grid import HalfVectorGrid
from measured_materials.bake.tables.grids.normal_vector_grid import NormalVectorGrid
from measured_materials.bake.tables.grids.parameterization import LogWarp
from measured_materials.bake.tables.table import FILTERS, Table
from measured_materials.nodes import expr
from measured_materials.nodes.group import call
from measured_materials.nodes.osl_parameters import grid_constants
from measured_materials.nodes.table_lookup_group import coordinates_group, table_lookup_group
from support.cards import card, data_image
from support.osl import header_card, osl_grid, shader_card, skip_without_osl

EPS = float(np.finfo(np.float32).eps)
WARPS = (LogWarp(4.0, 0.1), LogWarp(0.003, 4.0), LogWarp(0.1, 0.4))
UNIT = np.concatenate([[0, 1, 0.5, 1e-7, 1e-4, 1 - 1e-7], np.random.default_rng(0).random(2000)]).astype(np.float32)
GRIDS = {
    "half fitted": HalfVectorGrid((12, 20, 9), "fitted", warps=WARPS),
    "half fitted, not reciprocal": HalfVectorGrid((12, 20, 9), "fitted", warps=WARPS, reciprocal=False),
    "half times cosines": HalfVectorGrid((12, 20, 9), "fitted", warps=WARPS, cosine_power=1),
    "half times cosines squared": HalfVectorGrid((12, 20, 9), "fitted", warps=WARPS, reciprocal=False, cosine_power=2),
    "half bezier": HalfVectorGrid((12, 20, 9), "bezier", alphas=(0.4, 0.2, 0.6)),
    "half squared": HalfVectorGrid((12, 20, 9), "squared"),
    "normal fitted": NormalVectorGrid(12, "fitted", warps=(LogWarp(4.0, 0.4), LogWarp(0.01, 0.1))),
}


def direction_grid() -> tuple[np.ndarray, np.ndarray]:
    """Float32 pairs: poles, wi = wo, mirrors and near mirrors, grazing and opposite directions, and random ones."""
    theta = np.array([0, 1e-4, 0.01, 0.8, 1.5, np.pi / 2 - 1e-4])
    phi = np.array([0, 1e-4, 1.0, np.pi / 2, np.pi - 1e-3, np.pi, -2.0])
    ti, to, p = (a.ravel() for a in np.meshgrid(theta, theta, phi))
    rng = np.random.default_rng(1)
    ti, to = (np.concatenate([t, np.arccos(rng.random(3000))]) for t in (ti, to))
    p = np.concatenate([p, rng.uniform(-np.pi, np.pi, 3000)])
    # A thousand beside the mirror direction, where theta_h decides.
    to[-1000:] = ti[-1000:] * (1 + 1e-3 * rng.normal(size=1000))
    p[-1000:] = np.pi * (1 + 1e-3 * rng.normal(size=1000))
    wi, wo = spherical(ti, p).astype(np.float32), spherical(np.minimum(to, 1.57), 0.0).astype(np.float32)
    wi[..., 2], wo[..., 2] = np.maximum(wi[..., 2], 0), np.maximum(wo[..., 2], 0)
    return wi, wo


def tolerances(grid: Grid, wi: np.ndarray, wo: np.ndarray) -> list[np.ndarray]:
    """Of the three coordinates: what an error of a few ulp in the directions is worth at each pair.

    A direction whose last bits change moves h by half as much over |s|, and phi_d by as much over sin theta_h sin
    theta_d. The coordinates' own derivative, by differences in double precision, is the measure.
    """
    base = np.stack(grid.unit_coordinates(xp_numpy, wi, wo))
    rng = np.random.default_rng(2)
    worst = np.full(base.shape, 4 * EPS)
    for _ in range(12):
        noise = rng.normal(size=(2, *wi.shape)) * (2 * EPS)
        moved = np.stack(grid.unit_coordinates(xp_numpy, wi + noise[0], wo + noise[1]))
        worst = np.maximum(worst, np.abs(moved - base))
    return list(8 * worst)


@pytest.mark.parametrize("name", [name for name, grid in GRIDS.items() if not getattr(grid, "cosine_power", 0)])
@pytest.mark.parametrize("language", ["nodes", "osl"])
def test_coordinates(name: str, language: str) -> None:
    """Every coordinate within what float32 directions allow."""
    grid = GRIDS[name]
    wi, wo = direction_grid()
    if language == "nodes":
        found = card(lambda a, b: call(coordinates_group(grid), a, b), wi, wo)
    else:
        skip_without_osl()
        (at,) = header_card(
            f"MMGrid g = {osl_grid(grid)}; at = mm_coordinates(g, wi, wo);", {"at": "vector"}, wi=wi, wo=wo
        )
        found = list(at.T)
    wide = wi.astype(float), wo.astype(float)
    truth = grid.unit_coordinates(xp_numpy, *wide)
    # Below 0.01 degrees over the horizon theta_d's share is the quotient of two numbers of rounding's size.
    above = np.minimum(wi[:, 2], wo[:, 2]) > 2e-4
    for value, expected, tolerance in zip(found, truth, tolerances(grid, *wide), strict=True):
        assert np.isfinite(value).all() and value.min() >= -4 * EPS and value.max() <= 1 + 4 * EPS
        assert (np.abs(value - expected) <= tolerance)[above].all(), np.abs((value - expected) / tolerance)[above].max()


@pytest.mark.parametrize("kind", ["fitted", "squared"])
@pytest.mark.parametrize("near", [par.NARROWEST_END, 0.03, par.WIDEST_END])
@pytest.mark.parametrize("language", ["nodes", "osl"])
def test_forward(kind: str, near: float, language: str) -> None:
    """s from the chord, relative to the derivative."""
    warp = LogWarp(near, 0.1)
    if language == "nodes":
        (s,) = card(lambda v: par.forward(expr, kind, v, warp), UNIT)
    else:
        skip_without_osl()
        numbers = ", ".join(f"{x:.9g}" for x in warp.constants)
        (s,) = header_card(f's = mm_forward("{kind}", x, vector({numbers}));', {"s": "float"}, x=UNIT)
    v = UNIT.astype(float)
    truth = par.forward(xp_numpy, kind, v, warp)
    if kind == "squared":
        # The root of an arcsine wrong by 4 ulp; where it is 0 the root of an ulp.
        assert (np.abs(s - truth) * np.maximum(np.sqrt(v), EPS**0.5)).max() < 8 * EPS
    else:
        # The logarithm's argument is right to 4 roundings, and its result is at most 16 C = 1 to 3 times that.
        slope = warp.constants[2] * (1 / (v + near) + 1 / (1.1 - v))
        assert (np.abs(s - truth) / np.maximum(slope, 1)).max() < 12 * EPS


def random_table(grid: Grid) -> Table:
    """White noise, constant in phi at the poles."""
    values = np.random.default_rng(3).random((*grid.shape, 3)).astype(np.float32)
    values[:, -1], values[-1] = values[:, -1, :1], values[-1, :, :1]
    return Table(grid, values)


@pytest.mark.parametrize(
    ("name", "filter"),
    [
        *itertools.product(["half fitted", "half fitted, not reciprocal", "normal fitted"], FILTERS),
        ("half times cosines", "trilinear"),
        ("half times cosines squared", "trilinear"),
    ],
)
@pytest.mark.parametrize("language", ["nodes", "osl"])
def test_lookup(name: str, filter: str, language: str, tmp_path: Path) -> None:
    """The whole lookup: coordinates, atlas, gutter, image filter and the blend across slices."""
    table = random_table(GRIDS[name])
    wi, wo = direction_grid()
    if language == "nodes":
        image = data_image("half table", pack(table.grid, table.values))
        group = table_lookup_group(f"card {name} {filter}", image, table.grid, filter)
        (found,) = card(lambda a, b: call(group, a, b, 0.5), wi, wo)
    else:
        skip_without_osl()
        write_image(tmp_path / "atlas.exr", pack(table.grid, table.values), Storage.FLOAT32)
        constants = {
            "Table": str(tmp_path / "atlas.exr"),
            "Filter": filter,
            "Stochastic": 0,
            **grid_constants(table.grid),
        }
        (found,) = shader_card("measured_lookup.osl", ["BRDF"], constants, wi=wi, wo=wo)
    wide = wi.astype(float), wo.astype(float)
    keep = np.minimum(wi[:, 2], wo[:, 2]) > 2e-4
    # What is stored has the size of 1, the BRDF where it is divided by cosines another.
    factor = np.broadcast_to(table.grid.factor(xp_numpy, *wide), len(wi))
    difference = np.abs(found - table.evaluate(*wide, filter)).max(-1) * factor
    position = np.stack(table.grid.coordinates(xp_numpy, *wide), -1)
    if filter == "nearest":
        # At the border between two texels either is right.
        keep &= (np.abs(position - np.floor(position) - 0.5) > 2e-3).all(-1)
    # White noise turns a share of a texel into as much value. Where phi_d is uncertain, beside a pole, its texels come
    # with a weight that falls as the uncertainty grows: their product stays at the size of the other errors.
    assert np.isfinite(found).all()
    assert difference[keep].max() < 2e-3
    assert np.median(difference[keep]) < 4e-5
