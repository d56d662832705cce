"""Run inside a real Blender by check.py: the operators as the window calls them, and what a .blend keeps."""

import shutil
import sys
from pathlib import Path

import bpy

sys.path.insert(0, str(Path.cwd()))
from common import PACKAGE, require


def registered():
    """Whether the extension is there."""
    return hasattr(bpy.types, "MEASURED_MATERIALS_PT_material") and hasattr(bpy.types.Material, "measured_materials")


require(registered(), "not registered at the start")
for _ in range(2):
    bpy.ops.preferences.addon_disable(module=PACKAGE)
    require(not registered(), "something stayed when it was disabled")
    bpy.ops.preferences.addon_enable(module=PACKAGE)
    require(registered(), "not registered again")

cube = bpy.context.object
here = str(Path.cwd())
bpy.ops.measured_materials.import_brdf(
    directory=here, files=[{"name": "lacquer.binary"}], resolution=8, alpha="given", bundles=here
)
material = cube.active_material
require(material.name == "lacquer", "the cube has not got the material")
material.measured_materials.resolution = 12
bpy.ops.measured_materials.bake_again()
require(cube.active_material == material, "baking again changed the material's identity")

bpy.ops.wm.save_as_mainfile(filepath=str(Path(here, "saved.blend")))
require(bpy.ops.measured_materials.mark_asset() == {"FINISHED"}, "the material was not marked as an asset")
data, catalogues = material.asset_data, Path(here, "blender_assets.cats.txt")
require(data.catalog_id in catalogues.read_text(encoding="utf-8"), "its catalogue is not in the library")
require([tag.name for tag in data.tags] == ["Measured", "MERL", "Paint"], "the tags are others")
bpy.ops.wm.save_mainfile()
bpy.ops.wm.open_mainfile(filepath=str(Path(here, "saved.blend")))
material = bpy.data.materials["lacquer"]
require(tuple(material.preview.image_size) == (128, 128), "the asset's picture was not saved")
require(material.asset_data.description.startswith("Measured reflectance (MERL): lacquer."), "nor its description")
require(material.measured_materials.resolution == 12, "the settings were not saved")
images = [image for image in bpy.data.images if image.name.startswith("lacquer")]
require(len(images) > 2, f"the textures were not kept: {images}")
unpacked = [image.name for image in images if not image.packed_file]
require(not unpacked, f"textures were not packed: {unpacked}")
require(all(image.colorspace_settings.name == "Non-Color" for image in images), "the textures have a colour space")
shutil.rmtree(Path(here, "lacquer.mmat"))
for mode in ("preview", "balanced", "reference", "exact"):
    material.measured_quality.mode = mode
    require(not material.measured_quality.problem, f"mode {mode}: {material.measured_quality.problem}")
    require(material.measured_quality.mode == mode, f"mode {mode} was set back")
print("inside: all is well")
