"""A roll of a swatch: its geometry, or a plain sheet with a material, wrapped around an axis and seen from above.

Every place of a roll sees light and camera at other angles, which tells a shading map from what it stands for.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ...nodes import compat
from ..gantry.swatches import Swatch
from ..gantry.techniques import Array
from ..lights.light_tables import update_scene
from ..rendering.renderer import set_unbiased
from ..studio.studio import render_linear

TILES_AROUND, TILES_ALONG = 6, 4
RADIUS = TILES_AROUND / (2 * math.pi)
# Of the camera: how far it is turned about the axis, towards larger u, and how much of the scene its picture is wide.
CAMERA_TILT, PICTURE = math.radians(5.0), 2.1
_LAMP_TILT = math.radians(62.0)

Lights = Callable[[bpy.types.Scene], None]


def lamp_and_sky(scene: bpy.types.Scene) -> None:
    """Dim light from everywhere, and a lamp on the side of larger u, as it stands for photographs of one arc."""
    scene.world, background = compat.new_world("Roll light")
    background.inputs["Color"].default_value = (0.75, 0.85, 1.0, 1)
    background.inputs["Strength"].default_value = 0.12
    lamp = bpy.data.lights.new("Roll lamp", "AREA")
    lamp.shape, lamp.size, lamp.energy = "DISK", 1.5, 2600
    lamp.cycles.use_multiple_importance_sampling = True
    _add(scene, lamp, _above(_LAMP_TILT))


def sun_from(wi: tuple[float, float, float], angle: float) -> Lights:
    """One sun of irradiance 1 on a plane that faces it, in the direction wi (the roll's axis is y, its top z).

    Parameters
    ----------
    angle : diameter of the sun in radians
    """

    def light(scene: bpy.types.Scene) -> None:
        scene.world, background = compat.new_world("Roll night")
        background.inputs["Strength"].default_value = 0.0
        sun = bpy.data.lights.new("Roll sun", "SUN")
        sun.energy, sun.angle = 1.0, angle
        _add(scene, sun, Vector(wi).to_track_quat("Z", "Y").to_matrix().to_4x4())

    return light


def roll(target: Swatch | bpy.types.Material, size: int, samples: int, lights: Lights = lamp_and_sky) -> Array:
    """A roll of the swatch's geometry, or of a plain sheet with the material: (size, size, 3), linear.

    The picture's x runs along the axis, its y towards smaller u.

    Parameters
    ----------
    lights : puts them, and the world, into the scene
    """
    scene = bpy.data.scenes.new("Roll")
    try:
        objects = list(target.build(scene)) if isinstance(target, Swatch) else [_sheet(scene, target)]
        for obj in objects:
            bend(obj.data)
            scene.collection.objects.unlink(obj)
        _repeat_around(scene, objects)
        lights(scene)
        camera = bpy.data.cameras.new("Roll camera")
        camera.type, camera.ortho_scale = "ORTHO", PICTURE
        scene.camera = _add(scene, camera, _above(CAMERA_TILT))
        scene.render.resolution_x = scene.render.resolution_y = size
        set_unbiased(scene, samples, seed=1)
        update_scene(scene)
        return render_linear(scene)
    finally:
        _remove(scene, keep=target)


def bend(mesh: bpy.types.Mesh) -> None:
    """Wrap a tile around the axis y: u becomes an angle, height a distance from the surface of the roll."""
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    u, v, height = points.reshape(-1, 3).T.astype(np.float64)
    angle = u * (2 * math.pi / TILES_AROUND)
    bent = np.stack([(RADIUS + height) * np.sin(angle), v, (RADIUS + height) * np.cos(angle)], -1)
    mesh.vertices.foreach_set("co", bent.astype(np.float32).ravel())
    mesh.update()


def _sheet(scene: bpy.types.Scene, material: bpy.types.Material, steps: int = 48) -> bpy.types.Object:
    """A flat tile, fine enough along u to be bent."""
    u = np.linspace(0, 1, steps + 1)
    points = [(x, y, 0.0) for y in (0.0, 1.0) for x in u]
    faces = [(k, k + 1, steps + 2 + k, steps + 1 + k) for k in range(steps)]
    mesh = bpy.data.meshes.new("Sheet")
    mesh.from_pydata(points, [], faces)
    layer = mesh.uv_layers.new(name="UVMap")
    corners = np.array(points)[np.array(faces).ravel(), :2]
    layer.data.foreach_set("uv", corners.astype(np.float32).ravel())
    mesh.shade_smooth()
    mesh.materials.append(material)
    obj = bpy.data.objects.new("Sheet", mesh)
    scene.collection.objects.link(obj)
    return obj


def _repeat_around(scene: bpy.types.Scene, objects: list[bpy.types.Object]) -> None:
    tile = bpy.data.collections.new("Roll tile")
    for obj in objects:
        tile.objects.link(obj)
    for around in range(TILES_AROUND):
        turn = Matrix.Rotation(2 * math.pi * around / TILES_AROUND, 4, "Y")
        for along in range(TILES_ALONG):
            empty = bpy.data.objects.new("Roll tile", None)
            empty.instance_type, empty.instance_collection = "COLLECTION", tile
            empty.matrix_world = Matrix.Translation((0, along - TILES_ALONG / 2, 0)) @ turn
            scene.collection.objects.link(empty)


def _above(tilt: float) -> Matrix:
    """Above the roll, turned about its axis; the x of what stands there runs along the axis."""
    turn = Matrix.Rotation(tilt, 4, "Y")
    return turn @ Matrix.Translation((0, 0, 9)) @ Matrix.Rotation(math.radians(90), 4, "Z")


def _add(scene: bpy.types.Scene, data: bpy.types.ID, matrix: Matrix) -> bpy.types.Object:
    obj = bpy.data.objects.new(data.name, data)
    obj.matrix_world = matrix
    scene.collection.objects.link(obj)
    return obj


def _remove(scene: bpy.types.Scene, keep: Swatch | bpy.types.Material) -> None:
    objects = {*scene.collection.objects}
    tiles = {obj.instance_collection for obj in objects if obj.instance_collection}
    objects |= {obj for tile in tiles for obj in tile.objects}
    data = {obj.data for obj in objects if obj.data}
    materials = {slot for block in data for slot in getattr(block, "materials", ()) if slot and slot != keep}
    world = scene.world
    bpy.data.scenes.remove(scene)
    bpy.data.batch_remove([*objects, *data, *tiles, *materials, *([world] if world else [])])
