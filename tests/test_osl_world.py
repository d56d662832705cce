"""OSL materials under a world of one picture: aimed at it, or sampling it in the shader (method.md, section 10)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Euler
from measured_materials.addon.lights.light_tables import lamp_image, lamp_light_image, survey_scene, update_scene
from measured_materials.addon.lights.seen_world import surroundings_of, world_light_image
from measured_materials.addon.material.bake_material import material_from
from measured_materials.addon.material.build_brdf import build_brdf
from measured_materials.addon.material.choices import Choices
from measured_materials.addon.material.rebuild import rebuild_brdf
from measured_materials.addon.scene_check.check import check_scene, mend
from measured_materials.bake.bundle.bundle import Bundle
from measured_materials.bake.bundle.result import BakeResult
from measured_materials.nodes.material import build_material
from measured_materials.nodes.osl_material import build_osl_material
from measured_materials.nodes.osl_script import use_osl
from support import bundles
from support.clean_blend import clean_blend  # noqa: F401
from support.direct_light import World
from support.monte_carlo import assert_agree, compare
from support.osl import skip_without_osl
from support.scenes import TestScene, lit_sphere
from test_addon import registered  # noqa: F401
from test_unbiased import FINDS, add_lamp, add_world, room, stage

TURN = Euler((0.4, 0.9, -1.3))


@pytest.fixture(autouse=True, scope="module")
def osl() -> None:
    skip_without_osl()


@pytest.fixture(scope="module")
def paint(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    return bundles.baked(bundles.ANALYTIC["metallic paint"], tmp_path_factory.mktemp("paint"))


def built(scene: bpy.types.Scene, bundle: Bundle, kind: str) -> bpy.types.Material:
    """By the name of a case: a mode that aims; lamps that are sampled, the world aimed at; or both sampled."""
    if not kind.startswith(("sampled", "world")):
        return build_osl_material(bundle, mode=kind.split("-")[0], lamps=lamp_image())
    around = surroundings_of(survey_scene(scene, for_render=True)) if kind.startswith("world") else None
    assert (around is not None) == kind.startswith("world")
    return build_osl_material(bundle, mode="exact", lamps=lamp_image(), lights=lamp_light_image(), surroundings=around)


def lit() -> float:
    """How bright the table says that the world's picture is shown; 0 where it may not be sampled."""
    return float(np.array(world_light_image().pixels[:])[3])


def texture_of(scene: bpy.types.Scene) -> bpy.types.Node:
    return next(n for n in scene.world.node_tree.nodes if n.bl_idname == "ShaderNodeTexEnvironment")


