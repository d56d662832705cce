"""Envelopes: under the measurement, as much of it as can be, and what they leave."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured_materials.bake import xp_numpy
from measured_materials.bake.bundle.checked_json import dump_json
from measured_materials.bake.directions import spherical
from measured_materials.bake.envelope import (
    BASIS,
    Elevations,
    EnvelopeFit,
    EnvelopeSettings,
    ResidualSource,
    fit_envelope,
    fit_from_image,
    guarded_share,
    mirror_probability,
    pack_weights,
    reconstruction_errors,
    texture_coordinate,
    unpack_weights,
)
from measured_materials.bake.envelope.closures import neighbours
from measured_materials.bake.envelope.fit import node_weights
from measured_materials.bake.envelope.views import chord_of, gauss_chords, interpolated, light_directions, sample_views
from measured_materials.bake.errors import BakeError
from measured_materials.bake.lobes.lobes import Lobe
from measured_materials.bake.sources import analytic, read_source
from measured_materials.bake.tables.accuracy import direction_pairs
from measured_materials.bake.tables.grids.normal_vector_grid import NormalVectorGrid
from measured_materials.bake.tables.table import tabulate
from measured_materials.bake.tables.treated_source import TreatedSource

FEW = EnvelopeSettings(viewers=Elevations(24))


class Made:
    """A source from a function of (wi, wo)."""

    name = "made"

    def __init__(self, value: Callable[[np.ndarray, np.ndarray], np.ndarray], isotropic: bool = True) -> None:
        self.value, self.isotropic, self.bilateral = value, isotropic, True
        self.facts: dict[str, Any] = {}

    def evaluate(self, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
        wi, wo = np.broadcast_arrays(wi, wo)
        value = self.value(wi, wo)
        value[(wi[..., 2] <= 0) | (wo[..., 2] <= 0)] = 0
        return value


def sum_of(lobes: Sequence[Lobe], ends: np.ndarray) -> Made:
    """Closures whose weights run linearly in the chord from ends[0] (K, 3) at the normal to ends[1] at the horizon."""

    def value(wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
        v = chord_of(wo)[..., None]
        return sum(
            lobe.value(wi, wo)[..., None] * ((1 - v) * ends[0, k] + v * ends[1, k]) for k, lobe in enumerate(lobes)
        )

    return Made(value)


LOBES = (Lobe("lambert"), Lobe("ggx", 0.12), Lobe("sheen", 0.5))
ENDS = np.array(
    [[[0.3, 0.1, 0.02], [0.2, 0.3, 0.25], [0, 0.01, 0.3]], [[0.1, 0.1, 0.2], [0.5, 0.3, 0.1], [0.02, 0, 0.3]]]
)


@pytest.fixture(scope="module")
def exact() -> tuple[Made, EnvelopeFit]:
    source = sum_of(LOBES, ENDS)
    return source, fit_envelope(source, FEW)


def test_a_sum_of_closures_is_found_again(exact: tuple[Made, EnvelopeFit]) -> None:
    """The closures among twenty-one, all of the energy, and no overshoot, for none pays its price."""
    _, fit = exact
    assert set(fit.closures) == set(LOBES)
    assert fit.measured["share"] > 0.9999 and fit.measured["overshoot"] < 1e-6
    assert (fit.residual_share < 1e-3).all()
    v = np.linspace(0, 1, 24)[:, None, None]
    expected = (1 - v) * ENDS[0] + v * ENDS[1]
    found = np.stack([fit.weights[:, fit.closures.index(lobe)] for lobe in LOBES], 1)
    # At the horizon itself f is taken 0.03 degrees above it, and the weights of the last interval with it.
    assert np.abs(found - expected)[:-1].max() < 2e-3 and np.abs(found - expected).max() < 0.02


def smooth_sources(seed: int) -> list[analytic.Analytic]:
    rng = np.random.default_rng(seed)

    def rgb(high: float) -> tuple[float, ...]:
        return tuple(high * rng.random(3))

    return [
        analytic.Ward(diffuse=rgb(0.5), specular=rgb(0.5), alpha=float(rng.uniform(0.05, 0.5))),
        analytic.ModifiedPhong(diffuse=rgb(0.5), specular=rgb(0.5), exponent=float(10 ** rng.uniform(0.5, 3))),
        analytic.Ggx(alpha=float(rng.uniform(0.05, 0.7)), f0=rgb(1.0), diffuse=rgb(0.3)),
        analytic.MetallicPaint(diffuse=rgb(0.1), flake=rgb(0.5), flake_alpha=float(rng.uniform(0.2, 0.5))),
        analytic.OrenNayar(diffuse=rgb(0.8), sigma=float(rng.uniform(0.1, 0.8))),
    ]


@pytest.mark.parametrize("source", smooth_sources(1), ids=lambda s: s.name)
def test_without_a_budget_the_envelope_lies_under(source: analytic.Analytic) -> None:
    """At 30 000 pairs that the fit has not seen, half of them round the mirror direction."""
    fit = fit_envelope(source, EnvelopeSettings(budget=0.0, viewers=Elevations(24)))
    pairs = direction_pairs(30_000, offset=0.3)
    truth, envelope = source.evaluate(pairs.wi, pairs.wo), fit.evaluate(pairs.wi, pairs.wo)
    assert (envelope >= 0).all() and np.isfinite(envelope).all()
    # Between verified directions E touches f from below along a curve: it may cross by the curve's sag.
    over = np.maximum(envelope - truth, 0)
    low = np.minimum(pairs.wi[:, 2], pairs.wo[:, 2]) < 0.03
    assert over[~low].max() <= 5e-3 * truth[~low].max()
    assert pairs.relative_error(over, truth) < 2e-5
    assert fit.measured["overshoot"] < 1e-5
    # Not by being nothing. The least, 0.27, is a coat of alpha 0.02 whose Fresnel factor no closure shares.
    assert fit.measured["share"] > 0.2


def noise(wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
    """Reproducible uniform noise in [-1, 1], another value at each pair and channel."""
    phase = np.stack([wi @ [127.1, 311.7, 74.7] + wo @ [269.5, 183.3, 246.1] + c for c in range(3)], -1)
    return 2 * ((np.sin(phase) * 43758.5453) % 1.0) - 1


def test_budget() -> None:
    """A noisy grey with negative values: the more overshoot is allowed the more is carried, and not more is used."""
    source = Made(lambda wi, wo: 0.5 / np.pi * (1 + 1.1 * noise(wi, wo)))
    shares = []
    for budget in (0.0, 1e-3, 1e-2):
        fit = fit_envelope(source, EnvelopeSettings(budget=budget, price=0.0, viewers=Elevations(12), basis=BASIS[:8]))
        # White noise falls between any two sets of directions: a twentieth on top at a single viewer.
        assert fit.measured["overshoot"] <= budget
        assert fit.measured["overshoot_largest"] <= 1.05 * budget
        assert fit.facts()["budget"] == budget
        shares.append(fit.measured["share"])
    # Seen: 0, 0.008 and 0.066.
    assert shares[0] < 1e-3 < 0.005 < shares[1] < 0.04 < shares[2]


def test_measured_noise_and_zeros(shared_data: Path) -> None:
    """A genuine satin, neither symmetric nor positive: the budget multiplies what is carried."""
    source = read_source(shared_data / "rgl" / "satin_rosaline_rgb.bsdf")
    viewers = Elevations(20)
    strict, fit = (fit_envelope(source, EnvelopeSettings(budget=budget, viewers=viewers)) for budget in (0.0, 1e-3))
    assert fit.measured["overshoot"] <= 1e-3 and fit.measured["overshoot_largest"] < 2e-3
    assert strict.measured["overshoot"] < 1e-4
    assert fit.measured["share"] > strict.measured["share"] + 0.05 > 0.4


def test_of_a_table() -> None:
    """What is rendered may be fitted instead of what was measured: a trilinear table, with its creases."""
    source = analytic.Ggx(alpha=0.2, f0=(0.9, 0.6, 0.3), diffuse=(0.1, 0.1, 0.2))
    table = tabulate(source, NormalVectorGrid(24, "bezier"))
    fit, pairs = fit_envelope(table, EnvelopeSettings(viewers=Elevations(12))), direction_pairs(10_000, offset=0.7)
    truth = table.evaluate(pairs.wi, pairs.wo)
    assert pairs.relative_error(np.maximum(fit.evaluate(pairs.wi, pairs.wo) - truth, 0), truth) < 1.2e-3
    assert fit.measured["overshoot"] <= 1e-3 and fit.measured["share"] > 0.8


def test_channels_do_not_know_of_each_other(exact: tuple[Made, EnvelopeFit]) -> None:
    """Each channel's weights are those of a grey material made of it alone, and scale with it."""
    source, _ = exact
    views = sample_views(TreatedSource(source), np.linspace(0, 1, 8), 20, 12)
    together = node_weights(views, LOBES[:2], 1e-3, 10.0)
    for c in range(3):
        grey = Made(lambda wi, wo, c=c: np.repeat(source.evaluate(wi, wo)[..., c : c + 1], 3, -1) * [1, 1e-3, 1e3])
        alone = node_weights(sample_views(TreatedSource(grey), views.chords, 20, 12), LOBES[:2], 1e-3, 10.0)
        assert np.allclose(alone, together[..., c : c + 1] * [1, 1e-3, 1e3], rtol=1e-4, atol=1e-9)


