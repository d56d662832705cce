#!/usr/bin/env bash
# A coat that reflects nothing decides Cycles' Normal pass: the picture stays as it is, the normals do not.
#
# Seen with Blender 4.5.15 LTS (bpy 4.5.15 with numpy 1.26.4), Cycles on the processor.
#
# A plane of metal (Principled BSDF, Metallic 1, Roughness 0.2) has its Normal tilted by 37 degrees, to (0.6, 0, 0.8), and
# its Coat Normal upright, with a Coat IOR of 1: a coat that reflects and absorbs nothing. Normal pass at Coat Weight 0:
# (0.595, 0, 0.797). At 1: (0.328, 0, 0.940), the mean of both. At 1000, which Cycles takes as it is although the slider
# ends at 1: (0.001, 0, 0.995). The picture is the same in all three, to 1e-7. Baked, the same plane's Roughness
# is 0.20, 0.34 and 0.50, the coat's.
#
# Why: the pass sums the normals of a sample's closures by their weights, and a bake their roughness. What a closure
# reflects counts when one is chosen to follow, and in the light; not here. A coat of IOR 1 keeps its whole weight.
#
# Surprised is whoever switches a coat off by its IOR rather than by its weight, and then denoises or bakes by
# the Normal pass of bumps below it: half of the bumps is gone from the pass, and none from the picture.
#
# To live with it: switch coats off by Coat Weight 0. It is of use too: a material whose closures have random normals can
# tell the passes and bakes its true one by such a coat.
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
from pathlib import Path

import bpy
import numpy as np

FOLDER = Path(sys.argv[1])
say = open(3, "w", buffering=1).write


def pixels_of(path, size):
    image = bpy.data.images.load(str(path), check_existing=False)
    return np.array(image.pixels[:]).reshape(size, size, 4)


def coated(weight):
    """The scene's picture, the mean of its Normal pass, and the plane's baked roughness."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device, cycles.samples, cycles.seed = "CPU", 64, 1
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    scene.render.resolution_x = scene.render.resolution_y = 8
    settings = scene.render.image_settings
    settings.file_format, settings.color_depth = "OPEN_EXR", "32"
    scene.view_layers[0].use_pass_normal = True
    bpy.ops.mesh.primitive_plane_add(size=4)
    plane = bpy.context.object
    material = bpy.data.materials.new("metal")
    material.use_nodes = True
    tree = material.node_tree
    shader = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeBsdfPrincipled")
    tilted, upright = tree.nodes.new("ShaderNodeCombineXYZ"), tree.nodes.new("ShaderNodeNewGeometry")
    tilted.inputs["X"].default_value, tilted.inputs["Z"].default_value = 0.6, 0.8
    tree.links.new(tilted.outputs[0], shader.inputs["Normal"])
    tree.links.new(upright.outputs["Normal"], shader.inputs["Coat Normal"])
    values = {"Metallic": 1, "Roughness": 0.2, "Coat Weight": weight, "Coat IOR": 1, "Coat Roughness": 0.5}
    for name, value in values.items():
        shader.inputs[name].default_value = value
    plane.data.materials.append(material)
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.data.angle, sun.rotation_euler = 0.3, (0, 1.2, 0)
    scene.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.camera.location = (0, 0, 5)
    for obj in (sun, scene.camera):
        scene.collection.objects.link(obj)
    scene.use_nodes = True
    compositor = scene.node_tree
    layers = next(node for node in compositor.nodes if node.bl_idname == "CompositorNodeRLayers")
    shown = next(node for node in compositor.nodes if node.bl_idname == "CompositorNodeComposite")
    found = []
    for name in ("Image", "Normal"):
        compositor.links.new(layers.outputs[name], shown.inputs[0])
        scene.render.filepath = str(FOLDER / f"{name}.exr")
        bpy.ops.render.render(write_still=True)
        found.append(pixels_of(scene.render.filepath, 8)[..., :3])
    target = tree.nodes.new("ShaderNodeTexImage")
    target.image = bpy.data.images.new("roughness", 8, 8, float_buffer=True, is_data=True)
    tree.nodes.active = target
    bpy.ops.object.bake(type="ROUGHNESS", margin=0)
    return found[0], found[1].mean((0, 1)), np.array(target.image.pixels[:]).reshape(8, 8, 4)[..., 0].mean()


say(f"Blender {bpy.app.version_string}\n")
found = [coated(weight) for weight in (0, 1, 1000)]
for weight, (picture, normal, roughness) in zip((0, 1, 1000), found, strict=True):
    x, y, z = normal
    say(f"Coat Weight {weight}: picture {picture.mean():.5f}, Normal ({x:.3f}, {y:.3f}, {z:.3f}), Roughness {roughness:.3f}\n")
apart = max(abs(picture / found[0][0] - 1).max() for picture, _, _ in found)
say(f"pictures are apart by {apart:.1e} at most\n")
good = apart < 1e-5
good = good and found[0][1][0] > 0.59 and 0.2 < found[1][1][0] < 0.45 and abs(found[2][1][0]) < 0.01
good = good and abs(found[0][2] - 0.2) < 0.01 and abs(found[2][2] - 0.5) < 0.01
say("as described\n" if good else "NOT as described\n")
sys.exit(0 if good else 1)
PY
