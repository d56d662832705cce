"""The estimator that aimed draws make: its mean and its variance on node cards and in OSL's header, against quadrature.

A matte surface under one lamp: draws by the cosine, exchanged now and then for draws towards the lamp, weighed by the
density that the nodes state. The mean is the lamp's irradiance. The second moment is known as well, for the mixture of
both densities is: a density of half the worth could leave a picture's mean and double its noise.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from measured_materials.bake.directions import spherical
from measured_materials.bake.sampling.lamps import ELLIPSE, SUN, Lamp, lamp_table
from measured_materials.nodes.aimed_light_group import aimed_light_group
from measured_materials.nodes.group import call
from numpy.typing import NDArray
from support.cards import card, data_image
from support.osl import header_card, skip_without_osl
from test_light_sampling import LAMPS

Array = NDArray[np.float64]
COUNT = 200**2
UP = np.array([0.0, 0.0, 1.0])
SKY, LARGEST = 0.05, 0.8
# Of a glossy sampler, as the aim takes it: wide lamps are then aimed at less.
CONCENTRATION = 20.0
# Those that stand whole above a surface that faces up; of the sharp sun a card's float32 sees an uneven edge.
NAMES = ["rectangle", "ellipse", "sphere", "bulb", "sun"]


def seen(lamp: Lamp, wi: Array) -> tuple[Array, Array]:
    """Radiance of a lamp of power 1 in directions (N, 3) from the origin, and the density of even draws over it."""
    if lamp.kind > 1.5:
        if lamp.kind == SUN:
            axis, lean, radiance = np.array(lamp.axis), 2 * math.sin(lamp.extent / 4) ** 2, None
        else:
            distance = float(np.linalg.norm(lamp.centre))
            sine2 = (lamp.extent / distance) ** 2
            axis, lean = np.array(lamp.centre) / distance, sine2 / (1 + math.sqrt(1 - sine2))
            radiance = 1 / (math.pi * lamp.extent**2)
        solid = 2 * math.pi * lean
        met = ((wi - axis) ** 2).sum(-1) < 2 * lean
        return met * (1 / solid if radiance is None else radiance), met / solid
    axis = np.array(lamp.axis)
    facing = -(wi @ axis)
    towards = np.where(facing > 1e-9, facing, 1)
    distance = -(np.array(lamp.centre) @ axis) / towards
    hit = distance[:, None] * wi - np.array(lamp.centre)
    s, t = (hit @ np.array(edge) / (np.array(edge) @ np.array(edge)) for edge in (lamp.u, lamp.v))
    inside = s * s + t * t < 0.25 if lamp.kind == ELLIPSE else np.maximum(np.abs(s), np.abs(t)) < 0.5
    met = inside & (facing > 1e-9)
    return met * lamp.fourth(), met * lamp.fourth() * distance**2 / towards


def expected(lamp: Lamp, share: float) -> tuple[float, float]:
    """Mean and second moment of the estimator, over a fine lattice of directions about the lamp's middle."""
    middle = np.array(lamp.axis if lamp.kind == SUN else lamp.centre)
    middle = middle / np.linalg.norm(middle)
    lean = 1e-5 if lamp is LAMPS["bulb"] else 0.5  # 1 - cos of a cone that holds the lamp
    k = 1500
    m, phi = ((np.arange(k) + 0.5) / k * lean)[:, None], (np.arange(k) + 0.5) / k * 2 * np.pi
    first = np.cross(middle, [0.31, 0.87, 0.38])
    first /= np.linalg.norm(first)
    turn = np.cos(phi)[:, None] * first + np.sin(phi)[:, None] * np.cross(middle, first)
    wi = ((1 - m)[..., None] * middle + np.sqrt(m * (2 - m))[..., None] * turn).reshape(-1, 3)
    solid = 2 * np.pi * lean / k**2
    radiance, density = seen(lamp, wi)
    cosine = np.maximum(wi[:, 2], 0)
    value = radiance * cosine
    mixture = share * density + (1 - share) * cosine / np.pi
    lit = value > 0
    return float(value.sum() * solid), float((value[lit] ** 2 / mixture[lit]).sum() * solid)


def numbers() -> list[NDArray[np.float32]]:
    """Four for the choice and the place, and two for a draw by the cosine."""
    rng = np.random.default_rng(31)
    return [rng.random(COUNT).astype(np.float32) for _ in range(6)]


def assert_estimator(lamp: Lamp, wi: Array, aimed: Array, rest: Array) -> None:
    """Mean within four standard errors, variance within what so many draws leave of it."""
    share = 1 - float(rest.mean())
    assert np.ptp(rest) < 1e-6 and 0.2 < share <= LARGEST + 1e-6
    radiance, _ = seen(lamp, wi)
    value = radiance * np.maximum(wi[:, 2], 0) / (aimed + rest * np.maximum(wi[:, 2], 1e-9) / np.pi)
    mean, second = expected(lamp, share)
    variance = second - mean**2
    print(value.mean() / mean, value.var() / variance)
    # Of rays at the lamp's very edge rounding decides, one in some thousand.
    assert abs(value.mean() - mean) < 4 * math.sqrt(variance / COUNT) + 1e-3 * mean
    assert value.var() == pytest.approx(variance, rel=0.05)


@pytest.mark.parametrize("name", NAMES)
def test_estimator_of_nodes(name: str) -> None:
    lamp = LAMPS[name]
    u_lamp, u_aim, u1, u2, a, b = numbers()
    onto = spherical(np.arcsin(np.sqrt(a.astype(float))), 2 * np.pi * b.astype(float)).astype(np.float32)
    group = aimed_light_group(data_image("lamps", lamp_table([lamp], 4, SKY, LARGEST)), 1)
    zero, normal = np.zeros((COUNT, 3), np.float32), np.broadcast_to(np.float32(UP), (COUNT, 3))
    wi, aimed, rest = card(lambda *k: call(group, *k, CONCENTRATION), zero, normal, onto, u_lamp, u_aim, u1, u2)
    assert_estimator(lamp, wi.astype(float), aimed.astype(float), rest.astype(float))


@pytest.mark.parametrize("name", ["ellipse", "sun"])
def test_estimator_of_osl(name: str) -> None:
    skip_without_osl()
    lamp = LAMPS[name]
    u_lamp, u_aim, u1, u2, a, b = numbers()
    onto = spherical(np.arcsin(np.sqrt(a.astype(float))), 2 * np.pi * b.astype(float)).astype(np.float32)
    row = lamp_table([lamp], 1)[0].astype(float)
    texels = ", ".join(f"vector({', '.join(map(repr, texel[:3].tolist()))})" for texel in row[:4])
    facts = f"vector({row[0, 3]!r}, {row[1, 3]!r}, {row[3, 3]!r})"
    body = f"""MMLamp lamps[MM_MOST_LAMPS] = {{ {{{texels}, {facts}}} }};
      MMWorldCell cell = {{1, 1, color(0), 1}};
      float of_world;
      wi = mm_aim(lamps, 1, vector({SKY}, {LARGEST}, 0), vector(0), cell, {CONCENTRATION}, point(0), vector(0, 0, 1),
                  onto, u_lamp, u_aim, u1, u2, aimed, of_world, rest);"""
    outputs = {"wi": "vector", "aimed": "float", "rest": "float"}
    inputs = {"onto": onto, "u_lamp": u_lamp, "u_aim": u_aim, "u1": u1, "u2": u2}
    wi, aimed, rest = header_card(body, outputs, "measured_lamps.h", **inputs)
    assert_estimator(lamp, wi.astype(float), aimed.astype(float), rest.astype(float))
