"""Materials whose shader samples lamps, in OSL: the same picture with less noise, whatever stands between."""

from __future__ import annotations

from collections.abc import Iterator

import bpy
import numpy as np
import pytest
from mathutils import Matrix, Vector
from measured_materials.addon.lights.light_tables import lamp_image, lamp_light_image, update_scene
from measured_materials.addon.material.bake_material import material_from
from measured_materials.addon.scene_check.check import check_scene
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.bundle.result import BakeResult
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sources import analytic
from measured_materials.nodes import compat
from measured_materials.nodes.aimed_light_group import SLOTS_KEY
from measured_materials.nodes.group import trees_below
from measured_materials.nodes.lamp_light_groups import SAMPLED_KEY
from measured_materials.nodes.light_ray import can_raycast
from measured_materials.nodes.material import build_material
from measured_materials.nodes.osl_material import build_osl_material
from measured_materials.nodes.osl_script import use_osl
from support.clean_blend import clean_blend  # noqa: F401
from support.monte_carlo import assert_agree, compare
from support.osl import skip_without_osl
from support.scenes import TestScene, lit_sphere
from test_addon import registered  # noqa: F401

EFFECT = 0.01


@pytest.fixture(autouse=True, scope="module")
def osl() -> None:
    skip_without_osl()


