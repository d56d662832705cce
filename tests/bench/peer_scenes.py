"""The two scenes of `bench mitsuba`: a sphere on coloured ground under a lamp and an even sky, or under a picture.

What both renderers are told stands in `facts`; what is built of it here is Cycles' side, `mitsuba_child.py` the other.
Two things are made equal on purpose. In Cycles one sees past a lamp what is behind it: Mitsuba's lamp adds the sky's
radiance to its own. And Mitsuba has the first and last row of an environment at the poles, Cycles half a row before
them: Mitsuba gets the picture as Cycles interpolates it, in smaller pixels.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy
import numpy as np
from engine_scenes import room_pixels
from mathutils import Matrix, Vector
from measured_materials.addon.rendering.renderer import set_unbiased
from measured_materials.addon.studio.studio import OWNED, remove_studio, render_linear
from measured_materials.addon.studio.studio_meshes import sphere_mesh
from measured_materials.bake.source import Array
from measured_materials.nodes import compat

SCENES = ("lamp and sky", "HDR world")
BOUNCES = 12
_EYE, _TILT, _ANGLE = Vector((0, -4, 2)), math.radians(65), math.radians(39.6)
_GROUND, _HALF, _HEIGHT = (0.8, 0.5, 0.3), 5.0, -1.0
_SKY, _POWER, _SIZE, _LAMP = 0.3, 100.0, 1.0, Vector((2, -1, 3))
# Towards its rim the sphere of facets ends before the true one, and a pixel shows ground too.
_LEAST_COSINE = 0.25
_FINER = 4


def facts(name: str) -> dict[str, Any]:
    """A scene of `SCENES` in plain numbers: matrices of world from local, a lamp's square along z, radiances."""
    forward = Vector((0, math.sin(_TILT), -math.cos(_TILT)))
    told: dict[str, Any] = {
        "eye": list(_EYE),
        "target": list(_EYE + forward),
        "angle": math.degrees(_ANGLE),
        "ground": {"colour": _GROUND, "half": _HALF, "height": _HEIGHT},
        "bounces": BOUNCES,
    }
    if name == "HDR world":
        return told
    matrix = _lamp_matrix() @ Matrix.Rotation(math.pi, 4, "X") @ Matrix.Scale(_SIZE / 2, 4)
    radiance = _POWER / (math.pi * _SIZE**2) + _SKY
    return told | {"sky": _SKY, "lamp": {"matrix": [list(row) for row in matrix], "radiance": radiance}}


def environment() -> Array:
    """The world's picture for Mitsuba, (H, W, 3) float32, the first row at the zenith and the last at the nadir."""
    pixels = room_pixels()
    height, width = (_FINER * n for n in pixels.shape[:2])
    rows = np.clip(np.arange(height) / (height - 1) * pixels.shape[0] - 0.5, 0, pixels.shape[0] - 1)
    columns = (np.arange(width) + 0.5) / _FINER - 0.5
    return _blended(_blended(pixels, rows, 0), columns, 1).astype(np.float32)


def _blended(pixels: Array, place: Array, axis: int) -> Array:
    """Between neighbours along an axis, periodic."""
    low = np.floor(place).astype(int)
    weight = np.expand_dims(place - low, axis=tuple(k for k in range(3) if k != axis))
    count = pixels.shape[axis]
    return pixels.take(low % count, axis) * (1 - weight) + pixels.take((low + 1) % count, axis) * weight


