"""The functions of the OSL shaders against float64 numpy, input by input, on render cards (method.md, section 16).

OSL's sines and cosines are fast and wrong by up to 2e-7; its arcsine and arctangent by 1e-4, unless corrected.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from measured_materials.bake import xp_numpy
from measured_materials.bake.directions import spherical
from measured_materials.bake.envelope import mirror_probability, texture_coordinate
from measured_materials.bake.images.image_io import write_image
from measured_materials.bake.images.storage import Storage, quantize
from measured_materials.bake.sampling.cell_sampler import CellSampler, build_sampler
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sampling.lamps import (
    ELLIPSE,
    RECTANGLE,
    SPHERE,
    SUN,
    Lamp,
    aim_numpy,
    aimed_part,
    density_towards,
    draw_towards,
    expected_light,
    lamp_table,
)
from measured_materials.bake.sampling.world import (
    COLUMNS,
    ROWS,
    choose_cell,
    draw_in_world,
    expected_world_light,
    world_coordinates,
    world_texels,
)
from measured_materials.bake.sources import analytic
from measured_materials.bake.tables.atlas import pack
from measured_materials.bake.tables.grids import parameterization as par
from measured_materials.bake.tables.grids.normal_vector_grid import NormalVectorGrid
from measured_materials.bake.tables.table import FILTERS, Table
from measured_materials.nodes.osl_parameters import cell_constants, grid_constants
from scipy import stats
from support.osl import header_card, osl_grid, shader_card, skip_without_osl

EPS = float(np.finfo(np.float32).eps)


@pytest.fixture(autouse=True, scope="module")
def osl() -> None:
    skip_without_osl()


def pairs(count: int = 1500) -> tuple[np.ndarray, np.ndarray]:
    """Float32 pairs (wi, wo): both poles, the horizon, phi_delta 0 and pi, and random ones."""
    theta, phi = np.array([0, 1e-4, 0.8, np.pi / 2 - 1e-4, np.pi / 2]), np.array([0, 1e-4, 1.0, np.pi, -2.0])
    ti, to, p = (a.ravel() for a in np.meshgrid(theta, theta, phi))
    rng = np.random.default_rng(1)
    ti, to = (np.concatenate([t, np.arccos(rng.random(count))]) for t in (ti, to))
    p = np.concatenate([p, rng.uniform(-np.pi, np.pi, count)])
    wi, wo = spherical(ti, p).astype(np.float32), spherical(to, np.zeros_like(to)).astype(np.float32)
    wi[..., 2], wo[..., 2] = np.maximum(wi[..., 2], 0), np.maximum(wo[..., 2], 0)
    return wi, wo


@pytest.mark.parametrize("kind", ["identity", "uniform", "bezier"])
def test_coordinates(kind: str) -> None:
    wi, wo = pairs()
    grid = NormalVectorGrid(16, kind, 0.3, 0.15)
    body = f"MMGrid g = {osl_grid(grid)}; at = mm_coordinates(g, wi, wo);"
    (found,) = header_card(body, {"at": "vector"}, wi=wi, wo=wo)
    truth = par.normal_basis_coordinates(xp_numpy, wi.astype(float), wo.astype(float), kind, 0.3, 0.15)
    # As for the nodes; the Newton step leaves of the arcsine's 4.5e-5 its square, and the sine's own error.
    assert np.abs(found - np.stack(truth, -1)).max() < 16 * EPS


def random_table(n: int) -> Table:
    """White noise: the harshest table there is, its neighbours differ by up to 1."""
    values = np.random.default_rng(3).random((n, n, 2 * n, 3)).astype(np.float32)
    values[:, -1], values[-1] = values[:, -1, :1], values[-1, :, :1]
    return Table(NormalVectorGrid(n, "bezier", 0.3, 0.15), values)


def lookup_constants(folder: Path, table: Table, filter: str, storage: Storage = Storage.FLOAT32) -> dict:
    """Parameters of `measured_lookup.osl` for a table written to a file, half as bright there."""
    file = folder / f"atlas{storage.suffix}"
    write_image(file, pack(table.grid, table.values) / 2, storage)
    return {"Table": str(file), "Scale": 2.0, **grid_constants(table.grid), "Filter": filter, "Stochastic": 0}


@pytest.mark.parametrize("filter", FILTERS)
@pytest.mark.parametrize("n", [9, 64])
def test_lookup(tmp_path: Path, filter: str, n: int) -> None:
    table = random_table(n)
    wi, wo = pairs()
    (found,) = shader_card("measured_lookup.osl", ["BRDF"], lookup_constants(tmp_path, table, filter), wi=wi, wo=wo)
    # Table.evaluate is 0 at the horizon itself, where the lookup gives the value held there.
    lift = np.array([0.0, 0.0, 1e-12])
    inside = [w + lift * (w[:, 2:] <= 0) for w in (wi.astype(float), wo.astype(float))]
    difference = np.abs(found - table.evaluate(*inside, filter)).max(-1)
    if filter == "nearest":
        # At the border between two texels either is right; float32 decides within 1e-4 of a texel.
        position = np.stack(table.grid.coordinates(xp_numpy, *inside), -1)
        difference = difference[(np.abs(position - np.floor(position) - 0.5) > 2e-4).all(-1)]
    # As for the nodes: texture and table coordinates of 2^-24 and 16 eps, of up to 1056 and 128 texels of white noise.
    assert difference.max() < 6e-4
    assert np.median(difference) < 4e-5


@pytest.mark.parametrize("storage", [Storage.HALF, Storage.RGBE])
def test_lookup_of_other_storages(tmp_path: Path, storage: Storage) -> None:
    """OSL's texture system reads what the bake has written, without any colour management."""
    table = random_table(12)
    constants = lookup_constants(tmp_path, table, "trilinear", storage)
    stored = Table(table.grid, 2 * quantize(table.values / 2, storage))
    wi, wo = (w[-500:] for w in pairs())
    (found,) = shader_card("measured_lookup.osl", ["BRDF"], constants, wi=wi, wo=wo)
    assert np.abs(found - stored.evaluate(wi.astype(float), wo.astype(float), "trilinear")).max() < 1e-4