@pytest.fixture(scope="module")
def paint(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    """Colour, gloss of two widths, and a residual that is a third of the light."""
    source = analytic.MetallicPaint((0.05, 0.1, 0.3), (0.1, 0.2, 0.4), flake_alpha=0.3, coat_alpha=0.2)
    settings = BakeSettings(resolution=24, alpha=(0.5, 0.4), sampler=SamplerLayout(n_o=32, n_h=32, n_phi=16))
    return read_bundle(bake_source(source, tmp_path_factory.mktemp("paint") / "paint", settings).path)


def sampling(bundle: Bundle, mode: str = "exact", points: int = 1) -> bpy.types.Material:
    return build_osl_material(bundle, mode=mode, lamps=lamp_image(), lights=lamp_light_image(), points=points)


def mirroring(bundle: Bundle, mode: str = "exact") -> bpy.types.Material:
    return build_osl_material(bundle, mode=mode, lamps=lamp_image())


def show(scene: TestScene, material: bpy.types.Material) -> None:
    use_osl(scene.scene)
    scene.show(material)
    update_scene(scene.scene)


def add_card(scene: TestScene, size: float, material: bpy.types.Material) -> None:
    """A square half way to the lamp, facing it."""
    mesh = bpy.data.meshes.new("card")
    corners = [(x * size / 2, y * size / 2, 0) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
    mesh.materials.append(material)
    card = bpy.data.objects.new("card", mesh)
    half_way = Vector((2, -1.5, 3)) * 0.6
    card.matrix_world = Matrix.Translation(half_way) @ half_way.to_track_quat("Z", "Y").to_matrix().to_4x4()
    card.visible_camera = False
    scene.scene.collection.objects.link(card)


def veil(colour: float) -> bpy.types.Material:
    """Lets this part of the light through; a ray that asks takes it for opaque."""
    material = compat.new_material("veil")
    tree = material.node_tree
    clear, output = tree.nodes.new("ShaderNodeBsdfTransparent"), tree.nodes.new("ShaderNodeOutputMaterial")
    clear.inputs["Color"].default_value = (colour, colour, colour, 1)
    tree.links.new(clear.outputs[0], output.inputs["Surface"])
    return material


@pytest.fixture
def small_lamp(paint: Bundle) -> Iterator[TestScene]:
    with lit_sphere(mirroring(paint), lamp_size=0.5, resolution=32) as scene:
        scene.leave_terminator()
        yield scene


@pytest.mark.parametrize("size, points", [pytest.param(0.5, 1, marks=pytest.mark.slow), (3.0, 2)])
def test_sampled_lamps_give_the_same_picture(paint: Bundle, size: float, points: int) -> None:
    """Beside a mirror that is aimed, with sky, bounce light and a card in the way; a planted error of 2 % is found."""
    with lit_sphere(mirroring(paint), lamp_size=size, resolution=32) as scene:
        scene.leave_terminator()
        add_card(scene, 0.5, veil(0.0))
        show(scene, mirroring(paint))
        pictures = scene.render(144, 8)  # the noise is nearly all theirs
        material = sampling(paint, points=points)
        show(scene, material)
        found = scene.render(48, range(30, 38))
        assert_agree(compare(pictures, found, scene.mask()), EFFECT)
        node = next(n for n in material.node_tree.nodes if n.bl_idname == "ShaderNodeGroup")
        node.inputs["Tint"].default_value = (*(1.02,) * 3, 1)
        planted = compare(pictures, scene.render(48, range(200, 208)), scene.mask())
        assert not planted.passed, f"a planted error of 2 % was not found: {planted}"


@pytest.mark.slow
def test_transparent_things_are_left_to_the_mirror(paint: Bundle) -> None:
    """Half of the lamp's light passes, by the mirror alone; taken for lost, it would be missed."""
    with lit_sphere(mirroring(paint), lamp_size=2.0, resolution=32) as scene:
        scene.leave_terminator()
        add_card(scene, 1.2, veil(0.5))
        show(scene, mirroring(paint))
        pictures = scene.render(128, 8)
        show(scene, sampling(paint))
        assert_agree(compare(pictures, scene.render(192, range(30, 38)), scene.mask()), 0.015)


def test_noise_under_a_lamp_is_a_fraction(paint: Bundle, small_lamp: TestScene) -> None:
    """Of the variance less than half is left (0.37 was seen); without bounce light, which neither samples better."""
    scene = small_lamp
    scene.scene.cycles.max_bounces = 0
    variances = []
    for material in (mirroring(paint), sampling(paint)):
        show(scene, material)
        variances.append(float(scene.render(16, 4)[:, scene.mask()].var(0, ddof=1).mean()))
    assert variances[1] < 0.5 * variances[0]


def test_the_material_is_no_lamp_itself(paint: Bundle) -> None:
    """Cycles would sample it, with or without lamps; what it was told before comes back with a material of nodes."""
    material = bpy.data.materials.new("paint")
    material.cycles.emission_sampling = "FRONT"
    for lights in (lamp_light_image(), None, None):
        build_osl_material(paint, material, lamps=lamp_image(), lights=lights)
        assert material.cycles.emission_sampling == "NONE"
    material.cycles.emission_sampling = "AUTO"
    build_osl_material(paint, material)
    assert material.cycles.emission_sampling == "NONE"
    build_material(paint, material)
    assert material.cycles.emission_sampling == "FRONT"


@pytest.mark.parametrize("strength", [0.02, pytest.param(1.0, marks=pytest.mark.slow)])
def test_light_that_has_bounced_before_is_the_same(paint: Bundle, strength: float) -> None:
    """On ground beside the sphere, lit by what that reflects of a lamp: far brighter than the sky behind it, or not."""
    with lit_sphere(mirroring(paint), lamp_size=0.6, resolution=24) as scene:
        scene.leave_terminator()
        background = next(n for n in scene.scene.world.node_tree.nodes if n.bl_idname == "ShaderNodeBackground")
        ramp = next(n for n in scene.scene.world.node_tree.nodes if n.bl_idname == "ShaderNodeMapRange")
        ramp.inputs["To Max"].default_value = strength
        assert background.inputs["Strength"].is_linked
        outside = ~np.pad(scene.mask()[1:-1, 1:-1], 1) & (np.arange(24) > 12)[:, None]
        scene.sphere.visible_camera = False
        pictures = []
        for material in (mirroring(paint), sampling(paint)):
            show(scene, material)
            pictures.append(scene.render(64, range(8 * len(pictures), 8 * len(pictures) + 8)))
        assert_agree(compare(*pictures, outside), 0.02)


def test_a_file_of_a_newer_blender_is_told(registered: None, paint: Bundle) -> None:  # noqa: F811
    """Its groups sample lamps, which nothing here can: they are switched to none, and it is to be fitted again."""
    material = material_from(BakeResult(paint.path, paint.material, 0.0), pack=True)
    with lit_sphere(material, resolution=8) as scene:
        scene.leave_terminator()
        rules = {finding.rule for finding in check_scene(scene.scene) or ()}
        assert not rules & {"not_sampled", "emission_sampling"}
        aims = [tree for tree in trees_below(material.node_tree) if SLOTS_KEY in tree]
        assert aims and all(tree[SLOTS_KEY] == 1 for tree in aims)
        for tree in aims:
            tree[SAMPLED_KEY] = True
        found = {finding.rule: finding for finding in check_scene(scene.scene) or ()}
        assert {"not_sampled", "emission_sampling"} <= set(found)
        assert "before Blender 5.1" in found["not_sampled"].found and found["not_sampled"].mend is not None
        found["emission_sampling"].mend()
        assert material.cycles.emission_sampling == "NONE"
        update_scene(scene.scene)
        assert can_raycast() or all(tree[SLOTS_KEY] == 0 for tree in aims)


@pytest.mark.slow
def test_with_balanced_the_preview_is_shown_after_a_diffuse_bounce(paint: Bundle) -> None:
    """And nothing is emitted there: ground lit by the sphere is as under the other material."""
    with lit_sphere(sampling(paint, "balanced"), resolution=24) as scene:
        use_osl(scene.scene)
        outside = ~np.pad(scene.mask()[1:-1, 1:-1], 1) & (np.arange(24) > 15)[:, None]
        scene.sphere.visible_camera = False
        pictures = []
        for material in (mirroring(paint, "balanced"), sampling(paint, "balanced")):
            show(scene, material)
            pictures.append(scene.render(16, range(8 * len(pictures), 8 * len(pictures) + 8)))
        assert_agree(compare(*pictures, outside), 0.02)
