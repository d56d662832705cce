"""One survey of a scene's lights for all materials that are built in a row.

A survey has Blender evaluate the scene, which every new material gives it reason for, and looks at every object and
instance: of many materials each would pay for all others. What a survey hangs on is read off the settings of lamps and
world instead, in a fraction of the time. Events would not do: Blender tells nothing of Cycles' settings of a lamp, and
of any new material that the scene has changed.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager
from typing import Any

import bpy

from ...nodes.keeping import Keeping
from .exact_lamps import rays_of_world, volume_in_file, why_not_exact, why_not_in, why_world_not_exact
from .lamp_survey import LampReport, lamp_settings, rendered_layers, survey_scene
from .motion import changes
from .world_survey import world_light

# By scene: what a report hung on, and the report.
_reports: Keeping[int, tuple[Any, LampReport]] = Keeping()


def surveys_kept() -> AbstractContextManager[None]:
    """Inside, `surveyed` looks at a scene once, and again after an edit of its lamps, world, objects or collections."""
    return _reports.kept()


def surveyed(scene: bpy.types.Scene) -> LampReport:
    """`survey_scene` for a render, or its report of before where nothing has changed since."""
    reports = _reports.found
    if reports is None:
        return survey_scene(scene, for_render=True)
    known = reports.get(scene.session_uid)
    if known is not None and known[0] == _state(scene):
        return known[1]
    report = survey_scene(scene, for_render=True)
    reports.pop(scene.session_uid, None)
    # Its state not before: in Blender 5.2 the layers of a scene that was just made know no collections.
    if _tell_all(scene):
        reports[scene.session_uid] = _state(scene), report
    return report


def _state(scene: bpy.types.Scene) -> Any:
    """What lamps, world, and the objects that are lit have for settings."""
    objects = list(scene.objects)
    places = [obj.matrix_basis.copy() for obj in objects]
    shown = [
        (obj.session_uid, obj.hide_render, obj.hide_viewport, obj.instance_type, len(obj.modifiers)) for obj in objects
    ]
    lamps = [(lamp_settings(obj), _is_moved(obj)) for obj in objects if obj.type == "LIGHT"]
    layers = [(layer.name, *_visibility(layer.layer_collection)) for layer in rendered_layers(scene)]
    volume = volume_in_file()
    unknown = [why_not_exact(obj, obj.matrix_basis) for obj in objects if obj.type == "LIGHT"]
    unknown += why_not_in(scene, volume), volume, why_world_not_exact(scene)
    world = world_light(scene.world), rays_of_world(scene)
    return scene.frame_current_final, places, shown, lamps, layers, world, unknown


def _is_moved(lamp: bpy.types.Object) -> bool:
    """Whether animation, a driver, a constraint or physics has a say in what the lamp is."""
    return changes(lamp) or changes(lamp.data)


def _visibility(layer: bpy.types.LayerCollection) -> Iterator[tuple[Any, ...]]:
    collection = layer.collection
    yield (
        collection.session_uid,
        layer.exclude,
        layer.hide_viewport,
        collection.hide_render,
        collection.hide_viewport,
        len(collection.objects),
    )
    for child in layer.children:
        yield from _visibility(child)


def _tell_all(scene: bpy.types.Scene) -> bool:
    """Whether the lamps' own settings say all of them: none is an instance, or moved or driven by anything else."""
    if any(_is_moved(obj) for obj in scene.objects if obj.type == "LIGHT"):
        return False
    graphs = (layer.depsgraph for layer in rendered_layers(scene))
    instances = (instance for graph in graphs for instance in graph.object_instances if instance.is_instance)
    collections = (obj.instance_collection for obj in scene.objects if obj.instance_type == "COLLECTION")
    instanced = (obj for collection in collections if collection for obj in collection.all_objects)
    return not any(instance.object.type == "LIGHT" for instance in instances) and not any(
        obj.type == "LIGHT" or obj.instance_type == "COLLECTION" for obj in instanced
    )
