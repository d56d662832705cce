"""Run inside a real Blender window by window.py: seeded random edits, with undo and redo in between.

After each of them Blender draws and evaluates as it does for an artist; then the tables and groups that materials aim
by must be those of a scene that was just opened. Everything is said in a journal first: after a crash its last line
reports which edit it was.
"""

import importlib
import json
import random
import sys
import time
import traceback
from pathlib import Path

import bpy
import numpy as np

PACKAGE = "bl_ext.user_default.measured_materials"
SEED, COUNT = (int(word) for word in sys.argv[sys.argv.index("--") + 1 :][:2])
HERE = Path.cwd()
MODES = ("preview", "balanced", "exact", "reference")
LAMPS = ("POINT", "SUN", "SPOT", "AREA")
# Seconds that Blender gets to draw and to evaluate after an edit, before it is looked at.
PAUSE = 0.15

random.seed(SEED)
journal = (HERE / "journal.txt").open("w", buffering=1)


def note(words):
    """One line, on the disk before the next edit."""
    journal.write(f"{words}\n")
    journal.flush()


def view():
    """The 3D viewport as the context of operators."""
    window = bpy.context.window_manager.windows[0]
    area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
    region = next(region for region in area.regions if region.type == "WINDOW")
    return bpy.context.temp_override(window=window, screen=window.screen, area=area, region=region)


def operator(call, **arguments):
    """As an artist calls it: with an undo step of its own."""
    call("EXEC_DEFAULT", True, **arguments)


def edited(words):
    """Close an edit made by Python as a button does, with an undo step."""
    bpy.ops.ed.undo_push(message=words)


def scene():
    """The window's."""
    return bpy.context.window_manager.windows[0].scene


def place():
    """Somewhere around the objects."""
    return random.uniform(-4, 4), random.uniform(-4, 4), random.uniform(0.5, 5)


def select(objects):
    """These and no others."""
    bpy.ops.object.select_all(action="DESELECT")
    for obj in objects:
        obj.select_set(True)
        bpy.context.view_layer.objects.active = obj


def any_of(kind):
    """A random object of the scene of this type, or None."""
    found = [obj for obj in scene().objects if obj.type == kind]
    return random.choice(found) if found else None


def measured():
    """Materials of ours that can be changed."""
    return [material for material in bpy.data.materials if material.get("measured_materials_facts")]


# --- edits -----------------------------------------------------------------------------------------------


def add_lamp():
    kind = random.choice(LAMPS)
    operator(bpy.ops.object.light_add, type=kind, location=place(), rotation=(random.uniform(-1, 1), 0, 0))
    return kind


def move_lamp():
    if (lamp := any_of("LIGHT")) is None:
        return "no lamp"
    select([lamp])
    operator(bpy.ops.transform.translate, value=place())
    return lamp.name


def scale_lamp():
    if (lamp := any_of("LIGHT")) is None:
        return "no lamp"
    select([lamp])
    operator(bpy.ops.transform.resize, value=(random.uniform(0.5, 2),) * 3)
    return lamp.name


def delete_lamps():
    lamps = [obj for obj in scene().objects if obj.type == "LIGHT"]
    gone = random.sample(lamps, min(len(lamps), random.choice((1, 1, 2, 9))))
    if not gone:
        return "no lamp"
    words = ", ".join(obj.name for obj in gone)
    select(gone)
    operator(bpy.ops.object.delete)
    return words


def duplicate_lamp():
    if (lamp := any_of("LIGHT")) is None:
        return "no lamp"
    select([lamp])
    operator(bpy.ops.object.duplicate, linked=random.random() < 0.5)
    return lamp.name


def dim_lamp():
    if (lamp := any_of("LIGHT")) is None:
        return "no lamp"
    lamp.data.energy = random.choice((0.0, 3.0, 1000.0))
    edited("Energy")
    return f"{lamp.name} to {lamp.data.energy}"


def hide_lamp():
    if (lamp := any_of("LIGHT")) is None:
        return "no lamp"
    lamp.hide_viewport = not lamp.hide_viewport
    edited("Hide")
    return lamp.name


