"""Run inside a real Blender by leaving.py: whatever in it is the extension's, while it is enabled and after that."""

import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path.cwd()))
import bpy
from common import HERE, PACKAGE, empty_scene, lacquer, lamp, ours, save, square

NAME = "measured_materials"
_OWNERS = ("Material", "Scene", "Object", "World", "Light", "Camera", "NodeTree", "Image", "WindowManager", "ViewLayer")


def is_ours(thing):
    """Whether a function or class comes from the extension."""
    return NAME in (getattr(thing, "__module__", "") or "")


def traces():
    """All of it, in words."""
    found = [f"class {name}" for name in dir(bpy.types) if NAME in name.lower() or is_ours(getattr(bpy.types, name))]
    found += [f"operator {name}" for name in dir(getattr(bpy.ops, NAME))]
    for owner in _OWNERS:
        properties = getattr(bpy.types, owner).bl_rna.properties.keys()
        found += [f"property {owner}.{name}" for name in properties if name.startswith("measured")]
    for event in dir(bpy.app.handlers):
        listed = getattr(bpy.app.handlers, event)
        if isinstance(listed, list):
            found += [f"handler {event} {one.__name__}" for one in listed if is_ours(one)]
    for name in dir(bpy.types):
        drawn = getattr(getattr(getattr(bpy.types, name), "draw", None), "_draw_funcs", ())
        found += [f"entry of {name}" for one in drawn if is_ours(one)]
    for keys in bpy.context.window_manager.keyconfigs:
        found += [
            f"key {item.idname}" for keymap in keys.keymaps for item in keymap.keymap_items if NAME in item.idname
        ]
    for module in [module for name, module in list(sys.modules.items()) if name.startswith(PACKAGE)]:
        for one in vars(module).values():
            if callable(one) and is_ours(one) and not isinstance(one, type) and bpy.app.timers.is_registered(one):
                found.append(f"timer {one.__name__}")
    preferences = bpy.context.preferences
    found += [f"preferences of {name}" for name in preferences.addons.keys() if NAME in name]
    libraries = preferences.filepaths.asset_libraries
    found += [f"asset library {one.name}" for one in libraries if "measured" in (one.name + one.path).lower()]
    return sorted(set(found))


def installed():
    """Disabled and enabled again, twice; then a file to be rendered with and without it."""
    told = {"enabled": traces()}
    for again in ("", " again"):
        bpy.ops.preferences.addon_disable(module=PACKAGE)
        told[f"disabled{again}"] = traces()
        bpy.ops.preferences.addon_enable(module=PACKAGE)
    told["enabled again"] = traces()
    scene = empty_scene()
    square(scene)
    lamp(scene, (1, 1, 3))
    (HERE / "kept").mkdir(exist_ok=True)
    lacquer(HERE / "kept")
    save(HERE / "kept.blend")
    kept_pace = ours("addon.ui.background.kept_pace")
    kept_pace.keep()
    told["kept"] = bool(kept_pace.file() and kept_pace.file().is_file())
    return told


part = sys.argv[-1]
(HERE / f"{part}.json").write_text(json.dumps(installed() if part == "installed" else {"found": traces()}))
