"""The scene of `bench engine`: a sphere of the material above grey ground in four kinds of light, and its noise."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Matrix, Vector
from measured_materials.addon.lights.light_tables import lamp_image, lamp_light_image, survey_scene, update_scene
from measured_materials.addon.lights.seen_world import surroundings_of
from measured_materials.addon.rendering.renderer import set_unbiased
from measured_materials.addon.studio import studio_meshes
from measured_materials.addon.studio.studio import OWNED, remove_studio, render_linear
from measured_materials.bake.bundle.bundle import Bundle
from measured_materials.bake.source import Array
from measured_materials.nodes import compat
from measured_materials.nodes.group import trees_below
from measured_materials.nodes.osl_material import build_osl_material

# A pixel of the fireflies' picture is so many times so many, each of one sample: 256 samples a pixel, all of them kept.
FOLD = 16
# Pixels darker than this part of the picture's mean are left out of the search: hardly anything lights them.
_DARKEST = 0.02
# Brightness that is added before a pixel's noise is divided by its own.
_FLOOR = 0.1
_TARGET = Vector((0, 0, 0))


@dataclass(frozen=True)
class Sizes:
    """Edge of a picture in pixels, its samples, the fewer samples that set-up is told apart by, seeds, firefly edge."""

    edge: int = 56
    samples: int = 64
    few: int = 4
    seeds: int = 2
    firefly_edge: int = 20


@dataclass(frozen=True)
class Noise:
    """Of one material in one light.

    Attributes
    ----------
    rms : of a pixel at `Sizes.samples`, over the mean of all pixels of the material
    local : of a pixel over its own brightness and a tenth of the mean; RMS over the pixels
    mean : of the material's pixels and channels
    seconds : processor time of a million camera samples, set-up taken off
    firefly : largest of 256 samples over the mean of its pixel, in any pixel
    """

    rms: float
    local: float
    mean: float
    seconds: float
    firefly: float


# --- light -----------------------------------------------------------------------------------------------


def _sky(scene: bpy.types.Scene) -> None:
    _even(scene, (0.8, 0.9, 1.0), 1.0)


def square_lamp(scene: bpy.types.Scene, edge: float = 0.1) -> None:
    """At a distance of 2 from the sphere."""
    _even(scene, (0, 0, 0), 0.0)
    lamp = bpy.data.lights.new("lamp", "AREA")
    lamp.energy, lamp.size = 60, edge
    lamp.cycles.use_multiple_importance_sampling = True
    _place(scene, lamp, 3 * Vector((0.5, -0.62, 0.6)).normalized())


def _sun(scene: bpy.types.Scene) -> None:
    _even(scene, (0.5, 0.7, 1.0), 0.3)
    sun = bpy.data.lights.new("sun", "SUN")
    sun.energy, sun.angle = 3, math.radians(0.526)
    sun.cycles.use_multiple_importance_sampling = True
    _place(scene, sun, 5 * Vector((0.5, -0.62, 0.6)).normalized())


def _room(scene: bpy.types.Scene) -> None:
    """A picture all around: a smooth sky, and a bright window 14 degrees wide."""
    scene.world, background = compat.new_world("room")
    pixels = room_pixels()
    height, width, _ = pixels.shape
    image = bpy.data.images.new("room", width, height, float_buffer=True, is_data=True)
    image.pixels.foreach_set(np.concatenate([pixels[::-1], np.ones_like(pixels[..., :1])], -1).ravel())
    image.pack()
    tree = scene.world.node_tree
    around = tree.nodes.new("ShaderNodeTexEnvironment")
    around.image = image
    tree.links.new(around.outputs["Color"], background.inputs["Color"])
    # Cycles would tabulate 2 million directions of these pixels before every render.
    scene.world.cycles.sampling_method, scene.world.cycles.sample_map_resolution = "MANUAL", 512


def room_pixels() -> Array:
    """(128, 256, 3) float32, row 0 at the zenith; the window gives about half of the light."""
    rows, columns = np.mgrid[:128, :256]
    height = np.cos((rows + 0.5) / 128 * np.pi)
    pixels = (0.3 + 0.2 * height + 0.05 * np.cos(columns * np.pi / 64))[..., None] * np.array([0.8, 0.9, 1.0])
    # To the right of the camera and above it, where the lamps of the other scenes are.
    pixels[34:44, 164:174] = np.array([1.0, 0.92, 0.8]) * 70
    return pixels.astype(np.float32)


LIGHTS: dict[str, Callable[[bpy.types.Scene], None]] = {
    "sky": _sky,
    "small lamp": square_lamp,
    "sun and sky": _sun,
    "HDR world": _room,
}


def _even(scene: bpy.types.Scene, colour: tuple[float, float, float], strength: float) -> None:
    scene.world, background = compat.new_world("even")
    background.inputs["Color"].default_value = (*colour, 1)
    background.inputs["Strength"].default_value = strength


# --- scene -----------------------------------------------------------------------------------------------


@contextmanager
def lit(light: str | Callable[[bpy.types.Scene], None]) -> Iterator[bpy.types.Scene]:
    """The scene in one of `LIGHTS`, or as a function lights it.

    The sphere alone is seen directly, the ground only by what it reflects.
    """
    compat.ensure_cycles()
    scene = bpy.data.scenes.new("engine")
    sphere = _place(scene, studio_meshes.sphere_mesh(128, 64))
    sphere.name, sphere.shadow_terminator_geometry_offset = "sphere", 0
    ground = _place(scene, studio_meshes.backdrop_mesh(curved=False))
    ground.matrix_world = Matrix.Translation((0, 0, -1))
    ground.visible_camera = False
    ground.data.materials.append(_grey())
    camera = bpy.data.cameras.new("camera")
    camera.type, camera.ortho_scale = "ORTHO", 2.0
    scene.camera = _place(scene, camera, Vector((0, -5, 1.5)))
    set_unbiased(scene, samples=1, seed=0)
    scene.render.film_transparent = True
    scene.cycles.pixel_filter_type = "BOX"
    (LIGHTS[light] if isinstance(light, str) else light)(scene)
    try:
        yield scene
    finally:
        remove_studio(scene)


def show(scene: bpy.types.Scene, material: bpy.types.Material) -> None:
    """Put a material on the sphere, and let it aim at the scene's light."""
    slots = next(obj for obj in scene.objects if obj.name.startswith("sphere")).data.materials
    slots.clear()
    slots.append(material)
    # Only what is OSL is rendered by it: it slows down nodes.
    scene.cycles.shading_system = any(
        node.bl_idname == "ShaderNodeScript" for tree in trees_below(material.node_tree) for node in tree.nodes
    )
    update_scene(scene)


