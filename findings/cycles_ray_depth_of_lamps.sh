#!/usr/bin/env bash
# In Cycles, one and the same lamp is one bounce deeper for a ray that meets it by chance than for one aimed at it.
#
# Seen with Blender 4.5.15 LTS (bpy 4.5.15 with numpy 1.26.4), rendering on the CPU.
#
# A light whose strength is Light Path's output Ray Depth lights a floor that the camera looks at, so that the picture
# divided by the one of strength 1 tells what that node said. Between light and camera lies one reflection. A mesh
# that emits light hears 1, however it is found. A lamp hears 1 where the floor samples it directly, 2 where a mirror's
# ray meets it, and anything in between from a matte floor, which does both and weighs them (multiple importance
# sampling). A world does likewise: 2 from rays, and less where it has a texture, since only then it is sampled.
# Seen by the camera itself, with no reflection at all, a mesh hears 0, but lamp and world hear 1.
#
# Why: for lamps and worlds that a ray ends in, the meeting itself is counted as a bounce.
#
# Surprised is whoever reads the manual (docs.blender.org/manual/en/4.5, Light Path node: the number of reflections and
# transmissions) and shows a lamp or world only up to some Ray Depth: reflections lose the light one bounce before
# matte surfaces do, at one depth these show a part of it that depends on how noise was to be reduced, and a texture or
# the switch Multiple Importance changes brightness.
#
# To live with it: let no lamp or world depend on Ray Depth. To hide one from the camera use its Ray Visibility, or in
# a world Is Camera Ray; where depth must count, use meshes that emit light.
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


def put(data, z):
    obj = bpy.data.objects.new("object", data)
    obj.location = 0, 0, z
    bpy.context.scene.collection.objects.link(obj)
    return obj


def cleared(data):
    data.use_nodes = True
    data.node_tree.nodes.clear()
    return data.node_tree


def square(material):
    """Four metres wide, facing up; it emits light on both sides if at all."""
    mesh = bpy.data.meshes.new("square")
    mesh.from_pydata([(-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 0)], [], [(0, 1, 2, 3)])
    mesh.materials.append(material)
    return mesh


def set_light(tree, emission, output, by_depth):
    shader, end = tree.nodes.new(emission), tree.nodes.new(output)
    tree.links.new(shader.outputs[0], end.inputs["Surface"])
    if by_depth:
        tree.links.new(tree.nodes.new("ShaderNodeLightPath").outputs["Ray Depth"], shader.inputs["Strength"])
    return shader


def add_mesh(scene, by_depth, sampled):
    material = bpy.data.materials.new("light")
    set_light(cleared(material), "ShaderNodeEmission", "ShaderNodeOutputMaterial", by_depth)
    material.cycles.emission_sampling = "FRONT_BACK" if sampled else "NONE"
    put(square(material), 1)


def add_lamp(scene, by_depth, met):
    lamp = bpy.data.lights.new("lamp", "AREA")
    lamp.size, lamp.energy = 4, 16 * math.pi
    set_light(cleared(lamp), "ShaderNodeEmission", "ShaderNodeOutputLight", by_depth)
    lamp.cycles.use_multiple_importance_sampling = met
    put(lamp, 1).visible_camera = True


def add_world(scene, by_depth, sampled):
    scene.world = bpy.data.worlds.new("world")
    tree = cleared(scene.world)
    shader = set_light(tree, "ShaderNodeBackground", "ShaderNodeOutputWorld", by_depth)
    checker = tree.nodes.new("ShaderNodeTexChecker")
    checker.inputs["Scale"].default_value = 1
    checker.inputs["Color1"].default_value, checker.inputs["Color2"].default_value = (1,) * 4, (0.9, 0.9, 0.9, 1)
    tree.links.new(checker.outputs["Color"], shader.inputs["Color"])
    scene.world.cycles.sampling_method = "AUTOMATIC" if sampled else "NONE"


def floor_material(surface):
    material = bpy.data.materials.new("floor")
    tree = cleared(material)
    shader, output = tree.nodes.new(surface), tree.nodes.new("ShaderNodeOutputMaterial")
    shader.inputs["Color"].default_value = (1, 1, 1, 1)
    shader.inputs["Roughness"].default_value = 0.0
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    return material


def brightness(add_light, option, surface, by_depth):
    scene = new_scene()
    if surface:
        put(square(floor_material(surface)), 0)
    camera = bpy.data.cameras.new("camera")
    camera.type, camera.ortho_scale = "ORTHO", 0.1
    scene.camera = put(camera, 0.5)
    if not surface:  # then the camera looks up at the light itself
        scene.camera.rotation_euler = math.pi, 0, 0
    add_light(scene, by_depth, option)
    bpy.ops.render.render(write_still=True)
    return float(np.reshape(bpy.data.images.load(PICTURE).pixels[:], (-1, 4))[:, :3].mean())


MATTE, MIRROR = "ShaderNodeBsdfDiffuse", "ShaderNodeBsdfGlossy"
# Light, its switch, the floor, what is seen; the switch of lamps lets rays meet them, that of the others samples them.
CASES = {
    "mesh, matte floor, both ways at once": (add_mesh, True, MATTE, 1.0),
    "mesh, matte floor, met by rays only": (add_mesh, False, MATTE, 1.0),
    "mesh, mirror, met by rays": (add_mesh, True, MIRROR, 1.0),
    "mesh, no floor, seen by the camera": (add_mesh, True, None, 0.0),
    "lamp, matte floor, sampled only": (add_lamp, False, MATTE, 1.0),
    "lamp, matte floor, both ways at once": (add_lamp, True, MATTE, 1.43),
    "lamp, mirror, met by rays": (add_lamp, True, MIRROR, 2.0),
    "lamp, no floor, seen by the camera": (add_lamp, True, None, 1.0),
    "world, matte floor, met by rays only": (add_world, False, MATTE, 2.0),
    "world, matte floor, both ways at once": (add_world, True, MATTE, 1.82),
    "world, mirror, met by rays": (add_world, True, MIRROR, 2.0),
    "world, no floor, seen by the camera": (add_world, True, None, 1.0),
}
say(f"Blender {bpy.app.version_string}, numpy {np.__version__}\n")
still = True
for name, (add_light, option, surface, noted) in CASES.items():
    depth = brightness(add_light, option, surface, True) / brightness(add_light, option, surface, False)
    still = still and abs(depth - noted) < (0.005 if noted in (0, 1, 2) else 0.03)
    say(f"{name:<38}  Ray Depth expected: {1 if surface else 0}, seen: {depth:.2f}\n")
say("still so: lamps and worlds that a ray meets count one bounce more\n" if still else "changed\n")
sys.exit(0 if still else 1)
PY