@pytest.mark.parametrize("filter", ["trilinear", "bspline"])
def test_stochastic_slice_averages_to_the_blend(tmp_path: Path, filter: str) -> None:
    table = random_table(16)
    constants = lookup_constants(tmp_path, table, filter) | {"Stochastic": 1}
    wi, wo = (w[-20:] for w in pairs())
    steps = 400
    u = np.tile((np.arange(steps) + 0.5) / steps, len(wi)).astype(np.float32)
    repeated = {"wi": np.repeat(wi, steps, 0), "wo": np.repeat(wo, steps, 0), "Random": u}
    (found,) = shader_card("measured_lookup.osl", ["BRDF"], constants, **repeated)
    mean = found.reshape(len(wi), steps, 3).mean(1)
    # The mean over an even grid misses each of at most 3 jumps by half a step.
    assert np.abs(mean - table.evaluate(wi.astype(float), wo.astype(float), filter)).max() < 3 * 0.5 / steps


def draws(sampler: CellSampler, count: int = 3000) -> tuple[np.ndarray, np.ndarray]:
    """Viewers and random numbers, 0 and 1 included, that float32 cannot take for those of another cell."""
    rng, layout = np.random.default_rng(5), sampler.layout
    wo = spherical(np.concatenate([[0, 1e-4, np.pi / 2 - 1e-3], np.arccos(rng.random(count - 3))]), 0.0)
    u = rng.random((count, 4)).astype(np.float32)
    u[:81] = np.stack(np.meshgrid(*[[0, 0.37, 1]] * 4), -1).reshape(-1, 4)
    chord, cell = np.linalg.norm(wo - [0, 0, 1], axis=-1) / np.sqrt(2) * layout.n_o, u[:, 0] * float(layout.cells)
    indices = np.minimum(chord, layout.n_o - 1).astype(int), np.minimum(cell, layout.cells - 1).astype(int)
    far = (np.abs(u[:, 1] - sampler.texels[(*indices, 0)]) > 1e-5) & (np.abs(chord - np.round(chord)) > 1e-4)
    far &= (u[:, 0] == 0) | (u[:, 0] == 1) | (np.abs(cell - np.round(cell)) > 1e-3)
    return wo[far].astype(np.float32), u[far]


