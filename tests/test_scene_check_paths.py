"""The scene check on light that differs by kind of ray, and on volumes: what is reported, proven by pictures."""

# ruff: noqa: F811  (fixtures of another module, asked for by their names)

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
import pytest
from mathutils import Matrix
from measured_materials.addon.lights.light_tables import lamp_image, update_scene
from measured_materials.addon.scene_check.check import mend
from measured_materials.addon.scene_check.light_node_rules import emission_outputs
from measured_materials.bake.bundle.bundle import Bundle
from measured_materials.nodes.material import build_material
from support.checked_scenes import ALBEDO, clean_blend, matte  # noqa: F401
from support.light_paths import (
    KINDS,
    TELLING,
    darken,
    emitter,
    light_of,
    outputs,
    volume_in_a_material,
    world_volume,
)
from support.scene_check_cases import lamp_of, rules
from support.scenes import TestScene, diffuse_material, lit_sphere


def scene_of(bundle: Bundle, mode: str = "reference") -> TestScene:
    scene = lit_sphere(build_material(bundle, mode=mode, lamps=lamp_image()), 24, resolution=16)
    scene.leave_terminator()
    return scene


# --- which outputs ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_exactly_the_outputs_that_change_the_picture_are_told(matte: Bundle, kind: str) -> None:
    with scene_of(matte) as scene:
        tree, strength = light_of(scene, kind)
        update_scene(scene.scene)
        assert not rules(scene)
        told = set()
        for output in outputs():
            path = darken(tree, strength, output, 0.5)
            found = rules(scene)
            assert set(found) <= {f"{kind}_light_path", "lamp_table"}
            if f"{kind}_light_path" in found:
                told.add(output)
                finding = found[f"{kind}_light_path"]
                assert finding.severity == "wrong" and finding.mend is None and output in finding.found
            tree.nodes.remove(path)
    assert told == TELLING[kind]


# --- by which way they reach the light ------------------------------------------------------------------------


def nested(tree: Any, path: Any, strength: Any) -> None:
    """Out of one group, through another that passes it on."""
    inner = bpy.data.node_groups.new("inner", "ShaderNodeTree")
    inner.interface.new_socket("first", in_out="OUTPUT", socket_type="NodeSocketFloat")
    inner.interface.new_socket("second", in_out="OUTPUT", socket_type="NodeSocketFloat")
    inside, sink = inner.nodes.new("ShaderNodeLightPath"), inner.nodes.new("NodeGroupOutput")
    inner.links.new(inside.outputs["Is Glossy Ray"], sink.inputs[1])
    outer = bpy.data.node_groups.new("outer", "ShaderNodeTree")
    outer.interface.new_socket("in", in_out="INPUT", socket_type="NodeSocketFloat")
    outer.interface.new_socket("out", in_out="OUTPUT", socket_type="NodeSocketFloat")
    source, through = outer.nodes.new("NodeGroupInput"), outer.nodes.new("NodeGroupOutput")
    outer.links.new(source.outputs[0], through.inputs[0])
    first, second = tree.nodes.new("ShaderNodeGroup"), tree.nodes.new("ShaderNodeGroup")
    first.node_tree, second.node_tree = inner, outer
    tree.links.new(first.outputs[1], second.inputs[0])
    tree.links.new(second.outputs[0], strength)


def rerouted(tree: Any, path: Any, strength: Any) -> None:
    reroute = tree.nodes.new("NodeReroute")
    tree.links.new(path.outputs["Is Glossy Ray"], reroute.inputs[0])
    tree.links.new(reroute.outputs[0], strength)


def past_a_muted_node(tree: Any, path: Any, strength: Any) -> None:
    mixed = tree.nodes.new("ShaderNodeMath")
    tree.links.new(path.outputs["Is Glossy Ray"], mixed.inputs[0])
    tree.links.new(mixed.outputs[0], strength)
    mixed.mute = True


