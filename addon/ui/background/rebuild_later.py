"""A change of mode, effect or lighting made in a panel: what cannot be built at once is built by a timer, in portions.

The panel's own step of undo holds the new setting and the old groups; it is marked as the quick bake of an import is,
so that undo and redo go over it, and another follows when the groups are there.
"""

from __future__ import annotations

import contextlib
from typing import Any

import bpy
from bpy.app.handlers import persistent

from ....nodes.portions import Pause, Portions, found
from ... import events
from ...material import kinds
from ...material.together import built_together
from .tasks import FRESH, STATE_KEY
from .window import push, window

_BREATH = 0.01
# Where our panels stand. Scripts, also those of the text editor, have what they set at once.
_PANELS = {"PROPERTIES", "NODE_EDITOR", "VIEW_3D"}

# Materials that are being rebuilt, by their session_uid.
_pending: dict[int, Portions] = {}
# Those of which the lighting has changed, and perhaps the quality as well; of all others only that has.
_lit: set[int] = set()


def build(changed: Any, context: bpy.types.Context | None) -> bool:
    """Rebuild the material of these properties, or begin to; whether it is left to the timer.

    Raises BakeError.
    """
    material = changed.id_data
    if not _is_panel(context):
        _forget_work(material.session_uid)
        kinds.kind_of(material).rebuild_as_set(material, changed)
        return False
    work = _pending.setdefault(material.session_uid, Portions())
    if changed == material.measured_lighting:
        _lit.add(material.session_uid)
    if _went_on(material, work):
        return False
    material[STATE_KEY] = FRESH
    if not bpy.app.timers.is_registered(tick):
        bpy.app.timers.register(tick, first_interval=_BREATH)
    return True


def _is_panel(context: bpy.types.Context | None) -> bool:
    area = getattr(context, "area", None)
    return not bpy.app.background and area is not None and area.type in _PANELS


def _went_on(material: bpy.types.Material, work: Portions) -> bool:
    """One portion; whether it was the last. Raises BakeError; then nothing is left of the others."""
    try:
        with work.portion(), built_together():
            kinds.kind_of(material).rebuild_as_set(material, _changed(material))
    except Pause:
        return False
    except BaseException:
        _end(material.session_uid)
        raise
    _end(material.session_uid)
    return True


def _changed(material: bpy.types.Material) -> Any:
    """The properties that it is rebuilt as."""
    return material.measured_lighting if material.session_uid in _lit else material.measured_quality


def _end(uid: int) -> None:
    if work := _forget_work(uid):
        work.drop()


def _forget_work(uid: int) -> Portions | None:
    _lit.discard(uid)
    return _pending.pop(uid, None)


@events.timer
def tick() -> float | None:
    """The timer's function: a portion of the first material that waits."""
    if any(map(bpy.app.is_job_running, ("RENDER", "RENDER_PREVIEW"))):
        return 10 * _BREATH
    uid, work = next(iter(_pending.items()), (0, None))
    material = found("materials", uid) if uid else None
    if work is None:
        return None
    if material is None or not kinds.kind_of(material):
        _end(uid)
    else:
        with window(), kinds.without_rebuilding():
            kinds.saying_why_not(_changed(material), lambda: _finish(material, work))
    return _BREATH if _pending else None


def _finish(material: bpy.types.Material, work: Portions) -> None:
    try:
        done = _went_on(material, work)
    except BaseException:
        _settle(material)
        raise
    if done:
        _settle(material)


def _settle(material: bpy.types.Material) -> None:
    with contextlib.suppress(KeyError):
        del material[STATE_KEY]
    push("Rebuild Material")


def _forget() -> None:
    for work in _pending.values():
        work.forget()


@persistent
def _after_undo(*_: Any) -> None:
    _forget()
    # Where undo has gone behind the change, nothing is to be built; a handler removes no datablock.
    for uid in [uid for uid in _pending if STATE_KEY not in (found("materials", uid) or {})]:
        _forget_work(uid)


@persistent
def _before_load(*_: Any) -> None:
    _pending.clear()
    _lit.clear()


_HANDLERS = {"load_pre": _before_load, "undo_post": _after_undo, "redo_post": _after_undo}


def register() -> None:
    """Called by `addon.register`."""
    events.listen(_HANDLERS)
    kinds.builders.append(build)


def unregister() -> None:
    """Called by `addon.unregister`."""
    kinds.builders.remove(build)
    events.stop_listening(_HANDLERS)
    _pending.clear()
    _lit.clear()
    if bpy.app.timers.is_registered(tick):
        bpy.app.timers.unregister(tick)