def change_lamp():
    if (lamp := any_of("LIGHT")) is None:
        return "no lamp"
    lamp.data.type = random.choice(LAMPS)
    edited("Type")
    return f"{lamp.name} to {lamp.data.type}"


def add_object():
    operator(bpy.ops.mesh.primitive_monkey_add, location=place())
    if measured() and random.random() < 0.7:
        bpy.context.object.data.materials.append(random.choice(measured()))
        edited("Material")
    return bpy.context.object.name


def delete_object():
    meshes = [obj for obj in scene().objects if obj.type == "MESH"]
    if len(meshes) < 2:
        return "too few"
    gone = random.choice(meshes)
    words = gone.name
    select([gone])
    operator(bpy.ops.object.delete)
    return words


def bake():
    """The active object gets a measured material, of a table small enough to be made in a second."""
    settings = {"resolution": 8, "alpha": "given", "bundles": str(HERE)}
    operator(
        bpy.ops.measured_materials.import_brdf, directory=str(HERE), files=[{"name": "lacquer.binary"}], **settings
    )


def copy_material():
    if not measured() or (obj := any_of("MESH")) is None:
        return "no material"
    select([obj])
    copy = random.choice(measured()).copy()
    obj.active_material = copy
    edited("Material")
    return copy.name


def import_material():
    if (obj := any_of("MESH")) is None:
        return "no object"
    select([obj])
    bake()
    return bpy.context.object.active_material.name


def delete_material():
    if len(measured()) < 2:
        return "too few"
    gone = random.choice(measured())
    words = gone.name
    bpy.data.materials.remove(gone)
    edited("Delete Material")
    return words


def change_mode():
    if not measured():
        return "no material"
    material, mode = random.choice(measured()), random.choice(MODES)
    material.measured_quality.mode = mode
    edited("Mode")
    return f"{material.name} to {mode}"


def fit():
    if not measured():
        return "no material"
    operator(bpy.ops.measured_materials.fit_to_scene)
    return ""


def purge():
    operator(bpy.ops.outliner.orphans_purge, do_local_ids=True, do_linked_ids=True, do_recursive=True)
    return ""


def new_world():
    kind = random.choice(("none", "grey", "spot", "bright spot"))
    if kind == "none":
        scene().world = None
    else:
        world = bpy.data.worlds.new(kind)
        if bpy.app.version < (5, 0, 0):
            world.use_nodes = True
        tree = world.node_tree
        background = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeBackground")
        if kind != "grey":
            texture = tree.nodes.new("ShaderNodeTexEnvironment")
            texture.image = bpy.data.images.load(str(HERE / "spot.exr"), check_existing=True)
            tree.links.new(texture.outputs["Color"], background.inputs["Color"])
        background.inputs["Strength"].default_value = 5 if kind == "bright spot" else 0.5
        scene().world = world
    edited("World")
    return kind


def dim_world():
    tree = scene().world.node_tree if scene().world else None
    if tree is None:
        return "no world"
    background = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeBackground")
    background.inputs["Strength"].default_value = random.uniform(0, 2)
    edited("Strength")
    return ""


def shading():
    window = bpy.context.window_manager.windows[0]
    area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
    area.spaces.active.shading.type = random.choice(("RENDERED", "RENDERED", "SOLID"))
    return area.spaces.active.shading.type


def next_frame():
    operator(bpy.ops.screen.frame_offset, delta=random.choice((-1, 1)))
    return str(scene().frame_current)


def render():
    bpy.ops.render.render()
    return ""


def undo():
    steps = random.choice((1, 1, 1, 2, 3))
    for _ in range(steps):
        if bpy.ops.ed.undo.poll():
            bpy.ops.ed.undo()
    return str(steps)


def redo():
    steps = random.choice((1, 1, 2))
    for _ in range(steps):
        if bpy.ops.ed.redo.poll():
            bpy.ops.ed.redo()
    return str(steps)