def tinting(tree: Any, path: Any, strength: Any) -> None:
    tree.links.new(path.outputs["Is Glossy Ray"], strength.node.inputs["Color"])


def choosing(tree: Any, path: Any, strength: Any) -> None:
    """Between the light and nothing."""
    mix, shader = tree.nodes.new("ShaderNodeMixShader"), strength.node.outputs[0]
    target = shader.links[0].to_socket
    tree.links.new(path.outputs["Is Glossy Ray"], mix.inputs[0])
    tree.links.new(shader, mix.inputs[1])
    tree.links.new(mix.outputs[0], target)


def in_a_groups_shader(tree: Any, path: Any, strength: Any) -> None:
    group = bpy.data.node_groups.new("light", "ShaderNodeTree")
    group.interface.new_socket("light", in_out="OUTPUT", socket_type="NodeSocketShader")
    inside, emission, sink = (
        group.nodes.new(kind) for kind in ("ShaderNodeLightPath", "ShaderNodeEmission", "NodeGroupOutput")
    )
    group.links.new(inside.outputs["Is Glossy Ray"], emission.inputs["Strength"])
    group.links.new(emission.outputs[0], sink.inputs[0])
    node = tree.nodes.new("ShaderNodeGroup")
    node.node_tree = group
    tree.links.new(node.outputs[0], strength.node.outputs[0].links[0].to_socket)


def principled(tree: Any, path: Any, strength: Any) -> None:
    shader = tree.nodes.new("ShaderNodeBsdfPrincipled")
    tree.links.new(path.outputs["Is Glossy Ray"], shader.inputs["Emission Strength"])
    tree.links.new(shader.outputs[0], strength.node.outputs[0].links[0].to_socket)


def without_a_shader(tree: Any, path: Any, strength: Any) -> None:
    """A number in place of a shader is an emission."""
    tree.links.new(path.outputs["Is Glossy Ray"], strength.node.outputs[0].links[0].to_socket)


WAYS = (nested, rerouted, past_a_muted_node, tinting, choosing, in_a_groups_shader, principled, without_a_shader)


@pytest.mark.parametrize("way", WAYS, ids=lambda way: way.__name__)
def test_ways_to_the_light(way: Callable[..., None]) -> None:
    with lit_sphere(diffuse_material(), 8) as scene:
        tree = emitter(scene, lamp_of(scene).matrix_world)
        strength = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeEmission").inputs["Strength"]
        path = tree.nodes.new("ShaderNodeLightPath")
        assert not emission_outputs(tree)
        way(tree, path, strength)
        assert emission_outputs(tree) == {"Is Glossy Ray"}


def unused(tree: Any, path: Any, strength: Any) -> None:
    rerouted(tree, path, tree.nodes.new("ShaderNodeMath").inputs[0])


def muted(tree: Any, path: Any, strength: Any) -> None:
    tree.links.new(path.outputs["Is Glossy Ray"], strength)
    path.mute = True


def muted_link(tree: Any, path: Any, strength: Any) -> None:
    tree.links.new(path.outputs["Is Glossy Ray"], strength).is_muted = True


def not_chosen(tree: Any, path: Any, strength: Any) -> None:
    """The other shader of a mix is never there."""
    mix, other = tree.nodes.new("ShaderNodeMixShader"), tree.nodes.new("ShaderNodeEmission")
    shader = strength.node.outputs[0]
    target = shader.links[0].to_socket
    mix.inputs[0].default_value = 0
    tree.links.new(path.outputs["Is Glossy Ray"], other.inputs["Strength"])
    tree.links.new(shader, mix.inputs[1])
    tree.links.new(other.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], target)


def of_a_surface(tree: Any, path: Any, strength: Any) -> None:
    """Reflecting by kind of ray is no light."""
    shader = tree.nodes.new("ShaderNodeBsdfPrincipled")
    tree.links.new(path.outputs["Is Glossy Ray"], shader.inputs["Base Color"])
    tree.links.new(shader.outputs[0], strength.node.outputs[0].links[0].to_socket)


