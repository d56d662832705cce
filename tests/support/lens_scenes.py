"""A wall that shows which numbers a shader draws from the camera's lens, seen by cameras of all kinds."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix
from measured_materials.addon.lights.moving_camera import follow_cameras
from measured_materials.addon.rendering.renderer import render_pixels, set_unbiased
from measured_materials.nodes import compat, expr
from measured_materials.nodes.group import call
from measured_materials.nodes.lens_group import lens_group, lens_numbers
from measured_materials.nodes.osl_script import output, script_node, use_osl, with_headers
from measured_materials.nodes.stochastic_mirror_group import random_numbers_group
from numpy.typing import NDArray

EDGE, SAMPLES, DISTANCE = 32, 64, 5.0
# Variances of u, v, u v for even and independent u and v, and of the step u + v < 1.
VARIANCES = 1 / 12, 1 / 12, 7 / 144, 1 / 4
_OSL = """#include "measured_materials.h"
shader shown(vector Lens = 0, output color Numbers = 0, output float Step = 0)
{
  float xi[9];
  mm_random(P, I, u, v, xi);
  mm_by_lens(Lens, xi[0], xi[1]);
  Numbers = color(xi[0], xi[1], xi[0] * xi[1]);
  Step = xi[0] + xi[1] < 1;
}
"""


class LensScene:
    """A wall that fills the view of a camera at f/64, `DISTANCE` away.

    Attributes
    ----------
    scene, camera, wall : to change
    """

    def __init__(self, osl: bool) -> None:
        compat.ensure_cycles()
        self.scene = bpy.data.scenes.new("lens")
        set_unbiased(self.scene, SAMPLES, 0)
        self.scene.render.resolution_x = self.scene.render.resolution_y = EDGE
        # So few pixels are wide, and blur is told in pixels: as it would be in a picture of 1920.
        data = bpy.data.cameras.new("lens")
        data.dof.use_dof, data.dof.aperture_fstop, data.dof.focus_distance = True, 64.0, DISTANCE
        self.camera = self._add("camera", data)
        mesh = bpy.data.meshes.new("wall")
        mesh.from_pydata([(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)], [], [(0, 1, 2, 3)])
        self.wall = self._add("wall", mesh)
        self.wall.location.z = -DISTANCE
        self.scene.camera = self.camera
        self.materials = [_showing(step, osl) for step in (False, True)]
        if osl:
            use_osl(self.scene)

    def _add(self, name: str, data: Any) -> bpy.types.Object:
        obj = bpy.data.objects.new(name, data)
        self.scene.collection.objects.link(obj)
        return obj

    def move(self, matrix: Matrix) -> None:
        """Place camera and wall elsewhere together."""
        self.scene.view_layers[0].update()
        for obj in (self.camera, self.wall):
            obj.matrix_world = matrix @ obj.matrix_world

    def numbers(self, samples: int = SAMPLES) -> NDArray[np.float64]:
        """Pixel means (EDGE, EDGE, 4) of u, v, u v and u + v < 1."""
        self.scene.cycles.samples = samples
        follow_cameras()
        parts = []
        for material in self.materials:
            self.wall.data.materials.clear()
            self.wall.data.materials.append(material)
            parts.append(render_pixels(self.scene)[..., :3])
        return np.concatenate([parts[0], parts[1][..., :1]], -1).astype(np.float64)

    def remove(self) -> None:
        """Take everything away."""
        datas = [obj.data for obj in self.scene.objects]
        objects = list(self.scene.objects)
        bpy.data.scenes.remove(self.scene)
        bpy.data.batch_remove([*objects, *(data for data in datas if data is not None), *self.materials])


@contextmanager
def lens_scene(osl: bool = False) -> Iterator[LensScene]:
    """`LensScene`, removed in the end."""
    scene = LensScene(osl)
    try:
        yield scene
    finally:
        scene.remove()


def evenness(means: NDArray[np.float64], samples: int = SAMPLES) -> NDArray[np.float64]:
    """Variance of pixel means in parts of what white noise would have: (4,), of u, v, u v and u + v < 1."""
    return means.reshape(-1, 4).var(0, ddof=1) * samples / VARIANCES


def _showing(step: bool, osl: bool) -> bpy.types.Material:
    material = compat.new_material("shown numbers")
    material.cycles.emission_sampling = "NONE"
    tree = material.node_tree
    with expr.building(tree):
        shown = (_of_script if osl else _of_nodes)(step)
        emission = expr.node("ShaderNodeEmission", {}, {"Color": shown, "Strength": 1.0})
        expr.node("ShaderNodeOutputMaterial", {}, {"Surface": expr.Scalar(emission.outputs[0])})
    return material


def _of_nodes(step: bool) -> Any:
    u, v = call(lens_group(), *call(random_numbers_group())[:2])
    first = (u + v) < 1 if step else u
    return expr.vec(first, v, u * v)


def _of_script(step: bool) -> Any:
    inputs = {"Lens": expr.vec(*lens_numbers())}
    node = script_node("shown.osl", with_headers("shown.osl", _OSL), inputs)
    if step:
        value = output(node, "Step")
        return expr.vec(value, value, value)
    return output(node, "Numbers")


Change = Callable[[LensScene], Any]
