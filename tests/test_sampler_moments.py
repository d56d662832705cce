"""Where draws fall and how noisy they leave a picture: moments and variances by quadrature, in numpy, nodes and OSL.

A density may integrate to one and every draw meet its lamp while draws crowd where they should not; a picture by such
draws is wrong, or right and noisier than anybody needs. The truths here are areas and solid angles, integrated without
any of the samplers' formulas.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from measured_materials.bake import xp_numpy
from measured_materials.bake.directions import spherical
from measured_materials.bake.sampling.cell_sampler import build_sampler
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sampling.lamps import ELLIPSE, SUN, Lamp, aim_numpy, expected_light, lamp_table
from measured_materials.bake.sampling.world import expected_world_light, world_texels
from measured_materials.bake.sources import analytic
from measured_materials.nodes.aimed_light_group import aimed_light_group
from measured_materials.nodes.group import call
from numpy.typing import NDArray
from support.cards import card, data_image
from support.osl import header_card, skip_without_osl
from test_light_sampling import LAMPS, drawn
from test_world_sampling import draw as draw_world

Array = NDArray[np.float64]
Moments = tuple[Array, Array]
SIDE = 128  # draws form a grid of so many rows and columns, stratified by themselves


def moments(directions: Array, weights: Array | None = None) -> Moments:
    """Mean (3,) and covariance (3, 3) of directions (N, 3), each as heavy as its weight."""
    part = np.full(len(directions), 1 / len(directions)) if weights is None else weights / weights.sum()
    mean = part @ directions
    apart = directions - mean
    return mean, np.einsum("n,na,nb->ab", part, apart, apart)


def lamp_moments(lamp: Lamp) -> Moments:
    """Of directions from the origin that are even over an area lamp's own surface, or over a cone's solid angle."""
    if lamp.kind < 1.5:
        s, t = (a.ravel() for a in np.meshgrid(*[(np.arange(1000) + 0.5) / 1000 - 0.5] * 2))
        if lamp.kind == ELLIPSE:
            s, t = (a[s * s + t * t < 0.25] for a in (s, t))
        points = np.array(lamp.centre) + s[:, None] * np.array(lamp.u) + t[:, None] * np.array(lamp.v)
        return moments(points / np.linalg.norm(points, axis=-1, keepdims=True))
    if lamp.kind == SUN:
        axis, cosine = np.array(lamp.axis), math.cos(lamp.extent / 2)
    else:
        distance = float(np.linalg.norm(lamp.centre))
        axis = np.array(lamp.centre) / distance
        cosine = math.sqrt(1 - (lamp.extent / distance) ** 2) if distance > lamp.extent else -1.0
    # Of a cap even in solid angle: cos t is even from `cosine` to 1. 1 - cosine^2 and its like without cancellation.
    lean = 1 - cosine if cosine < 0.999 else 2 * math.sin(math.acos(cosine) / 2) ** 2
    along = lean * lean / 12
    across = 0.5 * (lean - lean * lean / 3)
    return axis * (1 - lean / 2), across * np.eye(3) + (along - across) * np.outer(axis, axis)


def world_moments(texels: Array) -> Moments:
    """Of directions by the density of each cell, through 40 x 40 points in it."""
    rows, columns = texels.shape[:2]
    fine = 40
    z = ((np.arange(rows * fine) + 0.5) / (rows * fine) * 2 - 1)[:, None]
    azimuth = (np.arange(columns * fine) + 0.5) / (columns * fine) * 2 * np.pi - np.pi
    sine = np.sqrt(1 - z * z)
    points = np.stack(np.broadcast_arrays(sine * np.cos(azimuth), sine * np.sin(azimuth), z), -1).reshape(-1, 3)
    weights = np.repeat(np.repeat(texels[..., 2].astype(float), fine, 0), fine, 1)
    return moments(points, weights.ravel())


def assert_moments(found: Moments, expected: Moments, count: int, name: str) -> None:
    """Within what so many draws leave: four standard errors of a mean, and 3 % of the largest variance."""
    spread = np.sqrt(np.trace(expected[1]))
    # Directions are float32 in nodes: 2e-7 is their own rounding.
    assert np.abs(found[0] - expected[0]).max() < 4 * spread / math.sqrt(count) + 2e-7, name
    largest = np.linalg.eigvalsh(expected[1])[-1]
    assert np.abs(found[1] - expected[1]).max() < 0.03 * largest, name


def stratified() -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Pairs in the unit square, one in the middle of each cell of a grid."""
    at = ((np.arange(SIDE) + 0.5) / SIDE).astype(np.float32)
    u1, u2 = np.meshgrid(at, at)
    return u1.ravel(), u2.ravel()


@pytest.fixture
def world() -> NDArray[np.float32]:
    """16 x 8 cells of very unlike weights."""
    return world_texels(np.random.default_rng(2).random((8, 16)) ** 4)


@pytest.mark.parametrize("name", LAMPS)
def test_draws_towards_a_lamp_are_even_over_it(name: str) -> None:
    count = 400_000
    wi, _ = drawn(LAMPS[name], count, seed=11)
    assert_moments(moments(wi), lamp_moments(LAMPS[name]), count, name)


