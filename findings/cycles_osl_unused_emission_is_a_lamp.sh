#!/usr/bin/env bash
# An OSL shader that could emit, and never does, is a lamp for Cycles: the rest of the scene gets three times as noisy.
#
# Seen with Blender 4.5.15 LTS (bpy 4.5.15 with numpy 1.26.4), Cycles on the processor with Open Shading Language.
#
# A matte floor lies under one area lamp; a ball beside it, unseen by the camera, has a Script node of matte OSL. In one
# version the shader also holds "if (Glow > 0) C += Glow * emission();", and Glow is 0, unlinked. Nothing emits light in
# either. Direct light on the floor, 16 samples, noise over four seeds in parts of the mean: 0.0155 without that line,
# 0.0467 with it. With the material's Emission Sampling set to None the pictures of both are equal bit for bit. The same
# with Light Tree on and off. The means agree: only noise tells.
#
# Why: Cycles looks for emission() in the compiled shader, not for whether it is reached. The ball then counts as a mesh
# light, and samples of light are spent on its dark triangles. A node graph whose Emission has the strength
# 0 is folded away before it comes to that.
#
# Surprised is whoever writes one OSL shader for many materials, with a switch for those that glow, or adds an optional
# glow to a shader that exists: every object that wears it takes samples from the true lamps.
#
# To live with it: set Emission Sampling (Material > Settings > Surface) to None where the shader does not glow, or
# compile the line in only where it is wanted.
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
import importlib
import sys
from pathlib import Path

import bpy
import numpy as np

FOLDER = Path(sys.argv[1])
say = open(3, "w", buffering=1).write
# OpenImageIO and oslquery, with which Cycles compiles Script nodes, lie inside the wheel and off its path.
sys.path.append(str(next((Path(bpy.utils.resource_path("LOCAL")) / "python" / "lib").glob("python3*/site-packages"))))

MATTE = "shader matte(float Glow = 0, output closure color C = 0) { C = 0.5 * diffuse(N);%s }"
SOURCES = {"matte": MATTE % "", "with unused emission": MATTE % " if (Glow > 0) C += Glow * emission();"}


def scripted(source):
    """A material of one Script node."""
    material = bpy.data.materials.new("script")
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    text = bpy.data.texts.new("matte.osl")
    text.from_string(source)
    node = tree.nodes.new("ShaderNodeScript")
    node.mode, node.script = "INTERNAL", text
    if not node.outputs:
        importlib.import_module("cycles.osl").update_script_node(node, lambda kind, words: print(kind, words))
    assert node.outputs, "the shader did not compile"
    tree.links.new(node.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    return material


def add(scene, name, data, place):
    made = bpy.data.objects.new(name, data)
    made.location = place
    scene.collection.objects.link(made)
    return made


def floor(source, sampling, light_tree, seed):
    """(32, 32) red of the floor under the lamp, with the ball beside it."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device, cycles.shading_system, cycles.use_light_tree = "CPU", True, light_tree
    cycles.samples, cycles.seed, cycles.max_bounces = 16, seed, 0
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    scene.render.resolution_x = scene.render.resolution_y = 32
    settings = scene.render.image_settings
    settings.file_format, settings.color_depth = "OPEN_EXR", "32"
    bpy.ops.mesh.primitive_plane_add(size=4)
    ground = bpy.data.materials.new("ground")
    ground.use_nodes = True
    bpy.context.object.data.materials.append(ground)
    bpy.ops.mesh.primitive_uv_sphere_add(location=(0, 0, 1.2), radius=0.5)
    ball = bpy.context.object
    ball.visible_camera = False
    material = scripted(source)
    material.cycles.emission_sampling = sampling
    ball.data.materials.append(material)
    lamp = bpy.data.lights.new("lamp", "AREA")
    lamp.size, lamp.energy = 0.5, 50
    add(scene, "lamp", lamp, (1.5, 0, 3))
    scene.camera = add(scene, "camera", bpy.data.cameras.new("camera"), (0, 0, 8))
    scene.render.filepath = str(FOLDER / "floor.exr")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(scene.render.filepath, check_existing=False)
    return np.array(image.pixels[:]).reshape(32, 32, 4)[..., 0]


def measured(name, sampling, light_tree):
    pictures = np.stack([floor(SOURCES[name], sampling, light_tree, seed) for seed in range(1, 5)])
    return pictures, pictures.std(0, ddof=1).mean() / pictures.mean()


say(f"Blender {bpy.app.version_string}\n")
good = True
for light_tree in (True, False):
    say(f"Light Tree {'on' if light_tree else 'off'}\n")
    plain, noise = measured("matte", "AUTO", light_tree)
    unused, more = measured("with unused emission", "AUTO", light_tree)
    told, same = measured("with unused emission", "NONE", light_tree)
    for words, pictures, value in (
        ("matte", plain, noise),
        ("with unused emission", unused, more),
        ("with unused emission, Emission Sampling None", told, same),
    ):
        say(f"  {words}: mean {pictures.mean():.4f}, noise {value:.4f} of it\n")
    good = good and more > 2 * noise and np.array_equal(plain, told) and abs(unused.mean() / plain.mean() - 1) < 0.01
say("as described\n" if good else "NOT as described\n")
sys.exit(0 if good else 1)
PY