@pytest.mark.parametrize("warp", [1, 2, 3])
def test_sampler(tmp_path: Path, warp: int) -> None:
    """Direction and density of every draw, and the density of any direction, against numpy."""
    layout = SamplerLayout(n_o=16, n_h=24, n_phi=16, warp_power=warp)
    sampler = build_sampler(analytic.Ggx(alpha=0.1), layout)
    write_image(tmp_path / "cells.exr", sampler.texels, Storage.FLOAT32)
    wo, u = draws(sampler)
    numbers = dict(zip(("RandomCell", "RandomAlias", "RandomU", "RandomV"), u.T, strict=True))
    expected_wi, expected_pdf = sampler.sample(wo.astype(float), u.astype(float))
    any_wi = np.random.default_rng(6).permutation(expected_wi).astype(np.float32)
    constants = {"Sampler": str(tmp_path / "cells.exr"), **cell_constants(layout)}
    wi, pdf, density = shader_card(
        "measured_sampler.osl", ["wi", "pdf", "Density"], constants, wo=wo, Direction=any_wi, **numbers
    )
    # 1 - cos theta_h spans eight decades: its square root, the reflection and the fast sine keep 1e-6 of the direction.
    assert np.abs(wi - expected_wi).max() < 4e-6
    up = expected_wi[:, 2] > 0
    # pdf_h is a texel, read exactly; wo . h > 0 is what rounds, worst where it is small.
    assert np.abs(pdf / expected_pdf - 1)[up].max() < 2e-4
    up = any_wi[:, 2] > 0
    truth = sampler.pdf(any_wi.astype(float)[up], wo.astype(float)[up])
    wrong = np.abs(density[up] / truth - 1) > 2e-4
    # Beside the border of a cell float32 may take its neighbour: two borders of 1e-5 of a cell, and warp 3's pow() of
    # 1e-5 x 24 cells.
    assert wrong.mean() < 2e-3


def test_viewer_frame() -> None:
    """Unit tangents at every angle, from along the normal to behind it, and the viewer reproduced in front."""
    rng = np.random.default_rng(7)
    normal, toward = rng.normal(size=(2, 2000, 3))
    normal[:6] = np.vstack([np.eye(3), -np.eye(3)])
    incoming = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    incoming = incoming + toward * rng.choice([0, 1e-7, 1e-4, 0.1, 1], size=(2000, 1))
    n, i = ((v / np.linalg.norm(v, axis=1, keepdims=True)).astype(np.float32) for v in (normal, incoming))
    body = "MMFrame f = mm_viewer_frame(n, i); wo = f.wo; t = f.tangent; b = f.bitangent; back = mm_to_world(f, wo);"
    wo, t, b, back = header_card(body, dict.fromkeys(("wo", "t", "b", "back"), "vector"), n=n, i=i)
    sine = np.linalg.norm(np.cross(n, i), axis=1)
    for vector in (wo, t, b):
        assert np.abs(np.linalg.norm(vector, axis=1) - 1).max() < 1e-6
    for first, second in ((t, b), (t, n), (b, n)):
        # The plane of incidence is known to eps / sine; below a sine of 1e-4 a fixed tangent takes over.
        assert (np.abs((first * second).sum(1)) < 4e-7 + 2e-7 / np.where(sine > 9e-5, sine, 1)).all()
    front = ((n * i).sum(1) > 2e-3) & (sine > 1.1e-4)
    assert np.abs(back - i)[front].max() < 2e-6


