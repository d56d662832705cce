"""Drawing directions towards lamps, against quadrature and against geometry."""

from __future__ import annotations

import math

import numpy as np
import pytest
from measured_materials.bake import xp_numpy
from measured_materials.bake.directions import normalize, spherical
from measured_materials.bake.sampling.lamps import (
    ELLIPSE,
    RECTANGLE,
    SPHERE,
    SUN,
    Lamp,
    aim_numpy,
    density_towards,
    draw_towards,
    expected_light,
    lamp_table,
)

DOWN = (0.0, 0.0, -1.0)
LAMPS = {
    "rectangle": Lamp(RECTANGLE, 1, (0.4, -0.3, 2.0), (1.0, 0.2, 0.0), (-0.1, 0.5, 0.0), DOWN),
    "ellipse": Lamp(ELLIPSE, 1, (0.4, -0.3, 1.0), (1.4, 0.0, 0.0), (0.0, 0.6, 0.0), DOWN),
    "sphere": Lamp(SPHERE, 1, (0.5, 0.5, 1.5), extent=0.7),
    "bulb": Lamp(SPHERE, 1, (3.0, 0.5, 4.0), extent=0.01),
    "around": Lamp(SPHERE, 1, (0.0, 0.1, 0.2), extent=2.0),
    "sun": Lamp(SUN, 1, axis=tuple(normalize(np.array([0.3, 0.2, 0.9]))), extent=math.radians(30)),
    "sharp sun": Lamp(SUN, 1, axis=tuple(normalize(np.array([-0.3, 0.2, 0.9]))), extent=math.radians(0.53)),
}
ORIGIN = np.zeros(3)


