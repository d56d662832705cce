#!/usr/bin/env bash
# Material previews of Cycles can forbid Python to write for the rest of a Blender session, to all timers and handlers.
#
# Usage: blender_forbids_writing_for_good.sh [BLENDER]    needs Xvfb, and no extension or settings of anyone's
#
# Seen with Blender 4.3.2, after 139 previews and a minute; 5.2.2 LTS refused nothing in four minutes.
#
# Cycles is the engine, and the material's tab is open, which draws its icon by Cycles in a thread of its own. A panel
# there takes 30 ms of Python to draw. A timer sets scene.frame_end and the material's roughness, which has the icon drawn
# again. After some icons, "Writing to ID classes in this context is not allowed" is all it gets, and of operators
# "can't modify blend data in this state (drawing/rendering)", also seconds after the last icon, when nothing is drawn or
# rendered any more. It stays so.
#
# Why: one flag for all threads says whether Python may write (rna_disallow_writes in bpy_rna.cc). Every call of a class'
# method puts its own value there, and puts back what it found. A panel's draw forbids; a render engine's methods allow.
# When Python switches threads in the middle of a draw, and the engine's method begins there and ends after the draw,
# what it puts back is the draw's "forbidden".
#
# Surprised is whoever works by bpy.app.timers, as downloads and bakes beside the window are to: what has worked all
# day fails on one machine and not on another.
#
# To live with it: operators that a person starts, and functions that follow a change of a property (update=), may write
# all the same. So a timer can set a property of the window manager, which is never forbidden, and do its work in that
# property's update function.
#
# Exit status: 0 if Blender still behaves so, 2 if it could not be tried, 1 otherwise.
set -euo pipefail

blender="${1:-blender}"
command -v "$blender" >/dev/null && command -v Xvfb >/dev/null || exit 2
folder="$(mktemp -d)"
server=
trap '[ -z "$server" ] || kill "$server"; rm -rf "$folder"' EXIT
export BLENDER_USER_RESOURCES="$folder/user" LIBGL_ALWAYS_SOFTWARE=1
Xvfb -displayfd 4 -screen 0 800x600x24 +extension GLX -nolisten tcp 4>"$folder/display" >/dev/null 2>&1 &
server=$!
for _ in $(seq 100); do [ -s "$folder/display" ] && break; sleep 0.1; done
[ -s "$folder/display" ] || exit 2
DISPLAY=":$(cat "$folder/display")"
export DISPLAY

cat >"$folder/forbid.py" <<'PY'
import os
import time

import bpy

bpy.context.preferences.view.show_splash = False
scene, material = bpy.context.scene, bpy.data.objects["Cube"].active_material
scene.render.engine = "CYCLES"
written = refused = previews = 0
began, quiet_since = time.monotonic(), None


class SLOW_PT_panel(bpy.types.Panel):
    bl_space_type, bl_region_type, bl_context, bl_label = "PROPERTIES", "WINDOW", "material", "Slow"

    def draw(self, context):
        until = time.perf_counter() + 0.03
        while time.perf_counter() < until:
            pass


def through_the_door(manager, context):
    scene.frame_end = 77


def say(words):
    print(words, flush=True)


def stop(code):
    os._exit(code)


def work():
    global written, refused, quiet_since
    rendering = bpy.app.is_job_running("RENDER_PREVIEW")
    for area in bpy.context.window_manager.windows[0].screen.areas:
        if area.type == "PROPERTIES":
            area.tag_redraw()
    now = time.monotonic()
    try:
        scene.frame_end = 100 + written % 100
    except AttributeError as error:
        refused += 1
        if rendering or quiet_since is None:
            quiet_since = now
        if now - quiet_since < 5:
            return 0.02
        say(f"written {written} times; then refused {refused} times, the last 5 s of them without any preview: {error}")
        try:
            bpy.ops.ed.undo_push(message="x")
        except RuntimeError as refusal:
            say(str(refusal))
        bpy.context.window_manager.door = True
        say(f"by the update function of a property of the window manager: frame_end is {scene.frame_end}")
        stop(0)
    quiet_since = None
    written += 1
    if not rendering:
        material.roughness = written % 97 / 97
    if now - began > 240:
        say(f"written {written} times in four minutes, refused {refused} times, but never for long")
        stop(1)
    return 0.02


bpy.utils.register_class(SLOW_PT_panel)
bpy.types.WindowManager.door = bpy.props.BoolProperty(update=through_the_door)
for area in bpy.context.window_manager.windows[0].screen.areas:
    if area.type == "PROPERTIES":
        area.spaces.active.context = "MATERIAL"
bpy.app.timers.register(work, first_interval=2)
PY

code=0
timeout 400 "$blender" --factory-startup -p 0 0 800 600 --python "$folder/forbid.py" >"$folder/log" 2>&1 || code=$?
grep -E "^(written|by the|Calling)" "$folder/log" || tail -n 5 "$folder/log" >&2
exit "$code"
