"""Registration with Blender, operators, panels and the command line."""

from __future__ import annotations

import atexit
import contextlib
from importlib import import_module
from types import ModuleType

# In the order of registration: a class comes after those that it refers to. Each module has register() and
# unregister(); they are imported only then, because they need bpy and the command line does not.
_MODULES = (
    "events",
    "ui.properties.bake",
    "ui.properties.photographs",
    "ui.properties.lighting",
    "ui.properties.quality",
    "ui.background.bake_queue",
    "ui.background.watch_bakes",
    "ui.background.rebuild_later",
    "ui.background.warm_worker",
    "ui.background.kept_pace",
    "ui.import_brdf",
    "lights.light_tables",
    "material.texture_repair",
    "material.older_files",
    "exports.gltf",
    "ui.photograph_look",
    "ui.import_photographs",
    "ui.import_bundle",
    "ui.maps.build_material",
    "ui.drop_files",
    "ui.bake_again",
    "ui.fit_to_scene",
    "ui.quiet_camera",
    "ui.adjust",
    "ui.assets",
    "ui.panels.pictures",
    "ui.panels.live_check",
    "ui.panels.panel",
    "ui.panels.asset_panel",
    "ui.panels.check_scene",
    "ui.add_cosine_lobe",
    "cli.blender_command",
)


_parts: list[ModuleType] = []


def register() -> None:
    """Register everything, or, when a part fails, nothing, and let its exception out."""
    done: list[ModuleType] = []
    try:
        for name in _MODULES:
            module = import_module(f".{name}", __package__)
            module.register()
            done.append(module)
    except BaseException:
        for module in reversed(done):
            module.unregister()
        raise
    _parts[:] = done
    _undo_at_exit()


def unregister() -> None:
    """Undo `register`, last first; where a part fails, all others are undone and its exception let out.

    Nothing happens where nothing is registered: at the end of Python both `atexit` and whatever has enabled the
    extension may ask.
    """
    atexit.unregister(unregister)
    with contextlib.ExitStack() as parts:
        for module in _parts:
            parts.callback(module.unregister)
        _parts.clear()


def _undo_at_exit() -> None:
    """Blender as a module ends with Python, and crashes or hangs in 4.5 on a function left in `bpy.app.handlers`.

    The application unregisters its extensions itself.
    """
    if import_module("..nodes.compat", __package__).is_module():
        atexit.unregister(unregister)
        atexit.register(unregister)
