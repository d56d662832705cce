"""What versions before have kept with a material and this one keeps elsewhere, brought in line when a .blend comes.

A shading map's mode was a property of its lighting; now `measured_quality.mode` is that of both kinds. The old value
stays in the file, where the older version finds it; what counts is the mode that the material was built in.
"""

from __future__ import annotations

import contextlib
from typing import Any

import bpy
from bpy.app.handlers import persistent

from ...bake.errors import BakeError
from ..events import listen, stop_listening
from .choices import without_rebuilding
from .kinds import SHADING_MAP, kind_of
from .rebuild import current_lighting


def show_modes() -> None:
    """Let every shading map's mode be that in which it was built; nothing is rebuilt, no datablock made or removed."""
    for material in bpy.data.materials:
        if kind_of(material) is SHADING_MAP:
            # Facts that cannot be read are told of by the panel.
            with contextlib.suppress(BakeError), without_rebuilding():
                mode = current_lighting(material).mode
                if material.measured_quality.mode != mode:
                    material.measured_quality.mode = mode


@persistent
def _after_loading(*_: Any) -> None:
    show_modes()


# What is appended comes by no load; the event is one since Blender 4.3.
_HANDLERS = {"load_post": _after_loading, "blend_import_post": _after_loading}


def register() -> None:
    """Called by `addon.register`, after the properties. The extension may be updated while a file is open."""
    listen(_HANDLERS)
    if hasattr(bpy.data, "materials"):  # while Blender starts there is no data yet
        show_modes()


def unregister() -> None:
    """Called by `addon.unregister`."""
    stop_listening(_HANDLERS)