def turn(scene: bpy.types.Scene, strength: float) -> None:
    """Turn the world's picture, and change its strength."""
    tree = scene.world.node_tree
    mapping, place = tree.nodes.new("ShaderNodeMapping"), tree.nodes.new("ShaderNodeTexCoord")
    mapping.inputs["Rotation"].default_value = TURN
    tree.links.new(place.outputs["Generated"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs["Vector"], texture_of(scene).inputs["Vector"])
    next(n for n in tree.nodes if n.type == "BACKGROUND").inputs["Strength"].default_value = strength


OTHERS = "reference", "reference-lamp", "sampled-lamp", "world", "world-lamp", "world-turned"
SLOW = [pytest.param(kind, marks=pytest.mark.slow) for kind in OTHERS]


@pytest.mark.parametrize("kind", ["sampled", *SLOW])
def test_a_world_is_aimed_at_without_bias(paint: Bundle, kind: str) -> None:
    """Against quadrature, alone and with a large lamp in front of it; a planted 2 % is found."""
    with stage("room") as seen:
        scene = seen.scene.scene
        use_osl(scene)
        lights: list[Any] = seen.lights
        if kind.endswith("lamp"):
            settings = {"energy": 60, "shape": "ELLIPSE", "size": 1.2, "size_y": 0.8}
            lights.append(add_lamp(seen.scene, "AREA", (2, -1.5, 2), **settings))
        if kind.endswith("turned"):
            turn(scene, 0.7)
            plain, matrix = lights[0].radiance, np.array(TURN.to_matrix())
            lights[0] = World(lambda direction: 0.7 * plain(direction @ matrix.T))
        seen.scene.show(built(scene, paint, kind))
        report = update_scene(scene)
        assert report.world.aimed and lit() == pytest.approx(0.7 if kind.endswith("turned") else 1.0)
        found = seen.judged(seen.truth(bundles.brdf_of(paint, "reference" if "reference" in kind else "exact")))
        print(found)
        assert_agree(found, FINDS)


@pytest.fixture
def in_room(paint: Bundle) -> Iterator[TestScene]:
    """A sphere above ground in the room of `test_unbiased`, both lit by nothing else."""
    with lit_sphere(build_material(paint, mode="exact", lamps=lamp_image()), lamp=False, resolution=32) as scene:
        scene.leave_terminator()
        tree = scene.scene.world.node_tree
        strength = next(n for n in tree.nodes if n.type == "BACKGROUND").inputs["Strength"]
        tree.links.remove(strength.links[0])
        add_world(scene, room())
        yield scene


@pytest.mark.slow
def test_bounce_light_and_noise_of_a_sampled_world(paint: Bundle, in_room: TestScene) -> None:
    """The picture of nodes, which aim a mirror, with less than half of its variance."""
    pictures = in_room.render(96, 8)
    use_osl(in_room.scene)
    in_room.show(built(in_room.scene, paint, "world"))
    update_scene(in_room.scene)
    found = in_room.render(96, range(30, 38))
    mask = in_room.mask()
    assert_agree(compare(pictures, found, mask), 0.01)
    assert not compare(pictures, 1.02 * found, mask).passed
    assert found[:, mask].var(0, ddof=1).mean() < 0.5 * pictures[:, mask].var(0, ddof=1).mean()


def test_a_world_that_is_not_known_is_not_sampled(paint: Bundle, in_room: TestScene) -> None:
    """Materials built before then aim at it: the table is dark, and bright again where the light is known again."""
    scene = in_room.scene
    in_room.show(built(scene, paint, "world"))
    world, texture = scene.world, texture_of(scene)
    background = next(n for n in world.node_tree.nodes if n.type == "BACKGROUND")

    def now() -> float:
        assert update_scene(scene).world.aimed
        return lit()

    assert now() == 1
    background.inputs["Strength"].default_value = 2.5
    assert now() == 2.5
    world.cycles.max_bounces = 4
    assert now() == 0 and "bounces" in survey_scene(scene).world_inexact
    world.cycles.max_bounces = 1024
    world.lightgroup = "sky"
    assert now() == 0 and "light group" in survey_scene(scene).world_inexact
    world.lightgroup = ""
    background.inputs["Strength"].keyframe_insert("default_value", frame=1)
    assert now() == 0 and "animated" in survey_scene(scene).world_inexact
    world.node_tree.animation_data_clear()
    scene.cycles.blur_glossy = 1
    assert now() == 0
    scene.cycles.blur_glossy = 0
    texture.interpolation = "Closest"
    assert now() == 0  # what the material shows is not it
    texture.interpolation = "Linear"
    assert now() == 2.5
    texture.image = texture.image.copy()
    assert now() == 0
    in_room.show(built(scene, paint, "world"))
    assert now() == 0  # while the older material is there
    for material in [m for m in bpy.data.materials if not m.users]:
        bpy.data.materials.remove(material)
    # Their groups are still in the file, and one is used by another.
    assert now() == 2.5


def test_scripts_of_another_world_are_told(registered: None, paint: Bundle, in_room: TestScene) -> None:  # noqa: F811
    """And fitted again sample the world that there is now."""
    scene = in_room.scene
    material = material_from(BakeResult(paint.path, paint.material, 0.0), pack=True)
    in_room.show(material)
    use_osl(scene)
    rebuild_brdf(material, Choices(shader="osl"), scene)
    update_scene(scene)
    assert lit() == 1 and not [finding.rule for finding in check_scene(scene) or ()]
    texture_of(scene).image = texture_of(scene).image.copy()
    update_scene(scene)
    (found,) = check_scene(scene) or ()
    assert lit() == 0 and found.rule == "not_sampled" and "world's picture" in found.found
    mend([found])
    update_scene(scene)
    assert lit() == 1 and not check_scene(scene)


def test_the_account_says_what_is_done(paint: Bundle, in_room: TestScene) -> None:
    """Under a picture it is sampled, and aimed at where its light is not known, beside lamps that are sampled too."""
    scene = in_room.scene

    def account() -> dict[str, tuple[bool, str]]:
        _, plan = build_brdf(paint, choices=Choices(shader="osl"), scene=scene)
        return {effect.name: (effect.kept, effect.why) for effect in plan.effects}

    told = account()
    assert told["Lamps sampled in the shader"][0] and "the world, sampled" in told["Aimed light"][1]
    scene.world.lightgroup = "sky"
    told = account()
    assert not told["Lamps sampled in the shader"][0]
    assert told["Aimed light"][0] and "aims at the world" in told["Aimed light"][1]
    add_lamp(in_room, "POINT", (1.5, -2, 2), energy=150, shadow_soft_size=0.5)
    told = account()
    assert told["Lamps sampled in the shader"][0] and "by the mirror" in told["Aimed light"][1]
