#!/usr/bin/env bash
# Cycles shows an area lamp that is sheared in a shape that nobody drew, and lights with yet another one.
#
# Seen with Blender 4.5.15 LTS (bpy 4.5.15 with numpy 1.26.4), rendering on the CPU.
#
# A square lamp, turned by 45 degrees, is the child of an empty scaled by 2 in x and by 0.5 in y, as happens when a rig
# is stretched. The viewport draws what geometry gives: a rhombus 2.83 wide and 0.71 high. A mirror shows a rhombus
# 1.5 wide and almost 6 high: long in the other direction, and of 4.5 times the area. Neither agrees with the light that
# falls on a matte floor: that changes by 6 % with the lamp's switch Multiple Importance, which is to change noise only.
#
# Why: the lamp's edges are no longer at right angles. The test whether a ray meets the lamp measures along each edge
# as if they were, which gives the rhombus between the lines that stand across the edges; lighting that is sampled
# directly takes other points. A mesh that emits light has none of this.
#
# Surprised is whoever parents lamps to something scaled unevenly, or imports such a hierarchy.
#
# To live with it: keep uneven scales off the parents of turned area lamps (apply the parent's scale and set the
# lamp's own size), or use a mesh that emits light.
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
import math
import sys

import bpy
import numpy as np

PICTURE = sys.argv[1] + "/picture.exr"
say = open(3, "w", buffering=1).write


def new_scene(samples, pixels):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.device = "CYCLES", "CPU"
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.use_adaptive_sampling = samples, False, False
    scene.cycles.sample_clamp_indirect = 0
    scene.render.resolution_x = scene.render.resolution_y = pixels
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    scene.render.filepath = PICTURE
    return scene


def put(data, **properties):
    obj = bpy.data.objects.new("object", data)
    for name, value in properties.items():
        setattr(obj, name, value)
    bpy.context.scene.collection.objects.link(obj)
    return obj


def floor(node, width, inputs):
    material = bpy.data.materials.new("floor")
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    shader, output = tree.nodes.new(node), tree.nodes.new("ShaderNodeOutputMaterial")
    for name, value in inputs.items():
        shader.inputs[name].default_value = value
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    mesh, half = bpy.data.meshes.new("floor"), width / 2
    mesh.from_pydata([(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)], [], [(0, 1, 2, 3)])
    mesh.materials.append(material)
    put(mesh)


def picture(node, inputs, view, samples, pixels, scale, multiple_importance=True):
    """(pixels, pixels): red channel of the floor under the lamp, seen from above by a camera `view` metres wide."""
    scene = new_scene(samples, pixels)
    rig = put(None, scale=scale)
    lamp = bpy.data.lights.new("lamp", "AREA")
    lamp.shape, lamp.size, lamp.energy = "SQUARE", 1, 10
    lamp.cycles.use_multiple_importance_sampling = multiple_importance
    put(lamp, parent=rig, location=(0, 0, 1), rotation_euler=(0, 0, math.radians(45)))
    floor(node, 20, {"Color": (1, 1, 1, 1), **inputs})
    camera = bpy.data.cameras.new("camera")
    camera.type, camera.ortho_scale = "ORTHO", view
    scene.camera = put(camera, location=(0, 0, 0.5))
    bpy.ops.render.render(write_still=True)
    return np.reshape(bpy.data.images.load(PICTURE).pixels[:], (pixels, pixels, 4))[..., 0]


def extent(scale):
    """Width and height of the lamp in a mirror, in metres, and its area there."""
    seen = picture("ShaderNodeBsdfGlossy", {"Roughness": 0.0}, 8, 16, 256, scale)
    rows, columns = np.nonzero(seen > seen.max() / 2)
    pixel = 8 / 256
    return (np.ptp(columns) + 1) * pixel, (np.ptp(rows) + 1) * pixel, len(rows) * pixel**2


def irradiance(scale, multiple_importance):
    return math.pi * picture("ShaderNodeBsdfDiffuse", {}, 0.1, 1024, 8, scale, multiple_importance).mean()


say(f"Blender {bpy.app.version_string}, numpy {np.__version__}\n")
seen = {}
for name, scale in (("even", (1, 1, 1)), ("uneven", (2, 0.5, 1))):
    shape = extent(scale)
    light = irradiance(scale, False), irradiance(scale, True)
    seen[name] = *shape, light[1] / light[0]
    drawn = math.sqrt(2) * scale[0], math.sqrt(2) * scale[1]
    say(f"parent's scale {name}\n")
    say(f"  in a mirror, expected: {drawn[0]:.2f} wide, {drawn[1]:.2f} high, area {drawn[0] * drawn[1] / 2:.2f}\n")
    say(f"                   seen: {shape[0]:.2f} wide, {shape[1]:.2f} high, area {shape[2]:.2f}\n")
    say(f"  irradiance without and with Multiple Importance, expected: equal; seen: {light[0]:.3f}, {light[1]:.3f}\n")
still = (
    np.allclose(seen["even"], (1.41, 1.41, 1.0, 1.0), rtol=0, atol=(0.1, 0.1, 0.05, 0.01))
    and np.allclose(seen["uneven"], (1.5, 5.9, 4.5, 1.06), rtol=0, atol=(0.1, 0.15, 0.1, 0.02))
)
found = "still so: the sheared lamp has another shape in the mirror, and its light depends on the switch"
say(f"{found if still else 'changed'}\n")
sys.exit(0 if still else 1)
PY