def at_no_strength(tree: Any, path: Any, strength: Any) -> None:
    tinting(tree, path, strength)
    strength.default_value = 0


def at_another_output(tree: Any, path: Any, strength: Any) -> None:
    other, output = tree.nodes.new("ShaderNodeEmission"), tree.nodes.new("ShaderNodeOutputMaterial")
    output.target = "EEVEE"
    tree.links.new(path.outputs["Is Glossy Ray"], other.inputs["Strength"])
    tree.links.new(other.outputs[0], output.inputs["Surface"])


@pytest.mark.parametrize(
    "way",
    (unused, muted, muted_link, not_chosen, of_a_surface, at_no_strength, at_another_output),
    ids=lambda way: way.__name__,
)
def test_what_does_not_reach_the_light(way: Callable[..., None]) -> None:
    with lit_sphere(diffuse_material(), 8) as scene:
        tree = emitter(scene, lamp_of(scene).matrix_world)
        strength = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeEmission").inputs["Strength"]
        way(tree, tree.nodes.new("ShaderNodeLightPath"), strength)
        lit = [node for node in tree.nodes if node.bl_idname == "ShaderNodeEmission"]
        assert not emission_outputs(tree) or not any(n.inputs["Strength"].default_value for n in lit)


def test_switched_off_nodes_are_not_told(matte: Bundle) -> None:
    with scene_of(matte) as scene:
        tree, strength = light_of(scene, "lamp")
        darken(tree, strength, "Glossy Depth", 0.5)
        update_scene(scene.scene)
        assert "lamp_light_path" in rules(scene)
        lamp_of(scene).data.use_nodes = False
        update_scene(scene.scene)
        assert not rules(scene)


def test_bounces_through_transparent_surfaces_are_told_where_there_are_some(matte: Bundle) -> None:
    with scene_of(matte) as scene:
        tree, strength = light_of(scene, "world")
        update_scene(scene.scene)
        darken(tree, strength, "Transparent Depth", 0.5)
        assert not rules(scene)
        veil = emitter(scene, scene.sphere.matrix_world)
        shader = veil.nodes.new("ShaderNodeBsdfPrincipled")
        target = veil.get_output_node("CYCLES").inputs["Surface"]
        veil.links.new(shader.outputs[0], target)
        assert not rules(scene)
        shader.inputs["Alpha"].default_value = 0.5
        assert "Transparent Depth" in rules(scene)["world_light_path"].found
        veil.links.new(veil.nodes.new("ShaderNodeBsdfTransparent").outputs[0], target)
        assert "Transparent Depth" in rules(scene)["world_light_path"].found


# --- what the pictures say ---------------------------------------------------------------------------------------


def brightness(bundle: Bundle, mode: str, kind: str, output: str, samples: int, seeds: int = 4) -> float:
    """Through a transparent pane, which lets all light pass."""
    with scene_of(bundle, mode) as scene:
        mask = scene.mask()
        veil = emitter(scene, Matrix.Translation((0, 0, 1.6)), 8.0)
        target = veil.get_output_node("CYCLES").inputs["Surface"]
        veil.links.new(veil.nodes.new("ShaderNodeBsdfTransparent").outputs[0], target)
        # So large that native closures too meet it by the rays they reflect.
        tree, strength = light_of(scene, kind, size=6.0)
        if output:
            limit = 4.0 if output == "Ray Length" else 1.5 if output == "Ray Depth" else 0.5
            darken(tree, strength, output, limit)
        update_scene(scene.scene)
        return float(scene.render(samples, seeds)[:, mask].mean())