def one_script(bundle: Bundle, scene: bpy.types.Scene) -> bpy.types.Material:
    """Mode Exact as one script of OSL, which samples the scene's lamps and its picture."""
    around = surroundings_of(survey_scene(scene))
    return build_osl_material(bundle, mode="exact", lamps=lamp_image(), lights=lamp_light_image(), surroundings=around)


def _grey() -> bpy.types.Material:
    material = compat.shader_material("ground", "ShaderNodeBsdfDiffuse", {"Color": (0.3, 0.3, 0.3, 1)})
    material[OWNED] = True
    return material


def _place(scene: bpy.types.Scene, data: bpy.types.ID, eye: Vector | None = None) -> bpy.types.Object:
    """An object at the origin or, at `eye`, turned to it."""
    obj = bpy.data.objects.new(data.name, data)
    if eye is not None:
        obj.matrix_world = Matrix.Translation(eye) @ (_TARGET - eye).to_track_quat("-Z", "Y").to_matrix().to_4x4()
    scene.collection.objects.link(obj)
    return obj


# --- measurement -----------------------------------------------------------------------------------------


def on_sphere(edge: int) -> Array:
    """(edge, edge) bool: pixels that lie on the sphere wholly; it fills the picture's width."""
    corners = np.abs(np.linspace(-1, 1, edge + 1)[:, None]) ** 2 + np.linspace(-1, 1, edge + 1) ** 2 < 0.97
    return corners[1:, 1:] & corners[1:, :-1] & corners[:-1, 1:] & corners[:-1, :-1]


def compare(scene: bpy.types.Scene, materials: dict[str, bpy.types.Material], sizes: Sizes) -> dict[str, Noise]:
    """Noise of several materials in one scene; they take turns, so that whatever disturbs the clock meets all alike."""
    pictures: dict[str, list[Array]] = {name: [] for name in materials}
    long: dict[str, list[float]] = {name: [] for name in materials}
    short: dict[str, list[float]] = {name: [] for name in materials}
    for seed in range(sizes.seeds):
        for name, material in materials.items():
            show(scene, material)
            # The first picture of a material also compiles its graph.
            _timed(scene, sizes.edge, 1, seed)
            short[name].append(_timed(scene, sizes.edge, sizes.few, seed)[1])
            pixels, seconds = _timed(scene, sizes.edge, sizes.samples, seed)
            pictures[name].append(pixels)
            long[name].append(seconds)
    mask = on_sphere(sizes.edge)
    found = {}
    for name, material in materials.items():
        show(scene, material)
        values = np.stack(pictures[name])[:, mask].astype(np.float64)
        mean, variance = float(values.mean()), values.var(0, ddof=1)
        rms = math.sqrt(float(variance.mean())) / mean
        brightness = values.mean((0, 2)) + _FLOOR * mean
        local = math.sqrt(float((variance.mean(-1) / brightness**2).mean()))
        rendered = (sizes.samples - sizes.few) * sizes.edge**2 / 1e6
        seconds = (min(long[name]) - min(short[name])) / rendered
        found[name] = Noise(rms, local, mean, seconds, _firefly(scene, sizes.firefly_edge))
    return found


def _timed(scene: bpy.types.Scene, edge: int, samples: int, seed: int) -> tuple[Array, float]:
    """Pixels, and seconds of all processors."""
    scene.render.resolution_x = scene.render.resolution_y = edge
    scene.cycles.samples, scene.cycles.seed = samples, seed
    started = time.process_time()
    return render_linear(scene), time.process_time() - started


def _firefly(scene: bpy.types.Scene, edge: int) -> float:
    """Largest sample over the mean of its pixel's 256.

    Of direct light and one bounce: beyond, any glossy material throws caustics that other surfaces find by chance.
    """
    bounces, scene.cycles.max_bounces = scene.cycles.max_bounces, 1
    single, _ = _timed(scene, edge * FOLD, 1, 7)
    scene.cycles.max_bounces = bounces
    samples = single.mean(-1).reshape(edge, FOLD, edge, FOLD).swapaxes(1, 2).reshape(edge, edge, -1)[on_sphere(edge)]
    mean = samples.mean(-1)
    seen = mean > _DARKEST * mean.mean()
    return float((samples.max(-1)[seen] / mean[seen]).max())
