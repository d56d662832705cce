"""Scenes that strain float32 or turn surfaces about: each a change to one sphere under a sky and a lamp."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import bmesh
import bpy
import numpy as np
from mathutils import Euler, Matrix, Vector
from measured_materials.addon.studio import studio_meshes

from support.scenes import TestScene, lit_sphere

FAR = (1e4, -1e4, 1e4)  # float32 steps there are 1e-3
VIEW = 1e-4  # width of an extreme zoom
_FACING = Vector((0.25, -0.8, 0.55)).normalized()  # a place on the sphere that lamp and camera see


@contextmanager
def hard_scene(name: str, material: bpy.types.Material, resolution: int = 32) -> Iterator[TestScene]:
    """The scene of this name in `HARD`, cleared away afterwards with all that it was made of."""
    with lit_sphere(material, 64, lamp_size=0.8, ground=False, resolution=resolution) as scene:
        scene.leave_terminator()
        scene.scene.camera.data.lens = 60  # the sphere fills the picture
        HARD[name](scene)
        try:
            yield scene
        finally:
            for block in [o for o in bpy.data.objects if o.users_scene in ((), (scene.scene,))]:
                if block.type == "EMPTY" or block == scene.sphere:
                    bpy.data.objects.remove(block)
            for collections in (bpy.data.collections, bpy.data.actions):
                for block in list(collections):
                    collections.remove(block)


def as_usual(scene: TestScene) -> None:
    """Nothing."""


def far(scene: TestScene) -> None:
    """Everything ten thousand units away, under a larger lamp.

    Where Cycles fears that a ray meets the next face at once, it moves the ray's origin by 32 steps of float32 on each
    axis, here by 0.05 in all. One ray in 300 000 thereby meets a lamp that its direction alone would miss, is not told
    apart from one that was never aimed, and counts ten times: true in the mean, but too rare for a t-test where the
    lamp is small and bright.
    """
    _transform(scene, Matrix.Translation(FAR))
    for obj in scene.scene.objects:
        if obj.type == "LIGHT":
            obj.data.size = 2.0


def far_narrow(scene: TestScene) -> None:
    """The same through a lens that shows a tenth of a unit, a hundred steps of float32."""
    far(scene)
    scene.scene.camera.data.lens *= 25


def far_orthographic(scene: TestScene) -> None:
    """The same, all rays of the camera parallel: what tells them apart is their position alone."""
    far(scene)
    scene.scene.camera.data.type, scene.scene.camera.data.ortho_scale = "ORTHO", 1.9


def millimetre(scene: TestScene) -> None:
    """A sphere of a millimetre with all that is around it, lit as brightly."""
    _transform(scene, Matrix.Scale(1e-3, 4))
    camera = scene.scene.camera
    camera.matrix_world = Matrix.LocRotScale(camera.matrix_world.translation, camera.matrix_world.to_quaternion(), None)
    camera.data.clip_start = 1e-5
    for obj in scene.scene.objects:
        if obj.type == "LIGHT":
            obj.data.energy *= 1e-6


def zoom(scene: TestScene) -> None:
    """A view as wide as a ten-thousandth of the sphere's radius, from near by."""
    distance = 0.01
    _look_at_surface(scene, distance)
    camera = scene.scene.camera.data
    camera.lens, camera.clip_start = camera.sensor_width * distance / VIEW, distance / 10


def zoom_orthographic(scene: TestScene) -> None:
    """The same by parallel rays."""
    _look_at_surface(scene, 1.0)
    scene.scene.camera.data.type, scene.scene.camera.data.ortho_scale = "ORTHO", VIEW


def moving(scene: TestScene) -> None:
    """Motion blur of an object that flies and turns."""
    sphere = scene.sphere
    for frame, sign in ((0, -1), (2, 1)):
        sphere.location, sphere.rotation_euler = (0.25 * sign, 0, 0.1 * sign), (0.4 * sign, 0, 0)
        sphere.keyframe_insert("location", frame=frame)
        sphere.keyframe_insert("rotation_euler", frame=frame)
    _blur(scene)


def deforming(scene: TestScene) -> None:
    """Motion blur of a mesh that swells."""
    scene.sphere.shape_key_add(name="rest")
    swollen = scene.sphere.shape_key_add(name="swollen")
    points = np.array([vertex.co for vertex in scene.sphere.data.vertices]) * (0.8, 1.2, 1.15)
    swollen.data.foreach_set("co", points.ravel())
    for frame, value in ((0, 0.0), (2, 1.0)):
        swollen.value = value
        swollen.keyframe_insert("value", frame=frame)
    _blur(scene)