@pytest.mark.parametrize("kind, output", [("world", "Is Glossy Ray"), ("world", "Is Camera Ray")])
def test_the_mirror_is_lit_otherwise(matte: Bundle, kind: str, output: str) -> None:
    """Of a world that is black for glossy rays Reference loses most; one that only the camera does not see, neither."""
    exact, reference = (brightness(matte, mode, kind, output, 32, 2) for mode in ("exact", "reference"))
    ratio = reference / exact
    assert (ratio < 0.4) if output in TELLING[kind] else ratio == pytest.approx(1, abs=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_told_outputs_are_those_that_part_the_modes(matte: Bundle, kind: str) -> None:
    """Every output of Light Path, each at a limit that parts the first reflection from what follows.

    Reference against Exact, which for a matte material is Cycles' own Diffuse; both are rendered without the nodes
    too. Noise is a percent.
    """
    plain = brightness(matte, "reference", kind, "", 64) / brightness(matte, "exact", kind, "", 64)
    assert plain == pytest.approx(1, abs=0.04)
    parted = set()
    for output in outputs():
        exact, reference = (brightness(matte, mode, kind, output, 64) for mode in ("exact", "reference"))
        if abs(reference - exact * plain) > 0.05 * max(reference, exact):
            parted.add(output)
    assert parted == TELLING[kind] | {"Transparent Depth"}


# --- volumes -----------------------------------------------------------------------------------------------------


def volume_object(scene: TestScene) -> None:
    scene.scene.collection.objects.link(bpy.data.objects.new("smoke", bpy.data.volumes.new("smoke")))


@pytest.mark.parametrize("fill", [world_volume, volume_in_a_material, volume_object], ids=lambda fill: fill.__name__)
def test_volumes_are_told_and_mended(matte: Bundle, fill: Callable[[TestScene], None]) -> None:
    with scene_of(matte) as scene:
        update_scene(scene.scene)
        assert not rules(scene)
        fill(scene)
        finding = rules(scene)["volume_roulette"]
        assert finding.severity == "wrong" and mend([finding])
        assert scene.scene.cycles.min_light_bounces == 1024 and not rules(scene)
        # As many as there are bounces at all are enough, one less is not.
        most = scene.scene.cycles.max_bounces
        scene.scene.cycles.min_light_bounces = most
        assert not rules(scene)
        scene.scene.cycles.min_light_bounces = most - 1
        assert set(rules(scene)) == {"volume_roulette"}


def test_volumes_that_are_not_rendered_are_not_told(matte: Bundle) -> None:
    with scene_of(matte) as scene:
        volume_in_a_material(scene)
        volume_object(scene)
        for obj in scene.scene.objects:
            if obj.name in ("emitter", "smoke"):
                obj.hide_render = True
        update_scene(scene.scene)
        assert not rules(scene)


def test_a_volume_without_lamps_is_not_told(matte: Bundle) -> None:
    with scene_of(matte) as scene:
        world_volume(scene)
        bpy.data.objects.remove(lamp_of(scene))
        update_scene(scene.scene)
        assert not rules(scene)


def in_a_volume(bundle: Bundle, mode: str, mended: bool, seeds: int) -> float:
    """Of a sphere and its ground of one material, under a lamp only."""
    material = build_material(bundle, mode=mode, lamps=lamp_image())
    with lit_sphere(material, 24, resolution=16) as scene:
        scene.leave_terminator()
        scene.scene.world.node_tree.nodes.clear()
        world_volume(scene)
        for obj in scene.scene.objects:
            if obj.type == "MESH":
                obj.data.materials.clear()
                obj.data.materials.append(material)
        update_scene(scene.scene)
        if mended:
            assert mend([rules(scene)["volume_roulette"]])
        return float(scene.render(32, seeds)[:, scene.mask()].mean())


def test_a_volume_takes_light_from_the_mirror_until_mended(matte: Bundle) -> None:
    """Two seeds know it to 1 %."""
    truth = in_a_volume(matte, "exact", True, 2)
    assert in_a_volume(matte, "reference", False, 2) < 0.92 * truth
    assert in_a_volume(matte, "reference", True, 2) == pytest.approx(truth, rel=0.04)
