"""Run inside a real Blender window by desk.py: imports beside it, cancelled, undone and redone, and what is left."""

import functools
import importlib
import json
import os
import random
import sys
import time
import traceback
import types
from pathlib import Path

import bpy

PACKAGE = "bl_ext.user_default.measured_materials"
CANCELS, ROUNDS, OTHERS = (int(word) for word in sys.argv[sys.argv.index("--") + 1 :][:3])
HERE = Path.cwd()
SOURCE = HERE / "data" / "lacquer.binary"
bakes = importlib.import_module(f"{PACKAGE}.addon.ui.background.bake_queue")
sys.path.insert(0, str(HERE))
others = importlib.import_module("desk_others")
found = {}
journal = (HERE / "journal.txt").open("w", buffering=1)
random.seed(3)
began = time.monotonic()


def note(words):
    """One line, on the disk before what comes next."""
    journal.write(f"{time.monotonic() - began:6.1f} {words}\n")
    journal.flush()


# --- what hangs ------------------------------------------------------------------------------------------

# All between two steps of the walk: the longest time without an answer, and what we did meanwhile, by wall clock and
# by this thread's own processor time, which other programs on a busy machine do not count in.
gaps, steps_taken = [], []
last = [time.perf_counter()]


def heartbeat():
    """Every 20 ms, where nothing keeps Blender busy."""
    now = time.perf_counter()
    gaps.append(now - last[0])
    last[0] = now
    return 0.02


inside = []


def timed(name, function, ours=True):
    """The same function, which notes how long it keeps the interface waiting, without what is timed within it."""

    @functools.wraps(function)
    def run(*arguments, **named):
        start, spent = time.perf_counter(), time.thread_time()
        inside.append([0.0, 0.0])
        try:
            return function(*arguments, **named)
        finally:
            wall, work = time.perf_counter() - start, time.thread_time() - spent
            within = inside.pop()
            if inside:
                inside[-1][0] += wall
                inside[-1][1] += work
            steps_taken.append((work - within[1], wall - within[0], name, ours))

    return run


for method in ("_begin", "_show", "_finish", "_tell_progress", "cancel"):
    setattr(bakes.Queue, method, timed(method, getattr(bakes.Queue, method)))
# The step of undo is Blender's own work.
replaced = []
bakes.push = timed("undo step, by Blender", bakes.push, ours=False)
for event in (name for name in dir(bpy.app.handlers) if isinstance(getattr(bpy.app.handlers, name), list)):
    handlers = getattr(bpy.app.handlers, event)
    for place, handler in enumerate(handlers):
        if getattr(handler, "__module__", "").startswith(PACKAGE):
            handlers[place] = bpy.app.handlers.persistent(timed(f"{event}: {handler.__name__}", handler))
            replaced.append((handlers, handlers[place], handler))


def felt(phase):
    """Note what this part of the walk was like, and begin the next."""
    ours = [step for step in steps_taken if step[3]]
    work, _wall, name, _ = max(ours, default=(0.0, 0.0, "", True))
    theirs = max((step for step in steps_taken if not step[3]), default=(0.0, 0.0, "", False))
    found.setdefault("stalls", {})[phase] = {
        "longest gap": round(max(gaps, default=0.0), 3),
        "longest of ours, processor": round(work, 3),
        "by wall clock": round(max((step[1] for step in ours), default=0.0), 3),
        "in": name,
        "longest undo step, processor": round(theirs[0], 3),
    }
    note(f"felt {phase}: {found['stalls'][phase]}")
    gaps.clear()
    steps_taken.clear()


# --- what an artist does ---------------------------------------------------------------------------------


def window():
    """The window."""
    return bpy.context.window_manager.windows[0]


def press(key, **modifiers):
    """A key, over the viewport."""
    for value in ("PRESS", "RELEASE"):
        window().event_simulate(type=key, value=value, x=300, y=300, **modifiers)


