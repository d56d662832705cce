"""Aimed sampling in Cycles towards the world: against Diffuse BSDF, by numpy, and the table that is kept of a world."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from measured_materials.addon.lights import light_tables, world_survey
from measured_materials.addon.lights.light_tables import lamp_image, pack_tables, survey, update_scene
from measured_materials.bake import xp_numpy
from measured_materials.bake.directions import normalize, spherical
from measured_materials.bake.sampling.lamps import (
    aim_numpy,
    density_towards,
    draw_towards,
    expected_light,
    lamp_table,
)
from measured_materials.bake.sampling.world import cell_directions, cell_light, expected_world_light, world_texels
from measured_materials.bake.shading_maps.render_settings import RenderSettings
from measured_materials.nodes import compat
from measured_materials.nodes.aimed_light_group import aimed_light_group
from measured_materials.nodes.group import call
from measured_materials.nodes.light_images import new_table
from measured_materials.nodes.shading_map_material import build_shading_map
from support.cards import card, data_image
from support.clean_blend import clean_blend  # noqa: F401
from support.monte_carlo import assert_agree, assert_same, compare
from support.node_count import count_nodes
from support.scenes import TestScene, add_lamp, diffuse_material, lit_sphere
from support.swatches import identity_map, map_bundle
from test_light_sampling import LAMPS
from test_world_sampling import density_at, draw, gradient, spot

ABOVE = (0.5, -0.6, 0.6)


def show_world(scene: TestScene, radiance: np.ndarray, strength: float = 1.0, **mapping: Any) -> bpy.types.World:
    """Light a scene by an equirectangular picture; `mapping` are rotation, scale and vector_type of a Mapping node."""
    world, background = compat.new_world("surroundings")
    tree = world.node_tree
    texture = tree.nodes.new("ShaderNodeTexEnvironment")
    texture.image = data_image("surroundings", radiance.astype(np.float32))
    background.inputs["Strength"].default_value = strength
    tree.links.new(texture.outputs["Color"], background.inputs["Color"])
    if mapping:
        turned, place = tree.nodes.new("ShaderNodeMapping"), tree.nodes.new("ShaderNodeTexCoord")
        turned.vector_type = mapping.get("vector_type", "POINT")
        turned.inputs["Rotation"].default_value = mapping.get("rotation", (0, 0, 0))
        turned.inputs["Scale"].default_value = mapping.get("scale", (1, 1, 1))
        tree.links.new(place.outputs["Generated"], turned.inputs["Vector"])
        tree.links.new(turned.outputs["Vector"], texture.inputs["Vector"])
    world.cycles.sampling_method, world.cycles.sample_map_resolution = "MANUAL", 256
    scene.scene.world = world
    return world


def mirror_only(tmp_path: Path) -> bpy.types.Material:
    """White of albedo 0.5 by stochastic mirror alone: nothing but aimed samples can find what is small."""
    render = RenderSettings(sigma=0.5, mode="reference")
    return build_shading_map(map_bundle(tmp_path / "grey", identity_map(colour=(1, 1, 1)), render), lamps=lamp_image())


def aim_group() -> bpy.types.ShaderNodeTree:
    """The one group that aims."""
    (group,) = (tree for tree in bpy.data.node_groups if tree.name.startswith("MM Aim"))
    return group


def noise(scene: TestScene) -> float:
    """Of a pixel of 32 samples, over the mean; from 4 seeds."""
    pictures = scene.render(32, 4)[:, scene.mask()]
    return float(np.sqrt(pictures.var(0, ddof=1).mean()) / pictures.mean())


@pytest.mark.parametrize("lighting", ["world", "world and lamp"])
def test_aimed_mirror_is_diffuse_under_a_world(tmp_path: Path, lighting: str) -> None:
    """A spot of 3 degrees that gives as much as all the rest; with a planted 2 % that fails, and the noise it saves."""
    with lit_sphere(diffuse_material(0.5), 64, lamp=False, ground=False) as scene:
        scene.leave_terminator()
        turn = {"rotation": (0.3, -0.2, 1.0), "scale": (1, -1, 1)} if lighting == "world" else {}
        world = show_world(scene, spot(128, (0.1, 0.9, 0.6) if turn else ABOVE, 3, 3.0), 0.8, **turn)
        if lighting == "world and lamp":
            add_lamp(scene, "POINT", (-1.5, -2, 2), energy=100, shadow_soft_size=0.1)
        reference = scene.render(32, 5)
        material = mirror_only(tmp_path)
        scene.show(material)
        report = update_scene(scene.scene)
        assert report.world.aimed and len(report.lamps) == (lighting != "world")
        assert_same(reference, scene.render(32, range(100, 106)), scene.mask(), 0.0, 0.01)
        aimed = noise(scene)
        world.cycles_visibility.glossy = True
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(world_survey, "world_light", lambda _: world_survey.WorldLight(3.0, why_not="not asked to"))
            assert noise(scene) > 3 * aimed


def test_a_stale_table_costs_noise_and_no_light(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The world turns after the table was made: a third of the samples goes where nothing is any more."""
    with lit_sphere(diffuse_material(0.5), 64, lamp=False, ground=False) as scene:
        scene.leave_terminator()
        world = show_world(scene, spot(64, ABOVE, 20, 3.0), rotation=(0, 0, 0))
        scene.show(mirror_only(tmp_path))
        assert update_scene(scene.scene).world.aimed
        monkeypatch.setattr(light_tables, "keep_current", lambda _: None)
        mapping = next(n for n in world.node_tree.nodes if n.bl_idname == "ShaderNodeMapping")
        mapping.inputs["Rotation"].default_value = (0, 0, 1.5)
        pictures = scene.render(64, range(100, 108))
        scene.show(diffuse_material(0.5))
        assert_agree(compare(scene.render(32, 5), pictures, scene.mask()), 0.01)