@pytest.mark.parametrize("differ", ["position", "direction", "place in the triangle"])
def test_random_numbers_are_even_and_independent(differ: str) -> None:
    """Nine numbers where only one thing tells rays apart, in the last bits that a far or narrow view leaves of it."""
    rng = np.random.default_rng(8)
    count = 40_000
    noise = rng.normal(size=(count, 3))
    p, i, t = np.full((count, 3), 1e4), np.tile([0.6, 0.0, 0.8], (count, 1)), np.full((count, 3), 0.25)
    changed = {"position": p, "direction": i, "place in the triangle": t}[differ]
    changed += noise * {"position": 0.5, "direction": 1e-4, "place in the triangle": 0.1}[differ]
    body = "float r[9]; mm_random(p, i, t[0], t[1], r); a = vector(r[0], r[1], r[2]); b = vector(r[3], r[4], r[5]);"
    body += "c = vector(r[6], r[7], r[8]);"
    inputs = {name: values.astype(np.float32) for name, values in {"p": p, "i": i, "t": t}.items()}
    parts = header_card(body, dict.fromkeys("abc", "vector"), **inputs)
    u = np.concatenate(parts, -1)
    assert u.min() >= 0 and u.max() <= 1
    # Nine tests of evenness and 36 of pairs on a 10 x 10 grid, at a level of 1e-6 each: an alarm in 20 000 runs.
    assert min(stats.kstest(column, "uniform").pvalue for column in u.T) > 1e-6
    cells = np.minimum((u * 10).astype(int), 9)
    for first in range(9):
        for second in range(first):
            counts = np.bincount(cells[:, first] * 10 + cells[:, second], minlength=100)
            assert stats.chisquare(counts).pvalue > 1e-6


def test_probability_and_place_of_the_envelope() -> None:
    _, wo = pairs()
    share = np.random.default_rng(9).random(len(wo)).astype(np.float32)
    share[:2] = 0, 1
    body = "p = mm_mirror_probability(s); x = mm_weight_coordinate(wo, 64);"
    p, x = header_card(body, {"p": "float", "x": "float"}, s=share, wo=wo)
    assert np.abs(p - mirror_probability(xp_numpy, share.astype(float))).max() < 4 * EPS
    assert np.abs(x - texture_coordinate(xp_numpy, wo.astype(float), 64)).max() < 4 * EPS


LAMPS = [
    Lamp(RECTANGLE, 1.0, (0.5, 0.3, 2.0), (0.8, 0.0, 0.0), (0.0, 0.4, 0.0), (0.0, 0.0, -1.0)),
    Lamp(ELLIPSE, 2.0, (-1.0, 0.3, 1.0), (0.0, 0.5, 0.0), (0.0, 0.0, 0.9), (1.0, 0.0, 0.0)),
    Lamp(SPHERE, 3.0, (0.2, -0.8, 0.7), extent=0.3),
    Lamp(SUN, 1.0, axis=(0.0, 0.6, 0.8), extent=0.05),
]


def lamps_body(
    count: int, lamps: list[Lamp] = LAMPS, flux: float = 0.0, toward: object = (0, 0, 0), concentration: float = 0.0
) -> str:
    """Statements that aim at the first of four rows of lamps and at a world, other light 0.6 and largest share 0.8."""

    def triple(numbers: object) -> str:
        return f"vector({', '.join(f'{x:.9g}' for x in numbers)})"

    rows = lamp_table(lamps, 4)
    vectors = [[triple(r[k, :3]) for k in range(4)] + [triple((r[0, 3], r[1, 3], r[3, 3]))] for r in rows]
    table = ", ".join("{" + ", ".join(row) + "}" for row in vectors)
    numbers = "u_lamp, u_aim, u1, u2, aimed, of_world, rest"
    call = (
        f"mm_aim(lamps, {count}, vector(0.6, 0.8, {flux}), {triple(toward)}, cell, {concentration}, p, n, w, {numbers})"
    )
    rest = "MMWorldCell cell = {32, 16, color(alias), acceptance};"
    return f"MMLamp lamps[MM_MOST_LAMPS] = {{{table}}}; {rest} wi = {call};"


