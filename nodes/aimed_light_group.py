"""Node group: aim at the scene's lamps and at the bright parts of its world.

One group has room for as many lamps as are ever aimed at, and for the world. What a scene calls for is chosen among its
Group Outputs, of which one is active: `aim_by`. Cycles compiles what the active one depends on and no more, so that
room costs no time; and a lamp that comes or goes while an artist works changes settings of nodes, never a datablock or
a link to one. (Blender's undo keeps datablocks from step to step, and does not know of what a handler has done to them
since: a group that a handler exchanged for another was a crash at the next undo, in 4.3 and 5.2.)
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import bpy

from ..bake.sampling.lamps import TEXELS, Aim, aim_at, aimed_part, density_towards, draw_towards, expected_light
from ..bake.sampling.world import choose_cell, draw_in_world, expected_world_light, world_coordinates
from . import expr
from .group import FAMILY_KEY, HASH_KEY, SWITCHED_KEY, active_output, call, content_hash, node_group, nodes_before
from .light_images import WORLD, texel, world_table
from .osl_script import SCRIPTED_KEY

NAME = "MM Aim"
# Custom properties of the group and of its outputs: how many lamps they aim at, and whether at the world.
SLOTS_KEY = "measured_materials_lamps"
WORLD_KEY = "measured_materials_world"
# Of a group that aims only at what the shader could sample and does not: whether that has the world's picture.
INSTEAD_KEY = "measured_materials_instead"
# Lamps that are aimed at. The first takes 155 nodes of the compiled shader, each other about 120, the world 53.
MAX_SLOTS = 4
# Of a sheet, whose two sides aim by two mirrors each: with more Cycles' stack has no room, and the sheet is black.
ON_SHEET = 2
_SWITCHED = "mute extension"
_REVISION = 2
_INPUTS = {"Position": "vector", "Normal": "vector", "wi": "vector"}
_INPUTS |= dict.fromkeys(("Random Lamp", "Random Aim", "Random 1", "Random 2", "Concentration"), "float")
_OUTPUTS = {"wi": "vector", "Aimed": "float", "Rest": "float"}
_AIM = {f.name: "float" if f.name in ("kind", "fourth", "m") else "vector" for f in fields(Aim)}


def aimed_light_group(
    lamps: bpy.types.Image, slots: int | None = None, world: bpy.types.Image | None = None, most: int = MAX_SLOTS
) -> bpy.types.ShaderNodeTree:
    """Exchange a drawn direction for one towards a light, now and then; world space.

    (Position, Normal, wi, four random numbers, Concentration) to (wi, Aimed, Rest): for the direction returned, Aimed
    is the density of having aimed there, and Rest the probability of not aiming from here at all. Of a sampler of
    density p, the whole density is then Aimed + Rest p. Concentration is of that sampler, see
    `bake.sampling.concentration`: the wider a lamp beside its lobes, the less often it is aimed at.

    Parameters
    ----------
    lamps : the table of `bake.sampling.lamps.lamp_table`, one lamp a row from the top
    slots : lamps to aim at, the first of the table; by default as many as the group does already, a new one at none
    world : the table of `bake.sampling.world.world_texels` to aim at too; by default as the group does already, a new
        one not, with the file's own table
    most : lamps that there is room for, `MAX_SLOTS` or `ON_SHEET`
    """
    columns, rows = lamps.size[0], lamps.size[1]
    room = min(most, rows)
    if columns != TEXELS or not 0 <= (slots or 0) <= room or (world is not None and rows < 2):
        raise ValueError(
            f"{slots} lamps of {columns} texels; a lamp has {TEXELS}, at most {most} are aimed at, and a world "
            "takes a second row"
        )
    table = world or world_table()
    group = made_before(_family(lamps, table, NAME, room)) or _new_group(lamps, table, room)
    if slots is not None or world is not None:
        aim_by(group, slots or 0, world is not None)
    return group


def aimed_instead_group(
    lamps: bpy.types.Image, pictured: bool, scripted: bool = False, most: int = MAX_SLOTS
) -> bpy.types.ShaderNodeTree:
    """`aimed_light_group` of materials that sample lamps and, if `pictured`, a world: at what they cannot sample now.

    An output more is 1 where it aims, and 0 as a constant where all is sampled. Those that sample by `scripted` rays
    can do so in every Blender, and have a group of their own.
    """
    world = world_table()
    name = f"{NAME} Instead of Picture" if pictured else f"{NAME} Instead"
    name += ", OSL" * scripted
    room = min(most, lamps.size[1])
    group = made_before(_family(lamps, world, name, room)) or _new_group(lamps, world, room, name)
    group[INSTEAD_KEY] = pictured
    if scripted:
        group[SCRIPTED_KEY] = True
    return group


def can_switch(group: bpy.types.NodeTree) -> bool:
    """Whether it has room; groups of versions before have none, and aim at what they were built for."""
    return SLOTS_KEY in group and SWITCHED_KEY in group


def room_of(group: bpy.types.NodeTree) -> int:
    """Lamps that a group can be switched to at most; one of versions before stays with those it was built for."""
    outputs = [n for n in group.nodes if n.bl_idname == "NodeGroupOutput" and SLOTS_KEY in n]
    return max((int(n[SLOTS_KEY]) for n in outputs), default=MAX_SLOTS)


def aim_by(group: bpy.types.NodeTree, slots: int, world: bool) -> None:
    """Let a group aim at so many lamps, at most at those it has room for, and at the world or not, if it ever does.

    With none and no world the direction passes through and costs nothing. What stands so already is left as it is.
    """
    outputs = [n for n in group.nodes if n.bl_idname == "NodeGroupOutput"]
    slots = min(slots, room_of(group))
    world = world and any(n[WORLD_KEY] for n in outputs)
    chosen = next(n for n in outputs if (n[SLOTS_KEY], bool(n[WORLD_KEY])) == (slots, world))
    if not chosen.is_active_output:
        chosen.is_active_output = True  # Blender lets go of the other
    needed = nodes_before(chosen)
    for node in group.nodes:
        # Cycles does not look into a muted group, and so is ready sooner.
        if node.bl_idname == "ShaderNodeGroup" and node.mute == (node in needed):
            node.mute = node not in needed
    if (group.get(SLOTS_KEY), group.get(WORLD_KEY)) != (slots, world):
        group[SLOTS_KEY], group[WORLD_KEY] = slots, world


def made_before(family: str) -> bpy.types.ShaderNodeTree | None:
    """The file's own group of this family that can be switched, and that nobody has edited."""
    # One of a linked library would be lost with the library.
    own = (t for t in bpy.data.node_groups if t.library is None and t.get(FAMILY_KEY) == family and can_switch(t))
    return next((t for t in own if content_hash(t) == t[HASH_KEY]), None)


