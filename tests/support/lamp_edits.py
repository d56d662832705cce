"""Edits of a scene's lamps and world, by name, as an artist makes them: for tests of what follows them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
from measured_materials.nodes import compat

KINDS = ("POINT", "SUN", "SPOT", "AREA")


def add(scene: bpy.types.Scene, kind: str, place: tuple[float, float, float], energy: float = 100) -> Any:
    data = bpy.data.lights.new(kind, kind)
    data.energy = energy
    if kind == "SUN":
        data.angle = 0.1
    elif kind == "AREA":
        data.size = 0.3
    else:
        data.shadow_soft_size = 0.1
    obj = bpy.data.objects.new(kind, data)
    obj.location = place
    scene.collection.objects.link(obj)
    return obj


def lamp(scene: bpy.types.Scene) -> Any:
    return next(obj for obj in scene.collection.objects if obj.type == "LIGHT")


def four_more(scene: bpy.types.Scene) -> None:
    for k, kind in enumerate(KINDS):
        add(scene, kind, (k - 1.5, 1, 3))


def parent(scene: bpy.types.Scene) -> None:
    empty = bpy.data.objects.new("empty", None)
    empty.location, empty.scale = (1, 2, 0), (2, 2, 2)
    scene.collection.objects.link(empty)
    lamp(scene).parent = empty


def hide_collection(scene: bpy.types.Scene) -> None:
    collection, hidden = bpy.data.collections.new("more"), lamp(scene)
    scene.collection.children.link(collection)
    collection.objects.link(hidden)
    scene.collection.objects.unlink(hidden)
    scene.view_layers[0].layer_collection.children["more"].exclude = True


def instances(scene: bpy.types.Scene) -> None:
    collection = bpy.data.collections.new("lit")
    collection.objects.link(add(scene, "POINT", (0, 0, 1)))
    empty = bpy.data.objects.new("instance", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", collection
    empty.location = (2, 0, 0)
    scene.collection.objects.link(empty)


def spot_world(scene: bpy.types.Scene) -> None:
    world, background = compat.new_world("spot")
    texture = world.node_tree.nodes.new("ShaderNodeTexEnvironment")
    texture.image = bpy.data.images.load(scene["sky"])
    world.node_tree.links.new(texture.outputs["Color"], background.inputs["Color"])
    scene.world = world


def grey_world(scene: bpy.types.Scene) -> None:
    world, background = compat.new_world("grey")
    background.inputs["Strength"].default_value = 0.4
    scene.world = world


def brighten_world(scene: bpy.types.Scene) -> None:
    """The world alone: the scene itself knows nothing of it."""
    background = next(n for n in scene.world.node_tree.nodes if n.bl_idname == "ShaderNodeBackground")
    background.inputs["Strength"].default_value *= 3


EDITS: dict[str, Callable[[bpy.types.Scene], object]] = {
    **{f"add {kind.lower()}": lambda s, kind=kind: add(s, kind, (1, -1, 2)) for kind in KINDS},
    "add four": four_more,
    "move": lambda s: setattr(lamp(s), "location", (2, 1, 2)),
    "scale": lambda s: setattr(lamp(s), "scale", (2, 2, 2)),
    "parent": parent,
    "delete": lambda s: bpy.data.objects.remove(lamp(s)),
    "dim": lambda s: setattr(lamp(s).data, "energy", 0.0),
    "brighten": lambda s: setattr(lamp(s).data, "energy", 500.0),
    "colour": lambda s: setattr(lamp(s).data, "color", (1, 0.2, 0.2)),
    "another type": lambda s: setattr(lamp(s).data, "type", "AREA"),
    "hide": lambda s: setattr(lamp(s), "hide_viewport", True),
    "hide from glossy rays": lambda s: setattr(lamp(s), "visible_glossy", False),
    "hide its collection": hide_collection,
    "instance": instances,
    "grey world": grey_world,
    "brighter grey world": brighten_world,
    "spotted world": spot_world,
    "brighter spotted world": brighten_world,
    "no world": lambda s: setattr(s, "world", None),
}
