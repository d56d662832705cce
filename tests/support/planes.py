"""A plane under rotations, mirroring and shear, against the same plane whose vertices were moved instead."""

from __future__ import annotations

import bpy
from mathutils import Matrix, Vector
from measured_materials.addon.rendering.renderer import set_unbiased
from measured_materials.nodes import compat, expr

from .scenes import TestScene

SHAPES = {
    "still": Matrix.Identity(4),
    "turned": Matrix.Rotation(0.7, 4, "Z"),
    "mirrored": Matrix.Diagonal((-1, 1, 1, 1)) @ Matrix.Rotation(0.5, 4, "Z"),
    "sheared": Matrix(((1, 0.8, 0, 0), (0, 0.7, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))),
    "sheared out of its plane": Matrix(((1, 0.3, 0.4, 0), (0.1, 0.8, 0, 0), (0.3, -0.2, 1, 0), (0, 0, 0, 1))),
}


def plane_scene(material: bpy.types.Material, matrix: Matrix, applied: bool, lamp: bool = False) -> TestScene:
    """A plane under a sky that glows in one place; `applied` moves the vertices instead of the object.

    UVs run at an angle to the edges, so that the tangent is nobody's axis.
    """
    compat.ensure_cycles()
    scene = bpy.data.scenes.new("plane")
    mesh = bpy.data.meshes.new("plane")
    corners = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
    mesh.from_pydata([matrix @ Vector(c) for c in corners] if applied else corners, [], [(0, 1, 2, 3)])
    layer = mesh.uv_layers.new()
    for loop, (x, y, _) in zip(layer.data, corners, strict=True):
        loop.uv = (0.8 * x + 0.3 * y, 0.9 * y - 0.2 * x)
    mesh.materials.append(material)
    plane = bpy.data.objects.new("plane", mesh)
    scene.collection.objects.link(plane)
    if not applied:
        # Alone it would keep location, rotation and scale of a matrix, and no shear.
        plane.parent = bpy.data.objects.new("parent", None)
        scene.collection.objects.link(plane.parent)
        plane.matrix_parent_inverse = matrix
    scene.world, background = compat.new_world("glow")
    tree = scene.world.node_tree
    with expr.building(tree):
        direction = expr.Vector(expr.node("ShaderNodeTexCoord", {}, {}).outputs["Generated"])
        along = expr.dot(expr.normalize(direction), expr.vec(0.3, 0.8, 0.52))
        expr.feed(tree, background.inputs["Strength"], expr.power(along, 4.0) * 2 + 0.2)
    background.inputs["Color"].default_value = (1.0, 0.9, 0.8, 1)
    scene.world.cycles.sampling_method, scene.world.cycles.sample_map_resolution = "MANUAL", 128
    if lamp:
        light = bpy.data.lights.new("lamp", "AREA")
        light.energy, light.size = 40, 0.5
        placed = bpy.data.objects.new("lamp", light)
        placed.matrix_world = Matrix.Translation((0.5, 1.2, 1.5)) @ Matrix.Rotation(-0.7, 4, "X")
        scene.collection.objects.link(placed)
    camera = bpy.data.cameras.new("camera")
    view = bpy.data.objects.new("camera", camera)
    view.matrix_world = Matrix.Translation((0, -2.4, 2.0)) @ Matrix.Rotation(0.87, 4, "X")
    camera.lens = 75
    scene.collection.objects.link(view)
    scene.camera = view
    scene.render.resolution_x = scene.render.resolution_y = 24
    set_unbiased(scene, samples=64, seed=0)
    return TestScene(scene, plane)
