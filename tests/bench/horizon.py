"""A plane that runs to the horizon under a swatch laid without end, in pieces: a few rows at each distance.

The swatch is a weave of a closed form, matte with some gloss, photographed under lights all around.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix
from measured_materials.addon.lights.light_tables import update_scene
from measured_materials.addon.rendering.renderer import set_unbiased
from measured_materials.addon.studio.studio import render_linear
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.maps.bake import MapSettings, maps_of
from measured_materials.bake.maps.folder import MapsFolder, read_maps_folder
from measured_materials.bake.maps.gloss import Gloss
from measured_materials.bake.maps.write import write_maps
from measured_materials.bake.photographs.stack import PhotoStack
from measured_materials.bake.shading_maps.bake import ArcSettings, bake_stack
from measured_materials.bake.source import Array
from measured_materials.nodes import compat
from measured_materials.nodes.surface_inputs import SWATCH_MAPPING

sys.path.insert(1, str(Path(__file__).resolve().parents[1]))

from support.relief import lights, photographs

SIDE = 256  # texels
ELEVATIONS = (10.0, 25.0, 40.0, 55.0, 70.0)
AZIMUTHS = 12
# Radians of a pixel; the camera is a metre above the plane.
PIXEL = 1e-3
_ROWS, _COLUMNS = 6, 64
_SUN = 40.0  # degrees above the plane


@dataclass(frozen=True)
class Piece:
    """Rows of the picture.

    texels : across a pixel, along its shorter axis on the plane
    distance : from the camera, metres
    """

    texels: float
    distance: float

    @property
    def repeat(self) -> float:
        """Swatches a metre."""
        return self.texels / (self.distance * PIXEL * SIDE)


# To the horizon: one swatch of two metres; and seen at half a right angle, a swatch that is ever smaller.
BANDS = tuple(Piece(texels, 8.0 * texels) for texels in (1.0, 4.0, 16.0))
TILTED = tuple(Piece(texels, 2**0.5) for texels in (1.0, 4.0, 16.0))


# --- swatch ---------------------------------------------------------------------------------------------


@cache
def weave() -> tuple[Array, Array]:
    """Photographs (n, H, W, 3) and the directions (n, 3) of their lights."""
    rng = np.random.default_rng(5)
    u, v = np.meshgrid(*[2 * np.pi * 16 * np.arange(SIDE) / SIDE] * 2)
    over = np.sin(u / 2) * np.sin(v / 2) > 0
    heights = 5.0 * np.where(over, np.abs(np.sin(v / 2)), np.abs(np.sin(u / 2)))
    heights += 0.35 * rng.standard_normal(heights.shape)
    directions = lights(ELEVATIONS, AZIMUTHS)
    dye = 1 + 0.15 * rng.standard_normal((SIDE, SIDE, 1))
    matte = photographs(heights, directions) * np.clip(dye, 0.3, 1.2) / np.pi
    p, q = (
        (np.roll(heights, -1, 1) - np.roll(heights, 1, 1)) / 2,
        (np.roll(heights, 1, 0) - np.roll(heights, -1, 0)) / 2,
    )
    normals = np.dstack([-p, -q, np.ones_like(p)])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    told = np.ones(heights.shape, bool)
    gloss = Gloss(np.full(heights.shape, 0.45, np.float32), np.full(heights.shape, 0.06, np.float32), told)
    shone = gloss.shown(directions, normals) * (matte.max(-1) > 0)
    return (matte + shone[..., None]).astype(np.float32), directions


def stack(*, arc: bool) -> PhotoStack:
    """The photographs, or those of them with light from the right."""
    images, directions = weave()
    chosen = np.abs(directions[:, 1]) < 1e-6
    chosen &= directions[:, 0] > -1e-6
    kept = chosen if arc else np.ones(len(images), bool)
    names = tuple(f"light {k}" for k in np.flatnonzero(kept))
    return PhotoStack(images[kept], names, directions[kept], True, ())


def map_bundle(folder: Path, *, arc: bool) -> Bundle:
    """A shading map of one arc, or over azimuth."""
    settings = ArcSettings(azimuths="arc" if arc else "all")
    found = stack(arc=arc)
    return read_bundle(
        bake_stack(found, folder / ("arc" if arc else "around"), settings, way="arc" if arc else "try").path
    )


def plain_maps(folder: Path) -> MapsFolder:
    """Normal, albedo, height, roughness and specular maps of every other of the same photographs."""
    folder = folder / "maps"
    folder.mkdir()
    every = stack(arc=False)
    half = PhotoStack(every.images[::2], every.names[::2], every.directions[::2], True, ())
    maps, facts, _ = maps_of(half, MapSettings(level=False, repeats=True), "weave")
    facts |= {"maps": write_maps(folder, maps, "opengl", "exr")}
    (folder / "maps.json").write_text(json.dumps(facts))
    return read_maps_folder(folder)


# --- picture --------------------------------------------------------------------------------------------


class Horizon:
    """The plane, a sun and an even sky, and a camera that looks at one piece."""

    def __init__(self, scene: bpy.types.Scene, plane: bpy.types.Object, camera: bpy.types.Object) -> None:
        self.scene, self._plane, self._camera = scene, plane, camera
        self._shown: Piece = BANDS[0]

    def show(self, material: bpy.types.Material, piece: Piece) -> None:
        """Lay the swatch out and turn the camera."""
        self._plane.data.materials.clear()
        self._plane.data.materials.append(material)
        mapping = next(n for n in material.node_tree.nodes if n.label == SWATCH_MAPPING)
        mapping.inputs["Scale"].default_value = (piece.repeat, piece.repeat, 1.0)
        self._shown = piece
        self._aim(0.0)
        update_scene(self.scene)

    def whole(self, material: bpy.types.Material, repeat: float, size: tuple[int, int], pixel: float) -> None:
        """All of it from near to far, in so many pixels of so many radians each, with `repeat` swatches a metre."""
        self.show(material, Piece(repeat * 6.0 * PIXEL * SIDE, 6.0))
        self._camera.data.angle = 2 * np.arctan(max(size) * pixel / 2)
        self.scene.render.resolution_x, self.scene.render.resolution_y = size

    def _aim(self, shift: float) -> None:
        """Pixels to the right."""
        down = np.arcsin(1 / self._shown.distance)
        self._camera.matrix_world = (
            Matrix.Translation((0, 0, 1))
            @ Matrix.Rotation(-shift * PIXEL, 4, "Z")
            @ Matrix.Rotation(np.pi / 2 - down, 4, "X")
        )

    def render(self, samples: int, seed: int, shift: float = 0.0) -> Array:
        """Rows (H, W, 3) of the piece."""
        self.scene.render.engine = "CYCLES"
        self.scene.cycles.samples, self.scene.cycles.seed = samples, seed
        self._aim(shift)
        return self.render_as_it_is()

    def use_eevee(self) -> None:
        """Until the next `render`, which is Cycles'."""
        self.scene.render.engine = "BLENDER_EEVEE_NEXT" if bpy.app.version < (5, 0) else "BLENDER_EEVEE"
        self.scene.eevee.taa_render_samples = 16

    def render_as_it_is(self) -> Array:
        """Rows (H, W, 3) by whichever engine and settings the scene has."""
        return render_linear(self.scene).astype(np.float64)