@pytest.mark.parametrize("names", [[], ["sun"], ["ellipse", "sphere", "sharp sun", "around"]])
def test_aiming_as_in_numpy(names: list[str]) -> None:
    rng = np.random.default_rng(0)
    chosen = [replace(LAMPS[name], power=k + 1.0) for k, name in enumerate(names)]
    toward, flux, count = (0.4, -0.3, 0.9), 5.0, 3000
    table = lamp_table(chosen, 4, 0.6, 0.8, (toward, flux))
    texels = world_texels(rng.random((16, 32)) ** 6 * (rng.random((16, 32)) > 0.4))
    position = rng.uniform(-0.3, 0.3, (count, 3)).astype(np.float32)
    normal, wi = (
        spherical(np.arccos(rng.uniform(-1, 1, count)), rng.uniform(0, 2 * np.pi, count)).astype(np.float32)
        for _ in range(2)
    )
    numbers = [rng.random(count).astype(np.float32) for _ in range(4)]
    for k, values in enumerate(numbers):
        values[2 * k : 2 * k + 2] = 0, 1
    group = aimed_light_group(data_image("lamps", table), len(chosen), data_image("world", texels[::-1]))
    found, aimed_density, rest = card(lambda *a: call(group, *a, 0.0), position, normal, wi, *numbers)

    p, up, w, u_lamp, u_aim, u1, u2 = (values.astype(float) for values in (position, normal, wi, *numbers))
    aims = [aim_numpy(row, p) for row in table[: len(chosen)]]
    light = [expected_light(xp_numpy, aim, up, lamp.power) for aim, lamp in zip(aims, chosen)]
    light = np.stack([*light, expected_world_light(xp_numpy, np.array(toward) / 2, flux / 4, up)])
    total = light.sum(0)
    share = np.minimum(total / (total + 0.6), 0.8)
    index = np.minimum((u_lamp * total > np.cumsum(light, 0)).sum(0), len(chosen))
    aimed = u_aim < share
    column, row = (np.minimum((u * n).astype(int), n - 1) for u, n in ((u1, 32), (u2, 16)))
    accepted = (u_aim < share * texels[row, column, 3])[:, None]
    cell = np.where(accepted, np.stack([column, row], -1), texels[row, column, :2])
    place = cell + 2.5e-4 + (1 - 5e-4) * np.stack([u1 * 32 - column, u2 * 16 - row], -1)
    to_world = spherical(np.arccos(np.clip(place[:, 1] / 8 - 1, -1, 1)), 2 * np.pi * place[:, 0] / 32 - np.pi)
    towards = np.stack([*(draw_towards(xp_numpy, aim, u1, u2) for aim in aims), to_world])[index, np.arange(count)]
    truth = np.where(aimed[:, None], towards, w)
    # Where a condition holds only just, float32 may decide it the other way.
    same = np.abs(found - truth).max(-1) < 2e-5
    assert same.mean() > 0.998
    assert np.abs(rest - (1 - share))[same].max() < 1e-5
    density = density_at(texels, truth) * light[-1]
    for k, (aim, part) in enumerate(zip(aims, light)):
        density += part * density_towards(xp_numpy, aim, truth, (aimed & (index == k)).astype(float))
    density *= share / total
    wrong = np.abs(aimed_density - density) > 2e-4 * np.maximum(density, 1e-3)
    assert wrong[same].mean() < 0.002


