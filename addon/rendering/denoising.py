"""Pictures denoised by what measured materials know of themselves, and never by what their mirrors met.

A material of nodes writes albedo and normal as it is rendered (`nodes.feature_passes`). Cycles' OSL writes no such
passes: of a material of OSL they come from a twin of nodes, in a second picture without any light.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ...bake.brdf.record import BrdfRecord
from ...bake.errors import BakeError
from ...bake.shading_maps.record import Record
from ...nodes import compat
from ...nodes.feature_passes import (
    albedo_polynomial,
    compositor_of,
    compositor_output,
    denoise_by_features,
    shown_features,
    stop_denoising,
)
from ...nodes.material import build_material, usual_mode
from .renderer import render_pixels

Array = NDArray[np.float32]

AUTO, ALWAYS, NEVER = "auto", "always", "never"
CHOICES = (AUTO, ALWAYS, NEVER)
# Samples from which a picture is left as it is unasked.
ENOUGH = 256
# The passes are free of noise where nothing is transparent or blurred: only edges take samples, each one in its pixel.
_FEATURE_SAMPLES = 16


@dataclass(frozen=True)
class Denoising:
    """Whether a picture is denoised, and why."""

    done: bool
    why: str

    def words(self, linear_too: bool) -> str:
        """What a reader of the picture has to know, in one line."""
        if not self.done:
            return f"not denoised: {self.why}"
        what = "picture and .exr are" if linear_too else "the picture is"
        return f"{what} denoised by the material's albedo and normals: {self.why}; --denoise never leaves the noise"


def plan_denoising(choice: str, samples: int, record: Record | None = None) -> Denoising:
    """What to do about the noise of a picture of a bundle. Raises BakeError where what is asked for cannot be had."""
    if choice == NEVER:
        return Denoising(False, "asked for")
    lacking = why_not_possible() or _unknown_albedo(record)
    if choice == ALWAYS:
        if lacking:
            raise BakeError("--denoise always", f"cannot be had: {lacking}", "leave it to auto, which does without")
        return Denoising(True, "asked for")
    if samples >= ENOUGH:
        return Denoising(False, f"{samples} samples, {ENOUGH} or more")
    if lacking:
        return Denoising(False, lacking)
    return Denoising(True, f"{samples} samples, fewer than {ENOUGH}")


def why_not_possible() -> str:
    """Why this Blender cannot denoise; empty if it can."""
    compat.ensure_cycles()
    try:
        built_in = bool(importlib.import_module("_cycles").with_openimagedenoise)
    except (ImportError, AttributeError):
        built_in = False
    return "" if built_in else "this Blender lacks Open Image Denoise"


def _unknown_albedo(record: Record | None) -> str:
    """Why a bundle cannot write its albedo; empty if it can. A shading map's is in its texels."""
    if isinstance(record, BrdfRecord):
        try:
            albedo_polynomial(record)
        except BakeError as error:
            return error.cause
    return ""


def denoise_renders(scene: bpy.types.Scene) -> None:
    """Have a scene's renders denoised by the passes of its materials, whose edges only are rough."""
    denoise_by_features(scene, prefilter="NONE")


def denoise_by_twin(
    twin: bpy.types.Material,
    scene: bpy.types.Scene,
    material: bpy.types.Material,
    noisy: Array,
    path: Path | None = None,
) -> Array:
    """The scene's picture (H, W, 3) without its noise, where its material cannot write the passes itself.

    Parameters
    ----------
    twin : of nodes, and writes the passes, as `twin_of` makes one; it is removed
    path : where to keep the 32-bit OpenEXR file as well
    """
    try:
        return denoised(noisy, *features_of(scene, material, twin), path)
    finally:
        bpy.data.materials.remove(twin)


def twin_of(record: BrdfRecord) -> bpy.types.Material:
    """A BRDF's material of nodes that writes the passes: of Preview, whose closures are cheap; any mode writes the
    same."""
    return build_material(
        record, mode="preview" if record.has("preview_weights") else usual_mode(record), features=True
    )


def features_of(scene: bpy.types.Scene, material: bpy.types.Material, twin: bpy.types.Material) -> tuple[Array, Array]:
    """Albedo and normal, (H, W, 3) each, of a scene where `twin` stands for `material`; the scene is left as it was.

    Parameters
    ----------
    twin : of nodes, and writes the passes
    """
    found = []
    with _worn(scene, material, twin), _unlit(scene):
        for shown in shown_features(scene):
            tree = compositor_of(scene)
            tree.links.new(shown, compositor_output(tree))
            found.append(render_pixels(scene)[..., :3].copy())
        stop_denoising(scene)
    return found[0], found[1]


def denoised(noisy: Array, albedo: Array, normal: Array, path: Path | None = None) -> Array:
    """A picture (H, W, 3) without its noise, by passes of the same size; kept as OpenEXR under `path` too."""
    scene = bpy.data.scenes.new("Measured Materials Denoising")
    images: list[bpy.types.Image] = []
    try:
        scene.render.resolution_y, scene.render.resolution_x = noisy.shape[:2]
        scene.render.resolution_percentage = 100
        scene.render.use_compositing, scene.render.use_sequencer = True, False
        tree = compositor_of(scene)
        denoise = tree.nodes.new("CompositorNodeDenoise")
        if "Prefilter" in denoise.inputs:
            denoise.inputs["Prefilter"].default_value = "None"
        else:
            denoise.prefilter = "NONE"
        for name, pixels in (("Image", noisy), ("Albedo", albedo), ("Normal", normal)):
            images.append(_image(name, pixels))
            source = tree.nodes.new("CompositorNodeImage")
            source.image = images[-1]
            tree.links.new(source.outputs["Image"], denoise.inputs[name])
        tree.links.new(denoise.outputs[0], compositor_output(tree))
        return render_pixels(scene, path)[..., :3].copy()
    finally:
        group = getattr(scene, "compositing_node_group", None)
        bpy.data.scenes.remove(scene)
        if group is not None:
            bpy.data.node_groups.remove(group)
        bpy.data.batch_remove(images)


def _image(name: str, pixels: Array) -> bpy.types.Image:
    image = bpy.data.images.new(f"MM {name}", pixels.shape[1], pixels.shape[0], float_buffer=True, is_data=True)
    rows = np.ones((*pixels.shape[:2], 4), np.float32)
    rows[..., :3] = pixels[::-1]
    image.pixels.foreach_set(rows.ravel())
    image.update()
    return image


@contextmanager
def _worn(scene: bpy.types.Scene, material: bpy.types.Material, twin: bpy.types.Material) -> Iterator[None]:
    slots = [slot for obj in scene.objects for slot in obj.material_slots if slot.material == material]
    for slot in slots:
        slot.material = twin
    try:
        yield
    finally:
        for slot in slots:
            slot.material = material


@contextmanager
def _unlit(scene: bpy.types.Scene) -> Iterator[None]:
    """Few samples of what the camera sees, by nodes."""
    settings = {"samples": _FEATURE_SAMPLES, "max_bounces": 0, "shading_system": False}
    kept: dict[str, Any] = {name: getattr(scene.cycles, name) for name in settings}
    composited = scene.render.use_compositing
    try:
        for name, value in settings.items():
            setattr(scene.cycles, name, value)
        yield
    finally:
        for name, value in kept.items():
            setattr(scene.cycles, name, value)
        scene.render.use_compositing = composited