@contextmanager
def horizon(*, ahead: bool = False) -> Iterator[Horizon]:
    """The scene, which is taken away again; the sun stands aside, or `ahead` where a tilted view meets its mirror."""
    compat.ensure_cycles()
    scene = bpy.data.scenes.new("horizon")
    mesh = bpy.data.meshes.new("plane")
    corners = [(-1000, -10, 0), (1000, -10, 0), (1000, 4000, 0), (-1000, 4000, 0)]
    mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
    for loop, (x, y, _) in zip(mesh.uv_layers.new(name="UVMap").data, corners, strict=True):
        loop.uv = (x, y)
    plane = bpy.data.objects.new("plane", mesh)
    sun = bpy.data.lights.new("sun", "SUN")
    sun.energy, sun.angle = 3.0, np.radians(0.53)
    lamp = bpy.data.objects.new("sun", sun)
    # From the right: the side that the arc was lit from.
    lamp.matrix_world = Matrix.Rotation(np.radians(-45 if ahead else 90 - _SUN), 4, "X" if ahead else "Y")
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.angle, camera.data.clip_start, camera.data.clip_end = 2 * np.arctan(_COLUMNS * PIXEL / 2), 0.01, 5000
    for obj in (plane, lamp, camera):
        scene.collection.objects.link(obj)
    scene.camera = camera
    scene.world, background = compat.new_world("even")
    background.inputs["Strength"].default_value = 0.0 if ahead else 0.3
    scene.render.resolution_x, scene.render.resolution_y = _COLUMNS, _ROWS
    set_unbiased(scene, samples=1, seed=0)
    scene.cycles.pixel_filter_type = "BOX"
    owned = [plane, lamp, camera]
    world = scene.world
    try:
        yield Horizon(scene, plane, camera)
    finally:
        data = [obj.data for obj in owned]
        bpy.data.scenes.remove(scene)
        bpy.data.batch_remove({*owned, *data, world})