def test_dark_channels_and_viewers() -> None:
    """A black channel, and a material black from 60 degrees on."""

    def value(wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
        return np.where(wo[..., 2:] > 0.5, 0.2, 0.0) * np.broadcast_to([1.0, 0.0, 0.5], wi.shape)

    source = Made(value)
    fit = fit_envelope(source, FEW)
    dark = np.linspace(0, 1, 24) > np.sqrt(0.5)
    assert np.isfinite(fit.weights).all()
    assert (fit.weights[dark] == 0).all() and (fit.weights[..., 1] == 0).all()
    assert (fit.weights[:14, 0, 0] > 0.9 * 0.2 * np.pi).all()
    assert (fit.residual_share[dark] == 0).all()
    assert fit.measured["share_rgb"][1] == 0
    dump_json(fit.facts(), "facts")


def test_grazing_directions_stay_finite(exact: tuple[Made, EnvelopeFit]) -> None:
    source, fit = exact
    z = 10 ** np.linspace(-9, -1, 40)
    wi, wo = spherical(np.arccos(z), np.pi)[:, None], spherical(np.arccos(z), 0.0)[None]
    for value in (fit.evaluate(wi, wo), ResidualSource(source, fit).evaluate(wi, wo)):
        assert np.isfinite(value).all() and (value >= 0).all()
    below = spherical(np.pi / 2 + 0.1, 0.0)
    assert (fit.evaluate(below, wo) == 0).all() and (fit.evaluate(wi, below) == 0).all()


def test_evaluation_is_the_sum_at_any_azimuth(exact: tuple[Made, EnvelopeFit]) -> None:
    _, fit = exact
    rng = np.random.default_rng(3)
    wi = spherical(np.arccos(rng.random(200)), 2 * np.pi * rng.random(200))
    node = 9
    wo = spherical(2 * np.arcsin(node / 23 / np.sqrt(2)), 2 * np.pi * rng.random(200))
    expected = sum(lobe.value(wi, wo)[:, None] * fit.weights[node, k] for k, lobe in enumerate(fit.closures))
    assert np.allclose(fit.evaluate(wi, wo), expected, rtol=1e-9)
    between = fit.weights_at(spherical(2 * np.arcsin((node + 0.25) / 23 / np.sqrt(2)), 0.3))
    assert np.allclose(between, 0.75 * fit.weights[node] + 0.25 * fit.weights[node + 1], rtol=1e-6)


def test_fewer_closures_where_they_do() -> None:
    """A diffuse material needs one; `most` holds, and more closures never carry less."""
    assert fit_envelope(analytic.Lambert(), FEW).closures == (Lobe("lambert"),)
    paint, few = analytic.MetallicPaint(), Elevations(12)
    one, three = (fit_envelope(paint, EnvelopeSettings(viewers=few, most=most, enough=1.0)) for most in (1, 3))
    assert (len(one.closures), len(three.closures)) == (1, 3)
    assert one.measured["share"] + 0.05 < three.measured["share"]


def test_widths_are_refined_between_those_of_the_basis() -> None:
    """GGX of alpha 0.145, not in the basis: under it fit 0.71 of alpha 0.12 or 0.75 of 0.17."""
    source = sum_of([Lobe("ggx", 0.145)], np.full((2, 1, 3), 0.5))
    fit = fit_envelope(source, EnvelopeSettings(viewers=Elevations(12), most=1))
    assert fit.closures[0].p1 == pytest.approx(0.145, rel=0.02)
    assert fit.measured["share"] > 0.97
    assert neighbours(Lobe("lambert"), 1.2) == [] and neighbours(Lobe("ggx", 1.0), 1.25) == [Lobe("ggx", 0.8)]


@pytest.mark.parametrize(
    "source, cause",
    [
        (Made(lambda wi, wo: np.zeros(wi.shape)), "reflects nothing"),
        (Made(lambda wi, wo: np.full(wi.shape, np.nan)), "not finite"),
        (Made(lambda wi, wo: np.ones(wi.shape), isotropic=False), "anisotropic"),
    ],
)
def test_unfit_sources_are_refused(source: Made, cause: str) -> None:
    with pytest.raises(BakeError, match=cause):
        fit_envelope(source, FEW)


@pytest.mark.parametrize(
    "settings",
    [
        {"budget": -1e-9},
        {"budget": 0.2},
        {"budget": float("nan")},
        {"price": -1.0},
        {"most": 0},
        {"most": 2.5},
        {"enough": 0.0},
        {"enough": "much"},
        {"basis": ()},
        {"basis": (Lobe("phong"),)},
        {"basis": (Lobe("lambert"), Lobe("lambert"))},
    ],
)
def test_settings_are_checked(settings: dict[str, Any]) -> None:
    with pytest.raises(BakeError):
        EnvelopeSettings(**settings)


@pytest.mark.parametrize("count", [3, True, 2000, 5.0])
def test_numbers_of_nodes_are_checked(count: Any) -> None:
    with pytest.raises(BakeError):
        Elevations(count)


# --- residual -------------------------------------------------------------------------------------------


def test_envelope_and_residual_are_the_material() -> None:
    """E + R = f but for the overshoot, and R's share of the light is what is stored."""
    source = analytic.MetallicPaint()
    fit = fit_envelope(source, FEW)
    chords = np.linspace(0, 1, 24)[[0, 7, 15, 21]]
    wi, wo, areas = light_directions(chords, 60, 40)
    rest = ResidualSource(source, fit).evaluate(wi, wo)
    envelope, truth = fit.evaluate(wi, wo), source.evaluate(wi, wo)
    assert (rest >= 0).all()
    assert np.allclose(envelope + rest, np.maximum(truth, envelope), rtol=1e-6, atol=1e-12)
    light = areas[..., None] * wi[..., 2:]
    share = (light * rest).sum((1, 2)) / (light * (rest + envelope)).sum((1, 2))
    # Two quadratures of a lobe 1 degree wide.
    assert share == pytest.approx(fit.residual_share[[0, 7, 15, 21]], abs=2e-3)
    over = (light * np.maximum(envelope - truth, 0)).sum((1, 2)) / (light * truth).sum((1, 2))
    assert (over <= 1e-3).all()


def test_residual_table_leaves_less_to_interpolation() -> None:
    """A lobe no table of 24 resolves: with E exact, the error of what is left is a fraction of the whole table's."""
    source = analytic.Ggx(alpha=0.03, f0=(0.9, 0.6, 0.3), diffuse=(0.1, 0.1, 0.2))
    fit = fit_envelope(source, FEW)
    grid = NormalVectorGrid(24, "bezier", 0.5, 0.5)
    rest, whole = tabulate(ResidualSource(source, fit), grid), tabulate(source, grid)
    assert (rest.values >= 0).all() and (rest.values <= whole.values + 1e-6).all()
    found = reconstruction_errors(source, fit, rest, whole, direction_pairs(8000))
    assert found["closer"] == "envelope_and_residual" and found["rms_ratio"] < 0.5
    assert found["envelope_and_residual"]["relative"] < found["table"]["relative"]
    # What is stated as a bias is all that is left without a table.
    assert found["overshoot"]["relative"] == pytest.approx(fit.measured["overshoot"], rel=0.5)


# --- texture --------------------------------------------------------------------------------------------


def test_image_keeps_the_envelope(exact: tuple[Made, EnvelopeFit]) -> None:
    _, fit = exact
    image = pack_weights(fit)
    assert image.shape == (len(fit.closures), 24, 4) and image.dtype == np.float32
    weights, share = unpack_weights(image, fit.viewers, len(fit.closures))
    assert (weights == fit.weights).all() and (share == guarded_share(fit)).all()
    back = fit_from_image(fit.closures, fit.viewers, image, fit.measured)
    pairs = direction_pairs(500)
    assert back.closures == fit.closures
    assert (back.evaluate(pairs.wi, pairs.wo) == fit.evaluate(pairs.wi, pairs.wo)).all()
    assert back.facts() == fit.facts()
    dump_json(fit.facts(), "facts")


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((2, 24, 3)),
        np.zeros((24, 4)),
        np.zeros((99, 24, 4)),
        np.zeros((2, 2, 4)),
        np.full((2, 24, 4), -1.0),
        np.full((2, 24, 4), np.inf),
        np.full((2, 24, 4), 2.0),
    ],
)
def test_damaged_images_are_refused(image: np.ndarray) -> None:
    with pytest.raises(BakeError):
        unpack_weights(image, Elevations(24), 2)


