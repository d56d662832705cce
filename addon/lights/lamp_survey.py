"""Lamps of a scene as a mirror meets them (addon/docs/method.md, section 10)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix, Vector
from numpy.typing import NDArray

from ...bake.sampling.lamp_light import LampLight
from ...bake.sampling.lamps import ELLIPSE, RECTANGLE, SPHERE, SUN, Lamp
from ...bake.source import luminance
from ...nodes import compat
from ...nodes.aimed_light_group import MAX_SLOTS
from ...nodes.group import is_measured_tree
from . import world_survey
from .exact_lamps import (
    emitted_light,
    rays_of_lamp,
    rays_of_world,
    volume_in_file,
    why_not_exact,
    why_not_in,
    why_world_not_exact,
)
from .motion import changes
from .world_survey import WorldLight

# Rows of the table. Only the strongest lamps are aimed at; the others are hit by chance, as without the table.
CAPACITY = MAX_SLOTS
_DARK = 0.05
_NOTHING = 1e-6
_HIDING = frozenset({"hide_render", "hide_viewport", "visible_glossy"})


@dataclass(frozen=True)
class LampReport:
    """Report of a survey: lamps aimed at, irradiance of everything else, and why other lamps are not aimed at.

    Parameters
    ----------
    to_come : lamps that give no light, but may do so in another frame
    lights : what each lamp aimed at emits
    inexact : why that is not known exactly enough for a shader to sample it, in words; empty if it is
    volume : the file's first volume, in words; empty if there is none
    world_inexact : why no shader may sample the world, in words; empty if one may
    world_rays : which rays see the world besides those of mirrors, as `LampLight` has it of a lamp
    """

    lamps: list[Lamp]
    sky: float
    left_out: list[str]
    world: WorldLight = field(default_factory=lambda: world_survey.world_light(None))
    to_come: int = 0
    lights: list[LampLight] = field(default_factory=list)
    inexact: str = ""
    volume: str = ""
    world_inexact: str = ""
    world_rays: int = 0

    @property
    def slots(self) -> int:
        """Lamps that a node group has to be prepared for: between frames of a render none can be rebuilt."""
        return min(len(self.lamps) + self.to_come, CAPACITY)

    def words(self) -> list[str]:
        """Lines on what is aimed at and why, then one for each lamp that is not."""
        counts = ((len(self.lamps), ""), (self.slots - len(self.lamps), " of other frames"))
        targets = [f"{count} lamp{'s' * (count > 1)}{which}" for count, which in counts if count]
        structure, reason = self.world.structure, self.world.why_not
        if self.world.aimed and structure is not None:
            targets.append("the world")
            reason = (
                f"{100 * structure.bright_light:.2g} % of the world's light comes from "
                f"{100 * structure.bright_sky:.2g} % of its directions, and aiming there takes the noise of a sample "
                f"on matte surfaces from {structure.unaimed:.2g} to {structure.aimed:.2g} of its mean"
            )
        if not targets:
            return [f"Nothing to aim at: no lamp that a mirror can meet, and {reason}", *self.left_out]
        return [
            f"Aims at {', '.join(targets[:-1])}{' and ' * (len(targets) > 1)}{targets[-1]}: {reason}",
            *self.left_out,
        ]


def survey_scene(scene: bpy.types.Scene, *, for_render: bool = False) -> LampReport:
    """`survey` of all view layers that are rendered."""
    layers = rendered_layers(scene)
    for layer in layers:
        layer.update()
    return survey(*(layer.depsgraph for layer in layers), for_render=for_render)


def rendered_layers(scene: bpy.types.Scene) -> list[bpy.types.ViewLayer]:
    """View layers that are rendered; the first where none is."""
    return [layer for layer in scene.view_layers if layer.use] or [scene.view_layers[0]]


def survey(*depsgraphs: bpy.types.Depsgraph, for_render: bool = False) -> LampReport:
    """Lamps of an evaluated scene's view layers that a mirror can meet, the strongest first, and its world."""
    found, rays, left_out, inexact, seen, to_come = [], [], [], [], set(), set()
    for owner, obj, matrix in (entry for graph in depsgraphs for entry in _lamp_objects(graph, for_render)):
        original, place = obj.original, tuple(map(tuple, matrix))
        if (original, place) in seen:
            continue  # shown by another view layer too
        seen.add((original, place))
        why_not = _why_not(obj, owner) or _why_not_there(obj.data, matrix)
        power = 0.0 if why_not else _lamp(obj.data, matrix).power
        if power > 0:
            found.append((original.name, _lamp(obj.data, matrix), obj.data, matrix))
            rays.append(rays_of_lamp(obj, owner))
            if reason := why_not_exact(original, matrix):
                inexact.append(f"{original.name}: {reason}")
        elif _may_shine_later(original):
            to_come.add(original)
        if why_not:
            left_out.append(f"{original.name}: {why_not}")
    shown = {original for original, _ in seen}
    hidden = (obj for obj in depsgraphs[0].scene.objects if obj.type == "LIGHT" and obj not in shown)
    to_come |= {obj for obj in hidden if changes(obj, _HIDING)}
    named, rest = [], 0.0
    for (name, lamp, data, _), which in zip(found, rays, strict=True):
        named.append((name, lamp, emitted_light(lamp, _colour(data), data, which)))
    if len(found) > 1 or any(_has_beam(data) for _, _, data, _ in found):
        target = _lit_place(depsgraphs)  # the slow part, of use only where there is a choice
        named = [
            (name, _in_beam(target, lamp, data, matrix), light)
            for (name, lamp, light), (_, _, data, matrix) in zip(named, found, strict=True)
        ]
        named.sort(key=lambda entry: -_light_at(target, entry[1]))
        rest = sum(_light_at(target, lamp) for _, lamp, _ in named[CAPACITY:])
    left_out += [f"{name}: only the {CAPACITY} strongest are aimed at" for name, _, _ in named[CAPACITY:]]
    world = world_survey.world_light(depsgraphs[0].scene.world)
    sky = rest + (world.structure.background if world.aimed and world.structure else world.irradiance)
    lamps = [lamp for _, lamp, _ in named[:CAPACITY]]
    lights = [light for _, _, light in named[:CAPACITY]]
    inexact += [f"{obj.name}: {reason}" for obj in to_come if (reason := why_not_exact(obj, obj.matrix_world))]
    volume = volume_in_file()
    everywhere = why_not_in(depsgraphs[0].scene, volume)
    unknown = inexact[0] if inexact else everywhere
    scene = depsgraphs[0].scene
    of_world = everywhere or _why_world_inexact(scene, world)
    world_rays = rays_of_world(scene)
    return LampReport(lamps, sky, left_out, world, len(to_come), lights, unknown, volume, of_world, world_rays)


