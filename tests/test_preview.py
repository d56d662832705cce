"""Mode Preview: native closures fitted to a measurement, by least squares and with its albedo."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from measured_materials.bake.brdf.parts import PreviewRecord
from measured_materials.bake.bundle.checked_json import Fields
from measured_materials.bake.directions import spherical
from measured_materials.bake.envelope import PreviewFit, fit_preview, pack_weights, preview_from_image
from measured_materials.bake.envelope.preview import non_negative
from measured_materials.bake.envelope.views import sample_views
from measured_materials.bake.errors import BakeError
from measured_materials.bake.lobes.lobes import Lobe
from measured_materials.bake.source import Array
from measured_materials.bake.sources import analytic
from measured_materials.bake.tables.treated_source import TreatedSource
from scipy.optimize import nnls

CHORDS = np.sqrt(2) * np.sin(np.radians([3, 20, 41, 58, 77]) / 2)


class Sum:
    """Native closures as a measurement."""

    isotropic = bilateral = True
    name = "sum"
    facts: dict[str, Any] = {}

    def __init__(self, parts: dict[Lobe, tuple[float, float, float]]) -> None:
        self.parts = parts

    def evaluate(self, wi: Array, wo: Array) -> Array:
        return sum(lobe.value(wi, wo)[..., None] * np.array(colour) for lobe, colour in self.parts.items())


def energy_error(source: Any, fit: PreviewFit) -> Array:
    """Largest relative difference of albedo over views that no node of the fit was at, and the shape's."""
    views = sample_views(TreatedSource(source), CHORDS, 61, 37)
    shown = fit.evaluate(views.wi, views.wo) * views.wi[..., 2:]
    return np.einsum("vp,vpc->vc", views.areas, shown) / views.energy - 1


def test_closures_that_are_the_measurement_are_found() -> None:
    parts = {Lobe("lambert"): (0.3, 0.2, 0.1), Lobe("ggx", 0.25): (0.1, 0.3, 0.2)}
    fit = fit_preview(Sum(parts))
    assert fit.closures == tuple(parts) and fit.error < 1e-4
    np.testing.assert_allclose(
        fit.weights[3:-3], np.broadcast_to([*parts.values()], fit.weights[3:-3].shape), rtol=2e-3
    )


@pytest.mark.parametrize(
    "source", [analytic.Lambert(), analytic.MetallicPaint(), analytic.OrenNayar(), analytic.Ward()]
)
def test_the_albedo_is_the_measured_one(source: Any) -> None:
    """At viewers between the nodes too; the narrow coat's quadratures differ by about a percent there."""
    assert np.abs(energy_error(source, fit_preview(source))).max() < 0.015


def test_more_closures_are_never_worse() -> None:
    errors = [fit_preview(analytic.MetallicPaint(), most=most).error for most in (1, 2, 3)]
    assert errors[0] > errors[1] >= errors[2]


def test_weights_are_those_of_scipy() -> None:
    rng = np.random.default_rng(4)
    columns, values = rng.random((40, 9, 3)), rng.standard_normal((40, 9))
    found = non_negative(np.swapaxes(columns, 1, 2) @ columns, np.einsum("npk,np->nk", columns, values))
    wanted = np.array([nnls(a, b)[0] for a, b in zip(columns, values)])
    np.testing.assert_allclose(found, wanted, atol=1e-6)
    assert (wanted == 0).any(-1).mean() > 0.5  # the bound is what is tried here


def test_a_black_channel_stays_black_and_nothing_is_negative() -> None:
    fit = fit_preview(Sum({Lobe("ggx", 0.1): (0.5, 0.0, 0.2)}))
    assert (fit.weights >= 0).all() and not fit.weights[..., 1].any() and np.isfinite(fit.weights).all()


def test_it_comes_back_from_its_image() -> None:
    fit = fit_preview(analytic.MetallicPaint())
    again = preview_from_image(fit.closures, fit.viewers, pack_weights(fit), fit.error)
    wi, wo = spherical(np.array([0.3, 1.2]), np.array([0.1, 2.0])), spherical(np.array([0.9]), np.zeros(1))
    np.testing.assert_array_equal(again.evaluate(wi, wo), fit.evaluate(wi, wo))


@pytest.mark.parametrize(
    "wrong", [{"nodes": 7}, {"closures": []}, {"error": "small"}, {"closures": [{"lobe": "mirror"}]}]
)
def test_foreign_facts_are_refused(wrong: dict[str, Any]) -> None:
    fit = fit_preview(analytic.Lambert())
    with pytest.raises(BakeError):
        found = PreviewRecord.parse(Fields(fit.facts() | wrong, "here"), anisotropic=False)
        preview_from_image(found.closures, found.viewers, pack_weights(fit), fit.error or 0)


def test_black_and_anisotropic_sources_are_refused() -> None:
    with pytest.raises(BakeError, match="reflects nothing"):
        fit_preview(Sum({Lobe("lambert"): (0.0, 0.0, 0.0)}))
    with pytest.raises(BakeError, match="anisotropic"):
        fit_preview(analytic.Ward(alpha=0.1, alpha_y=0.3))