def view():
    """The 3D viewport as the context of operators."""
    area = next(area for area in window().screen.areas if area.type == "VIEW_3D")
    region = next(region for region in area.regions if region.type == "WINDOW")
    return bpy.context.temp_override(window=window(), screen=window().screen, area=area, region=region)


def drop(names=(SOURCE.name,), **settings):
    """As Blender does when files are dropped: the operator is invoked, and the dialog confirmed."""
    with view():
        window().event_simulate(type="MOUSEMOVE", value="NOTHING", x=300, y=300)
        bpy.ops.measured_materials.import_brdf(
            "INVOKE_DEFAULT",
            directory=str(SOURCE.parent),
            files=[{"name": name} for name in names],
            bundles=str(SOURCE.parent),
            **settings,
        )
    yield 0.3
    press("RET")
    yield 0.1


def measured():
    """Materials of ours."""
    return [material for material in bpy.data.materials if material.get("measured_materials_facts")]


def built_as(material):
    """The mode that is set, and the one that the material was built in."""
    facts = json.loads(material["measured_materials_facts"])
    return material.measured_quality.mode, facts["rendering"]["choices"]["mode"]


def bundles():
    """All that lies beside the measurement."""
    return sorted(path.name for path in SOURCE.parent.iterdir() if path.name not in (SOURCE.name, "swatch"))


def datablocks():
    """How many there are of what we make."""
    return {kind: len(getattr(bpy.data, kind)) for kind in ("materials", "images", "node_groups")}


def children():
    """Processes that Blender has started and that still run."""
    pids = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if fields[0] != "Z" and int(fields[1]) == os.getpid():
            pids.append(int(stat.parent.name))
    return pids


def memory():
    """MiB of this process."""
    line = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmRSS"))
    return int(line.split()[1]) / 1024


def idle(seconds=600.0):
    """Wait for the queue."""
    until = time.monotonic() + seconds
    while bakes.queue.is_busy():
        if time.monotonic() > until:
            raise RuntimeError("the bake does not end")
        yield 0.05


def check(words, ok):
    """One thing that must be so."""
    note(f"{'ok  ' if ok else 'FAIL'} {words}")
    if not ok:
        raise RuntimeError(words)


def soon(words, condition, seconds=30.0):
    """What must be so before long: a busy machine may take its time."""
    until = time.monotonic() + seconds
    while not condition() and time.monotonic() < until:
        yield 0.1
    check(words, condition())


# --- the steps -------------------------------------------------------------------------------------------


