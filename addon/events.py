"""Functions that Blender calls at its events, such as a loaded file, or later; what a version lacks is left out.

Whether Python may write to datablocks, and call operators, Blender keeps in one place for all threads. A panel that
draws forbids it, and puts back what it found when it is done; a render engine, whose previews run in threads of their
own, allows it, and puts back what it found. A preview that begins while a panel draws, and ends later, so forbids it
for good, to all but operators that a person starts. Timers, which nothing that draws ever calls, would then be refused
for the rest of the session: seen in Blender 4.3.2 (Debian's), whose `bpy_rna.cc` keeps the flag; never in 5.2.2.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import bpy

Handlers = Mapping[str, Callable[..., None]]

# A property of the scene that holds nothing, to see by whether it may be set; and one of the window manager, which may
# be set in any case. While Blender calls the function that follows a change of a property, everything may be written.
_PROBE, _DOOR = "measured_materials_probe", "measured_materials_door"
# Seconds between two such calls at least: Blender draws all of its windows again after each.
_PACE = 0.2
_to_run: list[Callable[[], None]] = []


def timer(function: Callable[[], float | None]) -> Callable[[], float | None]:
    """Decorator of a timer's function: it may write, and call operators, even where Blender forbids that by mistake."""

    @functools.wraps(function)
    def allowed() -> float | None:
        if _may_write():
            return function()
        found: list[float | None] = []
        raised: list[BaseException] = []

        def run() -> None:
            try:
                found.append(function())
            except BaseException as error:  # Blender would print it, and go on
                raised.append(error)

        _to_run.append(run)
        setattr(bpy.context.window_manager, _DOOR, True)
        if raised:
            raise raised[0]
        return None if found[0] is None else max(found[0], _PACE)

    return allowed


def _may_write() -> bool:
    """Whether Python may write to datablocks now; True as well where nothing could be done about it."""
    scene = bpy.context.scene
    if scene is None or not hasattr(bpy.types.Scene, _PROBE):
        return True
    try:
        setattr(scene, _PROBE, True)
    except AttributeError:
        return False
    return True


def _run(_manager: bpy.types.WindowManager, _context: bpy.types.Context) -> None:
    _to_run.pop()()


def listen(handlers: Handlers) -> None:
    """Have each called at the event it stands under, a name of `bpy.app.handlers`."""
    for event, own in _known(handlers):
        event.append(own)


def stop_listening(handlers: Handlers) -> None:
    """Undo `listen`. Left in place, a function would keep a Python that runs the bpy wheel from ending."""
    for event, own in _known(handlers):
        event.remove(own)


def _known(handlers: Handlers) -> Iterator[tuple[list[Any], Any]]:
    """Blender's lists of handlers, those of this version, each with ours."""
    for event, own in handlers.items():
        if hasattr(bpy.app.handlers, event):
            yield getattr(bpy.app.handlers, event), own


def register() -> None:
    """Called by `addon.register`."""
    hidden: Any = {"HIDDEN", "SKIP_SAVE"}
    nothing: Any = {"get": lambda _scene: False, "set": lambda _scene, _value: None}
    setattr(bpy.types.Scene, _PROBE, bpy.props.BoolProperty(**nothing, options=hidden))
    setattr(bpy.types.WindowManager, _DOOR, bpy.props.BoolProperty(update=_run, options=hidden))


def unregister() -> None:
    """Called by `addon.unregister`."""
    delattr(bpy.types.WindowManager, _DOOR)
    delattr(bpy.types.Scene, _PROBE)
