"""Nodes that sample lamps and world in the shader: their formulas in Cycles against numpy, and a ball without shadows.

A Raycast node is there from Blender 5.1 on; `tests/real_blender` asks it. Here nothing stands in the way, which is so
around a lone ball, and all else is as it is there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import bpy
import numpy as np
import pytest
from measured_materials.addon.lights import aim_targets, light_tables
from measured_materials.addon.lights.aim_targets import sampling_of
from measured_materials.addon.lights.light_tables import lamp_image, lamp_light_image, survey_scene, update_scene
from measured_materials.addon.lights.seen_world import surroundings_of
from measured_materials.addon.material.build_brdf import build_brdf
from measured_materials.addon.material.choices import Choices
from measured_materials.bake import xp_numpy
from measured_materials.bake.bundle.bundle import Bundle
from measured_materials.bake.directions import spherical
from measured_materials.bake.sampling.lamp_light import ENDLESS, LampLight, distance_along, lamp_light_table
from measured_materials.bake.sampling.lamps import aim_numpy, density_towards, draw_towards, expected_light, lamp_table
from measured_materials.bake.sampling.world import COLUMNS, ROWS, expected_world_light, world_texels
from measured_materials.nodes import lamp_light_groups
from measured_materials.nodes.aimed_light_group import INSTEAD_KEY, SLOTS_KEY, WORLD_KEY
from measured_materials.nodes.group import call
from measured_materials.nodes.lamp_light_groups import SAMPLED_KEY, LightTables, chosen_group
from measured_materials.nodes.light_images import world_table
from measured_materials.nodes.material import build_material
from measured_materials.nodes.world_picture import Surroundings, radiance_group
from support import bundles
from support.cards import card, data_image
from support.clean_blend import clean_blend  # noqa: F401
from support.direct_light import World, environment
from support.monte_carlo import assert_agree
from test_light_sampling import LAMPS
from test_osl_world import TURN, lit, texture_of, turn
from test_unbiased import FINDS, add_lamp, room, stage
from test_world_sampling import density_at

STRENGTH = 1.7


@pytest.fixture(scope="module")
def paint(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    return bundles.baked(bundles.ANALYTIC["metallic paint"], tmp_path_factory.mktemp("paint"))


@pytest.fixture
def no_shadows(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """As if there were a Raycast node, and nothing for it to meet."""
    monkeypatch.setattr(lamp_light_groups, "light_ray", lambda *_: (1.0, ENDLESS))
    for module in (aim_targets, light_tables):
        monkeypatch.setattr(module, "can_raycast", lambda: True)
    yield


def around(pixels: np.ndarray, rows: np.ndarray, strength: float = STRENGTH) -> Surroundings:
    table = np.zeros((1, 3, 4), np.float32)
    table[0, :, :3], table[0, 0, 3] = rows, strength
    return Surroundings(data_image("around", pixels.astype(np.float32)), "Linear", data_image("lit", table))


def directions(rng: np.random.Generator, count: int) -> np.ndarray:
    found = spherical(np.arccos(rng.uniform(-1, 1, count)), rng.uniform(0, 2 * np.pi, count))
    return np.asarray(found, np.float32)


def test_the_picture_is_what_cycles_shows() -> None:
    """Turned, scaled, and without what is below 0."""
    rng = np.random.default_rng(2)
    pixels, rows, wi = rng.uniform(-0.3, 1.0, (16, 32, 3)), np.array(TURN.to_matrix()), directions(rng, 2000)
    group = radiance_group(around(pixels, rows))
    (found,) = card(lambda w: call(group, w), wi)
    truth = np.maximum(STRENGTH * environment(pixels)(wi.astype(float) @ rows.T), 0)
    # Cycles joins texels in steps of 1 / 256 nowhere, but its poles are wider by a texel.
    assert (np.abs(found - truth).max(-1) < 2e-3).mean() > 0.99


@pytest.mark.parametrize("strength", [STRENGTH, 0.0])
@pytest.mark.parametrize("names", [[], ["sun"], ["ellipse", "sphere", "sharp sun", "around"]])
def test_lamps_and_world_share_the_draws(names: list[str], strength: float) -> None:
    """One of all is drawn by its light, of an unknown world never, and its density is that of having drawn it."""
    if not names and not strength:
        pytest.skip("there is nothing to draw")
    rng = np.random.default_rng(0)
    chosen = [replace(LAMPS[name], power=k + 1.0) for k, name in enumerate(names)]
    lights = [LampLight((k + 1.0, 0.5, 0.25)) for k in range(len(names))]
    toward, flux, count = (0.4, -0.3, 0.9), 5.0, 3000
    table, rows = lamp_table(chosen, 4, 0.6, 0.8, (toward, flux)), np.array(TURN.to_matrix())
    texels = world_texels(rng.random((ROWS, COLUMNS)) ** 6 * (rng.random((ROWS, COLUMNS)) > 0.4))
    world_table().pixels.foreach_set(texels.ravel())
    world_table().update()
    position = rng.uniform(-0.3, 0.3, (count, 3)).astype(np.float32)
    normal = directions(rng, count)
    numbers = [rng.random(count).astype(np.float32) for _ in range(3)]
    pixels = rng.random((16, 32, 3))
    tables = LightTables(
        data_image("lamps", table), data_image("lights", lamp_light_table(lights, 4)), around(pixels, rows, strength)
    )
    group = chosen_group(tables, len(names), True)
    wi, density, radiance, length = card(lambda *a: call(group, *a), position, normal, *numbers)

    p, up, u_light, u1, u2 = (values.astype(float) for values in (position, normal, *numbers))
    aims = [aim_numpy(row, p) for row in table[: len(chosen)]]
    light = [expected_light(xp_numpy, aim, up, lamp.power) for aim, lamp in zip(aims, chosen)]
    of_world = expected_world_light(xp_numpy, np.array(toward) / 2, flux / 4, up) * (strength > 0)
    light = np.stack([*light, of_world])
    number, passed = u_light * light.sum(0), np.cumsum(light, 0)
    index = np.minimum((number > passed).sum(0), len(names))
    column, row = np.minimum((u1 * COLUMNS).astype(int), COLUMNS - 1), np.minimum((u2 * ROWS).astype(int), ROWS - 1)
    keep = number - (passed[-1] - light[-1]) < light[-1] * texels[row, column, 3]
    cell = np.where(keep[:, None], np.stack([column, row], -1), texels[row, column, :2])
    place = cell + 2.5e-4 + (1 - 5e-4) * np.stack([u1 * COLUMNS - column, u2 * ROWS - row], -1)
    cosine, azimuth = place[:, 1] / (ROWS / 2) - 1, 2 * np.pi * place[:, 0] / COLUMNS - np.pi
    to_world = spherical(np.arccos(np.clip(cosine, -1, 1)), azimuth)
    every = np.arange(count)
    truth = np.stack([*(draw_towards(xp_numpy, aim, u1, u2) for aim in aims), to_world])[index, every]
    lit_up = light.sum(0) > 0
    share = light[index, every] / np.where(lit_up, light.sum(0), 1)
    same = (np.abs(wi - truth).max(-1) < 2e-5) & lit_up
    # Where a condition holds only just, float32 may decide it the other way.
    assert same[lit_up].mean() > 0.99
    assert strength or (index < len(names))[same].all()
    facing = np.zeros(count)
    told = [
        (density_towards(xp_numpy, aim, truth, np.ones(count)), distance_along(xp_numpy, aim, facing, truth))
        for aim in aims
    ]
    told.append((density_at(texels, truth), np.full(count, ENDLESS)))
    expected = np.stack([own for own, _ in told])[index, every] * share
    assert (np.abs(density - expected) < 2e-3 * np.maximum(expected, 1e-3))[same].mean() > 0.995
    far = np.stack([near for _, near in told])[index, every]
    assert np.minimum(length, 1e9)[same] == pytest.approx(np.minimum(far, 1e9)[same], rel=1e-3)
    of_picture = strength * environment(pixels)(truth @ rows.T)
    shown = np.stack([*(np.tile(own.radiance, (count, 1)) for own in lights), of_picture])[index, every]
    assert (np.abs(radiance - shown).max(-1) < 4e-3)[same & (expected > 0)].mean() > 0.99


def built(scene: bpy.types.Scene, bundle: Bundle) -> bpy.types.Material:
    """A material of nodes that samples lamps and the scene's world."""
    found = surroundings_of(survey_scene(scene, for_render=True))
    assert found is not None
    return build_material(bundle, mode="exact", lamps=lamp_image(), lights=lamp_light_image(), surroundings=found)