def _family(lamps: bpy.types.Image, world: bpy.types.Image, name: str, room: int) -> str:
    # Groups of versions before, of other sockets, stay in what was built with them; they can be switched too.
    of_world = f" and {world.name_full}" * (world.name_full != WORLD)
    return f"{name}, {_REVISION}, of {room} by {lamps.name_full}{of_world}"


def _new_group(lamps: bpy.types.Image, world: bpy.types.Image, room: int, name: str = NAME) -> bpy.types.ShaderNodeTree:
    parts = _Parts(
        _lamp_group(lamps), _draw_group(), _density_group(), world_draw_group(world), world_density_group(world)
    )
    # Groups of equal content would be one.
    outputs = _OUTPUTS if name == NAME else _OUTPUTS | {name.removeprefix("MM "): "float"}

    def build(*arguments: Any) -> tuple[Any, ...]:
        for slots in range(room + 1):
            for with_world in (False, True) if lamps.size[1] > 1 else (False,):
                if slots or with_world:
                    found = call(_mixture_group(lamps, parts, slots, with_world), *arguments)
                    _output(dict(zip(outputs, (*found, 1.0))), slots, with_world)
        return (arguments[2], 0.0, 1.0, 0.0)[: len(outputs)]

    group = node_group(name, _INPUTS, outputs, build, switched=_SWITCHED)
    nothing = active_output(group)
    nothing[SLOTS_KEY], nothing[WORLD_KEY], nothing.label = 0, False, "Aim at nothing"
    group[FAMILY_KEY] = _family(lamps, world, name, room)
    aim_by(group, 0, False)
    return group