def steps():
    """All of them; each pause is in seconds."""
    cube = bpy.data.objects["Cube"]
    cube.select_set(True)
    bpy.context.view_layer.objects.active = cube
    with view():
        bpy.ops.ed.undo_push(message="Start")
    before, first = datablocks(), cube.active_material.name
    yield 1.0
    felt("start")
    yield 2.0
    felt("rest")
    # One import from the drop to the end.
    found["load"] = os.getloadavg()[0]
    watch = importlib.import_module("desk_times").Stopwatch(types.SimpleNamespace(**globals()))
    yield from drop()
    check("the dialog was confirmed and the bake goes on beside the window", bakes.queue.is_busy())
    while not measured():
        yield 0.02
    found["seconds_to_preview"] = watch.read()
    check("the preview is on the object", bpy.data.objects["Cube"].active_material == measured()[0])
    check("and is in mode Preview", measured()[0].measured_quality.mode == "preview")
    measured()[0].measured_quality.aim = "never"
    yield from idle()
    found["seconds_to_final"] = watch.read()
    material = measured()[0]
    check("one material, now Exact", len(measured()) == 1 and material.measured_quality.mode == "exact")
    check("the artist's setting was kept", material.measured_quality.aim == "never")
    check("one bundle and nothing else", bundles() == ["lacquer.mmat"])
    check("the worker is gone", not children())
    yield 0.5
    felt("import")
    if OTHERS:
        yield from others.steps(types.SimpleNamespace(**globals()), material)
        felt("end of others")
    # Undo and redo are one step each.
    press("Z", ctrl=True)
    was = lambda: not measured() and bpy.data.objects["Cube"].active_material.name == first  # noqa: E731
    yield from soon("undone in one step", was)
    yield 1.0
    press("Z", ctrl=True, shift=True)
    yield from soon("redone in one step", lambda: [m.measured_quality.mode for m in measured()] == ["exact"])
    yield 1.0
    press("Z", ctrl=True)
    yield 1.0
    note(f"{datablocks()} were {before}")
    felt("undo and redo")
    # Cancelled at random moments.
    for number in range(CANCELS):
        lying = bundles()
        yield from drop()
        yield random.uniform(0.0, 6.0)
        press("ESC")
        yield 0.5
        yield from soon(f"cancel {number}: not busy", lambda: not bakes.queue.is_busy())
        check(f"cancel {number}: no process", not children())
        check(f"cancel {number}: no file", bundles() == lying)
        check(f"cancel {number}: no material, the old one back", not measured())
        check(f"cancel {number}: slot", bpy.data.objects["Cube"].active_material.name == first)
        note(f"{datablocks()}")
        check(f"cancel {number}: no datablock", datablocks() == before)
    felt("cancels")
    # Undone while it bakes.
    yield from drop()
    while not measured():
        yield 0.02
    press("Z", ctrl=True)
    over = lambda: not bakes.queue.is_busy() and not children() and not measured()  # noqa: E731
    yield from soon("undo during a bake ends it", over)
    # Several at once.
    yield from drop((SOURCE.name, SOURCE.name), quality="draft")
    note(f"{bakes.queue.waiting}, {bakes.queue.task}")
    check("two wait in a row", len(bakes.queue.waiting) + (bakes.queue.task is not None) == 2)
    yield from idle()
    check("both are there", len(measured()) == 2)
    press("Z", ctrl=True)
    yield 1.0
    press("Z", ctrl=True)
    yield 1.0
    note(f"after two undos: {[m.name for m in measured()]}")
    sizes = []
    for number in range(ROUNDS):
        yield from drop(quality="draft")
        yield from idle()
        yield 0.2
        press("Z", ctrl=True)
        gone = lambda: not [m for m in measured() if m.users and not m.use_fake_user]  # noqa: E731
        yield from soon(f"round {number}: undone", gone)
        yield 0.6
        press("Z", ctrl=True, shift=True)
        yield from soon(f"round {number}: redone", lambda: any("measured_materials_bake" not in m for m in measured()))
        yield 0.6
        made = bpy.data.objects["Cube"].active_material
        check(f"round {number}: redone on the object", made is not None and made in measured())
        bpy.data.materials.remove(made)
        with view():
            bpy.ops.ed.undo_push(message="Delete")
            bpy.ops.outliner.orphans_purge("EXEC_DEFAULT", True, do_local_ids=True, do_recursive=True)
        yield 0.2
        sizes.append(round(memory()))
        note(f"round {number}: {sizes[-1]} MiB, {datablocks()}")
    found["memory_MiB"] = sizes
    felt("rounds")
    # Another file while it bakes.
    lying = bundles()
    yield from drop()
    yield 2.0
    bpy.ops.wm.open_mainfile(filepath=str(HERE / "start.blend"))
    yield 1.0
    check("a closed file leaves nothing", not children() and bundles() == lying and not measured())
    (HERE / "lying.json").write_text(json.dumps(bundles()))
    yield from drop()
    yield 2.0
    note("quit while it bakes")


todo = steps()


def advance():
    """Called by a timer; Blender's main loop runs in between."""
    try:
        return next(todo)
    except StopIteration:
        (HERE / "found.json").write_text(json.dumps(found))
        note("ended")
    except BaseException:
        note(traceback.format_exc())
        note(str(found))
    for handlers, own, handler in replaced:
        handlers[handlers.index(own)] = handler
    bpy.ops.wm.quit_blender()
    return None


bpy.app.timers.register(heartbeat, first_interval=1.0, persistent=True)
bpy.app.timers.register(advance, first_interval=2.0, persistent=True)
