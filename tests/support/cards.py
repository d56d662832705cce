"""Render cards: evaluate a formula of shader nodes at given inputs, exactly and without noise.

The inputs travel in 32-bit images, one texel per pixel of the picture, read with "Closest"; the result is emitted by
a plane that fills an orthographic view. What comes back is what Cycles' SVM (or OSL) computed in float32.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from measured_materials.nodes import compat, expr


def card(function: Callable[..., Any], *inputs: np.ndarray, osl: bool = False) -> list[np.ndarray]:
    """Results of `function` over sockets, each (P,) or (P, 3) float32, for inputs (P,) or (P, 3)."""
    count = len(inputs[0])
    side = int(np.ceil(np.sqrt(count)))
    images = [_input_image(f"card {k}", values, side) for k, values in enumerate(inputs)]
    results: list[np.ndarray] = []
    with _card_scene(side, osl) as (scene, tree), expr.building(tree):
        shown = tree.nodes["emission"].inputs["Color"]
        values = function(*_arguments(images, inputs))
        for value in values if isinstance(values, tuple) else (values,):
            vector = isinstance(value, expr.Vector)
            colour = value if vector else expr.vec(value, value, value)
            # A film cannot be trusted with negative light, so the two signs travel apart.
            parts = []
            for signed in (colour, -colour):
                expr.feed(tree, shown, expr.vector_node("MAXIMUM", signed, expr.vec(0.0, 0.0, 0.0)))
                parts.append(_render(scene, side))
            pixels = (parts[0] - parts[1])[:count]
            results.append(pixels if vector else pixels[:, 0])
    bpy.data.batch_remove(images)
    return results


def _arguments(images: list[bpy.types.Image], inputs: tuple[np.ndarray, ...]) -> list[Any]:
    """Each input as the nodes read it, in the tree being built."""
    x, y, _ = expr.components(expr.Vector(expr.node("ShaderNodeTexCoord", {}, {}).outputs["UV"]))
    taps = [expr.image_tap(image, x, y, "Closest")[0] for image in images]
    return [tap if given.ndim == 2 else expr.components(tap)[0] for tap, given in zip(taps, inputs, strict=True)]


def _input_image(name: str, values: np.ndarray, side: int) -> bpy.types.Image:
    pixels = np.zeros((side * side, 3), np.float32)
    pixels[: len(values)] = values if values.ndim == 2 else values[:, None]
    return data_image(name, pixels.reshape(side, side, 3)[::-1])


def data_image(name: str, pixels: np.ndarray) -> bpy.types.Image:
    """A float32 image of these numbers, (H, W, 3 or 4) with row 0 on top, that Cycles reads unchanged."""
    height, width, channels = pixels.shape
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :channels] = pixels
    image = bpy.data.images.new(name, width, height, float_buffer=True, is_data=True, alpha=True)
    image.alpha_mode = "CHANNEL_PACKED"
    image.use_half_precision = False
    image.pixels.foreach_set(np.ascontiguousarray(rgba[::-1]).ravel())
    image.pack()
    return image


@contextmanager
def _card_scene(side: int, osl: bool) -> Iterator[tuple[bpy.types.Scene, Any]]:
    """A plane that fills the view, and its material's tree, which shines by the node "emission"."""
    scene = bpy.data.scenes.new("card")
    mesh = bpy.data.meshes.new("card")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [], [(0, 1, 2, 3)])
    layer = mesh.uv_layers.new()
    for loop, corner in zip(layer.data, [(0, 0), (1, 0), (1, 1), (0, 1)], strict=True):
        loop.uv = corner
    plane = bpy.data.objects.new("card", mesh)
    scene.collection.objects.link(plane)
    camera = bpy.data.objects.new("card", bpy.data.cameras.new("card"))
    camera.data.type, camera.data.ortho_scale = "ORTHO", 1.0
    camera.location = (0.5, 0.5, 1)
    scene.collection.objects.link(camera)
    scene.camera = camera
    material = compat.new_material("card")
    tree = material.node_tree
    emission, output = tree.nodes.new("ShaderNodeEmission"), tree.nodes.new("ShaderNodeOutputMaterial")
    emission.name = "emission"
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    mesh.materials.append(material)
    scene.render.engine = "CYCLES"
    scene.render.resolution_x = scene.render.resolution_y = side
    scene.render.resolution_percentage = 100
    scene.cycles.samples = 1
    scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
    scene.cycles.sample_clamp_direct = scene.cycles.sample_clamp_indirect = 0
    scene.cycles.shading_system = osl
    # From one result to the next nothing changes but what is emitted.
    scene.render.use_persistent_data = True
    try:
        yield scene, tree
    finally:
        scene.render.use_persistent_data = False
        owned = [plane, mesh, camera, camera.data, material]
        bpy.data.scenes.remove(scene)
        bpy.data.batch_remove(owned)


def _render(scene: bpy.types.Scene, side: int) -> np.ndarray:
    compat.save_as_exr(scene.render.image_settings)
    with tempfile.TemporaryDirectory() as folder:
        scene.render.filepath = str(Path(folder) / "card.exr")
        bpy.ops.render.render(write_still=True, scene=scene.name)
        image = bpy.data.images.load(scene.render.filepath)
        pixels = np.empty(side * side * 4, np.float32)
        image.pixels.foreach_get(pixels)
        bpy.data.images.remove(image)
    return pixels.reshape(-1, 4)[:, :3]
