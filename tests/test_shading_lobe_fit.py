"""Parameters of lobes, as given and as read from files, and the lobe that averages along an arc ask for."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from measured_materials.bake.brdf.closures import lobe_of
from measured_materials.bake.bundle.checked_json import Fields
from measured_materials.bake.directions import spherical
from measured_materials.bake.errors import BakeError
from measured_materials.bake.lobes.lobe_fit import FITTED, fit_lobe
from measured_materials.bake.lobes.lobes import LOBES, PARAMETERS, Lobe
from support.lobe_cases import NARROW, WIDE, identity


@pytest.mark.parametrize("lobe", WIDE + NARROW, ids=identity)
def test_facts_round_trip(lobe: Lobe) -> None:
    """Through JSON text."""
    assert lobe_of(Fields(json.loads(json.dumps(lobe.facts())), "swatch.json")) == lobe
    names = {key: value for key, value in lobe.facts().items() if key != "name"}
    assert Lobe.of(lobe.name, **names) == lobe


def test_defaults_are_in_bounds() -> None:
    """Every lobe can be made by its name alone."""
    for name in LOBES:
        lobe = Lobe(name)
        values = (lobe.p1, lobe.p2)
        assert all(p.low <= values[k] <= p.high for k, p in enumerate(PARAMETERS[name]))
        assert values[len(PARAMETERS[name]) :] == (0.0,) * (2 - len(PARAMETERS[name]))


@pytest.mark.parametrize(
    "arguments",
    [
        ("velvet",),
        (None,),
        (["ggx"],),
        ("ggx", 0.0),
        ("ggx", 1.5),
        ("ggx", float("nan")),
        ("ggx", "0.5"),
        ("ggx", True),
        ("ggx", 0.5, 0.5),
        ("lambert", 0.5),
        ("phong", 30, -0.1),
        ("phong", 1e5),
        ("sheen", float("inf")),
    ],
)
def test_bad_lobes(arguments: tuple[Any, ...]) -> None:
    """One clear error each."""
    with pytest.raises(BakeError):
        Lobe(*arguments)


def test_unknown_parameter_by_name() -> None:
    """The error names the right ones."""
    with pytest.raises(BakeError, match="choose from alpha"):
        Lobe.of("ggx", roughness=0.5)
    with pytest.raises(BakeError, match="has no parameter alpha"):
        Lobe.of("lambert", alpha=0.5)


@pytest.mark.parametrize(
    "facts",
    [
        {},
        {"name": 3},
        {"name": "velvet"},
        {"name": "ggx"},
        {"name": "ggx", "alpha": "wide"},
        {"name": "ggx", "alpha": 0},
        {"name": "ggx", "alpha": 10**400},
        {"name": "ggx", "alpha": 0.5, "beta": 1},
        {"name": "phong", "exponent": 10},
        {"name": "lambert", 5: 1},
        {"name": [], "alpha": 1},
    ],
)
def test_bad_facts(facts: dict[Any, Any]) -> None:
    """Files are not trusted; the error names them."""
    with pytest.raises(BakeError, match=r"swatch\.json"):
        lobe_of(Fields(facts, "swatch.json"))


ELEVATIONS = np.radians([12, 20, 28, 36, 44, 52, 60, 68, 76, 84, 90])


def averages_of(lobe: Lobe, scale: float = 1.0) -> np.ndarray:
    """Averages of a flat swatch of this lobe."""
    wi = spherical(np.pi / 2 - ELEVATIONS, 0.0)
    return scale * lobe.value(wi, spherical(0.0, 0.0)) * wi[:, 2]


@pytest.mark.parametrize(
    "lobe",
    [
        Lobe("lambert"),
        Lobe("ggx", 0.1),
        Lobe("ggx", 0.63),
        Lobe("sheen", 0.4),
        Lobe("sheen", 0.9),
        Lobe("phong", 25.0, 0.4),
        Lobe("phong", 3.0, 0.0),
    ],
    ids=identity,
)
def test_fit_returns_the_lobe(lobe: Lobe) -> None:
    """From noise-free averages, in any unit and order."""
    order = np.random.default_rng(0).permutation(len(ELEVATIONS))
    fit = fit_lobe(ELEVATIONS[order], averages_of(lobe, 137.0)[order])
    assert fit.candidates[lobe.name].residual < 2e-3
    assert fit.candidates[lobe.name].scale == pytest.approx(137, rel=0.01)
    found = fit.candidates[lobe.name].lobe
    assert found.p1 == pytest.approx(lobe.p1, rel=0.02)
    assert found.p2 == pytest.approx(lobe.p2, abs=0.01)
    matte = fit.lobe.name in ("lambert", "oren_nayar")
    assert fit.residual <= min(c.residual for c in fit.candidates.values()) + (0.05 if matte else 0.01)
    assert len(PARAMETERS[fit.lobe.name]) <= len(PARAMETERS[lobe.name])
    assert set(fit.candidates) == set(FITTED)
    json.dumps(fit.facts())
    assert lobe_of(Fields(fit.facts()["lobe"], "swatch.json")) == fit.lobe


def test_fit_survives_noise_and_prefers_the_simple() -> None:
    """With 0.5 % of noise a Lambertian stays one, and gloss stays gloss."""
    rng = np.random.default_rng(1)
    noise = 1 + 0.005 * rng.standard_normal(len(ELEVATIONS))
    assert fit_lobe(ELEVATIONS, averages_of(Lobe("lambert")) * noise).lobe == Lobe("lambert")
    gloss = fit_lobe(ELEVATIONS, averages_of(Lobe("ggx", 0.3)) * noise)
    assert gloss.lobe.name == "ggx" and gloss.lobe.p1 == pytest.approx(0.3, rel=0.05)


def test_few_photographs_ask_for_few_parameters() -> None:
    """One photograph cannot distinguish lobes, three cannot fit Phong's two parameters and a scale."""
    assert set(fit_lobe([1.0], [2.0]).candidates) == {"lambert"}
    assert set(fit_lobe(ELEVATIONS[:3], [1, 2, 3]).candidates) == {"lambert", "oren_nayar", "ggx", "sheen"}
    assert set(fit_lobe([1.0, 1.0, 1.0, 1.0], [1, 1, 1, 1]).candidates) == {"lambert"}


@pytest.mark.parametrize(
    "elevations, averages",
    [
        ([], []),
        ([1.0], [1.0, 2.0]),
        ([[1.0]], [[1.0]]),
        ([0.0, 1.0], [1, 1]),
        ([-0.1, 1.0], [1, 1]),
        ([1.0, 3.5], [1, 1]),
        ([1.0, float("nan")], [1, 1]),
        ([1.0, 1.2], [1, float("nan")]),
        ([1.0, 1.2], [1, -1]),
        ([1.0, 1.2], [0, 0]),
        ([1.0, 1.2], [1, float("inf")]),
        ([1.0, 1.2], [1, 1e200]),
        (["high"], [1]),
        ([[1.0], [1.0, 2.0]], [1, 1]),
    ],
)
def test_fit_refuses(elevations: Any, averages: Any) -> None:
    """One clear error each."""
    with pytest.raises(BakeError, match="lobe fit"):
        fit_lobe(elevations, averages)
