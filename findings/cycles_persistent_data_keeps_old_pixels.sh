#!/usr/bin/env bash
# With Persistent Data, Cycles goes on rendering the pixels that an image had when it was first read.
#
# Seen with Blender 4.5.15 LTS (bpy 4.5.15 with numpy 1.26.4), rendering on the CPU.
#
# A plane emits what an image holds, which scripts fill through Image.pixels. The picture is rendered, the image is
# filled with three times as much, and the picture is rendered again. Without Persistent Data the second is three times
# as bright. With it, both are equal, whether the change is followed by Image.update(), by update_tag() of image and
# node tree, by packing the image, by moving the object, or by another frame. An image that takes the place of the first
# in the node is seen; and so are the new pixels of the first, as soon as the node asks for it with another Extension
# ("Repeat", "Extend", "Clip", "Mirror").
#
# Why: an image that lives inside Blender has no file whose date could tell that it has changed, and Cycles knows an
# image that it has read by its name and by how it is asked for, not by its pixels.
#
# Surprised is whoever writes textures from a handler for each frame (a table of lamps, a simulation) and switches on
# Persistent Data because it makes animations quicker: every frame shows the first one's texture, and nothing says so.
#
# To live with it: give the nodes another Extension whenever pixels have changed, where the coordinates lie inside, or
# write two images and exchange them; or switch Persistent Data off.
#
# Exit status: 0 if Blender still behaves so, 2 if the packages could not be installed, 1 otherwise.
set -euo pipefail

folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv" || exit 2
"$folder/venv/bin/pip" install --quiet --no-deps bpy==4.5.15 numpy==1.26.4 || exit 2
export BLENDER_USER_RESOURCES="$folder/user"

# Blender talks on standard output; what this script says goes by descriptor 3.
"$folder/venv/bin/python" -P - "$folder" 3>&1 >"$folder/log" <<'PY'
import sys

import bpy
import numpy as np

PICTURE = sys.argv[1] + "/picture.exr"
say = open(3, "w", buffering=1).write


def fill(image, value):
    image.pixels.foreach_set(np.tile(np.array([value, value, value, 1], np.float32), len(image.pixels) // 4))
    image.update()


def new_image(value):
    image = bpy.data.images.new("table", 4, 4, float_buffer=True, is_data=True)
    fill(image, value)
    return image


def new_scene(persistent):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.device, scene.cycles.samples = "CYCLES", "CPU", 1
    scene.cycles.use_denoising = False
    scene.render.use_persistent_data = persistent
    scene.render.resolution_x = scene.render.resolution_y = 4
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    scene.render.filepath = PICTURE
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.type, camera.data.ortho_scale, camera.location = "ORTHO", 1.0, (0, 0, 2)
    mesh = bpy.data.meshes.new("plane")
    mesh.from_pydata([(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)], [], [(0, 1, 2, 3)])
    material = bpy.data.materials.new("material")
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    node, emission = tree.nodes.new("ShaderNodeTexImage"), tree.nodes.new("ShaderNodeEmission")
    out = tree.nodes.new("ShaderNodeOutputMaterial")
    node.image = new_image(0.25)
    tree.links.new(node.outputs["Color"], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], out.inputs["Surface"])
    mesh.materials.append(material)
    plane = bpy.data.objects.new("plane", mesh)
    for obj in (camera, plane):
        scene.collection.objects.link(obj)
    scene.camera = camera
    return scene, plane, tree, node


def brightness():
    bpy.ops.render.render(write_still=True)
    picture = bpy.data.images.load(PICTURE)
    picture.colorspace_settings.is_data = True
    values = np.empty(len(picture.pixels), np.float32)
    picture.pixels.foreach_get(values)
    bpy.data.images.remove(picture)
    return float(values[0])


def tagged(scene, plane, tree, node):
    node.image.update_tag()
    tree.update_tag()


def packed(scene, plane, tree, node):
    node.image.pack()


def moved(scene, plane, tree, node):
    plane.location.x += 0.1


def next_frame(scene, plane, tree, node):
    scene.frame_set(scene.frame_current + 1)


def another_image(scene, plane, tree, node):
    node.image = new_image(0.75)


def another_extension(scene, plane, tree, node):
    node.extension = "EXTEND"


def nothing(*_):
    pass


failed = []
for persistent, then, wanted in (
    (False, nothing, 3.0),
    (True, nothing, 1.0),
    (True, tagged, 1.0),
    (True, packed, 1.0),
    (True, moved, 1.0),
    (True, next_frame, 1.0),
    (True, another_image, 3.0),
    (True, another_extension, 3.0),
):
    scene, plane, tree, node = new_scene(persistent)
    before = brightness()
    fill(node.image, 0.75)
    then(scene, plane, tree, node)
    found = brightness() / before
    name = ("Persistent Data, " if persistent else "") + then.__name__.replace("_", " ")
    say(f"{name:36s} the second picture is {found:.3f} times as bright as the first\n")
    if abs(found - wanted) > 1e-3:
        failed.append(name)
if failed:
    say(f"Blender {bpy.app.version_string} no longer behaves so: {', '.join(failed)}\n")
    sys.exit(1)
PY
