"""Run inside a real Blender window by tutorials.py: tutorial_measurement.md, step by step, by mouse and keys."""

import importlib
import json

import bpy
from hands import (
    HERE,
    area_of,
    by_sight,
    check,
    click,
    dialogues,
    function_key,
    keys,
    move,
    note,
    open_panel,
    picture,
    press,
    region_of,
    send,
    soon,
    type_into,
    unit,
    window,
)
from hands_menus import (
    choose,
    choose_file,
    file_import,
    open_tab,
)

PACKAGE = "bl_ext.user_default.measured_materials"
bakes = importlib.import_module(f"{PACKAGE}.addon.ui.background.bake_queue")
live = importlib.import_module(f"{PACKAGE}.addon.ui.panels.live_check")
tree = importlib.import_module(f"{PACKAGE}.nodes.material_tree")
NAME = "lacquer"
MODE = "measured_quality.mode"


def measured():
    """Materials of ours."""
    return [material for material in bpy.data.materials if material.get("measured_materials_facts")]


def facts():
    """Those of the only one."""
    return json.loads(measured()[0]["measured_materials_facts"])


def baked():
    """Wait for the queue."""
    yield from soon("the bake has ended", lambda: not bakes.queue.is_busy(), 900)
    yield 0.5


def on_object():
    """Screen place of the middle of the object."""
    from bpy_extras.view3d_utils import location_3d_to_region_2d

    area = area_of("VIEW_3D")
    region = region_of(area)
    middle = bpy.data.objects["Cube"].matrix_world.translation
    x, y = location_3d_to_region_2d(region, area.spaces.active.region_3d, middle)
    return region.x + x, region.y + y


def drop(name):
    """Drag a file from a file browser beside the viewport onto the object."""
    view = area_of("VIEW_3D")
    known = set(window().screen.areas)
    with bpy.context.temp_override(window=window(), screen=window().screen, area=view, region=region_of(view)):
        bpy.ops.screen.area_split(direction="VERTICAL", factor=0.4)
    (new,) = set(window().screen.areas) - known
    yield 0.5  # until the editors know where they are
    area = min(view, new, key=lambda one: one.x)
    area.ui_type = "FILES"
    yield 1.5
    space, region = area.spaces.active, region_of(area)
    space.params.directory = str(HERE / "data").encode()
    yield 1.0
    y = yield from _row_of(name, space, region)
    yield 0.8  # or the next press would be that of a double click
    start, end = (region.x + 4 * unit(), y), on_object()
    yield from send("mousedown", 1, seconds=0.0)
    for part in (0.0, 0.01, 0.02, 0.04, 0.1, 0.3, 0.6, 0.9, 1.0):
        yield from move(*(a + part * (b - a) for a, b in zip(start, end)))
        yield 0.15
    yield from picture("measurement_1_drag")
    yield from send("mouseup", 1, seconds=1.0)
    return area


@by_sight
def _row_of(name, space, region):
    """Click the rows of a file browser down to this file, and say where that is."""
    y = region.y + region.height
    while space.params.filename != name:
        y -= unit() / 2
        if y < region.y:
            raise RuntimeError(f"no file {name} in {space.params.directory}")
        yield from move(region.x + 4 * unit(), y)
        yield from click()
    return y


