"""Node groups against float64 numpy, input by input, on render cards (addon/docs/method.md, section 16)."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from measured_materials.bake import xp_numpy
from measured_materials.bake.directions import spherical
from measured_materials.bake.sampling.cell_sampler import build_sampler
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sources import analytic
from measured_materials.bake.tables.atlas import pack
from measured_materials.bake.tables.grids import parameterization as par
from measured_materials.bake.tables.grids.normal_vector_grid import NormalVectorGrid
from measured_materials.bake.tables.table import FILTERS, Table, bspline_weights
from measured_materials.nodes import expr
from measured_materials.nodes.alias_sampler_group import alias_sampler_group
from measured_materials.nodes.group import call
from measured_materials.nodes.local_frame_group import viewer_frame_group
from measured_materials.nodes.table_lookup_group import coordinates_group, table_lookup_group
from support.cards import card, data_image

EPS = float(np.finfo(np.float32).eps)
PAPER = ("identity", "uniform", "bezier")
ALPHAS = (0.0, 0.5, 1.0, 0.137, float(np.nextafter(np.float32(0.5), np.float32(1))))
UNIT = np.concatenate([[0, 1, 0.5, 1e-7, 1e-4, 1 - 1e-7, 0.5 + 1e-7], np.random.default_rng(0).random(2000)]).astype(
    np.float32
)


def direction_grid() -> tuple[np.ndarray, np.ndarray]:
    """Pairs of float32 directions: an edge grid with both poles, the horizon, phi_delta 0 and pi, and random ones."""
    theta = np.array([0, 1e-4, 0.01, 0.8, 1.5, np.pi / 2 - 1e-4, np.pi / 2])
    phi = np.array([0, 1e-4, 1.0, np.pi / 2, np.pi - 1e-4, np.pi, -2.0])
    ti, to, p = (a.ravel() for a in np.meshgrid(theta, theta, phi))
    rng = np.random.default_rng(1)
    ti, to = (np.concatenate([t, np.arccos(rng.random(4000))]) for t in (ti, to))
    p = np.concatenate([p, rng.uniform(-np.pi, np.pi, 4000)])
    wi, wo = spherical(ti, p).astype(np.float32), spherical(to, np.zeros_like(to)).astype(np.float32)
    wi[..., 2], wo[..., 2] = np.maximum(wi[..., 2], 0), np.maximum(wo[..., 2], 0)
    return wi, wo


@pytest.mark.parametrize("kind", PAPER)
@pytest.mark.parametrize("alpha", ALPHAS)
def test_forward(kind: str, alpha: float) -> None:
    """s from the chord: a handful of float32 operations on numbers up to 2."""
    (s,) = card(lambda v: par.forward(expr, kind, v, alpha), UNIT)
    # SVM's arcsine is exact to 4 ulp of pi / 2, everything else to one rounding per operation.
    assert np.abs(s - par.forward(xp_numpy, kind, UNIT.astype(float), alpha)).max() < 8 * EPS


@pytest.mark.parametrize("kind", PAPER)
@pytest.mark.parametrize("alpha", ALPHAS)
def test_inverse(kind: str, alpha: float) -> None:
    """The chord from s, and with it the angle, which the one-sided textbook form misses by 1.4e-4 rad."""
    (v,) = card(lambda s: par.inverse(expr, kind, s, alpha), UNIT)
    truth = np.asarray(par.inverse(xp_numpy, kind, UNIT.astype(float), alpha))
    angle = par.chord_to_theta(xp_numpy, v.astype(float)) - par.chord_to_theta(xp_numpy, truth)
    # theta = 2 asin(v / sqrt 2) grows at most twice as fast as v. Where alpha leaves an end infinitely sparse
    # (v ~ sqrt s) the input's own last bit is worth sqrt(eps): compare there against that.
    assert np.abs(angle).max() < 6e-7


@pytest.mark.parametrize("kind", PAPER)
@pytest.mark.parametrize("alphas", [(0.0, 1.0), (0.5, 0.5), (1.0, 0.0), (0.3, 0.15)])
def test_coordinates(kind: str, alphas: tuple[float, float]) -> None:
    """(u_o, u_i, u_phi) of direction pairs."""
    wi, wo = direction_grid()
    found = card(lambda a, b: call(coordinates_group(NormalVectorGrid(8, kind, *alphas)), a, b), wi, wo)
    truth = par.normal_basis_coordinates(xp_numpy, wi.astype(float), wo.astype(float), kind, *alphas)
    for value, expected in zip(found, truth, strict=True):
        # Differences of unit vectors carry their rounding (1 eps), s grows at most twice as fast as the chord.
        assert np.abs(value - expected).max() < 16 * EPS


def random_table(n: int, seed: int = 3) -> Table:
    """White noise: the harshest table there is, its neighbours differ by up to 1."""
    values = np.random.default_rng(seed).random((n, n, 2 * n, 3)).astype(np.float32)
    values[:, -1] = values[:, -1, :1]
    values[-1] = values[-1, :, :1]
    return Table(NormalVectorGrid(n, "bezier", 0.3, 0.15), values)


@pytest.mark.parametrize("filter", FILTERS)
@pytest.mark.parametrize("n", [8, 33, 64])
def test_lookup(filter: str, n: int) -> None:
    """The whole lookup: coordinates, atlas, gutter, image filter and the blend along theta_o."""
    table = random_table(n)
    image = data_image(f"table {n}", pack(table.grid, table.values))
    group = table_lookup_group(f"card lookup {filter} {n}", image, table.grid, filter)
    wi, wo = direction_grid()
    (found,) = card(lambda a, b: call(group, a, b, 0.5), wi, wo)
    padded_truth = evaluate_at_horizon(table, wi.astype(float), wo.astype(float), filter)
    difference = np.abs(found - padded_truth).max(-1)
    if filter == "nearest":
        # At the border between two texels either is right; float32 decides within 1e-4 of a texel.
        position = np.stack(table.grid.coordinates(xp_numpy, wi.astype(float), wo.astype(float)), -1)
        difference = difference[(np.abs(position - np.floor(position) - 0.5) > 2e-4).all(-1)]
    # Texture coordinates have 2^-24 of the atlas' width or height, up to 1056 texels: 6e-5 of a texel per axis,
    # the table coordinate 16 eps x 128 texels: 2.4e-4; white noise turns each into as much value.
    assert difference.max() < 6e-4
    assert np.median(difference) < 4e-5


def evaluate_at_horizon(table: Table, wi: np.ndarray, wo: np.ndarray, filter: str) -> np.ndarray:
    """Table.evaluate, but at the horizon itself the value held there, as the group returns it."""
    lift = np.array([0.0, 0.0, 1e-12])
    return table.evaluate(wi + lift * (wi[:, 2:] <= 0), wo + lift * (wo[:, 2:] <= 0), filter)


@pytest.mark.parametrize("filter", ["trilinear", "bspline"])
def test_stochastic_slice_averages_to_the_blend(filter: str) -> None:
    """One slice chosen by a random number has the blend as its mean over that number."""
    table = random_table(16)
    image = data_image("table stochastic", pack(table.grid, table.values))
    group = table_lookup_group(f"card stochastic {filter}", image, table.grid, filter, stochastic=True)
    wi, wo = (w[-60:] for w in direction_grid())
    steps = 400
    u = np.tile((np.arange(steps) + 0.5) / steps, len(wi)).astype(np.float32)
    (found,) = card(lambda a, b, r: call(group, a, b, r), np.repeat(wi, steps, 0), np.repeat(wo, steps, 0), u)
    mean = found.reshape(len(wi), steps, 3).mean(1)
    # The mean over an even grid of 400 misses each of at most 3 jumps by half a step.
    assert np.abs(mean - table.evaluate(wi.astype(float), wo.astype(float), filter)).max() < 3 * 0.5 / steps


def test_bspline_weights() -> None:
    """Sum to 1, on cards and in numpy, and reproduce the cardinal values at a node."""
    found = card(lambda t: bspline_weights(expr, t), UNIT)
    truth = bspline_weights(xp_numpy, UNIT.astype(float))
    assert max(np.abs(a - b).max() for a, b in zip(found, truth, strict=True)) < 4 * EPS
    assert np.abs(sum(truth) - 1).max() < 1e-15
    assert np.allclose([w[0] for w in truth], [1 / 6, 2 / 3, 1 / 6, 0], atol=1e-15)


@pytest.mark.parametrize("warp_power", [1, 2, 3])
def test_sampler(warp_power: int) -> None:
    """Direction and pdf of every drawn cell equal numpy's, random numbers of exactly 0 and 1 included."""
    layout = SamplerLayout(n_o=16, n_h=24, n_phi=16, warp_power=warp_power)
    sampler = build_sampler(analytic.Ggx(alpha=0.1), layout)
    image = data_image("sampler", sampler.texels)
    group = alias_sampler_group(f"card sampler {warp_power}", image, layout)
    rng = np.random.default_rng(5)
    count = 5000
    theta = np.concatenate([[0, 1e-4, np.pi / 2 - 1e-3], np.arccos(rng.random(count - 3))])
    wo = spherical(theta, 0.0).astype(np.float32)
    u = rng.random((count, 4)).astype(np.float32)
    u[:81] = np.stack(np.meshgrid(*[[0, 0.37, 1]] * 4), -1).reshape(-1, 4)
    keep = away_from_borders(sampler, wo, u)
    wo, u = wo[keep], u[keep]
    wi, pdf = card(lambda o, *r: call(group, o, *r), wo, *u.T)
    expected_wi, expected_pdf = sampler.sample(wo.astype(float), u.astype(float))
    # 1 - cos theta_h spans eight decades: its square root and the reflection keep 1e-6 of the direction.
    assert np.abs(wi - expected_wi).max() < 4e-6
    up = expected_wi[:, 2] > 0
    # pdf_h is a texel, read exactly; wo . h > 0 is what rounds, worst where it is small.
    assert np.abs(pdf / expected_pdf - 1)[up].max() < 2e-4
    assert np.median(np.abs(pdf / expected_pdf - 1)[up]) < 2e-7


