"""Run inside a real Blender window by asset_library.py: the library in the asset browser, an asset onto an object."""

import json
import sys
import traceback
from pathlib import Path

import bpy
from mathutils import Vector

sys.path.insert(0, str(Path.cwd()))
from bpy_extras.view3d_utils import location_3d_to_region_2d
from hands import HERE, _send, area_of, check, click, move, note, picture, region_of, soon, take, unit, window

WANTED = sys.argv[sys.argv.index("--") + 1]
# Numbers of catalogues by their path, as their file lists them.
LINES = (HERE / "assets" / "blender_assets.cats.txt").read_text().splitlines()
CATALOGUES = {parts[1]: parts[0] for parts in (line.split(":") for line in LINES) if len(parts) == 3}


def split():
    """The view above, an asset browser of the library below it; all other editors are closed."""
    view = area_of("VIEW_3D")
    others = [area for area in window().screen.areas if area != view]
    for area in others:
        with bpy.context.temp_override(window=window(), screen=window().screen, area=area):
            bpy.ops.screen.area_close()
        yield 0.2
    known = set(window().screen.areas)
    with bpy.context.temp_override(window=window(), screen=window().screen, area=view, region=region_of(view)):
        bpy.ops.screen.area_split(direction="HORIZONTAL", factor=0.58)
    (new,) = set(window().screen.areas) - known
    yield 0.5
    low, high = sorted((view, new), key=lambda area: area.y)
    low.ui_type = "ASSETS"
    yield 1.0
    return high, low


def show(browser):
    """The library of the preferences, its catalogues and what is known of an asset."""
    space = browser.spaces.active
    space.params.asset_library_reference = "Measured"
    space.show_region_toolbar = space.show_region_tool_props = True
    yield 2.0
    tree = region_of(browser, "TOOLS")
    yield from move(tree.x + 2 * unit(), tree.y + tree.height - 3.85 * unit())
    yield from click()  # open the row of Measured Materials


def active(browser):
    """Name of the asset that was clicked last, empty before."""
    with bpy.context.temp_override(window=window(), screen=window().screen, area=browser, region=region_of(browser)):
        asset = getattr(bpy.context, "asset", None)
    return "" if asset is None else asset.name


def find(browser, wanted):
    """Click from tile to tile to the asset that is wanted; the mouse stays on it."""
    region = region_of(browser)
    for y in range(region.y + region.height - 60, region.y, -120):
        for x in range(region.x + 60, region.x + region.width, 40):
            yield from move(x, y)
            yield from click()
            if active(browser) == wanted:
                return x, y
    raise RuntimeError(f"no asset {wanted}; the last one clicked is {active(browser)!r}")


def drag(start, end):
    """With the button held, by steps as a hand's."""
    yield from move(*start)
    _send("mousedown", 1)
    yield 0.3
    for step in range(1, 21):
        yield from move(*(a + (b - a) * step / 20 for a, b in zip(start, end)))
        yield 0.05
    yield 0.5
    take("dragged")
    _send("mouseup", 1)
    yield 1.0


def steps():
    """All of them."""
    view, browser = yield from split()
    yield from show(browser)
    place = yield from find(browser, WANTED)
    note(f"{WANTED} was found in the asset browser")
    yield 2.0
    take("browser")
    with bpy.context.temp_override(window=window(), screen=window().screen, area=browser, region=region_of(browser)):
        asset = bpy.context.asset
        told = asset.metadata
        words = {
            "description": told.description,
            "author": told.author,
            "license": told.license,
            "tags": [tag.name for tag in told.tags],
            "catalogue": next((path for path, uid in CATALOGUES.items() if uid == told.catalog_id), ""),
        }
    note(json.dumps(words))
    check("author, license and tag are there", words["author"] == "A. Weaver" and words["tags"] == ["Formula"])
    check("its catalogue is known", words["catalogue"] == "Measured Materials/Formulas")
    ball, region = bpy.data.objects["ball"], region_of(view)
    seen = location_3d_to_region_2d(region, view.spaces.active.region_3d, Vector((0.2, 0.0, 0.3)))
    yield from drag(place, (region.x + seen[0], region.y + seen[1]))
    yield from soon("the ball has the material", lambda: ball.active_material is not None, 20)
    check("and it is the one that was dragged", ball.active_material.name == WANTED)
    view.spaces.active.shading.type = "RENDERED"
    bpy.context.scene.cycles.preview_samples = 24
    view.spaces.active.overlay.show_overlays = view.spaces.active.show_gizmo = False
    yield 25.0
    yield from picture("asset_library")
    (HERE / "areas.json").write_text(
        json.dumps([[area.x, area.y, area.width, area.height] for area in (view, browser)])
    )
    view.spaces.active.shading.type = "SOLID"
    bpy.ops.wm.save_as_mainfile(filepath=str(HERE / "dropped.blend"))


todo = steps()


def advance():
    """Called by a timer; Blender's main loop runs in between."""
    try:
        return next(todo)
    except StopIteration:
        note("ended")
    except BaseException:
        note(traceback.format_exc())
        take("failed")
    bpy.ops.wm.quit_blender()
    return None


bpy.app.timers.register(advance, first_interval=2.0, persistent=True)
