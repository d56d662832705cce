"""The table of a scene's lamps, kept current, that measured materials aim at (DESIGN.md section 5)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from bpy.app.handlers import persistent
from mathutils import Matrix, Vector

from ..bake.light_sampling import ELLIPSE, RECTANGLE, SPHERE, SUN, TEXELS, Lamp, lamp_table
from ..nodes.aimed_light_group import MAX_SLOTS, NAME, SLOTS_KEY, aimed_light_group
from ..nodes.group import is_measured_tree

TABLE = "MM Lamps"
# Rows of the table. Only the strongest lamps are aimed at; the others are found by chance, as without the table.
CAPACITY = MAX_SLOTS
# Of the draws, at most: the rest finds sky, bounce light and lamps that are not in the table.
LARGEST_SHARE = 0.9
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


@dataclass(frozen=True)
class LampReport:
    """What is aimed at, the irradiance of everything else, about, and why other lamps are not aimed at."""

    lamps: list[Lamp]
    sky: float
    left_out: list[str]


def lamp_image() -> bpy.types.Image:
    """The file's table of lamps; made, with nothing to aim at, where there is none."""
    image = bpy.data.images.get(TABLE)
    if image is None or tuple(image.size) != (TEXELS, CAPACITY):
        image = bpy.data.images.new(TABLE, TEXELS, CAPACITY, float_buffer=True, is_data=True, alpha=True)
        image.name = TABLE
        image.alpha_mode = "CHANNEL_PACKED"
        image.use_half_precision = False
        _write(image, lamp_table([], CAPACITY))
    return image


def update_lamps(depsgraph: bpy.types.Depsgraph, *, rebuild: bool = True) -> LampReport:
    """Bring the table in line with an evaluated scene; nothing is written where nothing has changed.

    With `rebuild`, materials also get the node group for as many lamps as there are.
    """
    report = survey(depsgraph)
    image = lamp_image()
    _write(image, lamp_table(report.lamps, CAPACITY, report.sky, LARGEST_SHARE))
    if rebuild:
        _set_slots(image, len(report.lamps))
    return report


def update_scene(scene: bpy.types.Scene) -> LampReport:
    """`update_lamps` for a scene that need not be shown anywhere."""
    layer = scene.view_layers[0]
    layer.update()
    return update_lamps(layer.depsgraph)


def survey(depsgraph: bpy.types.Depsgraph) -> LampReport:
    """Lamps of an evaluated scene that a mirror can meet, the strongest first."""
    found, left_out = [], []
    for instance in depsgraph.object_instances:
        obj = instance.object
        if obj.type != "LIGHT":
            continue
        name = obj.original.name
        why_not = _why_not(obj)
        if why_not:
            left_out.append(f"{name}: {why_not}")
        else:
            matrix = instance.matrix_world.copy()
            if obj.data.type == "AREA" and _sheared(matrix):
                left_out.append(f"{name}: sheared by its parent's scale")
            else:
                found.append((name, _lamp(obj.data, matrix)))
    found, rest = [pair for pair in found if pair[1].power > 0], 0.0
    if len(found) > 1:
        target = _lit_place(depsgraph)  # the slow part, of use only where there is a choice
        found.sort(key=lambda pair: -_light_at(target, pair[1]))
        rest = sum(_light_at(target, lamp) for _, lamp in found[CAPACITY:])
    left_out += [f"{name}: only the {CAPACITY} strongest are aimed at" for name, _ in found[CAPACITY:]]
    sky = rest + _world_irradiance(depsgraph.scene.world)
    return LampReport([lamp for _, lamp in found[:CAPACITY]], sky, left_out)


def _light_at(target: Vector, lamp: Lamp) -> float:
    """About the irradiance that the lamp gives to a place."""
    if lamp.kind == SUN:
        return lamp.power
    to_target = target - Vector(lamp.centre)
    facing = max(Vector(lamp.axis).dot(to_target.normalized()), 0.05) if lamp.kind != SPHERE else 1.0
    return lamp.power * facing / max(to_target.length_squared, 1e-8)


def _set_slots(image: bpy.types.Image, slots: int) -> None:
    """Let every material aim at this many lamps; nothing happens where they do already."""
    used = [t for t in bpy.data.node_groups if any(_aims(n, image) for n in t.nodes)]
    if all(n.node_tree.get(SLOTS_KEY) == slots for t in used for n in t.nodes if _aims(n, image)):
        return
    group = aimed_light_group(image, slots)
    replaced = set()
    for tree in used:
        for node in tree.nodes:
            if _aims(node, image):
                replaced.add(node.node_tree)
                node.node_tree = group
    for old in replaced - {group}:
        if not old.users:
            bpy.data.node_groups.remove(old)


def _aims(node: bpy.types.Node, image: bpy.types.Image) -> bool:
    tree = getattr(node, "node_tree", None)
    return bool(tree) and tree.name.startswith(NAME) and any(getattr(n, "image", None) == image for n in tree.nodes)