def drawn(lamp: Lamp, count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    aim = aim_numpy(lamp_table([lamp], 1)[0], np.zeros((count, 3)))
    wi = draw_towards(xp_numpy, aim, rng.random(count), rng.random(count))
    return wi, density_towards(xp_numpy, aim, wi, np.zeros(count))


@pytest.mark.parametrize("name", LAMPS)
def test_draws_are_unit_and_meet_the_lamp(name: str) -> None:
    wi, pdf = drawn(LAMPS[name], 20000)
    # A sun's axis is a float32 texel.
    assert np.abs(np.linalg.norm(wi, axis=-1) - 1).max() < 6e-8
    # float32 texels: the edge itself is uncertain by 1e-7 of the lamp's size, for a sharp sun 1e-4 of its disc.
    assert (pdf > 0).mean() > 0.9995


@pytest.mark.parametrize("name", LAMPS)
def test_density_integrates_to_one(name: str) -> None:
    """Over the directions about the lamp, by a fine lattice in a cone that holds it."""
    lamp = LAMPS[name]
    wi, _ = drawn(lamp, 4000)
    axis = normalize(wi.mean(0)) if name != "around" else np.array([0.0, 0.0, 1.0])
    m_max = min(np.max(1 - wi @ axis) * 1.2 + 1e-12, 2.0)
    k = 1200
    m = (np.arange(k) + 0.5) / k * m_max
    phi = (np.arange(k) + 0.5) / k * 2 * np.pi
    first = normalize(np.cross(axis, [0.31, 0.87, 0.38]))
    second = np.cross(axis, first)
    sine = np.sqrt(m * (2 - m))[:, None, None]
    turn = np.cos(phi)[:, None] * first + np.sin(phi)[:, None] * second
    lattice = (1 - m)[:, None, None] * axis + sine * turn
    aim = aim_numpy(lamp_table([lamp], 1)[0], np.zeros((k, k, 3)))
    pdf = density_towards(xp_numpy, aim, lattice, np.zeros((k, k)))
    assert pdf.mean() * 2 * np.pi * m_max == pytest.approx(1, abs=1.5e-4)


@pytest.mark.parametrize("name", LAMPS)
def test_draws_follow_the_density(name: str) -> None:
    """E[g(wi) / pdf] over draws is the integral of g over the lamp's directions: its solid angle, and first moments."""
    lamp = LAMPS[name]
    wi, pdf = drawn(lamp, 200_000, seed=3)
    kept = pdf > 0
    solid_angle = (1 / pdf[kept]).sum() / len(wi)
    if lamp.kind == SUN:
        expected = 2 * np.pi * (1 - math.cos(lamp.extent / 2))
    elif lamp.kind == SPHERE:
        d2 = float(np.dot(lamp.centre, lamp.centre))
        inside = d2 < lamp.extent**2
        expected = 4 * np.pi if inside else 2 * np.pi * (1 - math.sqrt(1 - lamp.extent**2 / d2))
    else:
        s, t = (a.ravel() for a in np.meshgrid(*[(np.arange(800) + 0.5) / 800 - 0.5] * 2))
        if lamp.kind == ELLIPSE:
            keep = s * s + t * t < 0.25
            s, t = s[keep], t[keep]
        point = np.array(lamp.centre) + s[:, None] * np.array(lamp.u) + t[:, None] * np.array(lamp.v)
        d2 = (point**2).sum(-1)
        area = np.linalg.norm(lamp.u) * np.linalg.norm(lamp.v) / 800**2
        expected = (area * np.abs(point[:, 2]) / d2**1.5).sum()
    # Of 200 000 draws the ellipse has a standard error of 6.5e-4, the others less or none.
    assert solid_angle == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize("name", LAMPS)
def test_a_lamp_that_can_be_met_is_never_given_up(name: str) -> None:
    """Wherever some direction towards the lamp lies above the surface, some light is expected."""
    wi, pdf = drawn(LAMPS[name], 3000)
    rng = np.random.default_rng(5)
    normals = spherical(np.arccos(rng.uniform(-1, 1, 400)), rng.uniform(0, 2 * np.pi, 400))
    aim = aim_numpy(lamp_table([LAMPS[name]], 1)[0], np.zeros((400, 3)))
    reach = expected_light(xp_numpy, aim, normals, 1.0) > 0
    met = ((wi[pdf > 0] @ normals.T) > 1e-3).any(0)
    assert reach[met].all()
    if name in ("bulb", "sharp sun"):
        assert not reach[((wi @ normals.T) < -0.1).all(0)].any()


def test_an_area_lamp_seen_from_behind_is_not_aimed_at() -> None:
    lamp = Lamp(RECTANGLE, 1, (0, 0, 1), (1, 0, 0), (0, 1, 0), (0, 0, 1))
    aim = aim_numpy(lamp_table([lamp], 1)[0], np.zeros((1, 3)))
    assert not expected_light(xp_numpy, aim, np.array([[0.0, 0.0, 1.0]]), 1.0).any()
    assert density_towards(xp_numpy, aim, np.array([[0.0, 0.0, 1.0]]), np.zeros(1)) == 0


@pytest.mark.parametrize("name", ["rectangle", "ellipse", "bulb", "sharp sun"])
def test_expected_light_is_about_the_irradiance(name: str) -> None:
    """Of a surface that faces the zenith, by draws; lamps may be chosen by a rough figure, but not by a wrong one."""
    lamp = LAMPS[name]
    wi, pdf = drawn(lamp, 20000)
    kept = pdf > 0
    solid_angle = (1 / pdf[kept]).mean()
    # Radiance of a lamp of power 1: 1 / area facing it, 1 / (pi r^2), or 1 / solid angle.
    radiance = {RECTANGLE: lamp.fourth(), ELLIPSE: lamp.fourth(), SPHERE: 1 / (np.pi * max(lamp.extent, 1e-9) ** 2)}
    irradiance = (wi[kept, 2] / pdf[kept]).mean() * radiance.get(lamp.kind, 1 / solid_angle)
    aim = aim_numpy(lamp_table([lamp], 1)[0], np.zeros((1, 3)))
    found = expected_light(xp_numpy, aim, np.array([[0.0, 0.0, 1.0]]), 1.0)[0]
    assert found == pytest.approx(irradiance, rel=0.25)
