"""The tables of a scene's lamps and world, kept current, that measured materials aim at (DESIGN.md section 5).

They follow edits, frames and the start of a render; until then an old table costs noise, never bias.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import bpy
import numpy as np
from bpy.app.handlers import persistent
from mathutils import Matrix, Vector

from ..bake.light_sampling import ELLIPSE, RECTANGLE, SPHERE, SUN, TEXELS, Lamp, lamp_table
from ..nodes.aimed_light_group import MAX_SLOTS, NAME, SLOTS_KEY, WORLD_KEY, aimed_light_group
from ..nodes.group import is_measured_tree
from . import world_light
from .world_light import PROBE, WorldLight

TABLE = "MM Lamps"
# Rows of the table. Only the strongest lamps are aimed at; the others are found by chance, as without the table.
CAPACITY = MAX_SLOTS
# Of the draws, at most: the rest finds sky, bounce light and lamps that are not in the table.
LARGEST_SHARE = 0.9
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
_DARK = 0.05


@dataclass(frozen=True)
class LampReport:
    """What is aimed at, the irradiance of everything else, about, and why other lamps are not aimed at."""

    lamps: list[Lamp]
    sky: float
    left_out: list[str]
    world: WorldLight = field(default_factory=lambda: world_light.world_light(None))

    def words(self) -> list[str]:
        """What is aimed at and why, then one line for each lamp that is not."""
        targets = [f"{len(self.lamps)} lamp{'s' * (len(self.lamps) > 1)}"] if self.lamps else []
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
        return [f"Aims at {' and '.join(targets)}: {reason}", *self.left_out]


def lamp_image() -> bpy.types.Image:
    """The file's table of lamps; made, with nothing to aim at, where there is none."""
    image = bpy.data.images.get((TABLE, None))
    if image is None or not _is_table(image):
        image = bpy.data.images.new(TABLE, TEXELS, CAPACITY, float_buffer=True, is_data=True, alpha=True)
        image.name = TABLE
        image.alpha_mode = "CHANNEL_PACKED"
        image.use_half_precision = False
        _write(image, lamp_table([], CAPACITY))
    return image


def update_lamps(depsgraph: bpy.types.Depsgraph, *, rebuild: bool = True, for_render: bool = False) -> LampReport:
    """Bring the tables in line with an evaluated scene; nothing is written where nothing has changed.

    Parameters
    ----------
    rebuild : also give materials the node group for as many lamps as there are, and for the world where that pays
    for_render : take the lamps that a render will show, though the depsgraph is the viewport's
    """
    report = survey(depsgraph, for_render=for_render)
    lamp_image()
    structure = report.world.structure if report.world.aimed else None
    world = (structure.toward, structure.flux) if structure is not None else None
    table = lamp_table(report.lamps, CAPACITY, report.sky, LARGEST_SHARE, world)
    image = None
    if structure is not None:
        image = world_light.world_image(report.world) if rebuild else None
        world_light.write_world(report.world)
    for tables in _tables():
        _write(tables, table)
        if rebuild:
            _set_slots(tables, len(report.lamps), image)
    return report


def update_scene(scene: bpy.types.Scene, *, rebuild: bool = True, for_render: bool = False) -> LampReport:
    """`update_lamps` for a scene that need not be shown anywhere."""
    layer = scene.view_layers[0]
    layer.update()
    return update_lamps(layer.depsgraph, rebuild=rebuild, for_render=for_render)


def survey(depsgraph: bpy.types.Depsgraph, *, for_render: bool = False) -> LampReport:
    """Lamps of an evaluated scene that a mirror can meet, the strongest first, and its world."""
    found, left_out = [], []
    for obj, matrix in _lamp_objects(depsgraph, for_render):
        name, why_not = obj.original.name, _why_not(obj)
        if not why_not and obj.data.type == "AREA" and _sheared(matrix):
            why_not = "sheared by its parent's scale"
        if why_not:
            left_out.append(f"{name}: {why_not}")
        else:
            found.append((name, _lamp(obj.data, matrix), obj.data))
    found = [entry for entry in found if entry[1].power > 0]
    lamps, rest = [lamp for _, lamp, _ in found], 0.0
    if len(found) > 1 or any(_has_beam(data) for _, _, data in found):
        target = _lit_place(depsgraph)  # the slow part, of use only where there is a choice
        found = [(name, _in_beam(target, lamp, data), data) for name, lamp, data in found]
        found.sort(key=lambda entry: -_light_at(target, entry[1]))
        lamps = [lamp for _, lamp, _ in found]
        rest = sum(_light_at(target, lamp) for lamp in lamps[CAPACITY:])
    left_out += [f"{name}: only the {CAPACITY} strongest are aimed at" for name, _, _ in found[CAPACITY:]]
    world = world_light.world_light(depsgraph.scene.world)
    sky = rest + (world.structure.background if world.aimed and world.structure else world.irradiance)
    return LampReport(lamps[:CAPACITY], sky, left_out, world)


