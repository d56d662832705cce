"""Anisotropic envelopes: under the measurement, equal to Cycles' closures, and the same from their texture."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from measured_materials.bake.brdf.closures import anisotropic_lobe_of
from measured_materials.bake.bundle.checked_json import Fields
from measured_materials.bake.directions import spherical
from measured_materials.bake.envelope import (
    EnvelopeFit,
    EnvelopeSettings,
    PreviewFit,
    ResidualSource,
    ViewerGrid,
    fit_envelope,
    fit_from_image,
    fit_preview,
    guarded_share,
    pack_weights,
    preview_error,
    preview_from_image,
)
from measured_materials.bake.envelope.anisotropic_lobes import AnisotropicLobe
from measured_materials.bake.envelope.views import slope_views
from measured_materials.bake.errors import BakeError
from measured_materials.bake.sources import analytic
from measured_materials.bake.tables.accuracy import direction_pairs
from measured_materials.nodes import compat, expr
from measured_materials.nodes.native_closure import native_closure
from measured_materials.nodes.weighted_closures import WeightedClosures
from support.cards import card, data_image
from support.clean_blend import clean_blend  # noqa: F401
from test_native_closures import WEIGHT, Strips, weight

SATIN = analytic.Ward(alpha=0.12, alpha_y=0.35, diffuse=(0.3, 0.1, 0.05), specular=0.4)
WIDTHS = 0.12, 0.35


@pytest.fixture(scope="module")
def fit() -> EnvelopeFit:
    return fit_envelope(SATIN, EnvelopeSettings(viewers=ViewerGrid(10, 4, True, WIDTHS)))


def test_envelope_carries_most_within_its_budget(fit: EnvelopeFit) -> None:
    facts = fit.facts()
    # A Gaussian lobe ends where a GGX goes on: the isotropic envelope of such a Ward carries 0.54.
    assert facts["share"] > 0.45
    assert facts["overshoot"] < 1e-3 and facts["overshoot_largest"] < 2e-3
    # The same by directions of another kind.
    pairs = direction_pairs(30_000, offset=0.3, turned=True)
    truth, envelope = SATIN.evaluate(pairs.wi, pairs.wo), fit.evaluate(pairs.wi, pairs.wo)
    assert pairs.relative_error(np.maximum(envelope - truth, 0), truth) < 1.5e-3
    rest = ResidualSource(SATIN, fit).evaluate(pairs.wi, pairs.wo)
    np.testing.assert_allclose(np.minimum(envelope, truth) + rest, truth, rtol=1e-9)


def test_preview_reflects_the_albedo(fit: EnvelopeFit) -> None:
    chords, phi = fit.viewers.nodes()
    weights = fit_preview(SATIN, fit.viewers, fit.closures).weights.reshape(len(chords), -1, 3)
    views = slope_views(SATIN, chords, phi, WIDTHS, (64, 60))
    albedo = np.stack([lobe.value(views.wi, views.wo) for lobe in fit.closures], -1) * views.wi[..., 2:]
    reflected = np.einsum("vp,vpk,vkc->vc", views.areas, albedo, weights)
    low = chords < 0.9
    # Two quadratures; beyond 70 degrees the horizon cuts both.
    np.testing.assert_allclose(reflected[low], views.energy[low], rtol=0.02)


def test_preview_without_an_envelope_chooses_its_own_closures() -> None:
    """A sum of two closures is found in the basis, all else by the same fit; and it comes back from its image."""
    lobes = AnisotropicLobe("lambert"), AnisotropicLobe("ggx", 0.06, 0.4)

    class Sum:
        isotropic = bilateral = False
        name, facts = "sum", {}

        def evaluate(self, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
            return sum(lobe.value(wi, wo)[..., None] * (0.3, 0.2, 0.1) for lobe in lobes)

    preview = fit_preview(Sum(), ViewerGrid(6, 4, True, (0.06, 0.4)))
    assert preview.closures == lobes and preview.error < 1e-3
    np.testing.assert_allclose(preview.weights[:4], np.broadcast_to((0.3, 0.2, 0.1), (4, 4, 2, 3)), rtol=0.02)
    back = preview_from_image(preview.closures, preview.viewers, pack_weights(preview), preview.error, "here")
    np.testing.assert_array_equal(back.weights, preview.weights)
    assert back.facts() == preview.facts()


def test_preview_error_is_relative() -> None:
    """Of weights that a material was made of it is 0, of half of them a half, and of none 1."""
    grid, lobe = ViewerGrid(4, 4, True, WIDTHS), AnisotropicLobe("ggx", *WIDTHS)
    weights = np.ones((4, 4, 1, 3), np.float32)
    brushed = analytic.Ggx(alpha=WIDTHS[0], alpha_y=WIDTHS[1], f0=1)
    for share, error in ((1, 0), (0.5, 0.5), (0, 1)):
        made = PreviewFit((lobe,), grid, weights * np.float32(share), 0.0)
        assert preview_error(brushed, made) == pytest.approx(error, abs=1e-6)


def test_texture_round_trip(fit: EnvelopeFit) -> None:
    image = pack_weights(fit)
    back = fit_from_image(fit.closures, fit.viewers, image, fit.measured, "here")
    np.testing.assert_array_equal(back.weights, fit.weights)
    np.testing.assert_array_equal(back.residual_share, guarded_share(fit))
    assert back.facts() == fit.facts()
    for spoiled in (image[1:], -image, image * np.nan):
        with pytest.raises(BakeError):
            fit_from_image(fit.closures, fit.viewers, spoiled, fit.measured, "here")


def test_share_never_excludes_what_is_there(fit: EnvelopeFit) -> None:
    share = guarded_share(fit)
    assert share.min() >= 0.02 and share[(fit.weights > 0).any((2, 3))].max() <= 0.98


def test_weights_on_cards(fit: EnvelopeFit) -> None:
    """The texture's taps against numpy, across the azimuth's seam."""
    image = data_image("anisotropic weights", pack_weights(fit))
    closures = WeightedClosures(fit.closures, image, fit.viewers)
    rng = np.random.default_rng(3)
    theta, phi = np.arccos(rng.uniform(0, 1, 3000)), rng.uniform(-np.pi, np.pi, 3000)
    phi[:40], phi[40:80] = np.linspace(-1e-3, 1e-3, 40), np.pi - np.linspace(0, 1e-3, 40)
    wo = spherical(theta, phi).astype(np.float32)
    found = card(lambda w: tuple(colour for colour, _ in closures.weights(w)), wo)
    truth = fit.weights_at(wo.astype(float))
    for k, value in enumerate(found):
        # The texture's place has 2^-24 of 24 rows; an azimuth beside the pole has fewer digits.
        np.testing.assert_allclose(value, truth[:, k], atol=3e-5 * truth.max())


LOBES = [AnisotropicLobe("ggx", x, y) for x, y in ((0.05, 0.3), (0.3, 0.05), (0.2, 0.2), (0.4, 0.9))]


def test_closures_equal_cycles_own() -> None:
    """Under a sun of no size, in all azimuths: widths, which of them lies along the tangent, and the colour."""
    tangent = spherical(np.pi / 2, 0.7)

    def material(lobe: AnisotropicLobe) -> bpy.types.Material:
        made = compat.new_material("closure")
        with expr.building(made.node_tree) as tree:
            normal = expr.Vector(expr.node("ShaderNodeNewGeometry", {}, {}).outputs["Normal"])
            along = expr.Vector(expr.node("ShaderNodeCombineXYZ", {}, dict(enumerate(map(float, tangent)))).outputs[0])
            output = tree.nodes.new("ShaderNodeOutputMaterial")
            expr.feed(tree, output.inputs["Surface"], native_closure(lobe, weight(1.0), normal, along))
        return made

    axes = np.stack([tangent, np.cross([0, 0, 1], tangent), [0, 0, 1]], -1)
    with Strips([material(lobe) for lobe in LOBES]) as strips:
        for theta_o in np.radians([0, 40, 75]):
            for theta_i, phi_i in ((0.1, 1.0), (0.6, 2.6), (0.7, 3.6), (1.2, 0.5), (1.3, 5.0)):
                wo, wi = spherical(theta_o, 0.0), spherical(theta_i, phi_i)
                shown = strips.radiance(wi, wo)
                # x of the strips' frame is -y of the scene.
                own_wi, own_wo = (np.array([w[1], -w[0], w[2]]) for w in (wi, wo))
                for k, lobe in enumerate(LOBES):
                    expected = lobe.value(own_wi @ axes, own_wo @ axes) * wi[2] * WEIGHT
                    # Cycles' 1 - cos^2 theta_h is float32: D is uncertain by 5e-7 / alpha^2 in parts.
                    np.testing.assert_allclose(shown[k], expected, rtol=2e-4 + 2e-6 / lobe.alpha_x / lobe.alpha_y)


def test_facts_are_checked() -> None:
    for lobe in (*LOBES, AnisotropicLobe("lambert")):
        assert anisotropic_lobe_of(Fields(lobe.facts(), "here")) == lobe
    for bad in ({"name": "sheen"}, {"name": "ggx", "alpha_x": 0.1}, {"name": "ggx", "alpha_x": 0, "alpha_y": 1}):
        with pytest.raises(BakeError):
            anisotropic_lobe_of(Fields(bad, "here"))
