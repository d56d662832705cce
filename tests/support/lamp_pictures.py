"""Cycles' own picture of a lamp: which directions meet it, how bright it is there, and what a card receives of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix, Vector
from measured_materials.addon.rendering.renderer import set_unbiased
from measured_materials.addon.studio import studio
from measured_materials.nodes import compat
from numpy.typing import NDArray

from .scenes import diffuse_material

Array = NDArray[Any]
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
CARD = 0.02  # its edge


class LampRoom:
    """A dark scene with a small white card at the origin. Use it as a context manager: what lamps and collections were
    made inside go with it.

    Attributes
    ----------
    scene : the Blender scene
    card : a square of edge CARD
    """

    def __init__(self) -> None:
        compat.ensure_cycles()
        self._before = [(blocks, set(blocks)) for blocks in (bpy.data.lights, bpy.data.collections)]
        self.scene = bpy.data.scenes.new("lamps")
        camera = bpy.data.cameras.new("camera")
        self.scene.camera = self._link("camera", camera)
        mesh = bpy.data.meshes.new("card")
        corners = [(x * CARD / 2, y * CARD / 2, 0) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
        self._white = diffuse_material(1.0)
        mesh.materials.append(self._white)
        self.card = self._link("card", mesh)
        set_unbiased(self.scene, samples=1, seed=0)
        # Rays through the middle of each pixel, or the silhouette would be blurred.
        self.scene.cycles.pixel_filter_type, self.scene.cycles.filter_width = "BOX", 0.01

    def __enter__(self) -> LampRoom:
        return self

    def __exit__(self, *exception: object) -> None:
        studio.remove_studio(self.scene)
        bpy.data.materials.remove(self._white)
        for blocks, before in self._before:
            for block in set(blocks) - before:
                blocks.remove(block)

    def _link(self, name: str, data: Any) -> bpy.types.Object:
        obj = bpy.data.objects.new(name, data)
        self.scene.collection.objects.link(obj)
        return obj

    def add(self, kind: str, matrix: Matrix | None = None, **settings: Any) -> bpy.types.Object:
        """A lamp that mirrors meet."""
        data = bpy.data.lights.new(kind, kind)
        data.cycles.use_multiple_importance_sampling = True
        for name, value in settings.items():
            setattr(data, name, value)
        lamp = self._link(kind, data)
        lamp.visible_camera = True
        if matrix is not None:
            lamp.matrix_world = matrix
        return lamp

    def empty(self, matrix: Matrix) -> bpy.types.Object:
        """A parent or instancer."""
        obj = self._link("empty", None)
        obj.matrix_world = matrix
        return obj

    def picture(self, eye: Sequence[float], towards: Sequence[float], half_angle: float, size: int = 96) -> Picture:
        """Look at the lamps from a point; the card does not stand in the way."""
        self.card.hide_render = True
        try:
            radiance = self._look(eye, towards, half_angle, size, samples=1)
        finally:
            self.card.hide_render = False
        place = (np.arange(size) + 0.5) / size * 2 - 1
        x, y = np.meshgrid(place, -place)
        reach = math.tan(half_angle)
        rays = np.stack([x * reach, y * reach, np.full_like(x, -1)], -1)
        length = np.linalg.norm(rays, axis=-1)
        turn = np.array(_look_along(eye, towards).to_3x3())
        return Picture(rays / length[..., None] @ turn.T, radiance @ LUMINANCE, (2 * reach / size) ** 2 / length**3)

    def irradiance(self, place: Sequence[float], normal: Sequence[float], samples: int = 256) -> float:
        """Luminance of what the card receives there."""
        up = Vector(normal).normalized()
        self.card.matrix_world = Matrix.Translation(place) @ up.to_track_quat("Z", "Y").to_matrix().to_4x4()
        eye = Vector(place) + 0.1 * up
        seen = self._look(eye, place, math.atan(CARD / 8 / 0.1), 4, samples)
        return float(math.pi * (seen @ LUMINANCE).mean())

    def _look(self, eye: Any, towards: Any, half_angle: float, size: int, samples: int) -> Array:
        camera = self.scene.camera
        camera.matrix_world = _look_along(eye, towards)
        camera.data.angle, camera.data.clip_start = 2 * half_angle, 1e-4
        self.scene.render.resolution_x = self.scene.render.resolution_y = size
        self.scene.cycles.samples = samples
        return studio.render_linear(self.scene).astype(float)


class Picture:
    """Unit directions (N, N, 3) away from the eye, radiance (N, N) as luminance and solid angle (N, N) of pixels."""

    def __init__(self, directions: Array, radiance: Array, solid: Array) -> None:
        self.directions, self.radiance, self.solid = directions, radiance, solid

    @property
    def lit(self) -> NDArray[np.bool_]:
        """Pixels whose middle meets a lamp."""
        return self.radiance > 0

    def irradiance(self, normal: Array) -> float:
        """On a surface at the eye."""
        return float((self.radiance * self.solid * np.maximum(self.directions @ normal, 0)).sum())


def _look_along(eye: Any, towards: Any) -> Matrix:
    eye, towards = Vector(eye), Vector(towards)
    return Matrix.Translation(eye) @ (towards - eye).to_track_quat("-Z", "Y").to_matrix().to_4x4()
