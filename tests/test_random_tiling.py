"""A swatch laid out at random: the node group is the formula in numpy, and the formula blends what it should."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from measured_materials.addon.material.adjust.swatch import set_random_tiling
from measured_materials.bake import xp_numpy
from measured_materials.bake.lobes.lobes import Lobe
from measured_materials.bake.shading_maps.render_settings import RenderSettings
from measured_materials.bake.tiling.hexagons import SHARPNESS, hexagon_tiling
from measured_materials.nodes import expr
from measured_materials.nodes.group import call
from measured_materials.nodes.random_tiling_group import random_tiling_group
from measured_materials.nodes.shading_map_material import build_shading_map
from numpy.typing import NDArray
from support.cards import card
from support.clean_blend import clean_blend  # noqa: F401
from support.scenes import lit_sphere
from support.swatches import map_bundle, rough_map

UV = np.random.default_rng(11).uniform(-3, 3, (4000, 2))
NUMBERS = np.random.default_rng(12).uniform(size=len(UV))
SIZE = 0.7
COLUMN = np.array([1.0, 0.0])
ROW = np.array([0.5, math.sqrt(3) / 2])
"""Edges of the grid's triangles, at a size of 1."""


def no_offset(column: Any, row: Any) -> tuple[Any, Any]:
    """The hexagon itself in place of its offset."""
    return column * 1000.0, row * 1000.0


def chosen(uv: NDArray[Any], random: NDArray[Any], size: float = SIZE) -> NDArray[np.float64]:
    """(column, row) of the hexagon that is drawn at each place."""
    u, v = hexagon_tiling(xp_numpy, no_offset, uv[:, 0], uv[:, 1], size, random)
    return np.rint((np.stack([u, v], -1) - uv) / 1000)


def corners_and_weights(uv: NDArray[Any], size: float) -> tuple[NDArray[Any], NDArray[Any]]:
    """The nearest three corners of the grid and their weights, by solving for barycentric coordinates."""
    grid = np.stack([COLUMN, ROW], 1) * size
    base = np.floor(uv @ np.linalg.inv(grid).T)
    found, weights = [], []
    for triangle in (((0, 0), (1, 0), (0, 1)), ((1, 1), (1, 0), (0, 1))):
        corners = base[:, None] + np.array(triangle)
        places = corners @ grid.T
        edges = np.stack([places[:, 1] - places[:, 0], places[:, 2] - places[:, 0]], -1)
        inside = np.linalg.solve(edges, (uv - places[:, 0])[..., None])[..., 0]
        weights.append(np.concatenate([1 - inside.sum(-1, keepdims=True), inside], -1))
        found.append(corners)
    first = (weights[0].min(-1) >= 0)[:, None]
    weight = np.where(first, weights[0], weights[1])
    assert weight.min() > -1e-9
    return np.where(first[..., None], found[0], found[1]), weight


def test_one_of_three_corners_is_drawn_by_its_weight() -> None:
    """Over all random numbers, each as often as its sharpened share."""
    corners, weights = corners_and_weights(UV[:200], SIZE)
    shares = weights**SHARPNESS / (weights**SHARPNESS).sum(-1, keepdims=True)
    numbers = (np.arange(2000) + 0.5) / 2000
    places = np.repeat(UV[:200], len(numbers), 0)
    drawn = chosen(places, np.tile(numbers, 200)).reshape(200, len(numbers), 2)
    counts = np.stack([(drawn == corners[:, None, k]).all(-1).mean(-1) for k in range(3)], -1)
    assert np.abs(counts.sum(-1) - 1).max() < 1e-12
    assert np.abs(counts - shares).max() < 1.5 / 2000


def test_nothing_is_turned_or_stretched() -> None:
    """A hexagon shows the swatch as it is, moved: neighbours that draw the same one keep their distance."""
    step = np.array([1e-3, 0.0])
    random = NUMBERS
    same = (chosen(UV, random) == chosen(UV + step, random)).all(-1)
    assert same.mean() > 0.95

    def offset(column: Any, row: Any) -> tuple[Any, Any]:
        return np.sin(column * 12.9 + row * 78.2) * 3.1 % 1, np.sin(column * 39.3 + row * 11.1) * 5.7 % 1

    moved = [np.stack(hexagon_tiling(xp_numpy, offset, *uv.T, SIZE, random), -1) for uv in (UV, UV + step)]
    assert np.abs((moved[1] - moved[0])[same] - step).max() < 1e-9


