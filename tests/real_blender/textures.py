"""Run inside a real Blender by check.py: two materials of two bundles in one file, unpacked, each keeps its own pixels.

Arguments: a folder to make, and whether the file is one that a version before has left, all of whose bundles' images
were called alike ("older"), or one of today ("new").
"""

import shutil
import sys
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path.cwd()))
from common import HERE, empty_scene, felt, lacquer, lamp, open_again, ours, pixels, require, save, square

NAME, KIND = sys.argv[sys.argv.index("--") + 1 :][:2]
FOLDER = HERE / NAME
data_image, kept = ours("nodes.data_image"), ours("addon.material.textures.kept")


def build():
    """A canvas-like felt and a satin-like lacquer beside each other, packed."""
    scene = empty_scene()
    lamp(scene, (0, 1, 3))
    FOLDER.mkdir()
    for x, make in ((-1.0, felt), (1.0, lacquer)):
        square(scene, x)
        require(make(FOLDER).measured_quality is not None, "no material")
    if KIND == "older":
        forget_names()


def forget_names():
    """Packed under the bundles' common names, with no content noted."""
    for image in bpy.data.images:
        part = image.get(data_image.PART_KEY)
        if part:
            path = str(Path(image.filepath).with_name(part + Path(image.filepath).suffix))
            for packed in image.packed_files:
                packed.filepath = path
            image.filepath_raw = path
            del image[data_image.PART_KEY], image[data_image.CONTENT_KEY]


def textures():
    """Each texture by material and part."""
    return {(m.name, part): image for m in bpy.data.materials for part, image in kept.textures_of(m).items()}


def require_right(words):
    """Every texture holds what is in its bundle's file."""
    found = textures()
    require({name for name, _ in found} == {"felt", "lacquer"} and len(found) > 6, f"{words}: {sorted(found)}")
    for (name, part), image in found.items():
        bundle = ours("bake.bundle.bundle").read_bundle(FOLDER / f"{name}.mmat")
        truth = bpy.data.images.load(str(bundle.image_path(part)), check_existing=False)
        truth.colorspace_settings.name, truth.alpha_mode = "Non-Color", "CHANNEL_PACKED"
        same = tuple(image.size) == tuple(truth.size) and np.array_equal(pixels(image), pixels(truth))
        require(same, f"{words}: {name} {part} has other pixels, {image.filepath}")
        require(image.colorspace_settings.name == "Non-Color", f"{words}: {name} {part} has a colour space")
        bpy.data.images.remove(truth)


def rules():
    """What the scene check reports."""
    return {finding.rule for finding in ours("addon.scene_check.check").check_scene(bpy.context.scene)}


def picture():
    """Of the scene under its seed."""
    return ours("addon.studio.studio").render_linear(bpy.context.scene)


build()
require_right("built")
save(FOLDER / "scene.blend")
open_again(FOLDER / "scene.blend")
require_right("saved and opened")
before = picture()
require(before.max() > 0.01, "the picture is black")
bpy.ops.file.unpack_all(method="WRITE_LOCAL")
require(not any(image.packed_file for image in textures().values()), "something is packed still")
save(FOLDER / "scene.blend")
open_again(FOLDER / "scene.blend")
require_right("unpacked")
require(all(Path(bpy.path.abspath(i.filepath)).parent == FOLDER / "textures" for i in textures().values()), "places")
after = picture()
require(np.allclose(after, before, rtol=1e-5, atol=1e-7), f"unpacked, the picture is {after.mean() / before.mean()}")
require(not {"wrong_texture", "missing_texture", "common_names"} & rules(), f"reported without a cause: {rules()}")

# One material's file in another's place, as Blender did.
felts, lacquers = (
    [Path(bpy.path.abspath(i.filepath)) for (name, _), i in textures().items() if name == wanted]
    for wanted in ("felt", "lacquer")
)
shutil.copyfile(next(f for f in lacquers if "_table" in f.name), next(f for f in felts if f.suffix == ".exr"))
open_again(FOLDER / "scene.blend")
wrong = [f.where for f in ours("addon.scene_check.check").check_scene(bpy.context.scene) if f.rule == "wrong_texture"]
require(len(wrong) == 1 and "felt" in wrong[0], f"of one exchanged file is told: {wrong}")
print("textures: all is well")