def _lamp_objects(depsgraph: bpy.types.Depsgraph, for_render: bool) -> Iterator[tuple[bpy.types.Object, Matrix]]:
    """Lamps as objects and instances, linked ones too, with their matrices in the world."""
    shown = set()
    renderable = _renderable(depsgraph.view_layer.layer_collection) if for_render else None
    for instance in depsgraph.object_instances:
        obj = instance.object
        if obj.type != "LIGHT":
            continue
        owner = (instance.parent if instance.is_instance else obj).original
        shown.add(owner)
        if renderable is None or (owner in renderable and not obj.original.hide_render):
            yield obj, instance.matrix_world.copy()
    for obj in renderable or ():
        if obj.type == "LIGHT" and obj not in shown:
            yield obj, _place(obj)


def _renderable(layer: bpy.types.LayerCollection) -> set[bpy.types.Object]:
    """Objects that a render shows, whatever the viewport does."""
    if layer.exclude or layer.collection.hide_render:
        return set()
    found = {obj for obj in layer.collection.objects if not obj.hide_render}
    return found.union(*(_renderable(child) for child in layer.children))


def _place(obj: bpy.types.Object) -> Matrix:
    """Matrix of an object that the viewport hides and therefore does not evaluate."""
    if obj.constraints or (obj.parent and obj.parent_type != "OBJECT"):
        return obj.matrix_world.copy()
    return obj.parent.matrix_world @ obj.matrix_parent_inverse @ obj.matrix_basis if obj.parent else obj.matrix_basis


def _light_at(target: Vector, lamp: Lamp) -> float:
    """About the irradiance that the lamp gives to a place."""
    if lamp.kind == SUN:
        return lamp.power
    to_target = target - Vector(lamp.centre)
    facing = max(Vector(lamp.axis).dot(to_target.normalized()), _DARK) if lamp.kind != SPHERE else 1.0
    return lamp.power * facing / max(to_target.length_squared, 1e-8)


def _has_beam(data: Any) -> bool:
    return data.type == "SPOT" or (data.type == "AREA" and data.spread < math.pi - 1e-3)


def _in_beam(target: Vector, lamp: Lamp, data: Any) -> Lamp:
    """The lamp with the power that it has towards this place: a beam is dark outside and may be brighter inside."""
    if not _has_beam(data):
        return lamp
    cosine = Vector(lamp.axis).dot((target - Vector(lamp.centre)).normalized())
    if data.type == "SPOT":
        return lamp if cosine > math.cos(data.spot_size / 2) else replace(lamp, power=_DARK * lamp.power)
    # Cycles lets a spread fall off as 1 - tan(x) / tan(h) up to its half angle h, and keeps the whole power.
    half = max(data.spread / 2, 1e-3)
    kept = math.sin(half) ** 2 - (half - math.sin(half) * math.cos(half)) / math.tan(half)
    tangent = math.sqrt(max(1 / max(cosine, 1e-3) ** 2 - 1, 0.0))
    return replace(lamp, power=lamp.power * max((1 - tangent / math.tan(half)) / kept, _DARK))


def _set_slots(image: bpy.types.Image, slots: int, world: bpy.types.Image | None) -> None:
    """Let every material aim at this many lamps, and at the world or not; nothing happens where they do already."""
    used = [t for t in bpy.data.node_groups if t.library is None and any(_aims(n, image) for n in t.nodes)]
    aiming = [node for tree in used for node in tree.nodes if _aims(node, image)]
    wanted = (slots, world is not None)
    if all((n.node_tree.get(SLOTS_KEY), n.node_tree.get(WORLD_KEY, False)) == wanted for n in aiming):
        return
    group = aimed_light_group(image, slots, world)
    replaced = {node.node_tree for node in aiming}
    for node in aiming:
        node.node_tree = group
    for old in replaced - {group}:
        if not old.users:
            bpy.data.node_groups.remove(old)


