"""What extensions.blender.org asks for beside the zip: an icon of 256 x 256 and a picture of 1920 x 1080 pixels."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
from commands import baked, commands_of, save
from mathutils import Matrix, Vector
from measured_materials.addon.material.build_brdf import build_brdf, usual_choices
from measured_materials.addon.rendering.contact_sheet import to_display
from measured_materials.addon.rendering.denoising import denoise_renders
from measured_materials.addon.studio.studio import build_studio, remove_studio, render_linear, render_rgba
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.bundle.bundle import read_bundle
from PIL import Image

# Of the gallery, from left to right.
_SHOWN = ("paint", "gold", "steel")
_APART = 2.7
# What lies around them, in parts of their own extent; and the studio's ground, whose end is not to be seen.
_MARGIN, _GROUND = 1.06, 2.0


def make(out: Path, folder: Path) -> None:
    """Bake three, and render both pictures."""
    records = {}
    known = {command[command.index("--out") + 1]: command for command in commands_of("gallery.md")}
    for name in _SHOWN:
        records[name] = BrdfRecord.read(read_bundle(baked(known[f"{name}.mmat"], folder)))
    save(Image.fromarray(_featured(records)), out / "store" / "featured.jpg")
    icon = Image.fromarray(_icon(records["gold"]))
    icon.save(out / "store" / "icon.png", optimize=True)
    print(f"  icon.png: {icon.width} x {icon.height}")


def _featured(records: dict[str, BrdfRecord]) -> object:
    """The studio's ball three times."""
    names = list(records)
    materials = {name: bpy.data.materials.new(name) for name in names}
    scene = build_studio(materials[names[1]], resolution=(1920, 1080), samples=12)
    shown = [o for o in scene.objects if o.type == "MESH" and o.active_material == materials[names[1]]]
    for k, name in enumerate(names):
        if k == 1:
            continue
        for obj in shown:
            twin = obj.copy()
            twin.data = obj.data.copy()
            twin.data.materials.clear()
            twin.data.materials.append(materials[name])
            twin.matrix_world = Matrix.Translation(((k - 1) * _APART, 0, 0)) @ obj.matrix_world
            scene.collection.objects.link(twin)
    for obj in scene.objects:
        if obj.type == "MESH" and obj.active_material not in materials.values():
            obj.scale *= _GROUND
    _frame(scene, [o for o in scene.objects if o.type == "MESH" and o.active_material in materials.values()])
    denoise_renders(scene)
    for name, record in records.items():
        build_brdf(record, materials[name], choices=usual_choices(record), scene=scene)
    try:
        return to_display(render_linear(scene))
    finally:
        remove_studio(scene)


def _frame(scene: bpy.types.Scene, objects: list[bpy.types.Object]) -> None:
    """Move the camera, without turning it, to where all of these are in the picture, with a margin around them."""
    camera = scene.camera
    camera.data.lens = 50
    depsgraph = scene.view_layers[0].depsgraph
    depsgraph.update()
    corners = [obj.matrix_world @ Vector(corner) for obj in objects for corner in obj.bound_box]
    middle = sum(corners, Vector()) / len(corners)
    wide = [middle + _MARGIN * (corner - middle) for corner in corners]
    place, _ = camera.camera_fit_coords(depsgraph, [number for corner in wide for number in corner])
    camera.matrix_world = Matrix.Translation(place) @ camera.matrix_world.to_3x3().to_4x4()


def _icon(record: BrdfRecord) -> object:
    """A sphere alone, without background."""
    material = bpy.data.materials.new("icon")
    scene = build_studio(material, resolution=(256, 256), samples=1024, shape="sphere")
    for obj in scene.objects:
        if obj.type == "MESH" and obj.active_material != material:
            obj.visible_camera = False
    scene.render.film_transparent = True
    scene.camera.data.lens = 96
    build_brdf(record, material, choices=usual_choices(record), scene=scene)
    try:
        pixels = render_rgba(scene)
    finally:
        remove_studio(scene)
    alpha = np.clip(pixels[..., 3:], 0, 1)
    colour = pixels[..., :3] / np.maximum(alpha, 1e-3)  # the file's colours do not hold the cover
    return np.concatenate([to_display(colour), np.rint(255 * alpha).astype(np.uint8)], -1)