@pytest.mark.parametrize("name", LAMPS)
def test_nodes_draw_evenly_over_a_lamp(name: str) -> None:
    u1, u2 = stratified()
    zero = np.zeros((len(u1), 3), np.float32)
    group = aimed_light_group(data_image("lamps", lamp_table([LAMPS[name]], 4)), 1)
    normal = np.broadcast_to(lamp_moments(LAMPS[name])[0], zero.shape).astype(np.float32)
    nothing = np.zeros_like(u1)
    wi, density, _ = card(lambda *a: call(group, *a, 0.0), zero, normal, zero, nothing, nothing, u1, u2)
    assert (density > 0).all(), "a draw that was not aimed"
    assert_moments(moments(wi.astype(float)), lamp_moments(LAMPS[name]), len(u1), name)


@pytest.mark.parametrize("name", LAMPS)
def test_osl_draws_evenly_over_a_lamp(name: str) -> None:
    skip_without_osl()
    u1, u2 = stratified()
    row = lamp_table([LAMPS[name]], 1)[0].astype(float)
    centre, u, v, axis = (f"vector({', '.join(map(repr, texel[:3].tolist()))})" for texel in row[:4])
    facts = f"vector({row[0, 3]!r}, {row[1, 3]!r}, {row[3, 3]!r})"
    body = f"""MMLamp lamp = {{{centre}, {u}, {v}, {axis}, {facts}}};
      wi = mm_draw_towards(mm_aim_at(lamp, point(0)), u1, u2);"""
    (wi,) = header_card(body, {"wi": "vector"}, "measured_lamps.h", u1=u1, u2=u2)
    assert_moments(moments(wi.astype(float)), lamp_moments(LAMPS[name]), len(u1), name)


def test_draws_into_a_world_follow_its_cells(world: NDArray[np.float32]) -> None:
    count = 400_000
    wi, _ = draw_world(world, count, seed=5)
    assert_moments(moments(wi), world_moments(world), count, "numpy")


def test_nodes_draw_into_a_world_by_its_cells(world: NDArray[np.float32]) -> None:
    rng = np.random.default_rng(8)
    count = 160**2
    numbers = [rng.random(count).astype(np.float32) for _ in range(4)]
    # All are aimed, whatever the share: it is below 1 by the table alone.
    table = lamp_table([], 4, largest_share=1.0, world=((0.1, 0.2, 0.3), 1.0))
    zero = np.zeros((count, 3), np.float32)
    up = np.broadcast_to(np.float32([0, 0, 1]), zero.shape)
    group = aimed_light_group(data_image("lamps", table), 0, data_image("world", world[::-1]))
    wi, density, rest = card(lambda *a: call(group, *a, 9.0), zero, up, zero, *numbers)
    assert not rest.any() and (density > 0).all()
    assert_moments(moments(wi.astype(float)), world_moments(world), count, "nodes")


# --- noise ------------------------------------------------------------------------------------------------

LAYOUT = SamplerLayout(n_o=16, n_h=32, n_phi=16)


def half_lattice(wo: Array, per_cell: int = 6) -> tuple[Array, Array, Array]:
    """Light directions (N, 3) about half vectors in the cells of `LAYOUT`, their solid angles, and their cells."""
    edges = (np.arange(LAYOUT.n_h + 1) / LAYOUT.n_h) ** 4
    offset = (np.arange(per_cell) + 0.5) / per_cell
    m = (edges[:-1, None] + offset * np.diff(edges)[:, None]).reshape(-1)
    phi = (np.arange(LAYOUT.n_phi * per_cell) + 0.5) * np.pi / (LAYOUT.n_phi * per_cell)
    width = np.repeat(np.diff(edges), per_cell) / per_cell * np.pi / (LAYOUT.n_phi * per_cell)
    sine = np.sqrt(m * (2 - m))[:, None]
    one = np.broadcast_to(1 - m[:, None], (len(m), len(phi)))
    half = np.stack([sine * np.cos(phi), sine * np.sin(phi), one], -1).reshape(-1, 3)
    cell = np.repeat(np.arange(len(m)) // per_cell, len(phi)) * LAYOUT.n_phi + np.tile(
        np.arange(len(phi)) // per_cell, len(m)
    )
    wo_half = half @ wo
    wi = 2 * wo_half[:, None] * half - wo
    # Both sides of the viewer.
    solid = 2 * 4 * wo_half * np.repeat(width, len(phi))
    seen = (wi[:, 2] > 0) & (wo_half > 0)
    return wi[seen], solid[seen], cell[seen]


def second_moment(sampler_source: analytic.Ggx | analytic.Lambert, light: Callable[..., Array], theta: float) -> float:
    """Of f cos / pdf, by quadrature, in parts of its squared mean."""
    wo = spherical(theta, 0.0)
    wi, solid, _ = half_lattice(wo)
    value = light(wi, np.broadcast_to(wo, wi.shape)).mean(-1) * wi[:, 2]
    pdf = build_sampler(sampler_source, LAYOUT).pdf(wi, np.broadcast_to(wo, wi.shape))
    return float((value**2 / pdf * solid).sum() / (value * solid).sum() ** 2)