def _why_world_inexact(scene: bpy.types.Scene, light: WorldLight) -> str:
    if scene.world is None or not light.aimed:
        return light.why_not
    return why_world_not_exact(scene) if light.picture else "the world is more than one picture"


def lamp_settings(obj: bpy.types.Object) -> Any:
    """What a survey goes by of a lamp that neither is an instance nor hangs on anything but its parents' settings."""
    data, place = obj.data, _place(obj)
    beam = tuple(getattr(data, name, None) for name in ("type", "spot_size", "spot_blend", "spread"))
    return obj.session_uid, _why_not(obj), _why_not_there(data, place), _lamp(data, place), beam, rays_of_lamp(obj)


def _may_shine_later(obj: bpy.types.Object) -> bool:
    """Whether a lamp that gives no light now has something animated that may change that."""
    return changes(obj, _HIDING | {"scale"}) or changes(obj.data)


def _lamp_objects(
    depsgraph: bpy.types.Depsgraph, for_render: bool
) -> Iterator[tuple[bpy.types.Object, bpy.types.Object, Matrix]]:
    """Lamps as objects and instances, linked ones too, after what instances them or themselves; matrices in the world.

    What only a render shows has no evaluated matrix yet: it is placed by the settings of the object and its parents.
    """
    renderable = _renderable(depsgraph.view_layer.layer_collection) if for_render else set()
    placed = [entry for owner in renderable for entry in _placed(owner)]
    rendered, shown = {(owner, lamp) for owner, lamp, _ in placed}, set()
    for instance in depsgraph.object_instances:
        if (obj := instance.object).type != "LIGHT":
            continue
        by = instance.parent if instance.is_instance else obj  # evaluated, as animation has it
        owner = by.original
        shown.add((owner, obj.original))
        # Instances on vertices, faces and particles are known to the dependency graph alone.
        others = instance.is_instance and owner.instance_type != "COLLECTION" and owner in renderable
        if not for_render or (owner, obj.original) in rendered or (others and not obj.original.hide_render):
            yield by, obj, instance.matrix_world.copy()
    yield from (entry for entry in placed if entry[:2] not in shown)


def _renderable(layer: bpy.types.LayerCollection) -> set[bpy.types.Object]:
    """Objects that a render shows, whatever the viewport does."""
    if layer.exclude or layer.collection.hide_render:
        return set()
    found = {obj for obj in layer.collection.objects if not obj.hide_render}
    return found.union(*(_renderable(child) for child in layer.children))