def switches(kind: str) -> set[tuple[int, bool]]:
    """Lamps and world of all groups of a kind."""
    groups = (group for group in bpy.data.node_groups if kind in group and group.users)
    return {(group[SLOTS_KEY], bool(group[WORLD_KEY])) for group in groups}


@pytest.mark.parametrize("kind", ["lamp", "turned"])
def test_a_sampled_world_is_unbiased(no_shadows: None, paint: Bundle, kind: str) -> None:
    """Against quadrature; a planted 2 % is found."""
    with stage("room") as seen:
        scene = seen.scene.scene
        lights: list[Any] = seen.lights
        if kind == "lamp":
            settings = {"energy": 60, "shape": "ELLIPSE", "size": 1.2, "size_y": 0.8}
            lights.append(add_lamp(seen.scene, "AREA", (2, -1.5, 2), **settings))
        else:
            turn(scene, 0.7)
            plain, matrix = lights[0].radiance, np.array(TURN.to_matrix())
            lights[0] = World(lambda direction: 0.7 * plain(direction @ matrix.T))
        seen.scene.show(built(scene, paint))
        assert update_scene(scene).world.aimed and lit() == pytest.approx(0.7 if kind == "turned" else 1.0)
        assert switches(SAMPLED_KEY) == {(int(kind == "lamp"), True)} and switches(INSTEAD_KEY) == {(0, False)}
        found = seen.judged(seen.truth(bundles.brdf_of(paint, "exact")))
        print(found)
        assert_agree(found, FINDS)


