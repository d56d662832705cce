"""One survey of a scene's lights for all materials that are built in a row.

A survey looks at every object and instance of a scene, so that of many materials each would pay for all others. While
surveys are kept, Blender tells what changes: pending edits are evaluated before a report is given again, and any edit
but one of materials, node groups and images has the scene looked at anew. The world is looked at in any case.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy
from bpy.app.handlers import persistent

from ..events import listen, stop_listening
from .lamp_survey import LampReport, rendered_layers, survey_scene
from .world_survey import world_light

# By scene and its view layers; None where nothing is kept.
_kept: dict[Any, LampReport] | None = None
_HARMLESS = (bpy.types.Material, bpy.types.Image, bpy.types.Texture)


@contextmanager
def surveys_kept() -> Iterator[None]:
    """Inside, `surveyed` looks at a scene once, and again after an edit."""
    global _kept
    if _kept is not None:
        yield
        return
    _kept = {}
    listen(_HANDLERS)
    try:
        yield
    finally:
        stop_listening(_HANDLERS)
        _kept = None


def surveyed(scene: bpy.types.Scene) -> LampReport:
    """`survey_scene` for a render, or its report of before where nothing has changed since."""
    layers = rendered_layers(scene)
    for layer in layers:
        layer.update()  # what is pending: the handlers hear of it
    key = (scene.session_uid, tuple(layer.name for layer in layers))
    report = None if _kept is None else _kept.get(key)
    if report is None or report.world != world_light(scene.world):
        report = survey_scene(scene, for_render=True)
        if _kept is not None and _are_all_evaluated(layers):
            _kept[key] = report
    return report


def _are_all_evaluated(layers: list[bpy.types.ViewLayer]) -> bool:
    """Whether Blender evaluates every lamp of the file there: of an edit of those that it does not it tells nothing."""
    evaluated = {instance.object.original for layer in layers for instance in layer.depsgraph.object_instances}
    return all(obj in evaluated for obj in bpy.data.objects if obj.type == "LIGHT" and obj.users)


@persistent
def _after_an_edit(_scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    if _kept and any(_may_matter(update) for update in depsgraph.updates):
        _kept.clear()


def _may_matter(update: bpy.types.DepsgraphUpdate) -> bool:
    block = update.id
    if isinstance(block, bpy.types.Object) and block.type != "LIGHT":
        # Its shading changes with every material that it wears.
        return bool(update.is_updated_transform or update.is_updated_geometry)
    # Trees of a lamp or of a world are told of as lamp or world too.
    return not isinstance(block, _HARMLESS) and not isinstance(block, bpy.types.NodeTree)


@persistent
def _after_all_else(*_: Any) -> None:
    if _kept:
        _kept.clear()


_HANDLERS = {
    "depsgraph_update_post": _after_an_edit,
    "frame_change_post": _after_all_else,
    "load_post": _after_all_else,
    "undo_post": _after_all_else,
    "redo_post": _after_all_else,
}