def _placed(obj: bpy.types.Object) -> Iterator[tuple[bpy.types.Object, bpy.types.Object, Matrix]]:
    """The object, a lamp that a render shows of it, itself or in the collection that it instances, and the matrix."""
    # An instancer shows its children on its vertices or faces only.
    if obj.type == "LIGHT" and not (obj.parent and obj.parent.instance_type in {"VERTS", "FACES"}):
        yield obj, obj, _place(obj)
    if obj.instance_type == "COLLECTION" and obj.instance_collection:
        yield from ((obj, lamp, _place(obj) @ matrix) for lamp, matrix in _inside(obj.instance_collection))


def _inside(collection: bpy.types.Collection) -> Iterator[tuple[bpy.types.Object, Matrix]]:
    """Lamps that a render shows of an instanced collection, others instanced in it included."""
    offset = Matrix.Translation(-collection.instance_offset)
    inside = {obj for obj in _rendered_objects(collection) if not obj.hide_render}
    yield from ((lamp, offset @ matrix) for obj in inside for _, lamp, matrix in _placed(obj))


def _rendered_objects(collection: bpy.types.Collection) -> set[bpy.types.Object]:
    if collection.hide_render:
        return set()
    return set(collection.objects).union(*map(_rendered_objects, collection.children))


def _place(obj: bpy.types.Object) -> Matrix:
    """Matrix of an object that the viewport hides, maybe with its parents, and therefore does not evaluate."""
    if obj.constraints or (obj.parent and obj.parent_type != "OBJECT"):
        return obj.matrix_world.copy()
    return _place(obj.parent) @ obj.matrix_parent_inverse @ obj.matrix_basis if obj.parent else obj.matrix_basis


def _light_at(target: Vector, lamp: Lamp) -> float:
    """About the irradiance that the lamp gives to a place."""
    if lamp.kind == SUN:
        return lamp.power
    to_target = target - Vector(lamp.centre)
    facing = max(Vector(lamp.axis).dot(to_target.normalized()), _DARK) if lamp.kind != SPHERE else 1.0
    return lamp.power * facing / max(to_target.length_squared, 1e-8)


def _has_beam(data: Any) -> bool:
    return data.type == "SPOT" or (data.type == "AREA" and data.spread < math.pi - 1e-3)


def _in_beam(target: Vector, lamp: Lamp, data: Any, matrix: Matrix) -> Lamp:
    """The lamp with the power that it has towards this place: a beam is dark outside and may be brighter inside."""
    if not _has_beam(data):
        return lamp
    if data.type == "SPOT":
        # Scale and shear deform the cone: Cycles looks up the ray in the lamp's own space.
        ray = (matrix.inverted() @ target).normalized()
        edge = math.cos(data.spot_size / 2)
        t = min(max((-ray.z - edge) / max((1 - edge) * data.spot_blend, 1e-6), 0.0), 1.0)
        return replace(lamp, power=lamp.power * max(t * t * (3 - 2 * t), _DARK))
    cosine = Vector(lamp.axis).dot((target - Vector(lamp.centre)).normalized())
    # Cycles lets a spread fall off as 1 - tan(x) / tan(h) up to its half angle h, and keeps the whole power.
    half = max(data.spread / 2, 1e-3)
    kept = math.sin(half) ** 2 - (half - math.sin(half) * math.cos(half)) / math.tan(half)
    tangent = math.sqrt(max(1 / max(cosine, 1e-3) ** 2 - 1, 0.0))
    return replace(lamp, power=lamp.power * max((1 - tangent / math.tan(half)) / kept, _DARK))


def _why_not(obj: bpy.types.Object, owner: bpy.types.Object | None = None) -> str:
    """Why a mirror never meets this lamp, which an owner may instance; empty if it does."""
    data = obj.data
    if not (obj.visible_glossy and (owner is None or owner.visible_glossy)):
        return "hidden from glossy rays"
    if getattr(data.cycles, "is_portal", False):
        return "a portal, which lights nothing itself"
    if not data.cycles.use_multiple_importance_sampling:
        return "Multiple Importance is off"
    if data.type == "SUN":
        return "" if data.angle > 1e-5 else "no angle, so that no ray can meet it"
    if data.type == "AREA":
        size_y = data.size_y if data.shape in ("RECTANGLE", "ELLIPSE") else data.size
        return "" if min(data.size, size_y) > 0 else "no size, so that no ray can meet it"
    return "" if data.shadow_soft_size > 0 else "no radius, so that no ray can meet it"