def steps():
    """The numbers are those of the tutorial's headings."""
    check("1 the extension is installed", hasattr(bpy.types, "MEASURED_MATERIALS_FH_all"))
    yield from file_import("measured_materials.import_brdf")
    yield from choose_file(f"{NAME}.binary")
    yield 0.5
    yield from picture("measurement_3_file_browser")
    yield from keys("Escape")
    yield 0.5
    dialogues.clear()
    browser = yield from drop(f"{NAME}.binary")
    yield from soon("3 the dialogue is open", lambda: bool(dialogues))
    yield 0.5
    yield from picture("measurement_3_dialogue")
    yield from keys("Return")
    check("3 the bake goes on beside the window", bakes.queue.is_busy())
    with bpy.context.temp_override(window=window(), screen=window().screen, area=browser, region=region_of(browser)):
        bpy.ops.screen.area_close()
    yield from soon("3 the material is there", lambda: bool(measured()))
    cube = bpy.data.objects["Cube"]
    check("3 at once on the object, as a Preview", cube.active_material == measured()[0])
    check("3 in mode Preview", measured()[0].measured_quality.mode == "preview")
    yield from picture("measurement_3_preview")
    yield from baked()
    # The properties editor is looked at under heading 4, in Cycles: EEVEE takes minutes for a material's icon where it
    # draws by software, and all waits for it.
    check("3 it sharpens", measured()[0].measured_quality.mode == "exact" and len(measured()) == 1)
    check("3 the files lie beside the .blend", (HERE / "data" / f"{NAME}.mmat" / "material.json").exists())
    check("3 the textures are packed", all(i.packed_file for i in bpy.data.images if i.name.startswith("lacquer")))
    yield from picture("measurement_3_baked")
    properties = area_of("PROPERTIES")
    yield from suits(properties)
    yield from rendered()
    yield from adjusted(properties)
    yield from kept(properties)


def suits(properties):
    """Headings 4 and, of the mode, 5."""
    yield from open_tab(properties, "RENDER")
    yield from choose(properties, "render.engine", "c")
    yield from soon("4 the engine is Cycles", lambda: bpy.context.scene.render.engine == "CYCLES")
    yield from open_tab(properties, "MATERIAL")
    yield from soon("4 the panel says that settings spoil it", lambda: live.shown.harmful > 0)
    yield from picture("measurement_4_spoilt")
    before = live.shown.harmful
    yield from press(properties, "measured_materials.check_scene(mend=True)")
    yield from soon("4 Fix has fixed them", lambda: live.shown.harmful < before)
    note(f"{before} settings spoilt it, now {live.shown.harmful}")
    yield from open_panel(properties, "check")
    yield 1.0
    yield from picture("measurement_4_check")
    for letter, mode in (("b", "balanced"), ("p", "preview"), ("e", "exact")):
        yield from choose(properties, MODE, letter)
        built = lambda mode=mode: facts()["rendering"]["choices"]["mode"] == mode  # noqa: E731
        yield from soon(f"5 mode {mode}", built, 600)
        yield from picture(f"measurement_5_{mode}")


def rendered():
    """Heading 5: F12."""
    done = []
    bpy.app.handlers.render_complete.append(lambda *_: done.append(True))
    yield from move(*on_object())
    yield from function_key(12)
    yield from soon("5 the picture is rendered", lambda: bool(done))
    bpy.app.handlers.render_complete.clear()
    yield 1.0
    yield from picture("measurement_5_rendered")
    yield from keys("Escape")
    yield 1.0


def adjusted(properties):
    """Heading 6: a number typed, and undone."""
    yield from open_panel(properties, "adjust")
    _, node = next(iter(tree.measured_nodes(measured()[0].node_tree)))
    yield from type_into(properties, f"inputs[{node.inputs.find('Brightness')}]", "0.5")
    value = lambda: next(iter(tree.measured_nodes(measured()[0].node_tree)))[1].inputs["Brightness"].default_value  # noqa: E731
    yield from soon("6 the number typed is set", lambda: abs(value() - 0.5) < 1e-6)
    yield from picture("measurement_6_adjust")
    yield from move(*on_object())
    yield from keys("ctrl+z")
    yield from soon("6 undone", lambda: abs(value() - 1) < 1e-6)


def kept(properties):
    """Heading 7."""
    yield from open_panel(properties, "asset")
    yield from press(properties, "measured_materials.mark_asset")
    yield from picture("measurement_7_mark")
    yield from keys("Return")
    yield from soon("7 it is an asset", lambda: measured()[0].asset_data is not None)
    yield from move(*on_object())
    yield from keys("ctrl+s")
    yield from soon("7 the file is saved", lambda: not bpy.data.is_dirty)
    yield from picture("measurement_7_kept")
