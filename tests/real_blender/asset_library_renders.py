"""Run inside a real Blender by asset_library.py: the ball as it was left, fitted, and of the bundle itself."""

import importlib
import sys
from pathlib import Path

import bpy
import numpy as np

PACKAGE = "bl_ext.user_default.measured_materials"
bundle = Path(sys.argv[sys.argv.index("--") + 1]).resolve()
scene, ball = bpy.context.scene, bpy.data.objects["ball"]
render = importlib.import_module(f"{PACKAGE}.addon.studio.studio").render_linear
importlib.import_module(f"{PACKAGE}.addon.rendering.renderer").set_unbiased(scene, 256, 3)
scene.render.resolution_x = scene.render.resolution_y = 64
scene.camera.data.lens = 60

np.save("dropped.npy", render(scene))


def fresh():
    """Nothing of the material that the ball had stays."""
    ball.active_material = None
    for material in list(bpy.data.materials):
        bpy.data.materials.remove(material)
    bpy.ops.outliner.orphans_purge(do_recursive=True)
    bpy.context.view_layer.objects.active = ball


# From Blender 5.0 on a library's materials are usually linked and packed, which nothing can be fitted to.
fresh()
with bpy.data.libraries.load(f"assets/{bundle.stem}.blend", link=False, assets_only=True) as (there, wanted):
    wanted.materials = there.materials
ball.active_material = wanted.materials[0]
bpy.ops.measured_materials.fit_to_scene()
np.save("fitted.npy", render(scene))

fresh()
bpy.ops.measured_materials.import_bundle(filepath=str(bundle))
bpy.ops.measured_materials.fit_to_scene()
np.save("built.npy", render(scene))