@pytest.mark.slow
def test_what_is_no_longer_known_is_aimed_at_instead(no_shadows: None, paint: Bundle) -> None:
    """Another picture in the world, and a lamp with textured light: no group is exchanged, and no light is lost."""
    with stage("room") as seen:
        scene = seen.scene.scene
        seen.scene.show(built(scene, paint))
        update_scene(scene)
        assert switches(SAMPLED_KEY) == {(0, True)} and switches(INSTEAD_KEY) == {(0, False)}
        texture_of(scene).image = data_image("another", np.ascontiguousarray(room()[:, ::-1]))
        seen.lights[0] = World(environment(room()[:, ::-1]))
        seen.lights.append(add_lamp(seen.scene, "AREA", (2, -1.5, 2), energy=60, shape="ELLIPSE", size=1.2, size_y=0.8))
        lamp = next(obj for obj in scene.objects if obj.type == "LIGHT")
        lamp.lightgroup = "alone"
        assert update_scene(scene).inexact and lit() == 0
        assert switches(SAMPLED_KEY) == {(0, False)} and switches(INSTEAD_KEY) == {(1, True)}
        found = seen.judged(seen.truth(bundles.brdf_of(paint, "exact")))
        assert_agree(found, FINDS)


def test_the_account_tells_what_is_sampled(no_shadows: None, paint: Bundle) -> None:
    """Of the world what that saves, of lamps what that does."""
    with stage("room") as seen:
        scene = seen.scene.scene

        def account() -> tuple[str, str, str]:
            _, plan = build_brdf(paint, choices=Choices(), scene=scene)
            effects = {effect.name: effect.why for effect in plan.effects if effect.kept}
            return effects.get("Lamps sampled in the shader", ""), effects.get("Aimed light", ""), plan.mode

        sampled, aimed, _ = account()
        assert (
            "half of the noise under the world" in sampled and "lamp" not in sampled and "the world, sampled" in aimed
        )
        add_lamp(seen.scene, "POINT", (1.5, -2, 2), energy=150, shadow_soft_size=0.5)
        sampled, aimed, _ = account()
        assert "third of the noise under a lamp" in sampled and "under the world" in sampled
        scene.world.lightgroup = "sky"
        sampled, aimed, _ = account()
        assert not sampled and "the world" in aimed
        told = sampling_of(survey_scene(scene)).needless
        assert told == "the world's light goes to light group sky, and aiming at it is worth more"