def least_second_moment(light: Callable[..., Array], theta: float) -> float:
    """Of the best density that is even over half vectors in each cell of `LAYOUT`: (sum of roots of means)^2."""
    wo = spherical(theta, 0.0)
    wi, solid, cell = half_lattice(wo)
    value = light(wi, np.broadcast_to(wo, wi.shape)).mean(-1) * wi[:, 2]
    wo_half = np.sqrt(np.maximum((1 + wi @ wo) / 2, 0))
    of_half = value * 4 * wo_half  # density that a draw of the half vector is weighed against
    area = solid / (4 * wo_half)
    squares = np.bincount(cell, of_half**2 * area, LAYOUT.cells) * np.bincount(cell, area, LAYOUT.cells)
    return float(np.sqrt(squares).sum() ** 2 / (value * solid).sum() ** 2)


@pytest.mark.parametrize("theta", [0.3, 0.9, 1.3])
@pytest.mark.parametrize("name", ["lambert", "rough", "glossy"])
def test_noise_is_near_the_least_that_cells_allow(name: str, theta: float) -> None:
    """The bin's own elevations and the cosine's twentieth cost some of it, and nothing else may."""
    source = {"lambert": analytic.Lambert(), "rough": analytic.Ggx(alpha=0.5), "glossy": analytic.Ggx(alpha=0.1)}[name]
    found = second_moment(source, source.evaluate, theta)
    least = least_second_moment(source.evaluate, theta)
    print(name, theta, found, least, found / least)
    assert 0.999 < found / least < 1.06


@pytest.mark.parametrize("theta", [0.1, 0.9, 1.4])
def test_light_that_the_table_does_not_foresee_stays_bounded(theta: float) -> None:
    """A twentieth of all draws follows the cosine, hence Lambertian light has at most 20 times its second moment.

    That is what a mirror-like material's sampler owes to all it did not foresee: dust, a texture as tint, the spline
    between its samples. A floor of a thousandth would let single samples be 1000 times the mean.
    """
    found = second_moment(analytic.Ggx(alpha=0.002), analytic.Lambert().evaluate, theta)
    print(theta, found)
    # The cells' own noise at the horizon comes on top; that it is no less says that draws are not wasted on it.
    assert 18 < found < 22.5


@pytest.mark.parametrize("name", ["rectangle", "ellipse", "sphere", "sun"])
def test_no_lamp_is_expected_to_bring_far_less_than_it_does(name: str) -> None:
    """What is drawn with a hundredth of its light's share is a hundred times too bright when it is: a firefly.

    Surfaces of all normals, also those that only a lamp's edge can reach: of light that counts, beside the most that
    the lamp brings to any of them, at least a part is expected.
    """
    lamp = LAMPS[name]
    rng = np.random.default_rng(17)
    normals = spherical(np.arccos(rng.uniform(-1, 1, 3000)), rng.uniform(0, 2 * np.pi, 3000))
    wi, pdf = drawn(lamp, 20_000, seed=3)
    weight = np.divide(1, pdf, out=np.zeros_like(pdf), where=pdf > 0)
    radiance = {SUN: 1 / weight.mean()}.get(lamp.kind)
    if radiance is None:
        radiance = lamp.fourth() if lamp.kind < 1.5 else 1 / (np.pi * lamp.extent**2)
    arriving = radiance * (np.maximum(wi @ normals.T, 0) * weight[:, None]).mean(0)
    aim = aim_numpy(lamp_table([lamp], 1)[0], np.zeros((len(normals), 3)))
    expected = expected_light(xp_numpy, aim, normals, lamp.power)
    counts = arriving > 0.01 * arriving.max()
    ratio = expected[counts] / arriving[counts]
    print(name, ratio.min(), ratio.max())
    assert ratio.min() > 0.25
    assert ratio.max() < 6


def test_no_world_is_expected_to_bring_far_less_than_it_does() -> None:
    """Two small windows at any angle, one up to twenty times as bright: what the lesser alone lights is aimed at it."""
    rng = np.random.default_rng(23)
    ratios = []
    for _ in range(40):
        towards = spherical(np.arccos(rng.uniform(-1, 1, 2)), rng.uniform(0, 2 * np.pi, 2))
        flux = np.array([1.0, 10 ** -rng.uniform(0, 1.3)])
        normals = spherical(np.arccos(rng.uniform(-1, 1, 500)), rng.uniform(0, 2 * np.pi, 500))
        arriving = np.maximum(normals @ towards.T, 0) @ flux
        expected = expected_world_light(xp_numpy, flux @ towards / 2, flux.sum() / 4, normals)
        counts = arriving > 0.02 * flux.sum()
        ratios.append(expected[counts] / arriving[counts])
    found = np.concatenate(ratios)
    print(found.min(), found.max())
    assert found.min() > 0.04
    assert found.max() < 20