@dataclass(frozen=True)
class _Parts:
    """Groups inside: a small tree is built and edited in a fraction of the time of a large one."""

    lamp: bpy.types.ShaderNodeTree
    draw: bpy.types.ShaderNodeTree
    density: bpy.types.ShaderNodeTree
    world_draw: bpy.types.ShaderNodeTree
    world_density: bpy.types.ShaderNodeTree


def _mixture_group(lamps: bpy.types.Image, parts: _Parts, slots: int, with_world: bool) -> bpy.types.ShaderNodeTree:
    """As the group, for these lamps. Each is one of its own: what is not aimed at is then muted as a whole."""

    def build(position: Any, normal: Any, wi: Any, *numbers: Any) -> tuple[Any, Any, Any]:
        seen = [call(parts.lamp, float(k), position, normal, numbers[-1]) for k in range(slots)]
        return _mixture(lamps, parts, seen, with_world, (position, normal, wi), numbers)

    return node_group(f"MM Towards {targets(slots, with_world)}", _INPUTS, _OUTPUTS, build, switched=_SWITCHED)


def targets(slots: int, world: bool) -> str:
    """What a group is switched to, in words."""
    return " and ".join([f"{slots} Lamp{'s' * (slots > 1)}"] * (slots > 0) + ["World"] * world)


def _mixture(
    lamps: bpy.types.Image,
    parts: _Parts,
    seen: list[tuple[Any, ...]],
    with_world: bool,
    ray: tuple[Any, Any, Any],
    numbers: tuple[Any, ...],
) -> tuple[Any, Any, Any]:
    """The outputs for these lamps, each the results of `_lamp_group`, and for the world or not."""
    (position, normal, wi), (u_lamp, u_aim, u1, u2, concentration) = ray, numbers
    slots, wanted = len(seen), [found[-1] for found in seen]
    total = _sum([found[-2] for found in seen])
    if with_world:
        around = expected_world_light(expr, *texel(lamps, 1.0, 4), normal)
        wanted.append(around)
        total = around + total
    aims = _sum(wanted)
    sky, largest, _ = expr.components(texel(lamps, 0.0, 4)[0])
    most = expr.divide(aims, total) * largest if seen else largest
    share = expr.minimum(expr.divide(total, total + sky), most)
    index = which_light(u_lamp * aims, wanted)
    aimed = u_aim < share
    chosen, density = wi, 0.0
    if seen:
        target = seen[0] if slots == 1 else call(parts.lamp, index, position, normal, concentration)
        chosen = expr.where_vector(aimed, call(parts.draw, *target[:-2], u1, u2), chosen)
    if with_world:
        drawn = call(parts.world_draw, u1, u2, u_aim, share)
        chosen = expr.where_vector(aimed * (index > slots - 0.5) if seen else aimed, drawn, chosen)
        density = call(parts.world_density, chosen) * wanted[slots]
    for k, found in enumerate(seen):
        density = call(parts.density, *found[:-2], found[-1], chosen, aimed, index, float(k)) + density
    return chosen, expr.divide(density * share, aims), 1 - share


def _sum(values: list[Any]) -> Any:
    return sum(values[1:], start=values[0]) if values else 0.0


def which_light(threshold: Any, light: list[Any]) -> Any:
    """Index of the light that a number up to their sum chooses: how many of the running sums it has passed."""
    passed, index = light[0], 0.0
    for part in light[1:]:
        index = (threshold > passed) + index
        passed = passed + part
    return index