def _aims(node: bpy.types.Node, image: bpy.types.Image) -> bool:
    tree = getattr(node, "node_tree", None)
    return bool(tree) and tree.name.startswith(NAME) and any(getattr(n, "image", None) == image for n in tree.nodes)


def _is_table(image: bpy.types.Image) -> bool:
    return image.name.startswith(TABLE) and tuple(image.size) == (TEXELS, CAPACITY)


def _tables() -> list[bpy.types.Image]:
    """The file's table, and those that came along with linked and appended materials."""
    return [image for image in bpy.data.images if _is_table(image)]


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
    """Luminance of colour, temperature, exposure and, as far as they are plain, of the lamp's nodes."""
    colour = np.array(data.color, float) * max(data.energy, 0.0) * 2.0 ** getattr(data, "exposure", 0.0)
    if getattr(data, "use_temperature", False):
        colour *= np.array(data.temperature_color)
    if data.use_nodes and data.node_tree:
        output = data.node_tree.get_output_node("CYCLES")
        if output is None or not output.inputs["Surface"].is_linked:
            return 0.0
        node = output.inputs["Surface"].links[0].from_node
        if node.bl_idname == "ShaderNodeEmission" and not node.mute:
            tint, strength = node.inputs["Color"], node.inputs["Strength"]
            # A texture is taken for white.
            colour *= 1.0 if tint.is_linked else np.array(tint.default_value[:3])
            colour *= 1.0 if strength.is_linked else max(strength.default_value, 0.0)
    return float(np.maximum(colour, 0) @ _LUMINANCE)


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


def _write(image: bpy.types.Image, table: np.ndarray) -> None:
    pixels = np.ascontiguousarray(table[::-1]).ravel()
    before = np.empty_like(pixels)
    image.pixels.foreach_get(before)
    if not np.array_equal(pixels, before):
        image.pixels.foreach_set(pixels)
        image.update()


def keep_current(scene: bpy.types.Scene) -> None:
    """Bring the tables in line with the scene as it will be rendered, if some material aims by them."""
    if _in_use() and PROBE not in scene:
        update_scene(scene, for_render=True)


def pack_tables() -> None:
    """Put the tables into the .blend that is about to be saved: only so does it keep the pixels of such images.

    A table that was lost holds zeros, and nothing is aimed by it. (That of the world is packed whenever it is written.)
    """
    for image in _tables():
        if image.is_dirty and image.library is None and image.users:
            image.pack()


def _in_use() -> bool:
    return any(image.users > 0 for image in _tables())


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
    # Before every picture of a render too, then with the lamps that it shows; that may be outside Blender's main
    # thread, and the nodes are evaluated already: none is touched.
    if _in_use() and PROBE not in depsgraph.scene:
        update_lamps(depsgraph, rebuild=False)


@persistent
def _before_a_render(scene: bpy.types.Scene, *_: Any) -> None:
    # The last chance to change nodes, for lamps that only a render shows.
    if threading.current_thread() is threading.main_thread():
        keep_current(scene)


@persistent
def _after_loading(*_: Any) -> None:
    world_light.distrust_tables()
    if _in_use():
        update_scene(bpy.context.scene)


@persistent
def _after_undo(*_: Any) -> None:
    world_light.distrust_tables()


@persistent
def _before_saving(*_: Any) -> None:
    pack_tables()


_HANDLERS = {
    "depsgraph_update_post": _after_an_edit,
    "frame_change_post": _after_a_frame,
    "render_init": _before_a_render,
    "load_post": _after_loading,
    "undo_post": _after_undo,
    "redo_post": _after_undo,
    "save_pre": _before_saving,
}


def register() -> None:
    """Called by `addon.register`."""
    for event, handler in _HANDLERS.items():
        getattr(bpy.app.handlers, event).append(handler)


def unregister() -> None:
    """Called by `addon.unregister`."""
    for event, handler in _HANDLERS.items():
        getattr(bpy.app.handlers, event).remove(handler)
