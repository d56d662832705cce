"""The fit of maps over azimuth: closed forms, a modelled relief with cast shadows, and photographs left out."""

from __future__ import annotations

import numpy as np
import pytest
from measured_materials.bake.shading_maps.azimuth import azimuth_fit
from measured_materials.bake.shading_maps.azimuth.against_arc import arc_error, foretells, surround
from measured_materials.bake.shading_maps.azimuth.azimuth_basis import AzimuthBasis, node_means
from measured_materials.bake.shading_maps.azimuth.azimuth_fit import AzimuthChoice, Nodes, Prepared, fit_azimuth
from measured_materials.bake.shading_maps.azimuth.level_curve import LevelCurve
from measured_materials.bake.shading_maps.azimuth.light_stack import LightStack, relative_error
from measured_materials.bake.shading_maps.azimuth.light_weights import (
    PLATES,
    LightWeights,
    convex_hull,
    nearest_within,
    spacing,
    widest_gap,
)
from measured_materials.bake.shading_maps.shading_map import at_level, linearise
from support.azimuth import clamped_basis
from support.relief import bumps, lights, photographs

DOME = lights((15, 35, 55, 75), 8)
ELSEWHERE = lights((28, 46, 64), 5, zenith=False)


def lambertian(directions: np.ndarray, slope: float = 0.15, size: int = 12) -> np.ndarray:
    """n . l of leaning texels that no light of 15 degrees or more is behind; normals of the frame lean nowhere."""
    rng = np.random.default_rng(3)
    lean = rng.uniform(-slope, slope, (size, size, 2))
    lean -= lean.mean((0, 1))
    normals = np.concatenate([lean, np.ones((size, size, 1))], -1)
    shade = np.einsum("hwk,nk->nhw", normals, directions)
    return (shade[..., None] * [0.9, 0.7, 0.5]).astype(np.float32)


def shown(fit: azimuth_fit.AzimuthFit, direction: np.ndarray) -> np.ndarray:
    """The map as a light of this direction shows it, in the unit of the photographs."""
    level = float(fit.curve.level(direction[2]))
    return fit.curve.a_max * fit.basis.evaluate(level, float(np.arctan2(direction[1], direction[0])))


def relative(found: np.ndarray, truth: np.ndarray) -> float:
    return float(np.sqrt(np.square(found - truth).mean() / np.square(truth).mean()))


def test_a_lambertian_relief_is_held_between_its_photographs() -> None:
    fit = fit_azimuth(lambertian(DOME), DOME)
    for direction, truth in zip(ELSEWHERE, lambertian(ELSEWHERE), strict=True):
        assert relative(shown(fit, direction), truth) < 0.01
    assert fit.basis.rank <= 4 and fit.error < 0.06
    overhead = lambertian(np.array([[0.0, 0.0, 1.0]]))[0]
    assert relative(shown(fit, np.array([0.0, 0.0, 1.0])), overhead) < 0.01


def test_shadows_that_a_relief_casts_turn_with_the_light() -> None:
    heights = bumps(32)
    fit = fit_azimuth(photographs(heights, DOME), DOME)
    found = [relative(shown(fit, d), t) for d, t in zip(ELSEWHERE, photographs(heights, ELSEWHERE), strict=True)]
    stack = LightStack.of(photographs(heights, DOME), DOME)
    assert max(found) < 0.35 and np.median(found) < 0.2
    assert fit.error < 0.5 * arc_error(stack, 20)
    assert foretells(Prepared.of(stack), 20)
    turned = [fit.basis.evaluate(0.4, phi) for phi in (0.0, np.pi)]
    assert relative(turned[0], turned[1]) > 0.4