AIMED = {"wi": "vector", "aimed": "float", "of_world": "float", "rest": "float"}


def xyz(place: np.ndarray) -> np.ndarray:
    """With a third number, as `draw_in_world` takes it."""
    return np.concatenate([place, np.zeros_like(place[:, :1])], -1)


def _inside(place: np.ndarray) -> np.ndarray:
    """`choose_cell` keeps draws away from a cell's edges."""
    return 2.5e-4 + (1 - 5e-4) * place


@pytest.mark.parametrize("count, flux, concentration", [(1, 0.0, 0.0), (4, 0.0, 30.0), (0, 5.0, 30.0), (4, 5.0, 5.0)])
def test_aiming(count: int, flux: float, concentration: float) -> None:
    """Direction and density of aimed draws, over every kind of lamp and a world."""
    rng = np.random.default_rng(0)
    size = 2000
    p = rng.uniform(-0.3, 0.3, (size, 3)).astype(np.float32)
    n, w = (
        spherical(np.arccos(rng.uniform(-1, 1, size)), rng.uniform(0, 2 * np.pi, size)).astype(np.float32)
        for _ in range(2)
    )
    u_lamp, u_aim, u1, u2 = rng.random((4, size)).astype(np.float32)
    inputs = {"p": p, "n": n, "w": w, "u_lamp": u_lamp, "u_aim": u_aim, "u1": u1, "u2": u2}
    toward, texels = np.array((0.4, -0.3, 0.9)), world_texels(rng.random((16, 32)) ** 6 * (rng.random((16, 32)) > 0.4))
    column, row = (np.minimum((u * k).astype(int), k - 1) for u, k in ((u1, 32), (u2, 16)))
    inputs |= {"alias": texels[row, column, :3], "acceptance": texels[row, column, 3]}
    body = lamps_body(count, flux=flux / 4, toward=flux / 10 * toward, concentration=concentration)
    found, aimed_density, of_world, rest = header_card(body, AIMED, "measured_lamps.h", **inputs)

    aims = [aim_numpy(row, p.astype(float)) for row in lamp_table(LAMPS, 4)[:count]]
    light = [expected_light(xp_numpy, a, n.astype(float), lamp.power) for a, lamp in zip(aims, LAMPS)]
    world = expected_world_light(xp_numpy, flux / 10 * toward, flux / 4, n.astype(float))
    wanted = [part * aimed_part(xp_numpy, a, concentration) for a, part in zip(aims, light)]
    light, wanted = (np.stack([*values, world] if flux else values) for values in (light, wanted))
    total, aiming = light.sum(0), wanted.sum(0)
    share = np.minimum(total / (total + 0.6), 0.8 * aiming / np.maximum(total, 1e-30))
    index = np.minimum((u_lamp * aiming > np.cumsum(wanted, 0)).sum(0), len(light) - 1)
    aimed = u_aim < share
    numbers = u1.astype(float), u2.astype(float)
    towards = [draw_towards(xp_numpy, a, *numbers) for a in aims]
    if flux:
        accepted = (u_aim < share * texels[row, column, 3])[:, None]
        cell = np.where(accepted, np.stack([column, row], -1), texels[row, column, :2])
        place = np.stack([numbers[0] * 32 - column, numbers[1] * 16 - row], -1)
        towards.append(
            draw_in_world(xp_numpy, 32, 16, *(xyz(part) for part in (cell, 0 * cell)), 1, xyz(_inside(place)))
        )
    towards = np.stack(towards)[index, np.arange(size)]
    truth = np.where(aimed[:, None], towards, w)
    # Where a condition holds only just, float32 may decide it the other way.
    same = np.abs(found - truth).max(-1) < 2e-5
    assert same.mean() > 0.998
    assert np.abs(rest - (1 - share))[same].max() < 1e-5
    assert of_world == pytest.approx(world * share / np.maximum(aiming, 1e-30), rel=1e-5)
    density = sum(
        part * density_towards(xp_numpy, a, truth, (aimed & (index == k)).astype(float))
        for k, (a, part) in enumerate(zip(aims, wanted))
    )
    density = np.divide(density * share + np.zeros(size), aiming, out=np.zeros(size), where=aiming > 0)
    wrong = np.abs(aimed_density - density) > 2e-4 * np.maximum(density, 1e-3)
    assert wrong[same].mean() < 0.002


