"""Drawing directions towards the bright parts of a world: the alias table against its density and against pictures."""

from __future__ import annotations

import numpy as np
import pytest
from measured_materials.bake import xp_numpy
from measured_materials.bake.directions import normalize
from measured_materials.bake.sampling.world import (
    CellLight,
    cell_directions,
    cell_light,
    choose_cell,
    draw_in_world,
    expected_world_light,
    world_coordinates,
    world_structure,
    world_texels,
)
from numpy.typing import NDArray
from scipy import stats

Array = NDArray[np.float64]


def picture_directions(height: int) -> Array:
    """Directions of an equirectangular picture's pixels, (H, 2 H, 3)."""
    azimuth = (0.5 - (np.arange(2 * height) + 0.5) / (2 * height)) * 2 * np.pi
    theta = (np.arange(height) + 0.5) / height * np.pi
    sine = np.sin(theta)[:, None]
    parts = np.broadcast_arrays(sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(theta)[:, None])
    return np.stack(parts, -1)


def spot(height: int, towards: tuple[float, float, float], degrees: float, flux: float, base: float = 1.0) -> Array:
    """A grey picture (H, 2 H, 3) of radiance `base` with a round spot of this integral over directions."""
    apart = np.maximum(1 - picture_directions(height) @ normalize(np.array(towards)), 0)
    width = 1 - np.cos(np.radians(degrees))
    return np.repeat((base + flux / (2 * np.pi * width) * np.exp(-apart / width))[..., None], 3, -1)


def gradient(height: int) -> Array:
    """From black at the nadir to white at the zenith."""
    return np.repeat((1 + picture_directions(height)[..., 2:]) / 2, 3, -1)


def draw(texels: NDArray[np.float32], count: int, seed: int = 0) -> tuple[Array, Array]:
    """Directions and their densities, as the shader draws them."""
    rows, columns = texels.shape[:2]
    u1, u2, u3 = np.random.default_rng(seed).random((3, count))
    at, cell, place = choose_cell(xp_numpy, columns, rows, u1, u2)
    texel = texels[(at[:, 1] * rows).astype(int), (at[:, 0] * columns).astype(int)]
    wi = draw_in_world(xp_numpy, columns, rows, cell, texel[:, :3], u3 < texel[:, 3], place)
    drawn = np.where((u3 < texel[:, 3])[:, None], cell, texel[:, :3]).astype(int)
    return wi, texels[drawn[:, 1], drawn[:, 0], 2]


def density_at(texels: NDArray[np.float32], wi: Array) -> Array:
    """By texture coordinates, closest texel."""
    rows, columns = texels.shape[:2]
    u, v = world_coordinates(xp_numpy, wi)
    column, row = (np.clip((x * n).astype(int), 0, n - 1) for x, n in ((u, columns), (v, rows)))
    return texels[row, column, 2]


@pytest.fixture(scope="module")
def rough() -> NDArray[np.float32]:
    """A table of 16 x 8 cells of very unlike weights, a third of them 0."""
    rng = np.random.default_rng(1)
    return world_texels(rng.random((8, 16)) ** 4 * (rng.random((8, 16)) > 1 / 3))


def test_draws_follow_the_density_and_carry_it(rough: NDArray[np.float32]) -> None:
    wi, density = draw(rough, 200_000)
    assert np.abs(np.linalg.norm(wi, axis=-1) - 1).max() < 1e-12
    assert (density_at(rough, wi) == density).all()  # no draw so near to an edge that rounding finds the neighbour
    u, v = world_coordinates(xp_numpy, wi)
    column, row = np.minimum((u * 16).astype(int), 15), np.minimum((v * 8).astype(int), 7)
    counts = np.bincount(row * 16 + column, minlength=128)
    expected = rough[..., 2].ravel() * (4 * np.pi / 128) * len(wi)
    drawn = expected > 0
    assert not counts[~drawn].any()
    many = expected > 20
    # One part in a thousand of runs fails, but the seed is fixed; a shift of 2 % in a cell does fail.
    assert stats.chisquare(counts[many], expected[many] * counts[many].sum() / expected[many].sum()).pvalue > 1e-3


def test_draws_are_even_inside_a_cell() -> None:
    weights = np.zeros((8, 16))
    weights[1, 5] = 1
    wi, _ = draw(world_texels(weights), 100_000)
    u, v = world_coordinates(xp_numpy, wi)
    for place in (u * 16 - 5, v * 8 - 1):
        assert stats.kstest(place, "uniform").pvalue > 1e-3


def test_density_integrates_to_one(rough: NDArray[np.float32]) -> None:
    height = 512
    solid_angle = np.sin((np.arange(height) + 0.5) / height * np.pi)[:, None] * (np.pi / height) ** 2
    # A lattice of 512 rows meets the edges of 8 to a few parts in a thousand.
    assert (density_at(rough, picture_directions(height)) * solid_angle).sum() == pytest.approx(1, abs=5e-3)
    assert rough[..., 2].sum() * 4 * np.pi / 128 == pytest.approx(1, abs=1e-6)
    # What the alias method really draws, from the float32 that it decides by.
    acceptance = rough[..., 3].astype(float).ravel()
    probability = acceptance / 128
    np.add.at(probability, (rough[..., 1] * 16 + rough[..., 0]).astype(int).ravel(), (1 - acceptance) / 128)
    assert np.abs(probability - rough[..., 2].ravel() * 4 * np.pi / 128).max() < 1e-7