def test_along_an_arc_that_was_photographed_closely_it_is_as_good_as_the_map_of_that_arc() -> None:
    arc, between = (lights(tuple(np.linspace(*ends)), 1, zenith=False) for ends in ((5, 88, 10), (10, 65, 4)))
    around = lights((10, 30, 50, 70), 8, zenith=False)
    images, truths = (photographs(bumps(32), directions) for directions in (np.concatenate([arc, around]), between))
    fit = fit_azimuth(images, np.concatenate([arc, around]))
    alone = linearise(images[: len(arc)])
    errors = []
    for direction, truth in zip(between, truths, strict=True):
        level = float(truth.mean()) / alone.a_max
        errors.append(
            [relative(one, truth) for one in (shown(fit, direction), alone.a_max * at_level(alone.map, level))]
        )
    ours, theirs = np.sqrt(np.square(errors).mean(0))
    assert ours < theirs


def test_curves_are_as_many_as_keep_the_photographs() -> None:
    images = photographs(bumps(24), DOME)
    stack = LightStack.of(images, DOME)
    choice = AzimuthChoice(1e-3, False)
    nodes, errors = Nodes.of(stack, choice), azimuth_fit.left_out_by_rank(stack, choice)
    rank = azimuth_fit.called_for(stack, nodes, errors)
    foretold = int(np.argmin([found.sum() for found in errors])) + 1
    flat = images.reshape(len(images), -1).astype(np.float64)

    def lost(count: int) -> float:
        """Of the photographs, by least squares on the coefficient images of so many curves."""
        coefficients = nodes.reduced(stack, count)[1] @ flat
        rest = flat - flat @ np.linalg.pinv(coefficients) @ coefficients
        return float(np.sqrt(np.square(rest).mean(1) / np.square(flat).mean(1)).mean())

    assert lost(rank) < 0.02 < lost(rank - 1)
    # Nothing is kept for its own sake: left out, fewer curves foretell as much.
    assert errors[rank - 1].sum() < 1.05 * errors[foretold - 1].sum()


def test_a_highlight_is_interpolated_in_parts_of_the_level_and_a_matte_relief_as_it_is() -> None:
    half = DOME + np.array([0.0, 0.0, 1.0])
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    stack = LightStack.of(lambertian(half) ** 30 + np.float32(0.01) * lambertian(DOME), DOME)
    assert Prepared.of(stack).choice.plate != "plain"
    assert Prepared.of(LightStack.of(lambertian(DOME), DOME)).choice.plate == "plain"


def test_every_photograph_is_left_out_once_and_predicted_without_itself() -> None:
    images = photographs(bumps(16), DOME)
    stack = LightStack.of(images, DOME)
    left = np.concatenate([part for _, part in stack.folds()])
    assert sorted(left) == list(range(len(DOME)))
    assert all(not set(kept) & set(part) for kept, part in stack.folds())
    # A photograph that no other foretells shows in its own error, whatever it is.
    strange = images.copy()
    strange[5] = strange[5][::-1, ::-1]
    doubtful = LightStack.of(strange, DOME)
    shares = np.sqrt(azimuth_fit.left_out(doubtful, AzimuthChoice(1e-3, False)) / np.diag(doubtful.products))
    assert shares[5] > 2 * np.median(shares)


