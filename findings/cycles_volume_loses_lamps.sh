#!/usr/bin/env bash
# Inside a volume, Cycles loses light of lamps that a ray meets after two or more bounces.
#
# Seen with Blender 4.5.15 LTS (bpy 4.5.15 with numpy 1.26.4), rendering on the CPU.
#
# Two mirrors of 50 % form a periscope through which the camera looks at an area lamp of radiance 1: a quarter of it
# must arrive. It does in empty space. Fill the world with an absorbing volume so thin that it takes under 0.001 %,
# and half of the lamp's light is gone. A mesh that emits the same light, in the same place, keeps all of it.
#
# Why: Cycles ends paths at random, the more readily the less light they can still carry (Russian roulette), and makes
# up for that where a surviving path meets its next surface. A lamp object is no surface: in empty space a ray that
# meets one takes its light before chance decides, but in a volume chance decides first, and a path that survives is
# not made heavier before it takes the lamp's light.
#
# Surprised is whoever adds a little haze to a scene and sees reflections of lamps in reflections go dark. The tooltip
# of Min Light Bounces promises less noise from more of them, at a cost of time, and says nothing of brightness.
# Sharp mirrors and glass depend on lamps that rays meet; rough surfaces also sample lamps directly, and lose less.
#
# To live with it: set Min Light Bounces (under Light Paths) as high as Max Bounces, or use meshes for lamps.
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
from mathutils import Matrix

PICTURE = sys.argv[1] + "/picture.exr"
say = open(3, "w", buffering=1).write


def new_scene():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.device = "CYCLES", "CPU"
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.use_adaptive_sampling = 256, False, False
    scene.cycles.sample_clamp_indirect = 0
    scene.render.resolution_x = scene.render.resolution_y = 8
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    scene.render.filepath = PICTURE
    return scene


def put(data, matrix):
    obj = bpy.data.objects.new("object", data)
    obj.matrix_world = matrix
    bpy.context.scene.collection.objects.link(obj)
    return obj


def square(node, inputs):
    """One metre wide, facing up, of one shader."""
    material = bpy.data.materials.new("material")
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    shader, output = tree.nodes.new(node), tree.nodes.new("ShaderNodeOutputMaterial")
    for name, value in inputs.items():
        shader.inputs[name].default_value = value
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    mesh = bpy.data.meshes.new("square")
    mesh.from_pydata([(-0.5, -0.5, 0), (0.5, -0.5, 0), (0.5, 0.5, 0), (-0.5, 0.5, 0)], [], [(0, 1, 2, 3)])
    mesh.materials.append(material)
    return mesh


def fill_world(scene):
    scene.world = bpy.data.worlds.new("world")
    scene.world.use_nodes = True
    tree = scene.world.node_tree
    tree.nodes.clear()
    volume, output = tree.nodes.new("ShaderNodeVolumeAbsorption"), tree.nodes.new("ShaderNodeOutputWorld")
    volume.inputs["Density"].default_value = 1e-6
    tree.links.new(volume.outputs[0], output.inputs["Volume"])


def brightness(light, filled, min_bounces):
    """Mean of the picture that arrives through the periscope."""
    scene = new_scene()
    scene.cycles.min_light_bounces = min_bounces
    mirror = square("ShaderNodeBsdfGlossy", {"Color": (0.5, 0.5, 0.5, 1), "Roughness": 0.0})
    put(mirror, Matrix.Rotation(math.radians(45), 4, "Y"))
    put(mirror, Matrix.Translation((2, 0, 0)) @ Matrix.Rotation(math.radians(-45), 4, "Y"))
    if light == "lamp":
        lamp = bpy.data.lights.new("lamp", "AREA")
        lamp.size, lamp.energy = 1, math.pi
        put(lamp, Matrix.Translation((2, 0, 2)))
    else:
        face_down = Matrix.Rotation(math.pi, 4, "Y")
        put(square("ShaderNodeEmission", {"Strength": 1.0}), Matrix.Translation((2, 0, 2)) @ face_down)
    camera = bpy.data.cameras.new("camera")
    camera.type, camera.ortho_scale = "ORTHO", 0.2
    scene.camera = put(camera, Matrix.Translation((0, 0, 2)))
    if filled:
        fill_world(scene)
    bpy.ops.render.render(write_still=True)
    pixels = bpy.data.images.load(PICTURE).pixels[:]
    return float(np.reshape(pixels, (-1, 4))[:, :3].mean())


say(f"Blender {bpy.app.version_string}, numpy {np.__version__}\n")
say("expected: 0.2500 in every row, since the volume takes less than 1e-5 of the light on its way\n")
say("light  volume  min light bounces  seen\n")
seen = {}
for case in [(light, filled, least) for light in ("lamp", "mesh") for filled in (False, True) for least in (0, 1024)]:
    seen[case] = brightness(*case)
    say(f"{case[0]}   {'thin' if case[1] else 'none'}    {case[2]:<17}  {seen[case]:.4f}\n")
lost = seen.pop(("lamp", True, 0))
still = abs(lost - 0.125) < 0.01 and all(abs(value - 0.25) < 0.002 for value in seen.values())
say("still so: the thin volume takes half of the lamp's light\n" if still else "changed\n")
sys.exit(0 if still else 1)
PY