def test_facts_and_image_must_agree(exact: tuple[Made, EnvelopeFit]) -> None:
    _, fit = exact
    image = pack_weights(fit)
    for closures, nodes in ((fit.closures, 25), (fit.closures[:1], 24), ((), 24)):
        with pytest.raises(BakeError):
            fit_from_image(closures, Elevations(nodes), image, fit.measured)


def test_texture_coordinate_is_that_of_a_linear_tap() -> None:
    """A tap of 24 texels with extended ends, as an image node has it, interpolates between the nodes."""
    rng = np.random.default_rng(0)
    nodes = rng.random((24, 1))
    wo = spherical(np.linspace(0, np.pi / 2, 500), rng.random(500) * 6)
    position = np.clip(texture_coordinate(xp_numpy, wo, 24) * 24 - 0.5, 0, 23)
    tap = np.interp(position, np.arange(24), nodes[:, 0])
    assert np.allclose(tap, interpolated(nodes, chord_of(wo))[:, 0], atol=1e-12)


def test_mirror_probability() -> None:
    """The share itself, or less down to share / (1 + share), with the ends kept."""
    share = np.linspace(0, 1, 101)
    assert np.allclose(mirror_probability(xp_numpy, share), share)
    assert np.allclose(mirror_probability(xp_numpy, share[:-1], 1 - share[:-1]), share[:-1] / (1 + share[:-1]))
    thrifty = mirror_probability(xp_numpy, share, 0.5)
    assert thrifty[0] == 0 and thrifty[-1] == 1 and (np.diff(thrifty) > 0).all() and (thrifty <= share).all()


