"""A worker made ready while a dialogue is open, and ended where nobody confirms it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
from bpy.app.handlers import persistent

from ....bake.brdf.settings import BakeSettings
from ....bake.maps.bake import MapSettings
from ....bake.shading_maps.bake import ArcSettings
from ... import events
from ...baking import spare
from ...baking.hosts import hosts
from ...baking.request import BakeRequest

_LOOKED_AFTER = 5.0


def prepare(settings: BakeSettings | ArcSettings | MapSettings) -> None:
    """Have a worker ready for a bake with such settings. In the background nobody waits for one."""
    if bpy.app.background:
        return
    spare.prepare(hosts(BakeRequest(Path(), settings), bpy.app.binary_path))
    if not bpy.app.timers.is_registered(_look_after):
        bpy.app.timers.register(_look_after, first_interval=_LOOKED_AFTER)


@events.timer
def _look_after() -> float | None:
    if spare.is_due():
        spare.drop()
    return _LOOKED_AFTER if spare.is_there() else None


@persistent
def _before_load(*_: Any) -> None:
    spare.drop()


_HANDLERS = {"load_pre": _before_load}


def register() -> None:
    """Called by `addon.register`."""
    events.listen(_HANDLERS)


def unregister() -> None:
    """Called by `addon.unregister`."""
    events.stop_listening(_HANDLERS)
    spare.drop()
    if bpy.app.timers.is_registered(_look_after):
        bpy.app.timers.unregister(_look_after)
