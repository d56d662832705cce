"""The shading map's lookup as shader nodes against float64 numpy: slices, power law, basis, beyond a_max, any UV."""

import numpy as np
import pytest
from measured_materials.bake import xp_numpy
from measured_materials.bake.shading_maps.envelope_split import bounded_envelope, split
from measured_materials.bake.shading_maps.power_law import PowerLaw
from measured_materials.bake.shading_maps.shading_map import ShadingMap, linearise
from measured_materials.bake.shading_maps.slice_atlas import SliceLayout, level_position, pack_slices, tile_v
from measured_materials.bake.shading_maps.slice_basis import fit_basis
from measured_materials.nodes import expr
from measured_materials.nodes.group import call
from measured_materials.nodes.map_models import basis_group, piecewise_linear, power_group
from measured_materials.nodes.slices_group import SliceImages, SliceOptions, slices_group
from support.cards import card, data_image

HEIGHT, WIDTH, SLICES = 5, 7, 6


@pytest.fixture(scope="module")
def shading_map() -> ShadingMap:
    """Rough texels that answer to light in every way: convex, concave, not monotone."""
    rng = np.random.default_rng(5)
    exponent, k = rng.uniform(0.3, 3, (HEIGHT, WIDTH, 3)), rng.uniform(0.2, 2, (HEIGHT, WIDTH, 3))
    levels = np.array([0.1, 0.25, 0.4, 0.55, 0.8, 1.0])[:, None, None, None]
    photographs = k * levels**exponent * rng.uniform(0.8, 1.2, (6, HEIGHT, WIDTH, 3))
    return linearise(photographs.astype(np.float32), SLICES).map


def images_of(shading_map: ShadingMap) -> SliceImages:
    parts = split(shading_map)
    envelope = np.concatenate([parts.envelope, parts.share[..., None]], -1)
    layout = SliceLayout(SLICES - 1, HEIGHT, WIDTH)
    return SliceImages(
        data_image("residual", pack_slices(parts.residual[1:])), data_image("envelope", envelope), layout
    )


def probes() -> tuple[np.ndarray, np.ndarray]:
    """UV inside, outside and at the seams of [0, 1]; x at 0, at slices, between, at 1 and beyond."""
    rng = np.random.default_rng(1)
    uv = rng.uniform(-2.5, 2.5, (600, 2))
    uv[:40] = rng.choice([0.0, 1.0, -1.0, 0.5 / WIDTH, 1 - 0.5 / WIDTH], (40, 2))
    x = rng.uniform(0, 1, 600)
    x[::7] = np.tile(np.linspace(0, 1, SLICES), 15)[: len(x[::7])]
    x[3::11] = rng.uniform(1, 4, len(x[3::11]))
    return uv.astype(np.float32), x.astype(np.float32)


def looked_up(group, uv, *rest, coloured: bool = False) -> list[np.ndarray]:
    uv3 = np.concatenate([uv, np.zeros((len(uv), 1))], -1).astype(np.float32)
    return card(lambda at, x, *more: call(group, at, x, *more), uv3, *rest)


# A texel's weight in Cycles comes from float32 coordinates of an image of up to a hundred rows, and UVs up to 2.5
# lose two bits of the fraction: about 1e-5 of a texel, times slopes between random texels of about 2.
TOLERANCE = 5e-5


@pytest.mark.parametrize("interpolation", ["Linear", "Fetched"])
@pytest.mark.parametrize("above", ["clamp", "scale"])
def test_slices_as_in_numpy(shading_map: ShadingMap, above: str, interpolation: str) -> None:
    uv, x = probes()
    group = slices_group("test slices", images_of(shading_map), SliceOptions(above, interpolation=interpolation))
    reflected, residual, envelope, share = looked_up(group, uv, x, np.ones_like(x), np.full_like(x, 0.5))
    truth = shading_map.evaluate(uv, x, above)
    assert np.abs(reflected - truth).max() < TOLERANCE * 4
    inside = x <= 1
    assert np.abs(residual + envelope * x[:, None] - truth)[inside].max() < TOLERANCE
    assert residual.min() >= 0
    assert (share >= 0).all() and (share <= 1).all()