def _output(results: dict[str, Any], slots: int, world: bool) -> None:
    """A Group Output beside the first."""
    expr.need_tree()
    made = expr.node("NodeGroupOutput", {}, results)
    made.is_active_output = False
    made[SLOTS_KEY], made[WORLD_KEY] = slots, world
    made.label = f"Aim at {targets(slots, world)}"


def _lamp_group(lamps: bpy.types.Image) -> bpy.types.ShaderNodeTree:
    """(Row, Position, Normal, Concentration) to what `Aim` holds of a lamp, about the irradiance that it brings there,
    and the part of that by which it is aimed at."""

    def build(row: Any, position: Any, normal: Any, concentration: Any) -> tuple[Any, ...]:
        (centre, kind), (u, power), (v, _), (axis, fourth) = (texel(lamps, row, k) for k in range(4))
        aim = aim_at(expr, position, centre, kind, u, v, axis, fourth)
        light = expected_light(expr, aim, normal, power)
        return *(getattr(aim, name) for name in _AIM), light, light * aimed_part(expr, aim, concentration)

    inputs = {"Row": "float", "Position": "vector", "Normal": "vector", "Concentration": "float"}
    outputs = _AIM | {"Light": "float", "Wanted": "float"}
    return node_group("MM Lamp", inputs, outputs, build, switched=_SWITCHED)


def _draw_group() -> bpy.types.ShaderNodeTree:
    """(Aim, two random numbers) to a direction."""
    inputs = _AIM | {"Random 1": "float", "Random 2": "float"}
    return node_group(
        "MM Draw Towards Lamp", inputs, {"wi": "vector"}, lambda *a: draw_towards(expr, Aim(*a[:-2]), *a[-2:])
    )


def _density_group() -> bpy.types.ShaderNodeTree:
    """(Aim, Wanted, wi, Aimed, Index, Row) to the density of wi, times what the lamp is wanted by.

    Index is the row of the lamp that was drawn towards, if Aimed is 1.
    """

    def build(*values: Any) -> Any:
        *aim, wanted, wi, aimed, index, row = values
        here = aimed * ((index > row - 0.5) * (index < row + 0.5))
        return density_towards(expr, Aim(*aim), wi, here) * wanted

    numbers = dict.fromkeys(("Aimed", "Index", "Row"), "float")
    inputs = _AIM | {"Wanted": "float", "wi": "vector"} | numbers
    return node_group("MM Density Towards Lamp", inputs, {"Density": "float"}, build)


def world_draw_group(world: bpy.types.Image) -> bpy.types.ShaderNodeTree:
    """(two random numbers, that which has decided to aim, the share of draws to aim) to a direction."""

    def build(u1: Any, u2: Any, u_aim: Any, share: Any) -> Any:
        columns, rows = world.size
        at, cell, place = choose_cell(expr, columns, rows, u1, u2)
        alias, acceptance = world_texel(world, at)
        # Below the share u_aim is even from 0 to it: it may decide about the alias too.
        return draw_in_world(expr, columns, rows, cell, alias, u_aim < share * acceptance, place)

    inputs = dict.fromkeys(("Random 1", "Random 2", "Random Aim", "Share"), "float")
    return node_group("MM Draw Towards World", inputs, {"wi": "vector"}, build, switched=_SWITCHED)


def world_density_group(world: bpy.types.Image) -> bpy.types.ShaderNodeTree:
    """A direction to its density per solid angle."""

    def build(wi: Any) -> Any:
        u, v = world_coordinates(expr, wi)
        return expr.components(world_texel(world, expr.vec(u, v, 0.0))[0])[2]

    return node_group("MM Density Towards World", {"wi": "vector"}, {"Density": "float"}, build, switched=_SWITCHED)


def world_texel(world: bpy.types.Image, at: Any) -> tuple[Any, Any]:
    """Colour and alpha of the world's table at texture coordinates, in nodes."""
    made = expr.node("ShaderNodeTexImage", {"image": world, "interpolation": "Closest", "extension": "EXTEND"}, {0: at})
    return expr.Vector(made.outputs["Color"]), expr.Scalar(made.outputs["Alpha"])
