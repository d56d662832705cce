"""The built-in studio: a scene in which a material shows highlights, folds and grazing rims, and its rendering."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix, Vector
from numpy.typing import NDArray

from ...bake.errors import BakeError
from ...bake.images.image_io import write_png
from ...nodes import compat
from ..lights import light_tables
from ..rendering.contact_sheet import to_display
from ..rendering.renderer import render_pixels, set_unbiased
from . import studio_meshes

OWNED = "measured_materials_studio"  # custom property of every datablock that remove_studio may delete


def build_studio(
    material: bpy.types.Material,
    *,
    resolution: tuple[int, int] = (480, 480),
    samples: int = 64,
    seed: int = 0,
    environment: Path | None = None,
    shape: str = "ball",
) -> bpy.types.Scene:
    """Make a new scene around a material; the current scene stays as it is. Take it away by `remove_studio`.

    Parameters
    ----------
    resolution : width, height in pixels
    environment : image of the surroundings (latitude and longitude) in place of the soft light and the lamp
    shape : "ball" (a grooved ball in a ring, and a folded swatch) or "sphere" (one plain sphere)

    Raises
    ------
    BakeError : the environment cannot be read
    ValueError : unknown shape
    """
    if shape not in ("ball", "sphere"):
        raise ValueError(f"shape is 'ball' or 'sphere', not {shape!r}")
    world = _soft_world() if environment is None else _image_world(Path(environment))
    compat.ensure_cycles()
    scene = bpy.data.scenes.new("Measured Materials Studio")
    scene[OWNED] = True
    scene.world = world
    _place_shapes(scene, material, shape)
    ground = _add(scene, studio_meshes.backdrop_mesh(curved=environment is None))
    ground.data.materials.append(_ground_material())
    if environment is None:
        _add_lamp(scene)
    _add_camera(scene, shape)
    scene.render.resolution_x, scene.render.resolution_y = resolution
    set_unbiased(scene, samples, seed)
    return scene


def remove_studio(scene: bpy.types.Scene) -> None:
    """Delete the scene and everything `build_studio` made for it; the material it showed stays."""
    owned = [obj.data for obj in scene.collection.all_objects if obj.data is not None]
    slots = [slot for data in owned for slot in getattr(data, "materials", ()) if slot is not None and OWNED in slot]
    world = scene.world
    around = [node for node in world.node_tree.nodes if node.type == "TEX_ENVIRONMENT"] if world else []
    images = [node.image for node in around if node.image]
    objects = list(scene.collection.all_objects)
    bpy.data.scenes.remove(scene)
    bpy.data.batch_remove({*objects, *owned, *slots, *images, *([world] if world else [])})


def render_linear(
    scene: bpy.types.Scene, path: Path | None = None, *, progress: Callable[[float], None] | None = None
) -> NDArray[np.float32]:
    """Render any Cycles scene without its chatter; errors still reach stderr.

    The scene's output format and file path are changed.

    Parameters
    ----------
    path : where to keep the 32-bit OpenEXR file as well
    progress : called with the share of samples done, in [0, 1]

    Returns
    -------
    (H, W, 3) float32, scene-linear Rec.709, row 0 on top

    Raises
    ------
    BakeError : `path` cannot be written
    RuntimeError : Blender could not render
    """
    return render_rgba(scene, path, progress=progress)[..., :3].copy()


def render_rgba(
    scene: bpy.types.Scene, path: Path | None = None, *, progress: Callable[[float], None] | None = None
) -> NDArray[np.float32]:
    """Render as `render_linear` does, with alpha: (H, W, 4)."""
    light_tables.keep_current(scene)  # the handler that would do it runs only where the extension is registered
    return render_pixels(scene, path, progress=progress)


def render_png(
    scene: bpy.types.Scene, path: Path, *, exposure: float = 0.0, progress: Callable[[float], None] | None = None
) -> NDArray[np.float32]:
    """Render to an sRGB PNG that looks the same in every Blender version, and return the linear pixels.

    The view transform is `to_display`, as on the contact sheets: measured colours stay exact, only highlights
    are compressed. Raises as `render_linear`.
    """
    linear = render_linear(scene, progress=progress)
    write_png(Path(path), to_display(linear, exposure))
    return linear


# --- scene ----------------------------------------------------------------------------------------------


def _add(scene: bpy.types.Scene, data: Any, matrix: Matrix | None = None) -> bpy.types.Object:
    obj = bpy.data.objects.new(data.name, data)
    if matrix is not None:
        obj.matrix_world = matrix
    scene.collection.objects.link(obj)
    return obj


def _place_shapes(scene: bpy.types.Scene, material: bpy.types.Material, shape: str) -> None:
    height = Matrix.Translation((0, 0, 1.0 if shape == "sphere" else studio_meshes.RESTING_HEIGHT))
    if shape == "sphere":
        placed = [(studio_meshes.sphere_mesh(), height)]
    else:
        aside = Matrix.Translation((-0.30, 0.35, 0))
        tilt = Matrix.Rotation(0.30, 4, "X") @ Matrix.Rotation(0.22, 4, "Y")
        swatch = Matrix.Translation((1.06, -0.78, 0)) @ Matrix.Rotation(0.30, 4, "Z")
        placed = [
            (studio_meshes.sphere_mesh(256, 256, grooved=True), aside @ height @ tilt),
            (studio_meshes.ring_mesh(), aside),
            (studio_meshes.swatch_mesh(), swatch),
        ]
    for mesh, matrix in placed:
        mesh.materials.append(material)
        _add(scene, mesh, matrix)


def _ground_material() -> bpy.types.Material:
    material = compat.shader_material("Studio ground", "ShaderNodeBsdfDiffuse", {"Color": (0.13, 0.13, 0.13, 1)})
    material[OWNED] = True
    return material


def _look_at(position: tuple[float, float, float], target: tuple[float, float, float]) -> Matrix:
    eye = Vector(position)
    return Matrix.Translation(eye) @ (Vector(target) - eye).to_track_quat("-Z", "Y").to_matrix().to_4x4()


def _add_lamp(scene: bpy.types.Scene) -> None:
    """A soft box to the left of the camera; a lamp without extent or MIS would be invisible to a mirror."""
    lamp = bpy.data.lights.new("Studio lamp", "AREA")
    lamp.shape, lamp.size, lamp.size_y = "RECTANGLE", 2.0, 3.0
    lamp.energy, lamp.color = 370, (1.0, 0.965, 0.92)
    lamp.cycles.use_multiple_importance_sampling = True
    _add(scene, lamp, _look_at((-3.8, -2.2, 4.4), (-0.3, 0, 0.9)))


def _add_camera(scene: bpy.types.Scene, shape: str) -> None:
    camera = bpy.data.cameras.new("Studio camera")
    # All of ball and swatch in a square picture, with a margin.
    camera.lens, target = (74, (0.0, 0.0, 0.95)) if shape == "sphere" else (67, (0.40, 0.0, 0.85))
    camera.sensor_fit = "AUTO"
    scene.camera = _add(scene, camera, _look_at((0.7, -6.9, 2.55), target))


def _soft_world() -> bpy.types.World:
    """Dim below, bright above, with one broad glow behind that draws the grazing rim."""
    world, background = compat.new_world("Studio light")
    tree = world.node_tree

    def node(kind: str, operation: str | None, *inputs: Any) -> Any:
        made = tree.nodes.new(kind)
        if operation:
            made.operation = operation
        for socket, value in zip(made.inputs, inputs):
            if isinstance(value, bpy.types.NodeSocket):
                tree.links.new(value, socket)
            else:
                socket.default_value = value
        return made

    direction = node("ShaderNodeTexCoord", None).outputs["Generated"]
    height = node("ShaderNodeSeparateXYZ", None, direction).outputs["Z"]
    sky = node("ShaderNodeMapRange", None, height, -0.3, 1.0, 0.06, 0.42)
    sky.interpolation_type = "SMOOTHSTEP"
    glow_at = Vector((0.75, 0.62, 0.60)).normalized()
    cosine = node("ShaderNodeVectorMath", "DOT_PRODUCT", direction, glow_at).outputs["Value"]
    falloff = node("ShaderNodeMath", "MULTIPLY_ADD", cosine, 22.0, -22.0).outputs[0]
    glow = node("ShaderNodeMath", "EXPONENT", falloff).outputs[0]
    strength = node("ShaderNodeMath", "MULTIPLY_ADD", glow, 5.0, sky.outputs["Result"]).outputs[0]
    background.inputs["Color"].default_value = (0.93, 0.97, 1.0, 1)
    tree.links.new(strength, background.inputs["Strength"])
    # Cycles would tabulate 2 million directions of this smooth light before every render.
    world.cycles.sampling_method, world.cycles.sample_map_resolution = "MANUAL", 256
    return world


def _image_world(file: Path) -> bpy.types.World:
    try:
        image = bpy.data.images.load(str(file.resolve()), check_existing=False)
    except RuntimeError as error:
        raise BakeError(file, "cannot be read as a picture", "give an .exr or .hdr environment image") from error
    if not image.has_data and image.size[0] == 0:
        bpy.data.images.remove(image)
        raise BakeError(file, "cannot be read as a picture", "give an .exr or .hdr environment image")
    world, background = compat.new_world("Studio environment")
    texture = world.node_tree.nodes.new("ShaderNodeTexEnvironment")
    texture.image = image
    world.node_tree.links.new(texture.outputs["Color"], background.inputs["Color"])
    return world