@pytest.mark.parametrize("above", ["clamp", "scale"])
def test_coloured_levels_reach_their_own_slices(shading_map: ShadingMap, above: str) -> None:
    uv, x = probes()
    colour = np.stack([x, x[::-1], np.roll(x, 5)], -1)
    group = slices_group("test slices", images_of(shading_map), SliceOptions(above, coloured=True))
    reflected = looked_up(group, uv, colour, np.ones_like(x), np.full_like(x, 0.5))[0]
    assert np.abs(reflected - shading_map.evaluate(uv, colour, above)).max() < TOLERANCE * 4


def test_one_random_slice_is_the_blend_on_average(shading_map: ShadingMap) -> None:
    uv, x = probes()
    group = slices_group("test slices", images_of(shading_map), SliceOptions(stochastic=True))
    # Evenly spread numbers: their mean is the expectation but for the one that falls across the threshold.
    draws = 64
    randoms = (np.arange(draws) + 0.5) / draws
    total = np.zeros((len(x), 3))
    part = slice(0, 96)
    for random in randoms:
        total[part] += looked_up(group, uv[part], x[part], x[part] * 0 + 1, x[part] * 0 + np.float32(random))[0]
    truth = shading_map.evaluate(uv, x)
    step = np.ptp(shading_map.slices, 0).max() / draws
    assert np.abs(total[part] / draws - truth[part]).max() < step


def test_random_numbers_of_exactly_0_and_1_stay_among_the_two_slices(shading_map: ShadingMap) -> None:
    uv, x = probes()
    images = images_of(shading_map)
    group = slices_group("test slices", images, SliceOptions(stochastic=True))
    base, _ = level_position(xp_numpy, SLICES, x)
    for random in (0.0, 1.0):
        chosen = np.minimum(base + (random < np.minimum(x, 1) * (SLICES - 1) - base), SLICES - 1)
        residual = looked_up(group, uv, x, np.ones_like(x), np.full_like(x, random))[1]
        parts = split(shading_map)
        truth = ShadingMap(parts.residual).evaluate(uv, chosen / (SLICES - 1))
        # Where x is a slice in exact arithmetic, rounding may put it on either side; both are right.
        clear = np.abs(np.minimum(x, 1) * (SLICES - 1) % 1 - 0.5) < 0.49
        assert np.abs(residual - truth)[clear].max() < TOLERANCE


@pytest.mark.parametrize("peak", [1.0, 1.7, 5.0])
def test_envelope_stays_below_as_far_as_f_r_reaches(shading_map: ShadingMap, peak: float) -> None:
    rng = np.random.default_rng(2)
    uv = rng.uniform(0, 1, (500, 2)).astype(np.float32)
    x = (rng.uniform(0, 1, 500) * peak).astype(np.float32)
    group = slices_group("test slices", images_of(shading_map), SliceOptions("clamp", peak=True))
    numbers = np.full_like(x, peak), np.full_like(x, 0.5)
    reflected, residual, envelope, _ = looked_up(group, uv, x, *numbers)
    assert residual.min() > -1e-6
    assert np.abs(residual + envelope * x[:, None] - reflected).max() < 1e-5
    assert np.abs(reflected - shading_map.evaluate(uv, x)).max() < TOLERANCE
    # At texel centres it is numpy's bound; between them the nodes take the minimum of what was interpolated.
    centres = np.stack(np.meshgrid((np.arange(WIDTH) + 0.5) / WIDTH, (np.arange(HEIGHT) + 0.5) / HEIGHT), -1)
    at = centres.reshape(-1, 2).astype(np.float32)
    ones = np.ones(len(at), np.float32)
    found = looked_up(group, at, ones, ones * np.float32(peak), ones)[2]
    wanted = bounded_envelope(split(shading_map), peak, "clamp")[::-1].reshape(-1, 3)
    assert np.abs(found - wanted).max() < TOLERANCE


def test_extended_border_stays_in_the_swatch(shading_map: ShadingMap) -> None:
    uv, x = probes()
    group = slices_group("test slices", images_of(shading_map), SliceOptions(tiling="extend"))
    reflected = looked_up(group, uv, x, np.ones_like(x), np.full_like(x, 0.5))[0]
    half = 0.5 / np.array([WIDTH, HEIGHT])
    assert np.abs(reflected - shading_map.evaluate(np.clip(uv, half, 1 - half), x)).max() < TOLERANCE