def away_from_borders(sampler: object, wo: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Draws whose cell, bin and acceptance are decided by more than float32's last bits."""
    layout, texels = sampler.layout, sampler.texels
    chord = np.linalg.norm(wo.astype(float) - [0, 0, 1], axis=-1) / np.sqrt(2) * layout.n_o
    cell = u[:, 0].astype(float) * layout.cells
    i_o = np.minimum(chord, layout.n_o - 1).astype(int)
    acceptance = texels[i_o, np.minimum(cell, layout.cells - 1).astype(int), 0]
    far = np.abs(u[:, 1] - acceptance) > 1e-5
    edge = (u[:, 0] == 0) | (u[:, 0] == 1)
    return far & (edge | (np.abs(cell - np.round(cell)) > 1e-3)) & (np.abs(chord - np.round(chord)) > 1e-4)


def test_viewer_frame_is_orthonormal_at_every_angle() -> None:
    """From along the normal to behind it: unit tangents, and wo reproduced in front."""
    rng = np.random.default_rng(7)
    normal = rng.normal(size=(3000, 3))
    normal[:6] = np.vstack([np.eye(3), -np.eye(3)])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    toward = rng.normal(size=(3000, 3))
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    share = rng.choice([0, 1e-7, 1e-4, 0.1, 1], size=(3000, 1))
    incoming = normal * (1 - share) + toward * share
    incoming /= np.linalg.norm(incoming, axis=1, keepdims=True)
    normal, incoming = normal.astype(np.float32), incoming.astype(np.float32)
    wo, tangent, bitangent = card(lambda n, i: call(viewer_frame_group(), n, i), normal, incoming)
    for vector in (wo, tangent, bitangent):
        assert np.abs(np.linalg.norm(vector, axis=1) - 1).max() < 1e-6
    for a, b in ((tangent, bitangent), (tangent, normal), (bitangent, normal)):
        # The plane of incidence is known to eps / sine; below a sine of 1e-4 a fixed tangent takes over.
        sine = np.linalg.norm(np.cross(normal, incoming), axis=1)
        assert (np.abs((a * b).sum(1)) < 4e-7 + 2e-7 / np.where(sine > 9e-5, sine, 1)).all()
    front = ((normal * incoming).sum(1) > 2e-3) & (sine > 1.1e-4)
    back = wo[:, :1] * tangent + wo[:, 2:] * normal
    assert np.abs(back - incoming)[front].max() < 2e-6


def test_equal_groups_are_shared_and_edited_ones_are_not() -> None:
    """A group is reused only while its content hashes equal."""
    first = coordinates_group(NormalVectorGrid(8, "bezier"))
    assert coordinates_group(NormalVectorGrid(8, "bezier")) == first
    node = next(n for n in first.nodes if n.bl_idname == "ShaderNodeMath")
    node.operation = "SINE"
    second = coordinates_group(NormalVectorGrid(8, "bezier"))
    assert second != first
    bpy.data.node_groups.remove(first)
