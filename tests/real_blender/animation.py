"""Run inside a real Blender by check.py: an animation whose second lamp appears in frame 2, and the same without one.

Saved are moving.blend, still.blend, which always has both lamps, and persistent.blend, the first with Persistent Data.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path.cwd()))
from common import HERE, empty_scene, lacquer, lamp, save, square

for name in ("moving", "still", "persistent"):
    scene = empty_scene()
    scene.render.use_persistent_data = name == "persistent"
    scene.frame_start, scene.frame_end = 1, 3
    square(scene)
    lacquer(HERE)
    lamp(scene, (-1, 1, 3))
    second = lamp(scene, (1, 0, 2), energy=400.0)
    if name != "still":
        for frame, hidden in ((1, True), (2, False), (3, True)):
            second.hide_render = second.hide_viewport = hidden
            second.keyframe_insert("hide_render", frame=frame)
            second.keyframe_insert("hide_viewport", frame=frame)
    scene.frame_set(1)
    scene.render.filepath = f"//{name}_"
    save(HERE / f"{name}.blend")
print("animation: all is well")
