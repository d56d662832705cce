"""Run inside a real Blender window by tutorials.py: the parts that were asked for, in turn."""

import importlib
import os
import sys
import traceback
from pathlib import Path

import bpy

sys.path.insert(0, str(Path.cwd()))
hands = importlib.import_module("hands")
# The tutorials, which promise it.
LEARNT, FIVE_MINUTES = ("tutorial_measurement", "tutorial_swatch"), 300
# Of all processors: on a busier machine the time says nothing, for the window alone, drawn by software, takes one.
MOST_LOAD = 1.5
PARTS = sys.argv[sys.argv.index("--") + 1 :]


def steps():
    """Each from the file as it was at first."""
    hands.watch_panels("MEASURED_MATERIALS_PT_")
    for cls in bpy.types.Operator.__subclasses__():
        if cls.__name__.startswith("MEASURED_MATERIALS_OT_") and hasattr(cls, "draw"):
            importlib.import_module("hands_menus").watch_dialogue(cls)
    for part in PARTS:
        hands.note(f"{part} ...")
        bpy.ops.wm.open_mainfile(filepath=str(hands.HERE / "data" / "start.blend"))
        yield 1.0
        watch = hands.stopwatch()
        yield from importlib.import_module(part).steps()
        seconds, clock, searches = watch()
        hands.note(
            f"{part} done: {seconds:.0f} s of an artist's, by the clock {clock:.0f}, {searches} buttons looked for"
        )
        if part in LEARNT and os.getloadavg()[0] < MOST_LOAD * (os.cpu_count() or 1):
            hands.check(f"{part} takes less than five minutes", seconds < FIVE_MINUTES)


todo = steps()


@importlib.import_module("bl_ext.user_default.measured_materials.addon.events").timer
def advance():
    """Called by a timer; Blender's main loop runs in between."""
    try:
        return next(todo)
    except StopIteration:
        hands.note("ended")
    except BaseException:
        hands.note(traceback.format_exc())
        hands.take("failed")
    bpy.ops.wm.quit_blender()
    return None


bpy.app.timers.register(advance, first_interval=2.0, persistent=True)
