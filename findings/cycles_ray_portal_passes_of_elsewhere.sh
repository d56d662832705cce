#!/usr/bin/env bash
# Cycles fills the data passes of a surface that holds a Ray Portal with what lies at the portal's other end.
#
# Seen with Blender 4.5.15 LTS (bpy 4.5.15 with numpy 1.26.4), Cycles on the processor.
#
# A card of index 1 stands 2 units before the camera. It mixes a Diffuse BSDF with a Ray Portal that sends rays on from
# where they arrive, at right angles, to a wall of index 2 that the camera does not see. With 0.4 of the portal the passes
# are the card's: Object Index 1, Normal (0, 0, 1). With 0.6 the Normal pass is (-0.65, 0, 0): the wall's, of those samples
# that reach it, and of the card's own nothing is left, though 0.4 of it is still seen; most pixels' Object Index is 2. At an
# Alpha Threshold of 0 both are the card's again, even of a portal alone.
#
# Why: a portal counts as transparent, and these passes are written at the first surface whose opacity reaches the view
# layer's Alpha Threshold, 0.5 unless it is changed, which is there for cut-out leaves. Nothing is blended by the mix: below
# the threshold the card never counts.
#
# Surprised is whoever uses a portal as a part of a material, for a bent path through cloth or glass: masks by index, depth
# and normals for a denoiser or for fog jump to another place, from one pixel to the next where the mix crosses the half.
#
# To live with it: View Layer > Passes > Data, Alpha Threshold 0. What is as good as transparent is then seen as well.
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
SIZE = 8
say = open(3, "w", buffering=1).write


def grey(name, portal):
    """A material of a diffuse surface and, as far as `portal` goes, of a portal along +X."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    shown, mix = tree.nodes.new("ShaderNodeOutputMaterial"), tree.nodes.new("ShaderNodeMixShader")
    matte, through = tree.nodes.new("ShaderNodeBsdfDiffuse"), tree.nodes.new("ShaderNodeBsdfRayPortal")
    place, along = tree.nodes.new("ShaderNodeNewGeometry"), tree.nodes.new("ShaderNodeCombineXYZ")
    mix.inputs[0].default_value, along.inputs["X"].default_value = portal, 1.0
    tree.links.new(place.outputs["Position"], through.inputs["Position"])
    tree.links.new(along.outputs[0], through.inputs["Direction"])
    tree.links.new(matte.outputs[0], mix.inputs[1])
    tree.links.new(through.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], shown.inputs["Surface"])
    return material


def passes(portal, threshold):
    """Means of Object Index, of the Normal and of the picture."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene, layer = bpy.context.scene, bpy.context.view_layer
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device, cycles.samples, cycles.seed = "CPU", 64, 1
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    settings = scene.render.image_settings
    settings.file_format, settings.color_depth = "OPEN_EXR", "32"
    layer.use_pass_object_index = layer.use_pass_normal = True
    layer.pass_alpha_threshold = threshold
    bpy.ops.mesh.primitive_plane_add(size=4)
    card = bpy.context.object
    bpy.ops.mesh.primitive_plane_add(size=40, location=(9, 0, 0), rotation=(0, np.pi / 2, 0))
    wall = bpy.context.object
    card.pass_index, wall.pass_index = 1, 2
    card.data.materials.append(grey("card", portal))
    wall.data.materials.append(grey("wall", 0.0))
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    scene.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.camera.location = (0, 0, 2)
    for obj in (sun, scene.camera):
        scene.collection.objects.link(obj)
    scene.use_nodes = True
    tree = scene.node_tree
    layers = next(node for node in tree.nodes if node.bl_idname == "CompositorNodeRLayers")
    shown = next(node for node in tree.nodes if node.bl_idname == "CompositorNodeComposite")
    found = []
    for name in ("IndexOB", "Normal", "Image"):
        tree.links.new(next(out for out in layers.outputs if out.identifier == name), shown.inputs[0])
        scene.render.filepath = str(FOLDER / f"{name}.exr")
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(scene.render.filepath, check_existing=False)
        found.append(np.array(image.pixels[:]).reshape(SIZE, SIZE, 4)[..., :3].mean((0, 1)))
    return float(found[0][0]), found[1], float(found[2][0])


say(f"Blender {bpy.app.version_string}\n")
good = True
for portal, threshold, beyond in ((0.4, 0.5, False), (0.6, 0.5, True), (0.6, 0.0, False), (1.0, 0.0, False)):
    index, (x, y, z), light = passes(portal, threshold)
    words = f"index {index:.2f}, Normal ({x:.2f}, {y:.2f}, {z:.2f}), picture {light:.3f}"
    say(f"portal {portal}, Alpha Threshold {threshold}: {words}\n")
    as_told = 1.4 < index < 2 and -0.8 < x < -0.5 and abs(z) < 0.01 if beyond else abs(index - 1) < 1e-3 and z > 0.999
    good = good and as_told and (light > 0.05) == (portal < 1)
say("as described\n" if good else "NOT as described\n")
sys.exit(0 if good else 1)
PY