MAPPINGS: dict[str, dict[str, Any]] = {
    "plain": {},
    "point": {"rotation": (0.4, 0.9, -1.3)},
    "texture": {"rotation": (0.4, 0.9, -1.3), "vector_type": "TEXTURE", "scale": (2, 2, 2)},
    "mirrored": {"rotation": (0.4, 0.9, -1.3), "scale": (-1, 1, 1), "vector_type": "NORMAL"},
}


@pytest.mark.parametrize("name", MAPPINGS)
def test_a_world_read_is_the_world_rendered(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Cycles' own convention for directions, pictures and their rotation is the one that tables are made by."""
    monkeypatch.setattr(world_survey, "_WIDTH", 512)
    radiance = spot(64, ABOVE, 8, 2.0) * (1.0, 0.5, 0.25) + spot(64, (-0.5, 0.3, -0.2), 5, 0.5)
    with lit_sphere(diffuse_material(0.5), 16, lamp=False) as scene:
        world = show_world(scene, radiance, **MAPPINGS[name])
        picture = world_survey._picture(world_survey._surface(world))
        assert picture is not None
        read = cell_light(picture.read(), np.array(picture.to_world), columns=64, rows=32).mean
        rendered = cell_light(world_survey._rendered(world), columns=64, rows=32).mean
    # Either puts whole pixels into cells, and the spots' flanks are steep.
    assert np.abs(read - rendered).max() < 0.1 * rendered.max()
    assert np.abs(read - rendered).mean() < 0.01 * rendered.mean()


def test_worlds_that_nothing_stands_out_of_are_not_aimed_at(tmp_path: Path) -> None:
    """Neither an even sky nor a smooth one costs a node; sky is all that is left to the material's own sampler."""
    with lit_sphere(diffuse_material(0.5), 16, lamp=False) as scene:
        scene.show(mirror_only(tmp_path))
        nodes = count_nodes(aim_group())
        for radiance, reason in ((np.full((16, 32, 3), 0.5), "even"), (gradient(32), "nearly even")):
            show_world(scene, radiance, 2.0)
            report = update_scene(scene.scene)
            assert not report.world.aimed and reason in report.world.why_not
            assert report.sky == pytest.approx(math.pi, rel=0.3)
            assert "Nothing to aim at" in report.words()[0]
        plain = scene.scene.world.node_tree
        plain.links.remove(plain.nodes["Background"].inputs["Color"].links[0])
        plain.nodes["Background"].inputs["Color"].default_value = (0.3, 0.3, 0.3, 1)
        report = update_scene(scene.scene)
        assert report.world.why_not == "the world is even" and report.sky == pytest.approx(0.6 * math.pi, rel=1e-3)
        assert count_nodes(aim_group()) == nodes
        show_world(scene, spot(64, ABOVE, 4, 3.0))
        words = update_scene(scene.scene).words()[0]
        assert "Aims at the world" in words and "%" in words
        assert nodes + 40 < count_nodes(aim_group()) < nodes + 60
        scene.scene.world.cycles_visibility.glossy = False
        assert "hidden from glossy" in update_scene(scene.scene).world.why_not
        assert count_nodes(aim_group()) == nodes
        scene.scene.world = None
        assert survey(scene.scene.view_layers[0].depsgraph).sky == 0


def test_a_world_of_nodes_is_measured_on_request(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a camera sees of it does not matter; an edit makes the measurement void, the strength of light too."""
    monkeypatch.setattr(world_survey, "_WIDTH", 512)
    with lit_sphere(diffuse_material(0.5), 16, lamp=False) as scene:
        world = show_world(scene, spot(64, ABOVE, 4, 3.0))
        tree = world.node_tree
        hidden, choice = tree.nodes.new("ShaderNodeBackground"), tree.nodes.new("ShaderNodeMixShader")
        output = tree.get_output_node("CYCLES")
        tree.links.new(tree.nodes.new("ShaderNodeLightPath").outputs["Is Camera Ray"], choice.inputs[0])
        tree.links.new(tree.nodes["Background"].outputs[0], choice.inputs[1])
        tree.links.new(hidden.outputs[0], choice.inputs[2])
        tree.links.new(choice.outputs[0], output.inputs["Surface"])
        scene.show(mirror_only(tmp_path))
        assert "measure the world" in update_scene(scene.scene).world.why_not
        worlds, scenes, cameras = len(bpy.data.worlds), len(bpy.data.scenes), len(bpy.data.cameras)
        world_survey.measure_world(scene.scene)
        assert (worlds, scenes, cameras) == (len(bpy.data.worlds), len(bpy.data.scenes), len(bpy.data.cameras))
        report = update_scene(scene.scene)
        assert report.world.aimed and report.world.structure is not None
        assert normalize(np.array(report.world.structure.toward)) == pytest.approx(normalize(np.array(ABOVE)), abs=0.01)
        # A file that is opened again knows it still, from its image alone.
        world_survey._known.clear()
        world_survey.distrust_tables()
        assert survey(scene.scene.view_layers[0].depsgraph).world.aimed
        # And so does a table that came along with a linked or appended material, and that holds nothing yet.
        other = new_table(f"{world_survey.IMAGE} of a library", *bpy.data.images[world_survey.IMAGE].size)
        update_scene(scene.scene)
        assert np.array_equal(np.array(other.pixels), np.array(bpy.data.images[world_survey.IMAGE].pixels))
        bpy.data.images.remove(other)
        bpy.data.images[world_survey.IMAGE].pixels[7] = 0.5
        world_survey.distrust_tables()
        assert "measure the world" in survey(scene.scene.view_layers[0].depsgraph).world.why_not
        world_survey.measure_world(scene.scene)
        tree.nodes["Background"].inputs["Strength"].default_value = 2
        assert "measure the world" in update_scene(scene.scene).world.why_not


def test_the_tables_are_saved_with_the_file(tmp_path: Path) -> None:
    with lit_sphere(diffuse_material(0.5), 16, lamp=False) as scene:
        show_world(scene, spot(64, ABOVE, 4, 3.0))
        lamp = add_lamp(scene, "POINT", (0, 0, 3), energy=10, shadow_soft_size=0.1)
        scene.show(mirror_only(tmp_path))
        update_scene(scene.scene)
        pack_tables()
        lamp.location = (1, 2, 3)
        show_world(scene, spot(64, (0, 0, 1), 4, 3.0))
        update_scene(scene.scene)
        names = (light_tables.TABLE, world_survey.IMAGE)
        assert bpy.data.images[light_tables.TABLE].is_dirty  # for lamps move often, packing waits for saving
        kept = [np.array(bpy.data.images[name].pixels) for name in names]
        file = str(tmp_path / "saved.blend")
        window = bpy.context.window
        shown, window.scene = window.scene, scene.scene  # for tables follow the scene that is shown
        light_tables.register()
        try:
            bpy.ops.wm.save_as_mainfile(filepath=file, copy=True)
        finally:
            light_tables.unregister()
            window.scene = shown
        assert not any(bpy.data.images[name].is_dirty for name in names)
    with bpy.data.libraries.load(file, link=True) as (_, wanted):
        wanted.images = list(names)
    for image, pixels in zip(wanted.images, kept):
        assert np.array_equal(np.array(image.pixels), pixels) and pixels.any()
    # The file's own tables stay its own.
    assert lamp_image().library is None


def test_the_world_table_points_at_the_spot(tmp_path: Path) -> None:
    with lit_sphere(diffuse_material(0.5), 16, lamp=False) as scene:
        show_world(scene, spot(64, ABOVE, 4, 3.0))
        scene.show(mirror_only(tmp_path))
        update_scene(scene.scene)
        image = bpy.data.images[world_survey.IMAGE]
        texels = np.array(image.pixels, np.float32).reshape(image.size[1], image.size[0], 4)
    wi, density = draw(texels, 2000)
    assert np.median(wi @ normalize(np.array(ABOVE))) > math.cos(math.radians(10))
    assert (density > 1).mean() > 0.9
    heaviest = np.unravel_index(texels[..., 2].argmax(), texels.shape[:2])
    assert cell_directions(*image.size)[heaviest] @ normalize(np.array(ABOVE)) > 0.9995
