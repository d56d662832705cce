"""Functions that Blender calls at its events, such as a loaded file; what a version lacks is left out."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import bpy

Handlers = Mapping[str, Callable[..., None]]


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