def on_sphere(edge: int) -> Array:
    """(edge, edge) bool: pixels whose corners see the sphere, and none of it too obliquely."""
    place = np.linspace(-1, 1, edge + 1) * math.tan(_ANGLE / 2)
    x, y = np.meshgrid(place, -place)
    rays = np.stack([x, y, np.full_like(x, -1)], -1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    rays = rays @ np.array(Matrix.Rotation(_TILT, 3, "X")).T
    along = rays @ np.array(_EYE)
    inside = along**2 - (_EYE.length_squared - 1)
    # A hit is eye + t ray with t = -along - sqrt(inside), and there the cosine towards the eye is sqrt(inside).
    seen = inside > _LEAST_COSINE**2
    return seen[1:, 1:] & seen[1:, :-1] & seen[:-1, 1:] & seen[:-1, :-1]


@contextmanager
def lit(name: str) -> Iterator[bpy.types.Scene]:
    """One of `SCENES`, for `engine_scenes.show` to put materials into; one thread renders it."""
    compat.ensure_cycles()
    scene = bpy.data.scenes.new("peer")
    sphere = _place(scene, sphere_mesh())
    sphere.name, sphere.shadow_terminator_geometry_offset = "sphere", 0
    _place(scene, _ground())
    camera = bpy.data.cameras.new("camera")
    camera.angle = _ANGLE
    scene.camera = _place(scene, camera, Matrix.Translation(_EYE) @ Matrix.Rotation(_TILT, 4, "X"))
    set_unbiased(scene, samples=1, seed=0)
    scene.cycles.diffuse_bounces = BOUNCES
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", 1.0
    scene.render.threads_mode, scene.render.threads = "FIXED", 1
    (_picture if name == "HDR world" else _lamp_and_sky)(scene)
    try:
        yield scene
    finally:
        remove_studio(scene)


def timed(scene: bpy.types.Scene, edge: int, samples: int, seed: int) -> tuple[Array, float]:
    """Pixels (edge, edge, 3), and seconds of all processors."""
    scene.render.resolution_x = scene.render.resolution_y = edge
    scene.cycles.samples, scene.cycles.seed = samples, seed
    started = time.process_time()
    return render_linear(scene), time.process_time() - started


def _lamp_matrix() -> Matrix:
    return Matrix.Translation(_LAMP) @ (-_LAMP).to_track_quat("-Z", "Y").to_matrix().to_4x4()


def _lamp_and_sky(scene: bpy.types.Scene) -> None:
    scene.world, background = compat.new_world("even")
    background.inputs["Color"].default_value, background.inputs["Strength"].default_value = (1, 1, 1, 1), _SKY
    lamp = bpy.data.lights.new("lamp", "AREA")
    lamp.energy, lamp.size = _POWER, _SIZE
    lamp.cycles.use_multiple_importance_sampling = True
    _place(scene, lamp, _lamp_matrix())


def _picture(scene: bpy.types.Scene) -> None:
    scene.world, background = compat.new_world("picture")
    pixels = room_pixels()
    image = bpy.data.images.new("picture", pixels.shape[1], pixels.shape[0], float_buffer=True, is_data=True)
    image.pixels.foreach_set(np.concatenate([pixels[::-1], np.ones_like(pixels[..., :1])], -1).ravel())
    image.pack()
    tree = scene.world.node_tree
    around = tree.nodes.new("ShaderNodeTexEnvironment")
    around.image = image
    tree.links.new(around.outputs["Color"], background.inputs["Color"])
    # Cycles would tabulate 2 million directions of these pixels before every render.
    scene.world.cycles.sampling_method, scene.world.cycles.sample_map_resolution = "MANUAL", 512


def _ground() -> bpy.types.Mesh:
    mesh = bpy.data.meshes.new("ground")
    corners = [(x * _HALF, y * _HALF, _HEIGHT) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
    material = compat.shader_material("ground", "ShaderNodeBsdfDiffuse", {"Color": (*_GROUND, 1)})
    material[OWNED] = True
    mesh.materials.append(material)
    return mesh


def _place(scene: bpy.types.Scene, data: bpy.types.ID, matrix: Matrix | None = None) -> bpy.types.Object:
    obj = bpy.data.objects.new(data.name, data)
    obj.matrix_world = matrix or Matrix.Identity(4)
    scene.collection.objects.link(obj)
    return obj