def instanced(scene: TestScene) -> None:
    """Instances of a collection, turned, stretched and some of them mirrored."""
    collection = bpy.data.collections.new("instanced")
    collection.objects.link(scene.sphere)
    scene.scene.collection.objects.unlink(scene.sphere)
    rng = np.random.default_rng(0)
    for k in range(9):
        empty = bpy.data.objects.new("instance", None)
        empty.instance_type, empty.instance_collection = "COLLECTION", collection
        size = 0.45 * rng.uniform(0.85, 1.0, 3) * ((-1, 1, 1) if k % 2 else 1)
        place = (k % 3 * 0.66 - 0.66, 0, k // 3 * 0.66 - 0.66)
        empty.matrix_world = Matrix.LocRotScale(place, Euler(rng.uniform(0, 3, 3)), size)
        scene.scene.collection.objects.link(empty)


def mirrored(scene: TestScene) -> None:
    """Negative scale."""
    scene.sphere.scale = (-1, 1, 1)


def sheared(scene: TestScene) -> None:
    """A turned object under an unevenly scaled parent: its normals are no longer its axes turned."""
    parent = bpy.data.objects.new("parent", None)
    parent.scale = (1.1, 0.5, 1.3)
    scene.scene.collection.objects.link(parent)
    scene.sphere.parent = parent
    scene.sphere.rotation_euler, scene.sphere.scale = (0.7, 0.3, 0), (1, 1.3, 0.7)


def two_sided(scene: TestScene) -> None:
    """A bowl of no thickness, whose inside shows the backs of its faces; shading there turns to the viewer."""
    mesh = bmesh.new()
    mesh.from_mesh(scene.sphere.data)
    cut = Vector((0.1, -0.6, 0.8)).normalized()
    bmesh.ops.delete(mesh, geom=[f for f in mesh.faces if f.calc_center_median().dot(cut) > 0.25], context="FACES")
    mesh.to_mesh(scene.sphere.data)
    mesh.free()


def flat(scene: TestScene) -> None:
    """Few faces, each with one normal."""
    mesh = studio_meshes.sphere_mesh(12, 6)
    mesh.shade_flat()
    for material in scene.sphere.data.materials:
        mesh.materials.append(material)
    before, scene.sphere.data = scene.sphere.data, mesh
    bpy.data.meshes.remove(before)


HARD: dict[str, Callable[[TestScene], None]] = {
    function.__name__: function
    for function in (
        *(
            as_usual,
            far,
            far_narrow,
            far_orthographic,
            millimetre,
            zoom,
            zoom_orthographic,
            moving,
            deforming,
            instanced,
        ),
        *(mirrored, sheared, two_sided, flat),
    )
}


def link_bump(material: bpy.types.Material) -> None:
    """A Bump node on the group's Normal, fed by a texture over the object."""
    tree, group = _tree_and_group(material)
    coordinates, texture = tree.nodes.new("ShaderNodeTexCoord"), tree.nodes.new("ShaderNodeTexNoise")
    texture.inputs["Scale"].default_value, texture.inputs["Detail"].default_value = 3.0, 0.0
    bump = tree.nodes.new("ShaderNodeBump")
    bump.inputs["Strength"].default_value, bump.inputs["Distance"].default_value = 0.5, 0.3
    tree.links.new(coordinates.outputs["Object"], texture.inputs["Vector"])
    tree.links.new(texture.outputs[0], bump.inputs["Height"])
    tree.links.new(bump.outputs["Normal"], group.inputs["Normal"])


def link_normal_map(material: bpy.types.Material) -> None:
    """A Normal Map node on the group's Normal, whose colours lean every normal over by up to 20 degrees."""
    tree, group = _tree_and_group(material)
    colour = tree.nodes.new("ShaderNodeTexNoise")
    colour.inputs["Scale"].default_value, colour.inputs["Detail"].default_value = 2.0, 0.0
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    lean = tree.nodes.new("ShaderNodeVectorMath")
    lean.operation = "MULTIPLY_ADD"
    lean.inputs[1].default_value, lean.inputs[2].default_value = (0.7, 0.7, 0.0), (0.15, 0.15, 1.0)
    normal_map = tree.nodes.new("ShaderNodeNormalMap")
    tree.links.new(coordinates.outputs["Object"], colour.inputs["Vector"])
    tree.links.new(colour.outputs["Color"], lean.inputs[0])
    tree.links.new(lean.outputs["Vector"], normal_map.inputs["Color"])
    tree.links.new(normal_map.outputs["Normal"], group.inputs["Normal"])


def _tree_and_group(material: bpy.types.Material) -> tuple[bpy.types.NodeTree, bpy.types.Node]:
    tree = material.node_tree
    return tree, next(node for node in tree.nodes if node.bl_idname == "ShaderNodeGroup")


def _transform(scene: TestScene, matrix: Matrix) -> None:
    for obj in scene.scene.objects:
        obj.matrix_world = matrix @ obj.matrix_world


def _look_at_surface(scene: TestScene, distance: float) -> None:
    turn = (-_FACING).to_track_quat("-Z", "Y").to_matrix().to_4x4()
    scene.scene.camera.matrix_world = Matrix.Translation(_FACING * (1 + distance)) @ turn


def _blur(scene: TestScene) -> None:
    scene.scene.render.use_motion_blur, scene.scene.render.motion_blur_shutter = True, 1.0
    scene.scene.frame_set(1)