def _why_not(obj: bpy.types.Object) -> str:
    """Why a mirror never meets this lamp; empty if it does."""
    data, original = obj.data, obj.original
    if not original.visible_glossy:
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


def _sheared(matrix: Matrix) -> bool:
    """Whether the edges and the axis of an area lamp are no longer at right angles."""
    u, v, w = (column.normalized() for column in matrix.to_3x3().col)
    return max(abs(u.dot(v)), abs(u.dot(w)), abs(v.dot(w))) > 1e-3


def _lamp(data: Any, matrix: Matrix) -> Lamp:
    """In world space."""
    centre, turn = matrix.translation, matrix.to_3x3()
    power = float(np.array(data.color) @ _LUMINANCE) * max(data.energy, 0.0)
    power *= 2.0 ** getattr(data, "exposure", 0.0)
    if data.type == "SUN":
        axis = (turn @ Vector((0, 0, 1))).normalized()
        return Lamp(SUN, power, axis=tuple(axis), extent=data.angle)
    if data.type == "AREA":
        size_y = data.size_y if data.shape in ("RECTANGLE", "ELLIPSE") else data.size
        u, v = turn @ Vector((data.size, 0, 0)), turn @ Vector((0, size_y, 0))
        axis = (turn @ Vector((0, 0, -1))).normalized()
        kind = ELLIPSE if data.shape in ("DISK", "ELLIPSE") else RECTANGLE
        return Lamp(kind, power / math.pi, tuple(centre), tuple(u), tuple(v), tuple(axis))
    return Lamp(SPHERE, power / (4 * math.pi), tuple(centre), extent=data.shadow_soft_size)


def _lit_place(depsgraph: bpy.types.Depsgraph) -> Vector:
    """Middle of the objects with measured materials, else of all that is solid."""
    chosen, others = [], []
    for obj in depsgraph.objects:
        if obj.type in {"MESH", "CURVE", "CURVES", "SURFACE", "META", "FONT"}:
            middle = obj.matrix_world @ (sum((Vector(c) for c in obj.bound_box), Vector()) / 8)
            slots = [slot.material for slot in obj.material_slots if slot.material]
            measured = any(is_measured_tree(m.node_tree) for m in slots if m.node_tree)
            (chosen if measured else others).append(middle)
    places = chosen or others
    return sum(places, Vector()) / len(places) if places else Vector()


def _world_irradiance(world: bpy.types.World | None) -> float:
    """About what the sky gives to a surface that faces it; a picture or a texture is taken for middle grey."""
    if world is None:
        return 0.0
    tree = world.node_tree
    backgrounds = [n for n in tree.nodes if n.type == "BACKGROUND"] if tree else []
    if not backgrounds:
        return math.pi * float(np.array(world.color) @ _LUMINANCE)
    total = 0.0
    for node in backgrounds:
        colour, strength = node.inputs["Color"], node.inputs["Strength"]
        grey = 0.5 if colour.is_linked else float(np.array(colour.default_value[:3]) @ _LUMINANCE)
        total += math.pi * grey * (0.5 if strength.is_linked else max(strength.default_value, 0.0))
    return total


def _write(image: bpy.types.Image, table: np.ndarray) -> None:
    pixels = np.ascontiguousarray(table[::-1]).ravel()
    before = np.empty_like(pixels)
    image.pixels.foreach_get(before)
    if not np.array_equal(pixels, before):
        image.pixels.foreach_set(pixels)
        image.update()
        image.pack()  # a generated image keeps its pixels in the .blend only so


def keep_current(scene: bpy.types.Scene) -> None:
    """Bring the table in line with the scene, if some material aims by it."""
    if _in_use():
        update_scene(scene)


def _in_use() -> bool:
    image = bpy.data.images.get(TABLE)
    return image is not None and image.users > 0


@persistent
def _after_an_edit(_scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    if _in_use() and any(_concerns_lamps(update.id) for update in depsgraph.updates):
        update_lamps(depsgraph)


def _concerns_lamps(block: bpy.types.ID) -> bool:
    """Whether an edit of this block may change what is aimed at, or by whom; most edits only move other objects."""
    if isinstance(block, bpy.types.Object):
        return block.type == "LIGHT" or block.is_instancer
    kinds = (bpy.types.Light, bpy.types.World, bpy.types.Scene, bpy.types.Collection, bpy.types.Material)
    return isinstance(block, (*kinds, bpy.types.ShaderNodeTree))


@persistent
def _after_a_frame(_scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    # While an animation is rendered this is not Blender's main thread: no node is touched.
    if _in_use():
        update_lamps(depsgraph, rebuild=False)


def register() -> None:
    """Called by `addon.register`."""
    bpy.app.handlers.depsgraph_update_post.append(_after_an_edit)
    bpy.app.handlers.frame_change_post.append(_after_a_frame)


def unregister() -> None:
    """Called by `addon.unregister`."""
    bpy.app.handlers.depsgraph_update_post.remove(_after_an_edit)
    bpy.app.handlers.frame_change_post.remove(_after_a_frame)