def test_place_in_the_world_s_table() -> None:
    """Of a draw, both ends of the numbers included, and of any direction."""
    rng = np.random.default_rng(2)
    u1, u2 = rng.random((2, 500)).astype(np.float32)
    u1[:4], u2[:4] = (0, 1, 0, 1), (0, 0, 1, 1)
    wi = spherical(np.arccos(rng.uniform(-1, 1, 500)), rng.uniform(-3.1, 3.1, 500)).astype(np.float32)
    body = "at = mm_world_place(MM_WORLD_COLUMNS, MM_WORLD_ROWS, u1, u2); place = mm_world_coordinates(wi);"
    found, place = header_card(body, {"at": "vector", "place": "vector"}, "measured_lamps.h", u1=u1, u2=u2, wi=wi)
    at, _, _ = choose_cell(xp_numpy, COLUMNS, ROWS, u1.astype(float), u2.astype(float))
    # Next to an edge float32 may choose the other cell.
    assert (np.abs(found - at).max(-1) < 1e-6).mean() > 0.99
    assert np.abs(found[:4] - at[:4]).max() < 1e-6
    assert np.abs(place[:, :2] - np.stack(world_coordinates(xp_numpy, wi.astype(float)), -1)).max() < 4 * EPS


def test_aiming_leaves_dark_lamps_alone() -> None:
    """Rows without a lamp, and one below the horizon, get no sample and no density."""
    below = Lamp(SPHERE, 1.0, (0.0, 0.0, -2.0), extent=0.5)
    w = spherical(np.linspace(0, 1.5, 50), 0.3).astype(np.float32)
    u = np.linspace(0, 1, 50).astype(np.float32)
    inputs = {"p": 0 * w, "n": 0 * w + np.float32([0, 0, 1]), "w": w, "u_lamp": u, "u_aim": 0 * u, "u1": u, "u2": u}
    inputs |= {"alias": 0 * w, "acceptance": u}
    wi, aimed, of_world, rest = header_card(lamps_body(4, [below]), AIMED, "measured_lamps.h", **inputs)
    assert (of_world == 0).all()
    assert (wi == w).all() and (aimed == 0).all() and (rest == 1).all()


def test_roulette_keeps_the_mean() -> None:
    """Weights below what Cycles keeps: raised to it as often as keeps their mean; others untouched."""
    weight = np.repeat(np.float32([[4e-6, 1e-6, 0], [1e-5, 2e-5, 3e-5], [0.1, 2.0, 0.0], [0, 0, 0]]), 1000, 0)
    u = np.tile((np.arange(1000) + 0.5) / 1000, 4).astype(np.float32)
    (found,) = header_card("y = mm_roulette(color(x), r);", {"y": "color"}, x=weight, r=u)
    found, weight = found.reshape(4, 1000, 3), weight.reshape(4, 1000, 3)
    # Of a thousand even steps one more or less may pass.
    assert np.allclose(found.mean(1), weight.mean(1), rtol=0.005, atol=0)
    kept = found[0][found[0].any(-1)]
    assert np.allclose(kept.mean(-1), 2e-5, rtol=1e-5)
    assert np.allclose(found[1:3], weight[1:3], rtol=1e-6, atol=0)
