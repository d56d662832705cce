"""What programs that run inside a real Blender share; see check.py."""

import importlib
from pathlib import Path

import bpy

PACKAGE = "bl_ext.user_default.measured_materials"
HERE = Path.cwd()


def ours(name):
    """A module of the extension."""
    return importlib.import_module(f"{PACKAGE}.{name}")


def require(good, words):
    """Unlike assert, also under python -O."""
    if not good:
        raise RuntimeError(words)


def empty_scene(size=16, samples=4):
    """A new file without anything but a camera, rendered by Cycles to small OpenEXR files."""
    bpy.ops.wm.read_homefile(use_empty=True)
    ours("nodes.compat").ensure_cycles()
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_adaptive_sampling, scene.cycles.use_denoising = samples, False, False
    scene.render.resolution_x = scene.render.resolution_y = size
    ours("nodes.compat").save_as_exr(scene.render.image_settings)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.location = (0, 0, 6)
    scene.collection.objects.link(camera)
    scene.camera = camera
    return scene


def square(scene, x=0.0):
    """An object of one face with texture coordinates, active."""
    bpy.ops.mesh.primitive_plane_add(size=2, location=(x, 0, 0))
    return bpy.context.object


def lamp(scene, place, energy=200.0, size=0.5):
    """An area lamp that shines downwards."""
    data = bpy.data.lights.new("lamp", "AREA")
    data.energy, data.size = energy, size
    obj = bpy.data.objects.new("lamp", data)
    obj.location = place
    scene.collection.objects.link(obj)
    return obj


def lacquer(folder, name="lacquer", resolution=8):
    """The active object gets a measured paint, of a table small enough to be made in a second."""
    bpy.ops.measured_materials.import_brdf(
        directory=str(HERE),
        files=[{"name": f"{name}.binary"}],
        resolution=resolution,
        alpha="given",
        bundles=str(folder),
    )
    return bpy.context.object.active_material


def felt(folder):
    """The active object gets a shading map of photographs."""
    bpy.ops.measured_materials.import_arc(filepath=str(HERE / "felt"), bundles=str(folder))
    return bpy.context.object.active_material


def pixels(image):
    """All of an image's numbers."""
    import numpy as np

    values = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(values)
    return values


def save(file):
    """Without the file manager's questions."""
    bpy.ops.wm.save_as_mainfile(filepath=str(file), check_existing=False)


def open_again(file):
    """As a user opens it."""
    bpy.ops.wm.open_mainfile(filepath=str(file))