def _why_not_there(data: Any, matrix: Matrix) -> str:
    """Why a mirror cannot be aimed at a lamp of this matrix; empty if it can."""
    u, v, w = matrix.to_3x3().col
    # Cycles takes no scale for the size of points and spots, but for a spot's cone.
    needed = {"POINT": (), "SUN": (w,)}.get(data.type, (u, v, w))
    flat = data.type == "SPOT" and abs(matrix.to_3x3().determinant()) < _NOTHING**3
    if flat or any(column.length < _NOTHING for column in needed):
        return "scaled to nothing, so that no ray can meet it"
    # The table holds area lamps whose edges and axis are at right angles.
    u, v, w = (column.normalized() for column in (u, v, w))
    sheared = max(abs(u.dot(v)), abs(u.dot(w)), abs(v.dot(w))) > 1e-3
    return "sheared by its parent's scale" if data.type == "AREA" and sheared else ""


def _lamp(data: Any, matrix: Matrix) -> Lamp:
    """In world space."""
    centre, turn = matrix.translation, matrix.to_3x3()
    power = _strength(data)
    if data.type == "SUN":
        axis = (turn @ Vector((0, 0, 1))).normalized()
        power *= _unless_normalized(data, math.pi * math.sin(data.angle / 2) ** 2)
        return Lamp(SUN, power, axis=tuple(axis), extent=data.angle)
    if data.type == "AREA":
        size_y = data.size_y if data.shape in ("RECTANGLE", "ELLIPSE") else data.size
        u, v = turn @ Vector((data.size, 0, 0)), turn @ Vector((0, size_y, 0))
        axis = (turn @ Vector((0, 0, -1))).normalized()
        kind = ELLIPSE if data.shape in ("DISK", "ELLIPSE") else RECTANGLE
        power *= _unless_normalized(data, u.length * v.length * (math.pi / 4 if kind == ELLIPSE else 1))
        return Lamp(kind, power / math.pi, tuple(centre), tuple(u), tuple(v), tuple(axis))
    axis = (turn @ Vector((0, 0, -1))).normalized()
    power *= _unless_normalized(data, 4 * math.pi * data.shadow_soft_size**2)
    return Lamp(SPHERE, power / (4 * math.pi), tuple(centre), axis=tuple(axis), extent=data.shadow_soft_size)


def _unless_normalized(data: Any, size: float) -> float:
    """1, or the size where the strength is not that of the whole lamp; Blender before 4.5 leaves no choice."""
    return 1.0 if getattr(data, "normalize", True) else size


def _strength(data: Any) -> float:
    """Luminance of what `_colour` finds."""
    return float(luminance(_colour(data)))


def _colour(data: Any) -> NDArray[np.float64]:
    """Colour, temperature, exposure and, as far as they are plain, of the lamp's nodes; by channel."""
    colour = np.array(data.color, float) * max(data.energy, 0.0) * 2.0 ** getattr(data, "exposure", 0.0)
    if getattr(data, "use_temperature", False):
        colour *= np.array(data.temperature_color)
    if compat.uses_nodes(data):
        output = data.node_tree.get_output_node("CYCLES")
        if output is None or not output.inputs["Surface"].is_linked:
            return np.zeros(3)
        node = output.inputs["Surface"].links[0].from_node
        if node.bl_idname == "ShaderNodeEmission" and not node.mute:
            tint, strength = node.inputs["Color"], node.inputs["Strength"]
            # A texture is taken for white.
            colour *= 1.0 if tint.is_linked else np.array(tint.default_value[:3])
            colour *= 1.0 if strength.is_linked else max(strength.default_value, 0.0)
    return np.maximum(colour, 0)


def _lit_place(depsgraphs: Iterable[bpy.types.Depsgraph]) -> Vector:
    """Middle of the objects with measured materials, else of all that is solid."""
    chosen: list[Vector] = []
    others: list[Vector] = []
    known: dict[bpy.types.Material, bool] = {}
    for obj in (obj for depsgraph in depsgraphs for obj in depsgraph.objects):
        if obj.type in {"MESH", "CURVE", "CURVES", "SURFACE", "META", "FONT"}:
            middle = obj.matrix_world @ (sum((Vector(c) for c in obj.bound_box), Vector()) / 8)
            slots = [slot.material for slot in obj.material_slots if slot.material]
            (chosen if any(_is_measured(material, known) for material in slots) else others).append(middle)
    places = chosen or others
    return sum(places, Vector()) / len(places) if places else Vector()


def _is_measured(material: bpy.types.Material, known: dict[bpy.types.Material, bool]) -> bool:
    """Whether a material holds a group of ours; of each, the nodes are looked at once."""
    if material not in known:
        known[material] = material.node_tree is not None and is_measured_tree(material.node_tree)
    return known[material]