def test_the_error_told_is_not_the_least_of_the_trials(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of trials that differ by chance alone, the least is a lucky one, and as good as any other at what is new."""
    stack, rng = LightStack.of(lambertian(DOME), DOME), np.random.default_rng(0)
    own = np.diag(stack.products)

    def by_chance(*_: object) -> np.ndarray:
        return own * np.square(rng.exponential(1.0, len(own)))

    monkeypatch.setattr(azimuth_fit, "left_out", by_chance)
    tried = azimuth_fit.trials(stack)
    lucky, told = [], []
    for _ in range(20):
        found = {trial: by_chance() for trial in tried}
        monkeypatch.setattr(azimuth_fit, "trials", lambda _, found=found: found)
        prepared = Prepared.of(stack)
        lucky.append(relative_error(stack, found[prepared.choice]))
        told.append(relative_error(stack, prepared.errors))
        ranks = {trial: [each, by_chance()] for trial, each in found.items()}
        assert np.array_equal(azimuth_fit.foretold(prepared, ranks, 1), prepared.errors)
    assert np.mean(lucky) < 0.85 and abs(np.mean(told) - 1) < 0.1


def test_the_rank_that_foretells_photographs_keeps_the_others_alone() -> None:
    """Where those of one fold are noise that no curve holds, their own error is that of the rank the others need."""
    images, rng = lambertian(DOME), np.random.default_rng(0)
    left = LightStack.of(images, DOME).folds()[0][1]
    images[left] = rng.exponential(images.mean(), images[left].shape)
    stack = LightStack.of(images, DOME)
    choice = AzimuthChoice(1e-3, False)
    prepared = Prepared(stack, choice, (choice,) * len(stack.folds()), np.zeros(len(stack)))
    ranks = np.ones(len(stack)) * np.arange(1, 9)[:, None]
    used = azimuth_fit.foretold(prepared, {choice: list(ranks)}, None)
    assert np.ptp(used[left]) == 0 and used[left].max() < np.delete(used, left).min()


def test_errors_by_products_are_those_of_the_pixels() -> None:
    images = photographs(bumps(16), DOME)
    stack = LightStack.of(images, DOME)
    nodes = Nodes.of(stack, AzimuthChoice(1e-3, False))
    curves, mixed, lost = nodes.reduced(stack, 6)
    weights = nodes.predicted(curves, mixed, ELSEWHERE)
    flat = images.reshape(len(images), -1).astype(np.float64)
    wanted = np.arange(len(ELSEWHERE))
    direct = np.square(weights @ flat - flat[wanted]).mean(1)
    assert np.allclose(stack.errors(weights, wanted, np.arange(len(images))), direct, rtol=1e-5)
    level = np.tile(nodes.x, nodes.azimuths)[:, None]
    whole, reduced = nodes.weights @ flat, level * curves[:, :, 1:].reshape(6, -1).T @ (mixed @ flat)
    by_level = np.square(whole - reduced).mean(1).reshape(nodes.azimuths, -1).mean(0)
    assert np.allclose(lost, by_level, rtol=1e-3, atol=1e-6 * by_level.max())
    assert np.allclose(stack.averages, flat.mean(1), rtol=1e-5)


@pytest.mark.parametrize("even", [False, True])
def test_means_are_the_levels(even: bool) -> None:
    leaning = photographs(bumps(16), DOME) * (1 + 0.4 * DOME[:, 0])[:, None, None, None].astype(np.float32)
    stack = LightStack.of(leaning, DOME)
    nodes = Nodes.of(stack, AzimuthChoice(1e-3, even))
    means = (nodes.weights @ stack.averages).reshape(nodes.azimuths, -1)
    assert np.allclose(means.mean(0), nodes.x, rtol=1e-6)
    apart = np.ptp(means[:, 25]) / nodes.x[25]
    assert apart < 1e-6 if even else apart > 0.4


def test_a_fitted_map_has_its_levels_for_means_and_one_look_at_the_zenith() -> None:
    fit = fit_azimuth(photographs(bumps(24), DOME), DOME, rank=5)
    assert np.abs(node_means(fit.basis).mean(0) - 1).max() < 1e-4
    assert fit.basis.rank == 5
    assert np.ptp(fit.basis.curves[:, :, -1], axis=1).max() < 1e-6


def test_levels_of_next_to_no_light_are_not_scaled_up() -> None:
    basis = clamped_basis()
    dark = basis.coefficients - basis.coefficients.mean((0, 1, 2), keepdims=True) * np.float32(1 - 1e-9)
    found = azimuth_fit.levelled(AzimuthBasis(dark * np.float32(1e-9), basis.curves))
    assert np.abs(found.curves).max() <= 2.001 * np.abs(basis.curves).max()


def test_brightness_that_goes_with_azimuth_is_kept_and_uneven_lamps_are_not() -> None:
    images = lambertian(DOME)
    leaning = images * (1 + 0.4 * DOME[:, 0])[:, None, None, None].astype(np.float32)
    assert not Prepared.of(LightStack.of(leaning, DOME)).choice.even
    lamps = np.exp(np.random.default_rng(0).normal(0, 0.4, len(DOME)))[:, None, None, None].astype(np.float32)
    assert Prepared.of(LightStack.of(images * lamps, DOME)).choice.even


def test_lights_of_one_elevation_and_beyond_the_outermost() -> None:
    ring = lights((45,), 8, zenith=False)
    fit = fit_azimuth(lambertian(ring), ring)
    overhead = lambertian(np.array([[0.0, 0.0, 1.0]]))[0]
    assert relative(shown(fit, np.array([0.0, 0.0, 1.0])), overhead) < 0.05
    # Lower than any light the swatch darkens, and looks as under the lowest.
    low, rim = (fit.basis.evaluate(x, 0.0) for x in (0.15, 0.6))
    assert relative(low / low.mean(), rim / rim.mean()) < 0.05


def test_weights_sum_to_one_and_hold_what_is_linear() -> None:
    curve = LevelCurve.of(DOME[:, 2], DOME[:, 2] ** 4)
    weights = LightWeights(DOME, 1e-4, curve)
    places = ELSEWHERE[:, :2]
    found = weights(places)
    assert np.allclose(found.sum(1), 1) and np.allclose(found @ DOME, ELSEWHERE, atol=1e-9)
    for plate in PLATES:
        exact = LightWeights(DOME, 0.0, curve, plate)
        assert np.allclose(exact(DOME[:, :2]), np.eye(len(DOME)), atol=1e-6)
        # In parts of the level, what is one for all lights stays so; a plain plate holds radiance instead.
        kept = exact(places) @ curve.level(DOME[:, 2]) / curve.level(ELSEWHERE[:, 2])
        assert (np.abs(kept - 1).max() < 1e-6) == (plate != "plain")


def test_places_outside_of_the_lights_move_to_the_nearest_on_their_rim() -> None:
    hull = convex_hull(np.array([[0, 0], [2, 0], [2, 1], [0, 1], [1, 0.5], [1, 0]], float))
    assert len(hull) == 4
    moved = nearest_within(hull, np.array([[1, 0.5], [3, 0.5], [-1, -1], [1, 4]], float))
    assert np.allclose(moved, [[1, 0.5], [2, 0.5], [0, 0], [1, 1]])


def test_levels_rise_with_the_cosine() -> None:
    cosines, averages = np.array([0.2, 0.5, 0.4, 0.8]), np.array([0.1, 0.3, 0.32, 0.6])
    curve = LevelCurve.of(cosines, averages)
    assert np.isclose(curve.a_max, 0.75) and np.isclose(curve.level(np.array(1.0)), 1)
    x = np.linspace(0, 1, 50)
    assert (np.diff(curve.level(x)) > 0).all() and np.allclose(curve.cosine(curve.level(x)), x, atol=1e-4)
    assert np.isclose(curve.level(np.array(0.45)), 0.31 / 0.75, rtol=1e-3)
    assert np.isclose(curve.level(np.array(0.1)), 0.05 / 0.75, rtol=1e-3)


def test_which_lights_surround_a_swatch() -> None:
    assert surround(lights((45,), 4)) and surround(lights((30, 60), 3)) and surround(DOME)
    assert not surround(None) and not surround(lights((45,), 2)) and not surround(DOME[DOME[:, 0] > -0.1])
    assert np.isclose(widest_gap(lights((45,), 4)), np.pi / 2)
    assert np.isclose(spacing(lights((45,), 4, zenith=False)), np.arccos(0.5))
