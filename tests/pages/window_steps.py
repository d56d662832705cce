"""Run inside a real Blender window by window.py: a material is imported, checked and marked, and pictures are taken."""

import importlib
import json
import subprocess
import sys
import traceback
from pathlib import Path

import bpy
from mathutils import Euler

PACKAGE = "bl_ext.user_default.measured_materials"
HERE = Path.cwd()
_PANELS = ("panel", "asset_panel", "check_scene")
taken = {}


def window():
    """The window."""
    return bpy.context.window_manager.windows[0]


def area_of(kind):
    """The first area of this type."""
    return next(area for area in window().screen.areas if area.type == kind)


def within(area):
    """The area as context of operators."""
    region = next(region for region in area.regions if region.type == "WINDOW")
    return bpy.context.temp_override(window=window(), screen=window().screen, area=area, region=region)


def take(name, *areas, share=1.0):
    """A picture of what these areas cover together, of their height only an upper share."""
    subprocess.run(["import", "-window", "root", str(HERE / f"{name}.png")], check=True)
    left, low = min(a.x for a in areas), min(a.y for a in areas)
    right, high = max(a.x + a.width for a in areas), max(a.y + a.height for a in areas)
    high_enough = round(share * (high - low))
    taken[name] = [left, high - high_enough, right - left, high_enough]


def scrolled(area, steps):
    """Turn the wheel over a panel."""
    for _ in range(steps):
        with within(area):
            bpy.ops.view2d.scroll_down()
        yield 0.05


def split(view):
    """The editor cut in two; the new one, on the right, shows properties."""
    known = set(window().screen.areas)
    with within(view):
        bpy.ops.screen.area_split(direction="VERTICAL", factor=0.62)
    (new,) = set(window().screen.areas) - known
    yield 0.5  # until the editors know where they are
    left, right = sorted((view, new), key=lambda area: area.x)
    right.ui_type = "PROPERTIES"
    return left, right


def open_panels(names):
    """Have these sub-panels open and all others closed, from their first drawing on."""
    # In the order in which the extension registers them, which is that of the panels on the screen.
    modules = [importlib.import_module(f"{PACKAGE}.addon.ui.panels.{name}") for name in _PANELS]
    for cls in (cls for module in modules for cls in module.classes):
        name = cls.__name__
        if not name.startswith("MEASURED_MATERIALS_PT_material_"):
            continue
        bpy.utils.unregister_class(cls)
        cls.bl_options = set() if name.rpartition("_")[2] in names else {"DEFAULT_CLOSED"}
        bpy.utils.register_class(cls)


def scene():
    """A ball on a table under a lamp."""
    for obj in list(bpy.data.objects):
        if obj.type == "MESH":
            bpy.data.objects.remove(obj)
    with within(area_of("VIEW_3D")):
        bpy.ops.mesh.primitive_plane_add(size=60, location=(0, 0, -1))
        bpy.ops.mesh.primitive_monkey_add(size=2.4, rotation=(-0.35, 0, 0.35))
        bpy.ops.object.shade_smooth()
        modifier = bpy.context.object.modifiers.new("Subdivision", "SUBSURF")
        modifier.levels = modifier.render_levels = 2
    lamp = next(obj for obj in bpy.data.objects if obj.type == "LIGHT")
    lamp.data.type = "AREA"
    lamp.data.energy, lamp.data.size = 600, 2.0
    lamp.location = (3.0, -2.5, 3.5)
    lamp.rotation_euler = (0.75, 0.35, 0.6)
    bpy.context.scene.world.node_tree.nodes["Background"].inputs[0].default_value = (0.1, 0.12, 0.15, 1)
    bpy.context.scene.render.engine = "CYCLES"


def steps():
    """All of them; each pause is in seconds."""
    scene()
    view, panel = yield from split(area_of("VIEW_3D"))
    yield 0.5
    with within(view):
        bpy.ops.measured_materials.import_bundle(filepath=str(HERE / "gold.mmat"))
    bpy.context.view_layer.objects.active.active_material.name = "Gold"
    yield 0.5
    panel.spaces.active.context = "MATERIAL"
    space = view.spaces.active
    space.overlay.show_overlays, space.show_gizmo, space.show_region_toolbar = False, False, False
    around = space.region_3d
    around.view_perspective, around.view_distance, around.view_location = "PERSP", 6.0, (0, 0, 0.1)
    around.view_rotation = Euler((1.25, 0, 0.25)).to_quaternion()
    bpy.context.scene.cycles.preview_samples = 48
    space.shading.type = "RENDERED"
    yield 42.0
    take("window_panel", view, panel)
    space.shading.type = "SOLID"
    check = importlib.import_module(f"{PACKAGE}.addon.ui.panels.live_check")
    check.check_now(bpy.context.scene)
    yield 0.5
    yield from scrolled(panel, 14)
    yield 1.0
    take("window_check", panel)
    with within(panel):
        bpy.ops.measured_materials.mark_asset(author="A. Weaver", license="CC0", copyright="")
    bpy.ops.wm.save_mainfile()
    with within(panel):
        bpy.ops.screen.area_close()
    view = area_of("VIEW_3D")
    view.ui_type = "ASSETS"
    yield 1.0
    browser = view.spaces.active
    browser.params.asset_library_reference = "LOCAL"
    browser.show_region_tool_props = True
    yield 3.0
    with within(view):
        browser.activate_asset_by_id(bpy.data.materials["Gold"])
    yield 3.0
    take("window_assets", view, share=0.75)


def run():
    """The next step."""
    try:
        return next(walk)
    except StopIteration:
        (HERE / "taken.json").write_text(json.dumps(taken))
    except Exception:
        traceback.print_exc()
        (HERE / "failed.txt").write_text(traceback.format_exc())
    sys.stdout.flush()
    bpy.ops.wm.quit_blender()
    return None


open_panels({"adjust", "check"})
walk = steps()
bpy.app.timers.register(run, first_interval=2.0)
