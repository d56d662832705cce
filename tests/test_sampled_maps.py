"""Shading maps whose shader samples lamps and world: against quadrature and the aimed mirror, and by the one switch.

Before Blender 5.1 a script of OSL asks what rays meet, and the nodes around it are those of later versions.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from measured_materials.addon.lights import light_tables
from measured_materials.addon.lights.light_tables import lamp_image, lamp_light_image, survey_scene, update_scene
from measured_materials.addon.lights.seen_world import surroundings_of
from measured_materials.addon.material.build_shading_map import build_map
from measured_materials.addon.material.choices import Choices, show_choices
from measured_materials.addon.material.facts import keep_facts
from measured_materials.addon.material.kinds import SHADING_MAP
from measured_materials.addon.material.lighting import show_lighting
from measured_materials.addon.material.rebuild import effects_of
from measured_materials.addon.material.textures.packed import pack_textures
from measured_materials.addon.scene_check.check import check_scene
from measured_materials.addon.scene_check.findings import SLOW, WRONG
from measured_materials.bake.bundle.bundle import Bundle
from measured_materials.bake.lobes.lobes import Lobe
from measured_materials.bake.shading_maps.record import ShadingMapRecord
from measured_materials.bake.shading_maps.render_settings import RenderSettings
from measured_materials.bake.shading_maps.shading_map import ShadingMap
from measured_materials.nodes.aimed_light_group import INSTEAD_KEY, SLOTS_KEY, aim_by
from measured_materials.nodes.group import HASH_KEY, trees_below
from measured_materials.nodes.lamp_light_groups import SAMPLED_KEY
from measured_materials.nodes.osl_script import is_one_script, is_scripted, use_osl
from measured_materials.nodes.shading_map_material import build_shading_map
from support.clean_blend import clean_blend  # noqa: F401
from support.monte_carlo import assert_agree, compare
from support.osl import skip_without_osl
from support.scenes import TestScene, add_lamp, lit_sphere
from support.swatches import map_bundle, rough_map
from test_addon import registered  # noqa: F401
from test_sampled_lamps import add_card, veil
from test_unbiased import FINDS, darken, stage

SLICES = 6
POWERS = np.array([0.6, 1.3, 2.2])  # of the level, by channel: under the line from black, above, and far above it


@pytest.fixture(autouse=True, scope="module")
def osl() -> None:
    skip_without_osl()


@pytest.fixture(autouse=True)
def other_scene() -> Iterator[None]:
    """The one that Blender starts with, which handlers look at, would not let its own lamp be sampled."""
    cycles = bpy.context.scene.cycles
    before, cycles.blur_glossy = cycles.blur_glossy, 0.0
    yield
    cycles.blur_glossy = before


def lit_by(lobe: Lobe, above: str = "clamp", mode: str = "exact") -> RenderSettings:
    """Brighter than the brightest photograph about the peak of f_r."""
    settings = RenderSettings(lobe, sigma=0.8, above=above, mode=mode)
    return replace(settings, a_max=0.8 * 0.6 * float(lobe.peak(np.array([0.0, 0.0, 1.0]))))


def even_map() -> ShadingMap:
    """Every texel alike, and no line."""
    levels = np.linspace(0, 1, SLICES)[:, None, None, None]
    return ShadingMap(np.broadcast_to(levels**POWERS, (SLICES, 2, 2, 3)).astype(np.float32))


def response(settings: RenderSettings) -> Any:
    """What the even map reflects, as a BRDF: S(r) over the cosine, S in straight pieces."""
    levels = np.linspace(0, 1, SLICES)

    def brdf(wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
        cosine = np.maximum(wi[..., 2], 1e-9)
        x = settings.lobe.value(wi, wo) * cosine * (settings.sigma / settings.a_max)
        beyond = np.maximum(x, 1) if settings.above == "scale" else 1.0
        reflected = [np.interp(np.minimum(x, 1), levels, levels**power) * beyond for power in POWERS]
        return np.stack(reflected, -1) * (settings.a_max / cosine)[..., None]

    return brdf


def sampling(bundle: Bundle, **options: Any) -> bpy.types.Material:
    options = {"lights": lamp_light_image(), "scripted": True} | options
    return build_shading_map(bundle, lamps=lamp_image(), pack=True, **options)


def show(scene: TestScene, material: bpy.types.Material) -> None:
    use_osl(scene.scene)
    scene.show(material)
    update_scene(scene.scene)


@pytest.fixture
def rough(tmp_path: Path) -> Bundle:
    return map_bundle(tmp_path / "rough", rough_map(), lit_by(Lobe("ggx", 0.4), "scale"))


@pytest.mark.parametrize(
    "lobe, above, name",
    [
        (Lobe("ggx", 0.3), "scale", "small lamp"),
        pytest.param(Lobe("lambert"), "clamp", "three lamps", marks=pytest.mark.slow),
        pytest.param(Lobe("phong", 12.0, 0.4), "clamp", "hard point", marks=pytest.mark.slow),
        pytest.param(Lobe("ggx", 0.3), "clamp", "room", marks=pytest.mark.slow),
        pytest.param(Lobe("oren_nayar", 0.5), "scale", "disk", marks=pytest.mark.slow),
    ],
    ids=lambda value: getattr(value, "name", value),
)
def test_sampled_swatches_are_what_quadrature_says(tmp_path: Path, lobe: Lobe, above: str, name: str) -> None:
    """A planted error of 2 % is found."""
    settings = lit_by(lobe, above)
    bundle = map_bundle(tmp_path / "even", even_map(), settings)
    with stage(name) as seen:
        around = surroundings_of(survey_scene(seen.scene.scene, for_render=True))
        assert (around is not None) == (name == "room")
        show(seen.scene, sampling(bundle, surroundings=around))
        groups = [tree for tree in bpy.data.node_groups if SAMPLED_KEY in tree]
        assert groups and all(tree[SLOTS_KEY] == len(seen.lighting.lamps) for tree in groups)
        found = seen.judged(seen.truth(response(settings)))
        print(found)
        assert_agree(found, FINDS)


@pytest.mark.slow
def test_a_rough_swatch_shows_the_same_as_by_the_mirror(rough: Bundle) -> None:
    """With sky, light from the ground and a card before the lamp, which casts a shadow; a planted 2 % is found."""
    with lit_sphere(build_shading_map(rough, lamps=lamp_image()), lamp_size=1.0, resolution=32) as scene:
        scene.leave_terminator()
        add_card(scene, 0.5, veil(0.0))
        update_scene(scene.scene)
        pictures = scene.render(256, 8)
        material = sampling(rough)
        show(scene, material)
        found = scene.render(96, range(30, 38))
        assert_agree(compare(pictures, found, scene.mask()), FINDS)
        node = next(n for n in material.node_tree.nodes if n.bl_idname == "ShaderNodeGroup")
        node.inputs["Tint"].default_value = (*(1.02,) * 3, 1)
        planted = compare(pictures, scene.render(96, range(200, 208)), scene.mask())
        assert not planted.passed, f"a planted error of 2 % was not found: {planted}"


def test_noise_under_a_lamp_is_a_fraction(rough: Bundle) -> None:
    """Of the variance less than a quarter is left; without sky and bounce light, which neither samples better."""
    with lit_sphere(build_shading_map(rough, lamps=lamp_image()), lamp_size=0.5, resolution=32) as scene:
        scene.leave_terminator()
        scene.scene.cycles.max_bounces = 0
        darken(scene)
        update_scene(scene.scene)
        aimed = scene.render(16, 4)[:, scene.mask()].var(0, ddof=1).mean()
        show(scene, sampling(rough))
        sampled = scene.render(16, 4)[:, scene.mask()].var(0, ddof=1).mean()
        print(f"variance {sampled / aimed:.3f} of the aimed mirror's")
        assert sampled < 0.25 * aimed


def test_without_the_language_a_mirror_brings_all(rough: Bundle) -> None:
    """Cycles leaves the script out: then nothing is sampled, bit for bit."""
    with lit_sphere(sampling(rough), lamp_size=0.5, resolution=16) as scene:
        update_scene(scene.scene)
        assert not scene.scene.cycles.shading_system
        groups = [tree for tree in bpy.data.node_groups if SAMPLED_KEY in tree]
        assert groups and all(tree[SLOTS_KEY] == 1 for tree in groups)
        without = scene.render(4, 2)
        for group in groups:
            aim_by(group, 0, False)
        assert np.allclose(scene.render(4, 2), without, rtol=1e-6)


def test_without_the_language_the_check_tells_of_noise_alone(rough: Bundle) -> None:
    """What is missing then is no light; a BRDF beside it that is a script would be missing whole."""
    with lit_sphere(sampling(rough), 24, lamp_size=0.5, resolution=16) as scene:
        for spoil in ("osl_off", "osl_gpu"):
            scene.scene.cycles.shading_system = spoil == "osl_gpu"
            scene.scene.cycles.device = "GPU" if spoil == "osl_gpu" else "CPU"
            found = {finding.rule: finding for finding in check_scene(scene.scene) or ()}
            assert found[spoil].severity == SLOW and "noisier" in found[spoil].why
            whole = bpy.data.node_groups.new("whole", "ShaderNodeTree")
            whole.nodes.new("ShaderNodeScript")
            whole[HASH_KEY] = ""
            material = scene.sphere.data.materials[0]
            node = material.node_tree.nodes.new("ShaderNodeGroup")
            node.node_tree = whole
            found = {finding.rule: finding for finding in check_scene(scene.scene) or ()}
            assert found[spoil].severity == WRONG and "noisier" not in found[spoil].why
            material.node_tree.nodes.remove(node)
        scene.scene.cycles.device, scene.scene.cycles.shading_system = "CPU", False


def worn(scene: TestScene, bundle: Bundle, **choices: str) -> bpy.types.Material:
    """A material as the extension builds it for a scene."""
    material, record = build_shading_map(bundle), ShadingMapRecord.of(bundle)
    scene.show(material)
    show_lighting(material, record.render)
    show_choices(material.measured_quality, Choices(**choices))
    account = build_map(bundle, material, record.render, pack=False, scene=scene.scene)
    means = {**bundle.material["map"], "means": rough_map().slices.mean((1, 2)).tolist()}
    keep_facts(material, {**bundle.material, "map": means, "rendering": account})
    return material


def test_one_switch_for_swatches_too(registered: None, rough: Bundle) -> None:  # noqa: F811
    """It samples, is no lamp itself, finds its textures packed, and goes back to nodes."""
    with lit_sphere(None, 24, resolution=16) as scene:
        scene.leave_terminator()
        material = worn(scene, rough)
        kept = {effect.name: effect.kept for effect in effects_of(material)}
        name = "Lamps sampled in the shader"
        assert kept["Aimed light"] and not kept[name] and not is_scripted(material)
        with bpy.context.temp_override(scene=scene.scene):
            assert bpy.ops.measured_materials.use_osl() == {"FINISHED"}
        kept = {effect.name: effect.kept for effect in effects_of(material)}
        assert kept[name] and kept["Open Shading Language"] and "Aimed light" not in kept
        (worth,) = (effect.why for effect in effects_of(material) if effect.name == name)
        assert worth == "about a fifth of the noise under a small lamp, for about twice the time of a sample"
        assert is_scripted(material) and not is_one_script(material)
        assert material.cycles.emission_sampling == "NONE" and material.measured_quality.shader == "osl"
        update_scene(scene.scene)
        assert {finding.rule for finding in check_scene(scene.scene) or ()} <= {"lamp_table"}
        assert {"sample", "shader"} <= set(SHADING_MAP.effective(material))
        lamp = next(obj for obj in scene.scene.objects if obj.type == "LIGHT")
        lamp.data.use_shadow = False
        found = {finding.rule: finding for finding in check_scene(scene.scene) or ()}
        assert "no longer sampled" in found["not_sampled"].found
        found["not_sampled"].mend()
        assert not is_scripted(material) and material.cycles.emission_sampling == "AUTO"
        lamp.data.use_shadow = True
        with bpy.context.temp_override(scene=scene.scene):
            assert bpy.ops.measured_materials.use_osl(nodes=True) == {"FINISHED"}
        assert not is_scripted(material) and not scene.scene.cycles.shading_system


def test_textures_are_packed_for_the_language(registered: None, rough: Bundle) -> None:  # noqa: F811
    """Of nodes they may stay files."""
    with lit_sphere(None, 24, resolution=16) as scene:
        scene.leave_terminator()
        for shader in ("nodes", "osl"):
            trees = trees_below(worn(scene, rough, shader=shader).node_tree)
            images = {n.image for tree in trees for n in tree.nodes if getattr(n, "image", None)}
            files = [image for image in images if image.source == "FILE" and image.packed_file is None]
            assert len(files) == (2 if shader == "nodes" else 0)


def test_pictures_of_the_artist_stay_files(registered: None, rough: Bundle, tmp_path: Path) -> None:  # noqa: F811
    """The world's, which the swatch samples, and one among its own nodes."""
    with stage("room") as seen:
        around = next(n for n in seen.scene.scene.world.node_tree.nodes if n.bl_idname == "ShaderNodeTexEnvironment")
        around.image.filepath_raw, around.image.file_format = str(tmp_path / "room.exr"), "OPEN_EXR"
        around.image.save()
        around.image = bpy.data.images.load(str(tmp_path / "room.exr"))
        material = worn(seen.scene, rough, shader="osl")
        beside = material.node_tree.nodes.new("ShaderNodeTexImage")
        beside.image = bpy.data.images.load(str(tmp_path / "room.exr"))
        pack_textures(material)
        nodes = [n for tree in trees_below(material.node_tree) for n in tree.nodes if getattr(n, "image", None)]
        assert {around.image, beside.image} < {node.image for node in nodes}
        files = {node.image for node in nodes if node.image.source == "FILE" and node.image.packed_file is None}
        assert files == {around.image, beside.image}


