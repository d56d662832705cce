"""Run inside a real Blender window by desk_steps.py: all that keeps an artist waiting beside a measurement's import."""

import functools
import importlib
import json
import os
import sys
import time

import bpy

PACKAGE = "bl_ext.user_default.measured_materials"


def steps(desk, material):
    """Bake Again, Fit to Scene, modes, lamps, a bundle and photographs; `desk` is the module desk_steps."""
    uid = material.session_uid
    yield from baking_again(desk, uid)
    yield from modes(desk, uid)
    yield from lamps(desk)
    yield from fitting(desk)
    yield from loading(desk)
    yield from photographs(desk)
    yield from importlib.import_module("desk_times").steps(desk)
    # Back to where the walk was.
    for _ in range(40):
        if not desk.measured():
            break
        desk.press("Z", ctrl=True)
        yield 0.3
    bpy.ops.wm.open_mainfile(filepath=str(desk.HERE / "start.blend"))
    for path in list(desk.SOURCE.parent.glob("*.mmat")):
        remove(path)
    yield 1.0
    cube = bpy.data.objects["Cube"]
    cube.select_set(True)
    bpy.context.view_layer.objects.active = cube
    with desk.view():
        bpy.ops.ed.undo_push(message="Start")
    yield from desk.drop()
    yield from desk.idle()
    yield 0.5


def remove(path):
    """A bundle."""
    for inner in path.iterdir():
        inner.unlink()
    path.rmdir()


def found(uid):
    """The material of this number: undo makes pointers invalid."""
    return next(one for one in bpy.data.materials if one.session_uid == uid)


def baking_again(desk, uid):
    """As the button does."""
    desk.felt("before")
    found(uid).measured_materials.quality = "draft"
    desk.check("Draft sets the resolution", found(uid).measured_materials.resolution == 32)
    with desk.view():
        bpy.ops.measured_materials.bake_again("INVOKE_DEFAULT")
    desk.check("Bake Again goes on beside the window", desk.bakes.queue.is_busy())
    yield from desk.idle()
    facts = json.loads(found(uid)["measured_materials_facts"])
    desk.check("baked again in place", facts["settings"]["resolution"] == 32 and len(desk.measured()) == 1)
    yield 0.5
    desk.felt("bake again")


def modes(desk, uid):
    """Each mode in turn; and lamps to aim at, which the walk has switched off, on again."""
    later = importlib.import_module(f"{PACKAGE}.addon.ui.background.rebuild_later")
    later._went_on = desk.timed("rebuilding", later._went_on)
    yield from setting(desk, later, uid, "aim", "auto")
    desk.felt("aim at lamps")
    for mode in ("reference", "balanced", "preview", "exact"):
        yield from setting(desk, later, uid, "mode", mode)
        desk.check(f"mode {mode}", not found(uid).measured_quality.problem)
        desk.felt(f"mode {mode}")
    yield from setting(desk, later, uid, "mode", "reference")
    for words, mode, shift in (("undone", "exact", False), ("redone", "reference", True)):
        desk.press("Z", ctrl=True, shift=shift)
        built = functools.partial(is_built_as, desk, uid, mode)
        yield from desk.soon(f"a mode is {words} in one step", built)
        yield 0.5
    yield from setting(desk, later, uid, "mode", "exact")
    desk.felt("modes undone and redone")


def is_built_as(desk, uid, mode):
    """Whether this mode is set, and the material is built in it."""
    return desk.built_as(found(uid)) == (mode, mode)


def setting(desk, later, uid, name, value):
    """As a panel does: the change, its step of undo, and what is built after that."""
    with desk.view():
        desk.timed(f"setting {value}", setattr)(found(uid).measured_quality, name, value)
        bpy.ops.ed.undo_push(message=f"{name} {value}")
    yield 0.02
    while later._pending:
        yield 0.02
    yield 0.5


def lamps(desk):
    """Added, moved, deleted."""
    made = []
    for number in range(6):
        with desk.view():
            bpy.ops.object.light_add(type=("POINT", "AREA", "SUN", "SPOT")[number % 4], location=(number, 2, 3))
        made.append(bpy.context.object.name)
        yield 0.2
        bpy.context.object.location.x += 0.5
        bpy.context.object.data.energy *= 2
        yield 0.2
    desk.felt("lamps added and moved")
    for name in made:
        bpy.data.objects.remove(bpy.data.objects[name])
        yield 0.1
    cube = bpy.data.objects["Cube"]
    cube.select_set(True)
    bpy.context.view_layer.objects.active = cube
    yield 0.5
    desk.felt("lamps deleted")


def fitting(desk):
    """Fit to Scene, as the button does."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    yield 0.5
    desk.felt("engine")
    fit = importlib.import_module(f"{PACKAGE}.addon.ui.fit_to_scene")
    operator = fit.MEASURED_MATERIALS_OT_fit_to_scene
    fit._each = desk.timed("fit", fit._each)
    with desk.view():
        bpy.ops.measured_materials.fit_to_scene("INVOKE_DEFAULT")
    for _ in range(200):
        yield 0.05
        if not any(one.bl_idname == operator.__name__ for one in desk.window().modal_operators):
            break
    desk.check("fitted", not any(one.bl_idname == operator.__name__ for one in desk.window().modal_operators))
    desk.felt("fit to scene")


def loading(desk):
    """A bundle that is there already, dropped."""
    count = len(desk.measured())
    with desk.view():
        bpy.ops.measured_materials.import_bundle(
            "INVOKE_DEFAULT", directory=str(desk.SOURCE.parent), files=[{"name": "lacquer.mmat"}]
        )
    yield from desk.idle()
    desk.check("a bundle is loaded", len(desk.measured()) == count + 1)
    yield 0.5
    desk.felt("load a bundle")


def photographs(desk):
    """A folder of them, by a file with their lights."""
    before = set(desk.measured())
    names = {material.session_uid for material in before}
    with desk.view():
        bpy.ops.measured_materials.import_arc("INVOKE_DEFAULT", filepath=str(desk.SOURCE.parent / "swatch" / "a.lp"))
    look = importlib.import_module(f"{PACKAGE}.addon.ui.photograph_look").looking
    while look.is_looking():
        yield 0.05
    desk.found["photographs_looked_at"] = list(look.look.names) if look.look else look.problem
    yield 1.5
    desk.felt("look at photographs")
    desk.press("RET")
    yield 0.2
    desk.check("the photographs are baked beside the window", desk.bakes.queue.is_busy())
    start = time.monotonic()
    while len(desk.measured()) == len(names):
        yield 0.02
    desk.found["photographs_seconds_to_preview"] = time.monotonic() - start
    yield from desk.idle()
    desk.found["photographs_seconds_to_final"] = time.monotonic() - start
    made = [material for material in desk.measured() if material.session_uid not in names]
    desk.check("one swatch", len(made) == 1 and desk.bakes.queue.task is None)
    yield 0.5
    desk.felt("photographs")


if __name__ == "__main__":
    sys.exit(os.EX_USAGE)