@pytest.mark.parametrize("height", [32, 300, 1500])
def test_cells_keep_the_light_and_its_place(height: int) -> None:
    """One bright pixel in a turned picture: a coarse one, one of odd size, and one that is averaged."""
    rng = np.random.default_rng(height)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    radiance = np.full((height, 2 * height, 3), 0.5)
    y, x = height // 3, height // 2 + 7
    radiance[y, x] = 1e5
    cells = cell_light(radiance, turn)
    pixel = np.sin((y + 0.5) / height * np.pi) * (np.pi / height) ** 2
    flux = 0.5 * 4 * np.pi + 1e5 * pixel
    # A cell's mean is over the lattice points that fall into it, and those differ by a tenth or so.
    assert cells.mean.mean() * 4 * np.pi == pytest.approx(flux, rel=0.12)
    bright = cells.mean - 0.5
    place = normalize(np.tensordot(bright, cell_directions(512, 256), 2))
    towards = turn @ picture_directions(height)[y, x]
    # A cell is 0.7 degrees wide, or a part of the pixel.
    assert np.degrees(np.arccos(place @ towards)) < max(0.4, 30 / height)
    assert (cells.rms >= cells.mean * (1 - 1e-6)).all()


def test_what_cannot_be_seen_counts_as_dark() -> None:
    radiance = np.ones((32, 64, 3))
    radiance[:16] = -1
    radiance[16:20] = np.nan
    cells = cell_light(radiance)
    assert np.isfinite(cells.mean).all() and cells.mean.min() == 0


def test_what_stands_out() -> None:
    structure, weights = world_structure(cell_light(spot(256, (0.5, -0.6, 0.6), 4, 3.0)))
    # The spot's tails below the mean are not part of it: 3 sr of a grey of 1 raise the mean to 1.24.
    assert structure.flux == pytest.approx(3.0, rel=0.05)
    assert normalize(np.array(structure.toward)) == pytest.approx(normalize(np.array([0.5, -0.6, 0.6])), abs=5e-3)
    assert structure.background == pytest.approx(np.pi, rel=0.02)
    # The cap in which the exponential spot exceeds the mean, 1 + 3 / (4 pi).
    width = 1 - np.cos(np.radians(4))
    cap = width * np.log(3 / (2 * np.pi * width) / (3 / (4 * np.pi))) / 2
    assert structure.bright_sky == pytest.approx(cap, rel=0.05)
    assert structure.bright_light == pytest.approx(3 / (4 * np.pi + 3), rel=0.05)
    assert (weights > 0).mean() == structure.bright_sky


def test_expected_light_is_about_the_irradiance() -> None:
    """Exact would be max(cos, 0) of a small spot; the two orders of it that are kept err by a quarter."""
    toward, flux = np.array([0.0, 0.0, 1.0]), 1.0
    for cosine in (1.0, 0.5, 0.0, -0.5, -1.0):
        normal = np.array([np.sqrt(1 - cosine**2), 0, cosine])
        found = expected_world_light(xp_numpy, toward / 2, flux / 4, normal)
        assert found > 0 and abs(found - max(cosine, 0)) < 0.26


@pytest.mark.parametrize("degrees", [3, 20])
def test_predicted_noise_is_that_of_draws(degrees: float) -> None:
    mean = cell_light(spot(128, (0.3, 0.2, 0.8), degrees, 2.0), columns=64, rows=32).mean
    cells = CellLight(mean, mean)  # for the draws below see each cell as even
    structure, weights = world_structure(cells)
    texels = world_texels(weights)
    rng = np.random.default_rng(0)
    count, moments = 20_000, []
    for normal in (np.array(n) for n in np.ndindex(3, 3, 3) if n != (1, 1, 1)):
        normal = normalize(normal - 1.0)
        expected = expected_world_light(xp_numpy, np.array(structure.toward) / 2, structure.flux / 4, normal)
        share = min(expected / (expected + structure.background), 0.9)
        onto = normalize(normal + normalize(rng.normal(size=(count, 3))))
        for probability in (0.0, share):
            wi = np.where((rng.random(count) < probability)[:, None], draw(texels, count)[0], onto)
            cosine = np.maximum(wi @ normal, 0)
            u, v = world_coordinates(xp_numpy, wi)
            row, column = np.minimum((v * 32).astype(int), 31), np.minimum((u * 64).astype(int), 63)
            pdf = probability * texels[row, column, 2] + (1 - probability) * cosine / np.pi
            value = np.divide(cells.mean[row, column] * cosine, pdf, out=np.zeros(count), where=cosine > 0)
            moments.append((value.mean() ** 2, (value**2).mean()))
    square, second = np.array(moments).reshape(-1, 2, 2).mean(0).T
    found = np.sqrt(second / square - 1)
    # 26 x 20,000 draws.
    assert found[0] == pytest.approx(structure.unaimed, rel=0.1)
    assert found[1] == pytest.approx(structure.aimed, rel=0.1)


def test_it_pays_where_something_stands_out() -> None:
    worlds = {
        "even": (np.ones((16, 32, 3)), False),
        "nearly even": (1 + 0.1 * gradient(64), False),
        "brighter upwards": (gradient(64), False),
        "soft glow": (spot(128, (0, 0.5, 0.5), 15, 3.0), True),
        "sun": (spot(1024, (0, 0.5, 0.5), 0.3, 12.0), True),
        "black": (np.zeros((16, 32, 3)), False),
    }
    for name, (radiance, pays) in worlds.items():
        structure, weights = world_structure(cell_light(radiance))
        assert structure.pays == pays, name
        assert np.isfinite([structure.unaimed, structure.aimed, *structure.toward]).all()
    assert structure.flux == 0 and not weights.any()