@pytest.mark.parametrize("above", ["clamp", "scale"])
def test_power_law_as_in_numpy(above: str) -> None:
    rng = np.random.default_rng(3)
    k = rng.uniform(0, 2, (HEIGHT, WIDTH, 3)).astype(np.float32)
    exponent = rng.uniform(0.2, 4, (HEIGHT, WIDTH, 3)).astype(np.float32)
    image = data_image("power", pack_slices(np.stack([k, exponent])))
    images = SliceImages(image, image, SliceLayout(2, HEIGHT, WIDTH))
    group = power_group("test power", images, SliceOptions(above, peak=True))
    rows, columns = rng.integers(0, HEIGHT, 300), rng.integers(0, WIDTH, 300)
    uv = np.stack([(columns + 0.5) / WIDTH, 1 - (rows + 0.5) / HEIGHT], -1).astype(np.float32)
    x = rng.uniform(0, 3, 300).astype(np.float32)
    reflected, residual, envelope, share = looked_up(group, uv, x, np.full_like(x, 3), x)
    law = PowerLaw(k[rows, columns], exponent[rows, columns])
    held = np.minimum(x, 1)[:, None]
    truth = law.k * held**law.exponent * (np.maximum(x, 1)[:, None] if above == "scale" else 1)
    assert np.abs(reflected - truth).max() < TOLERANCE * 4
    assert np.abs(residual + envelope * x[:, None] - reflected).max() < 2e-5
    assert residual.min() > -2e-5
    # Share by quadrature over x in [0, 1].
    levels = (np.arange(4000) + 0.5) / 4000
    reflects = law.k.sum(-1) * 0 + np.stack([law.k * level**law.exponent for level in levels]).mean(0).sum(-1)
    carries = 0.5 * envelope.sum(-1)
    exact = np.isclose(law.exponent, 1, atol=1e-4).any(-1)
    assert (share >= -1e-6).all() and (share <= 1 + 1e-6).all()
    assert ((share < 0.999) == (carries > 1e-3 * reflects))[~exact].all()


def test_basis_as_in_numpy(shading_map: ShadingMap) -> None:
    basis = fit_basis(shading_map.slices, 2, nonnegative=True)
    again = ShadingMap(np.stack([basis.evaluate(x) for x in shading_map.levels]).astype(np.float32))
    parts = split(ShadingMap(np.maximum(again.slices, 0)))
    tiles = np.ascontiguousarray(np.moveaxis(basis.coefficients, -1, 0)).astype(np.float32)
    images = SliceImages(
        data_image("coefficients", pack_slices(tiles)),
        data_image("envelope", np.concatenate([parts.envelope, parts.share[..., None]], -1)),
        SliceLayout(2, HEIGHT, WIDTH),
    )
    curves = tuple(tuple(map(float, row)) for row in basis.curves)
    uv, x = probes()
    for options in (SliceOptions(), SliceOptions("scale"), SliceOptions(peak=True)):
        group = basis_group("test basis", images, curves, options)
        reflected = looked_up(group, uv, x, np.full_like(x, 4), x)[0]
        assert np.abs(reflected - again.evaluate(uv, x, options.above)).max() < TOLERANCE * 4


def test_piecewise_linear_curves() -> None:
    curves = ((0.0, 0.3, 0.2, 1.0), (0.5, 0.1, 0.9, 0.0))
    x = np.linspace(0, 1, 301).astype(np.float32)
    found = card(lambda at: tuple(piecewise_linear(curves, at)), x)
    for curve, values in zip(curves, found):
        assert np.abs(values - np.interp(x, np.linspace(0, 1, 4), curve)).max() < 1e-6


def test_layer_positions() -> None:
    layout = SliceLayout(SLICES - 1, 64, 32)
    rng = np.random.default_rng(7)
    index, v = rng.integers(0, SLICES - 1, 400).astype(np.float32), rng.uniform(0, 1, 400).astype(np.float32)
    x = np.concatenate([np.linspace(0, 1.5, 380), np.linspace(0, 1, 20)]).astype(np.float32)

    def formulas(k, at, level):
        return tile_v(expr, layout, k, at), *level_position(expr, SLICES, level)

    at, base, t = card(formulas, index, v, x)
    row = index.astype(float) * (64 + 8) + 4 + (1 - v.astype(float)) * 64
    # One texel is 1/360 of the image; 2e-7 is a ten-thousandth of it.
    assert np.abs(at - (1 - row / layout.rows)).max() < 3e-7
    assert np.abs(base + t - np.minimum(x, 1.0) * (SLICES - 1)).max() < 1e-6
    assert base.min() == 0 and base.max() == SLICES - 2 and t.max() <= 1 and t.min() >= 0