EDITS = {
    add_lamp: 8, move_lamp: 4, scale_lamp: 2, delete_lamps: 4, duplicate_lamp: 4, dim_lamp: 3, hide_lamp: 2,
    change_lamp: 2, add_object: 3, delete_object: 2, copy_material: 2, import_material: 2, delete_material: 1,
    change_mode: 4, fit: 2, purge: 1, new_world: 4, dim_world: 2, shading: 2, next_frame: 1, render: 1,
    undo: 16, redo: 8,
}  # fmt: skip


# --- what must be so after each --------------------------------------------------------------------------


def expected():
    """What `lamps` would make of the scene if it had just been opened, by a survey of its own."""
    lamps = importlib.import_module(f"{PACKAGE}.addon.lights.light_tables")
    report = lamps.survey(bpy.context.evaluated_depsgraph_get())
    return lamps.table_of(report), (report.slots, report.world.aimed), (0 if report.inexact else report.slots, False)


def fault():
    """Words on what is not as in a scene that was just opened; empty if all is well."""
    tables = [i for i in bpy.data.images if i.name.startswith("MM Lamps") and i.users and i.library is None]
    if not tables:
        return ""
    table, aimed, sampled = expected()
    for image in tables:
        pixels = np.empty(table.size, np.float32)
        image.pixels.foreach_get(pixels)
        if not np.array_equal(pixels, table[::-1].ravel()):
            return f"{image.name} is not that of a fresh start: {pixels.reshape(table.shape)[::-1].tolist()}"
    for tree in bpy.data.node_groups:
        found = (tree.get("measured_materials_lamps"), tree.get("measured_materials_world"))
        if "measured_materials_instead" in tree:
            continue  # it hangs on what the others can sample
        wanted = aimed
        if "measured_materials_sampled" in tree:
            found, wanted = found[:1], sampled[:1]
        if found[0] is not None and tree.users and found != wanted:
            return f"{tree.name} aims at {found}, a fresh start at {wanted}"
    return ""


# --- one step at a time, so that Blender draws in between ------------------------------------------------


def prepare():
    """The file's measured material in a rendered viewport."""
    if not measured():
        raise RuntimeError("the file has no measured material")
    note(f"Blender {bpy.app.version_string}, seed {SEED}, {COUNT} edits of {len(measured())} measured material")
    area = next(a for a in bpy.context.window_manager.windows[0].screen.areas if a.type == "VIEW_3D")
    space = area.spaces.active
    space.shading.type = "RENDERED"
    space.overlay.show_overlays = space.show_gizmo = False  # most of the time of a window drawn by software


def steps():
    """Does one edit, then waits, then looks; yields in between."""
    prepare()
    yield
    for number in range(COUNT):
        while any(map(bpy.app.is_job_running, ("RENDER_PREVIEW", "RENDER"))):
            yield  # while a thread renders, Blender refuses writes to a timer; an artist's edits stop the thread
        edit = random.choices(list(EDITS), list(EDITS.values()))[0]
        note(f"{number} {edit.__name__} ...")
        with view():
            words = edit()
        note(f"{number} {edit.__name__} {words}")
        yield
        yield
        for _ in range(20):  # what a handler was refused, because of a preview, it does soon
            if not (words := fault()):
                break
            yield
        else:
            raise RuntimeError(words)
    bpy.ops.wm.save_as_mainfile(filepath=str(HERE / "edited.blend"), copy=True)
    table, wanted, _ = expected()
    (HERE / "table.json").write_text(json.dumps({"table": table.tolist(), "groups": wanted}))
    note("all edits done")


todo = steps()


def advance():
    """Called by a timer; Blender's main loop runs in between."""
    try:
        next(todo)
    except StopIteration:
        note(f"ended after {time.monotonic() - began:.0f} s")
        bpy.ops.wm.quit_blender()
        return None
    except BaseException:
        note(traceback.format_exc())
        bpy.ops.wm.quit_blender()
        return None
    return PAUSE


began = time.monotonic()
bpy.app.timers.register(advance, first_interval=2.0, persistent=True)