def test_what_cannot_be_sampled_any_more_is_aimed_at(rough: Bundle) -> None:
    """Its own groups alone: other materials of nodes cannot sample before Blender 5.1."""
    with lit_sphere(sampling(rough), lamp_size=0.5, resolution=16) as scene:
        lamp = next(obj for obj in scene.scene.objects if obj.type == "LIGHT")
        for shadow, sampled, aimed in ((True, 1, 0), (False, 0, 1)):
            lamp.data.use_shadow = shadow
            update_scene(scene.scene)
            trees = trees_below(scene.sphere.data.materials[0].node_tree)
            assert {tree[SLOTS_KEY] for tree in trees if SAMPLED_KEY in tree} == {sampled}
            assert {tree[SLOTS_KEY] for tree in trees if INSTEAD_KEY in tree} == {aimed}


@pytest.mark.parametrize("most", [2, 4])
def test_a_lamp_that_the_viewport_hides_is_sampled_in_a_render(
    monkeypatch: pytest.MonkeyPatch, rough: Bundle, most: int
) -> None:
    """As many as the view that needs most, also where another needs fewer; and never more than materials aim at."""
    monkeypatch.setattr(light_tables, "MOST_LAMPS", most)
    monkeypatch.setattr(light_tables, "is_blended", lambda _: True)
    with lit_sphere(sampling(rough), lamp_size=0.5, resolution=16) as scene:
        for place in ((-2, 1, 3), (1, 2, 3)):
            add_lamp(scene, "POINT", place, energy=50, shadow_soft_size=0.2).hide_viewport = True
        layer = scene.scene.view_layers[0]
        layer.update()
        shown = light_tables.update_lamps(layer.depsgraph)
        rendered = update_scene(scene.scene, for_render=True)
        assert (shown.slots, rendered.slots, shown.inexact, rendered.inexact) == (1, 3, "", "")
        trees = trees_below(scene.sphere.data.materials[0].node_tree)
        assert {tree[SLOTS_KEY] for tree in trees if SAMPLED_KEY in tree} == {min(3, most)}
        assert {tree[SLOTS_KEY] for tree in trees if INSTEAD_KEY in tree} == {0}


@pytest.mark.parametrize("technique, mode", [("lookup", "reference"), ("lit_texture", "exact"), ("lookup", "preview")])
def test_what_is_all_mirror_or_closures_stays_so(tmp_path: Path, technique: str, mode: str) -> None:
    settings = replace(lit_by(Lobe("ggx", 0.4)), technique=technique, mode=mode)
    material = sampling(map_bundle(tmp_path / "map", even_map(), settings))
    assert not is_scripted(material) and material.cycles.emission_sampling == "AUTO"