def test_no_part_that_carries_light_is_left_out() -> None:
    """Interpolated between nodes too, mirror and closures each keep a chance wherever they reflect anything."""
    closures = (Lobe("lambert"),)
    weights = np.zeros((6, 1, 3), np.float32)
    weights[2] = 0.4
    share = np.array([1, 1, 0.0, 1, 1, 0.0], np.float32)
    guarded = guarded_share(EnvelopeFit(closures, Elevations(6), weights, share, {}))
    assert guarded == pytest.approx([1, 0.98, 0.02, 0.98, 1, 0.02])
    whole = EnvelopeFit(closures, Elevations(6), np.ones((6, 1, 3), np.float32), np.zeros(6, np.float32), {})
    assert (guarded_share(whole) == 0).all()


# --- quadrature -----------------------------------------------------------------------------------------


def test_light_directions_integrate_every_closure() -> None:
    """Solid angle of the hemisphere, Lambert's albedo of 1, and the GGX lobes against a finer set."""
    chords = np.linspace(0, 1, 7)
    wi, wo, areas = light_directions(chords, 28, 16)
    assert (areas * wi[..., 2] / np.pi).sum(-1) == pytest.approx(np.ones(7), abs=2e-3)
    fine_wi, fine_wo, fine_areas = light_directions(chords, 90, 60)
    for lobe in (*BASIS, Lobe("ggx", 0.005)):
        coarse = (areas * lobe.value(wi, wo) * wi[..., 2]).sum(-1)
        fine = (fine_areas * lobe.value(fine_wi, fine_wo) * fine_wi[..., 2]).sum(-1)
        # The view along the surface has its whole highlight within a tenth of a degree of the horizon.
        assert coarse[:-1] == pytest.approx(fine[:-1], rel=0.02)
    v, weights = gauss_chords(20)
    assert weights.sum() == pytest.approx(1) and (weights * (1 - v * v)).sum() == pytest.approx(2 / 3)
