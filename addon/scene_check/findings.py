"""What the scene check looks at, and what it finds."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import bpy
from mathutils import Vector

from ...nodes import compat
from ...nodes.group import HASH_KEY, trees_below

WRONG, SLOW, NOTE = "wrong", "slow", "note"
SEVERITIES = (WRONG, SLOW, NOTE)
"""
wrong  biases the picture of measured materials
slow   costs time or noise
note   is worth knowing; nothing that is fixed unasked
"""
_RANDOM = {"ShaderNodeTexWhiteNoise", "ShaderNodeScript"}


@dataclass(frozen=True)
class Finding:
    """A setting and what it does to measured materials.

    Parameters
    ----------
    rule : which one; the same in every scene and version
    severity : of `SEVERITIES`
    where : the datablock in words
    found, wanted : what is set, and to what it should be; no `wanted` where nothing can be set
    why : one short sentence, with a measured figure where there is one
    mend : fixes it; None where only a person can decide, or the datablock belongs to another file
    """

    rule: str
    severity: str
    where: str
    found: str
    wanted: str
    why: str
    mend: Callable[[], None] | None = None

    @property
    def key(self) -> str:
        """Key of the finding, the same in the next check."""
        return f"{self.rule} {self.where}"

    @property
    def setting(self) -> str:
        """Place and setting in words."""
        return f"{self._place}: {self.found}" + (f", should be {self.wanted}" if self.wanted else "")

    @property
    def _place(self) -> str:
        """Where, without its kind where it is named by that, as Blender names the first of each kind."""
        kind, _, name = self.where.partition(" ")
        return name if name.lower() == kind.lower() else self.where

    @property
    def line(self) -> str:
        """The finding in one line."""
        return f"{self.severity:<5}  {self.setting}: {self.why}"

    @property
    def mended_line(self) -> str:
        """The change that was made, in one line."""
        return f"fixed {self._place}: {self.found} -> {self.wanted}"

    def facts(self) -> dict[str, Any]:
        """JSON-ready."""
        told = ("rule", "severity", "where", "found", "wanted", "why")
        return {**{name: getattr(self, name) for name in told}, "mendable": self.mend is not None}


@dataclass(frozen=True)
class Subject:
    """A scene as far as it concerns measured materials.

    Parameters
    ----------
    objects : what a render shows, instances and lamps included
    wearers : measured materials, each with the objects that show it
    materials : all that objects show, measured or not
    """

    scene: bpy.types.Scene
    objects: tuple[bpy.types.Object, ...]
    wearers: dict[bpy.types.Material, tuple[bpy.types.Object, ...]]
    materials: tuple[bpy.types.Material, ...] = ()

    @property
    def lamps(self) -> list[bpy.types.Object]:
        """Lamps that give light, portals left out."""
        lamps = (obj for obj in self.objects if obj.type == "LIGHT")
        return [obj for obj in lamps if not obj.data.cycles.is_portal and obj.data.energy > 0]

    @property
    def shown(self) -> list[bpy.types.Object]:
        """Objects with a measured material, each once."""
        return list(dict.fromkeys(obj for objects in self.wearers.values() for obj in objects))

    @cached_property
    def mirrors(self) -> list[bpy.types.Material]:
        """Measured materials with a stochastic mirror; mode Preview has none."""
        return [m for m in self.wearers if any(n.bl_idname in _RANDOM for t in measured_trees(m) for n in t.nodes)]

    def distance(self, lamp: bpy.types.Object) -> float:
        """Distance from a lamp to the middle of the nearest object with a measured material, at least a hair's
        breadth."""
        place = lamp.matrix_world.translation
        return max(min((middle(obj) - place).length for obj in self.shown), 1e-6)


def subject_of(scene: bpy.types.Scene) -> Subject:
    """Look through a scene, which need not be shown anywhere. Cycles is switched on."""
    compat.ensure_cycles()
    rendered: dict[bpy.types.Object, None] = {}
    for layer in scene.view_layers:
        if layer.use:
            _collect(layer.layer_collection, rendered)
    worn: dict[bpy.types.Material, dict[bpy.types.Object, None]] = {}
    for obj, material in (*_own_materials(rendered), *_evaluated_materials(scene, rendered)):
        worn.setdefault(material, {})[obj] = None
    measured = {material: tuple(objects) for material, objects in worn.items() if measured_trees(material)}
    return Subject(scene, tuple(rendered), measured, tuple(worn))


def editable(block: bpy.types.ID, function: Callable[[], None]) -> Callable[[], None] | None:
    """The function, or None where the datablock is linked from another .blend."""
    return function if block.is_editable else None


def setting(owner: Any, name: str, value: Any) -> Callable[[], None] | None:
    """A function that sets a property, or None where it belongs to another .blend."""
    return editable(owner.id_data, lambda: setattr(owner, name, value))


def measured_trees(material: bpy.types.Material) -> list[bpy.types.NodeTree]:
    """Node groups made here that a material uses, at any depth; none where its nodes are switched off."""
    if not compat.uses_nodes(material):
        return []
    return [tree for tree in trees_below(material.node_tree) if HASH_KEY in tree]


def middle(obj: bpy.types.Object) -> Vector:
    """Middle of an object's bounding box in world space."""
    return obj.matrix_world @ (sum((Vector(corner) for corner in obj.bound_box), Vector()) / 8)


def _collect(layer: bpy.types.LayerCollection, found: dict[bpy.types.Object, None]) -> None:
    if layer.exclude or layer.collection.hide_render:
        return
    _add(layer.collection.objects, found)
    for child in layer.children:
        _collect(child, found)


def _add(objects: Any, found: dict[bpy.types.Object, None]) -> None:
    """Objects that a render shows, and what they instance."""
    for obj in objects:
        if obj is not None and not obj.hide_render and obj not in found:
            found[obj] = None
            if obj.instance_type == "COLLECTION" and obj.instance_collection is not None:
                _add(obj.instance_collection.all_objects, found)


def _own_materials(objects: Any) -> Iterator[tuple[bpy.types.Object, bpy.types.Material]]:
    for obj in objects:
        for slot in obj.material_slots:
            if slot.material is not None:
                yield obj, slot.material


def _evaluated_materials(
    scene: bpy.types.Scene, rendered: Any
) -> Iterator[tuple[bpy.types.Object, bpy.types.Material]]:
    """Those that geometry nodes and particles bring."""
    for layer in [layer for layer in scene.view_layers if layer.use] or scene.view_layers[:1]:
        layer.update()
        met = set()
        for instance in layer.depsgraph.object_instances:
            owner, mesh = (instance.parent if instance.is_instance else instance.object).original, instance.object.data
            # What is scattered is one of a few meshes, thousands of times.
            if (owner, mesh) not in met and owner in rendered:
                met.add((owner, mesh))
                for material in getattr(mesh, "materials", None) or ():
                    if material is not None:
                        yield owner, material.original
