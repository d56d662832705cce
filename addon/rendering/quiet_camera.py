"""Quiet Camera: depth of field that nobody sees, for the even numbers that its lens gives (method.md, section 14)."""

from __future__ import annotations

from collections.abc import Iterable

import bpy
from mathutils import Vector

from ...bake.errors import BakeError
from ...nodes.lens_group import MOST_BLUR

# Radius of the blur of what is far away, in pixels: an edge there then is off by 0.12 pixels in the mean.
BLUR = 0.3
LEAST_STOP = 64.0
FLAT = ("PERSP", "ORTHO")


def quiet_camera(scene: bpy.types.Scene, objects: Iterable[bpy.types.Object]) -> str:
    """Turn depth of field of the scene's camera on at an aperture so small that the picture stays; says what it did.

    Depth of field that is on already is left as it is.

    Parameters
    ----------
    objects : that are to be in focus, such as those with measured materials

    Raises
    ------
    BakeError : there is no camera, or none that this is for
    """
    camera = scene.camera
    if camera is None or camera.type != "CAMERA":
        raise BakeError(f"scene {scene.name}", "has no camera", "add one")
    data = camera.data
    if data.type not in FLAT:
        raise BakeError(f"camera {camera.name}", "has no flat picture", "choose Perspective or Orthographic")
    if not data.is_editable:
        raise BakeError(f"camera {camera.name}", "is linked from another file", "make it local")
    if data.dof.use_dof:
        return f"depth of field of {camera.name} is on already, at {_stop(data)}; {used_words(scene)}"
    near, far = _depths(camera, objects) or (data.dof.focus_distance,) * 2
    near = max(near, data.clip_start)
    if data.type == "PERSP":
        focus = near
        stop = data.lens / (2000 * BLUR * _pixel(scene) * focus)
    else:
        focus = max((near + far) / 2, near)
        slope = min(BLUR * _pixel(scene) / max((far - near) / 2, 1e-6), BLUR / _pixels(scene))
        stop = 1 / (2 * slope * focus)
    data.dof.use_dof, data.dof.focus_object, data.dof.focus_distance = True, None, focus
    data.dof.aperture_fstop = max(stop, LEAST_STOP)
    return f"depth of field of {camera.name} is on at {_stop(data)}, focused at {focus:.3g}; {used_words(scene)}"


def is_used(scene: bpy.types.Scene) -> bool:
    """Whether depth of field is on, and its blur so narrow that materials draw numbers from the lens."""
    camera = scene.camera
    if camera is None or camera.type != "CAMERA" or camera.data.type not in FLAT:
        return False
    dof = camera.data.dof
    return dof.use_dof and dof.focus_object is None and blur_of(scene) < MOST_BLUR


def used_words(scene: bpy.types.Scene) -> str:
    """What the camera's depth of field does to the picture and to measured materials, in words."""
    if scene.camera.data.dof.focus_object is not None:
        return "it follows an object, and measured materials do not use it"
    if not is_used(scene):
        return f"what is far away blurs over {blur_of(scene):.2g} pixels, and measured materials do not use it"
    words = f"what is far away blurs over {blur_of(scene):.2g} pixels"
    samples = scene.cycles.samples
    return words if is_even(samples) else f"{words}; {even_samples(samples)} samples are worth more than {samples}"


def blur_of(scene: bpy.types.Scene) -> float:
    """Radius in pixels of the blur of what is far away; of an orthographic camera, as far as the picture is wide."""
    data = scene.camera.data
    stop, focus = max(data.dof.aperture_fstop, 1e-5), max(data.dof.focus_distance, 1e-5)
    if data.type == "ORTHO":
        return float(_pixels(scene) / (2 * stop * focus))
    return float(data.lens / (2000 * stop * focus * _pixel(scene)))


def is_even(samples: int) -> bool:
    """Whether a number of samples is a power of two, at which the numbers are spread most evenly."""
    return samples & (samples - 1) == 0


def even_samples(samples: int) -> int:
    """The nearest power of two by proportion."""
    lower = 1 << (samples.bit_length() - 1)
    return lower if samples * samples < 2 * lower * lower else 2 * lower


def _stop(data: bpy.types.Camera) -> str:
    return f"f/{data.dof.aperture_fstop:.3g}"


def _pixels(scene: bpy.types.Scene) -> float:
    render = scene.render
    return float(max(render.resolution_x, render.resolution_y) * render.resolution_percentage / 100)


def _pixel(scene: bpy.types.Scene) -> float:
    """A pixel's width in the world at distance 1, of an orthographic camera at any."""
    data = scene.camera.data
    width = data.sensor_width / data.lens if data.type == "PERSP" else data.ortho_scale
    return float(width / _pixels(scene))


def _depths(camera: bpy.types.Object, objects: Iterable[bpy.types.Object]) -> tuple[float, float] | None:
    """Distances before the camera of the nearest and the farthest corner of objects' bounding boxes, if any."""
    to_camera = camera.matrix_world.normalized().inverted()
    depths = [-(to_camera @ (obj.matrix_world @ Vector(corner))).z for obj in objects for corner in obj.bound_box]
    before = [depth for depth in depths if depth > 0]
    return (min(before), max(before)) if before else None
