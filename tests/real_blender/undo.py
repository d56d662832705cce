"""Run inside a real Blender by check.py, without a window: lamps, undo and redo, and what materials aim by after each.

In a window that is window_edits.py's; here Blender's own undo runs in the background.
"""

import sys
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path.cwd()))
from common import HERE, empty_scene, lacquer, ours, pixels, require, square


def require_current(words, count):
    """As many lamps, and the table and groups of a scene that was just opened."""
    bpy.context.view_layer.update()
    lamps = [obj for obj in bpy.context.scene.objects if obj.type == "LIGHT"]
    require(len(lamps) == count, f"{words}: {len(lamps)} lamps")
    report = ours("addon.lights.light_tables").survey(bpy.context.evaluated_depsgraph_get())
    table = ours("addon.lights.light_tables").table_of(report)
    found = pixels(bpy.data.images["MM Lamps"])
    require(np.array_equal(found, table[::-1].ravel()), f"{words}: the table is another:\n{found}\n{table}")
    groups = [tree for tree in bpy.data.node_groups if tree.users and "measured_materials_lamps" in tree]
    groups = [tree for tree in groups if "measured_materials_instead" not in tree]
    aims = {(tree["measured_materials_lamps"], bool(tree["measured_materials_world"])) for tree in groups}
    require(len(report.lamps) == count, f"{words}: {report.words()}")
    require(aims == {(count, report.world.aimed)}, f"{words}: groups aim at {aims}")


scene = empty_scene()
square(scene)
lacquer(HERE)
require_current("none", 0)
bpy.ops.ed.undo_push(message="Start")
for number, kind in enumerate(("AREA", "SUN", "AREA")):  # which have a size from the start; with a step of their own
    bpy.ops.object.light_add("EXEC_DEFAULT", True, type=kind, location=(number - 1, 0, 3))
    require_current(f"lamp {number} added", number + 1)
for number in (2, 1, 0):
    bpy.ops.ed.undo()
    require_current(f"undone to {number}", number)
for number in (1, 2, 3):
    bpy.ops.ed.redo()
    require_current(f"redone to {number}", number)
bpy.ops.ed.undo()
require_current("undone again", 2)
bpy.ops.ed.redo()
require_current("redone again", 3)
print("undo: all is well")