def test_the_group_is_the_formula() -> None:
    """With Cycles' own hash for the offsets, looked up apart; but where float32 decides otherwise at a border."""
    random = NUMBERS.astype(np.float32)
    uv = np.column_stack([UV, np.zeros(len(UV))]).astype(np.float32)

    def graph(place: Any, number: Any) -> Any:
        def offsets(column: Any, row: Any) -> tuple[Any, Any]:
            return expr.white_noise(expr.vec(column, row, 5.0), 0.0)[:2]

        u, v, _ = expr.components(place)
        return expr.vec(*hexagon_tiling(expr, offsets, u, v, SIZE, number), 0.0)

    (found,) = card(graph, uv, random)
    hexagons = np.array([(a, b, 5.0) for a in range(-12, 13) for b in range(-12, 13)], np.float32)
    (noise,) = card(lambda place: expr.Vector(expr.vec(*expr.white_noise(place, 0.0)).socket), hexagons)
    table = {(int(a), int(b)): row[:2] for (a, b, _), row in zip(hexagons, noise)}
    wanted = UV + np.array([table[int(a), int(b)] for a, b in chosen(uv[:, :2].astype(float), random.astype(float))])
    off = np.abs(found[:, :2] - wanted).max(-1)
    assert (off > 1e-5).mean() < 2e-3
    assert len({tuple(row) for row in noise[:, :2].tolist()}) == len(noise)


def test_the_node_draws_by_a_number_of_its_own() -> None:
    """Every place of a patch's border meets several patches; the offsets of one seed are not those of another."""
    uv = np.column_stack([UV, np.zeros(len(UV))]).astype(np.float32)

    def moved(seed: float) -> NDArray[Any]:
        (found,) = card(lambda place: call(random_tiling_group(), place, SIZE, seed), uv)
        return (found[:, :2] - UV) % 1

    one, again, other = moved(1.0), moved(1.0), moved(2.0)
    assert np.array_equal(one, again) and (np.abs(one - other).max(-1) > 1e-3).mean() > 0.9
    corners, weights = corners_and_weights(UV, SIZE)
    # A place that lies in the middle of a patch shows that patch: all such places of one patch are moved alike.
    middle = weights.max(-1) > 0.75
    patch = [tuple(c) for c in corners[np.arange(len(UV)), weights.argmax(-1)]]
    alike: dict[tuple[float, ...], list[NDArray[Any]]] = {}
    for k in np.flatnonzero(middle):
        alike.setdefault(patch[k], []).append(one[k])
    spread = [np.ptp(np.array(found), axis=0).max() for found in alike.values() if len(found) > 3]
    assert len(spread) > 20 and np.median(spread) < 1e-5
    assert np.abs(np.concatenate([found[:1] for found in alike.values()]).mean(0) - 0.5).max() < 0.1


@pytest.mark.parametrize("mode", ["exact", "reference"])
def test_the_picture_keeps_its_light(tmp_path: Any, mode: str) -> None:
    """On average over many patches a material reflects what it did; off, the picture is the same bit by bit."""
    render = RenderSettings(Lobe("lambert"), sigma=0.6, mode=mode)
    material = build_shading_map(map_bundle(tmp_path / "cloth", rough_map(), render))
    mapping = next(n for n in material.node_tree.nodes if n.bl_idname == "ShaderNodeMapping")
    mapping.inputs["Scale"].default_value = (40, 20, 1)
    with lit_sphere(material, ground=False, lamp=False, resolution=48) as scene:
        plain, mask = scene.render(32, 1), scene.mask()
        set_random_tiling(material, True)
        random = scene.render(32, 1)
        set_random_tiling(material, False)
        assert np.array_equal(scene.render(32, 1), plain)
    means = [picture[0][mask].mean(0) for picture in (plain, random)]
    assert np.abs(plain - random).max() > 0.01
    assert means[1] == pytest.approx(means[0], rel=0.02)
