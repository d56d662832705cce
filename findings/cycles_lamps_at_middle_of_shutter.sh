#!/usr/bin/env bash
# Cycles blurs no moving lamp, and has it where it is half way through the shutter: with the shutter at Start on Frame the
# light is not where the frame shows the lamp.
#
# Seen with Blender 4.5.15 LTS (bpy 4.5.15 with numpy 1.26.4), Cycles on the processor; in 5.2.2 LTS too.
#
# A spot of no size moves by one metre a frame over a floor, motion blur on, shutter 1.0. Middle of the light on the floor
# at frame 2, where the lamp is at x = 0: 0.000 without motion blur and with Center on Frame, 0.500 with Start on Frame,
# -0.500 with End on Frame. Its width is 0.155 to 0.156 in all four: no blur.
#
# Why: where the shutter is not centred on the frame, Cycles evaluates the whole scene at its middle and then takes steps
# around it, for geometry and camera. Lamps have none. A dependency graph asked at the frame has the lamp half a shutter
# earlier or later.
#
# Surprised is whoever bakes or computes light at the frame beside a render (shader tables, drivers, shadow tricks, a
# comparison with another engine), and whoever expects a fast lamp to draw a streak.
#
# To live with it: Center on Frame, or lamps read at frame + shutter / 2 (Start) and frame - shutter / 2 (End).
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
SIZE, WIDE = 64, 6.0
say = open(3, "w", buffering=1).write


def floor(blur, position):
    """Middle and spread in metres of a moving spot's light along x."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device, cycles.samples, cycles.max_bounces = "CPU", 256, 0
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    render = scene.render
    render.resolution_x, render.resolution_y = SIZE, 8
    render.use_motion_blur, render.motion_blur_shutter, render.motion_blur_position = blur, 1.0, position
    render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR", "32"
    bpy.ops.mesh.primitive_plane_add(size=20)
    light = bpy.data.lights.new("spot", "SPOT")
    light.energy, light.shadow_soft_size, light.spot_size, light.spot_blend = 100, 0.0, 0.3, 0.0
    lamp = bpy.data.objects.new("spot", light)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.type, camera.data.ortho_scale, camera.location = "ORTHO", WIDE, (0, 0, 5)
    for obj in (lamp, camera):
        scene.collection.objects.link(obj)
    scene.camera = camera
    for frame, x in ((0, -2), (4, 2)):
        lamp.location = (x, 0, 2)
        lamp.keyframe_insert("location", frame=frame)
    for curve in lamp.animation_data.action.fcurves:
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
    scene.frame_set(2)
    render.filepath = str(FOLDER / "floor.exr")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(render.filepath, check_existing=False)
    row = np.array(image.pixels[:]).reshape(8, SIZE, 4)[..., 0].mean(0)
    x = ((np.arange(SIZE) + 0.5) / SIZE - 0.5) * WIDE
    middle = (row * x).sum() / row.sum()
    return middle, np.sqrt((row * (x - middle) ** 2).sum() / row.sum())


say(f"Blender {bpy.app.version_string}\n")
good = True
for blur, position, expected in ((False, "CENTER", 0), (True, "CENTER", 0), (True, "START", 0.5), (True, "END", -0.5)):
    middle, spread = floor(blur, position)
    say(f"motion blur {'on' if blur else 'off'}, {position}: light at x = {middle:.3f} m, spread {spread:.3f} m\n")
    good = good and abs(middle - expected) < 0.01 and abs(spread - 0.155) < 0.005
say("as described\n" if good else "NOT as described\n")
sys.exit(0 if good else 1)
PY
