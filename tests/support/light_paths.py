"""Lights whose nodes tell kinds of rays apart, for the scene check and its proofs."""

from __future__ import annotations

from typing import Any

import bpy
from mathutils import Matrix
from measured_materials.nodes import compat

from support.scene_check_cases import lamp_of
from support.scenes import TestScene

KINDS = ("world", "lamp", "emission")
BOUNCES = frozenset({"Diffuse Depth", "Glossy Depth"})
RAYS = frozenset({"Is Diffuse Ray", "Is Glossy Ray", "Is Singular Ray", "Is Reflection Ray"})
TELLING = {"world": RAYS | BOUNCES | {"Ray Depth"}, "lamp": BOUNCES | {"Ray Depth"}, "emission": RAYS | BOUNCES}
"""What reaches native closures and the mirror differently, as `test_scene_check_paths.py` proves by pictures."""


def outputs() -> list[str]:
    """Of the Light Path node of this Blender."""
    tree = bpy.data.node_groups.new("outputs", "ShaderNodeTree")
    names = [socket.name for socket in tree.nodes.new("ShaderNodeLightPath").outputs]
    bpy.data.node_groups.remove(tree)
    return names


def light_of(scene: TestScene, kind: str, size: float = 2.0) -> tuple[bpy.types.NodeTree, Any]:
    """The only light of the scene becomes one of a kind; returns its tree and the strength's socket."""
    world, lamp = scene.scene.world.node_tree, lamp_of(scene)
    if kind == "world":
        bpy.data.objects.remove(lamp)
        return world, next(n for n in world.nodes if n.bl_idname == "ShaderNodeBackground").inputs["Strength"]
    world.nodes.clear()
    if kind == "lamp":
        lamp.data.use_nodes = True
        tree = lamp.data.node_tree
    else:
        tree = emitter(scene, lamp.matrix_world.copy(), size)
        bpy.data.objects.remove(lamp)
    return tree, next(n for n in tree.nodes if n.bl_idname == "ShaderNodeEmission").inputs["Strength"]


def emitter(scene: TestScene, matrix: Matrix, size: float = 2.0) -> bpy.types.NodeTree:
    """A square that shines to both sides; returns its material's tree."""
    mesh = bpy.data.meshes.new("emitter")
    mesh.from_pydata([(x * size / 2, y * size / 2, 0) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))], [], [range(4)])
    material = compat.shader_material("emitter", "ShaderNodeEmission", {"Strength": 10})
    mesh.materials.append(material)
    obj = bpy.data.objects.new("emitter", mesh)
    obj.matrix_world = matrix
    scene.scene.collection.objects.link(obj)
    return material.node_tree


def darken(tree: bpy.types.NodeTree, strength: Any, output: str, above: float) -> bpy.types.Node:
    """The light is black where an output of Light Path is larger than a number; returns that node."""
    path, larger, dark = (
        tree.nodes.new(kind) for kind in ("ShaderNodeLightPath", "ShaderNodeMath", "ShaderNodeMapRange")
    )
    larger.operation, larger.inputs[1].default_value = "GREATER_THAN", above
    dark.inputs["To Min"].default_value, dark.inputs["To Max"].default_value = 1, 0
    product = tree.nodes.new("ShaderNodeMath")
    product.operation, product.inputs[1].default_value = "MULTIPLY", strength.default_value
    if strength.is_linked:
        tree.links.new(strength.links[0].from_socket, product.inputs[1])
    for source, target in (
        (path.outputs[output], larger.inputs[0]),
        (larger.outputs[0], dark.inputs["Value"]),
        (dark.outputs["Result"], product.inputs[0]),
        (product.outputs[0], strength),
    ):
        tree.links.new(source, target)
    return path


def world_volume(scene: TestScene) -> None:
    """A thin absorbing volume fills the scene."""
    tree = scene.scene.world.node_tree
    output = tree.get_output_node("CYCLES") or tree.nodes.new("ShaderNodeOutputWorld")
    volume = tree.nodes.new("ShaderNodeVolumeAbsorption")
    volume.inputs["Density"].default_value = 0.05
    tree.links.new(volume.outputs[0], output.inputs["Volume"])


def volume_in_a_material(scene: TestScene) -> None:
    """The emitter's material scatters within."""
    tree = emitter(scene, lamp_of(scene).matrix_world)
    volume = tree.nodes.new("ShaderNodeVolumeScatter")
    tree.links.new(volume.outputs[0], tree.get_output_node("CYCLES").inputs["Volume"])
