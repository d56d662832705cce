"""Node group: aim at the scene's lamps and at the bright parts of its world."""

from __future__ import annotations

from typing import Any

import bpy

from ..bake.light_sampling import TEXELS, aim_at, density_towards, draw_towards, expected_light
from ..bake.world_sampling import choose_cell, draw_in_world, expected_world_light, world_coordinates
from . import expr
from .group import FAMILY_KEY, node_group

NAME = "MM Aim"
# Custom properties of the group: how many lamps it aims at, and whether at the world.
SLOTS_KEY = "measured_materials_lamps"
WORLD_KEY = "measured_materials_world"
# Lamps that are aimed at. The first adds 155 nodes, each other about 120, the world 53.
MAX_SLOTS = 4


def aimed_light_group(
    lamps: bpy.types.Image, slots: int = 0, world: bpy.types.Image | None = None
) -> bpy.types.ShaderNodeTree:
    """Exchange a drawn direction for one towards a light, now and then; world space.

    (Position, Normal, wi, four random numbers) to (wi, Aimed, Rest): for the direction returned, Aimed is the density
    of having aimed there, and Rest the probability of not aiming from here at all. Of a sampler of density p, the whole
    density is then Aimed + Rest p.

    Parameters
    ----------
    lamps : the table of `bake.light_sampling.lamp_table`, one lamp a row from the top
    slots : lamps to aim at, the first of the table; with 0 and no world the direction passes through and costs nothing
    world : the table of `bake.world_sampling.world_texels`, or None to leave the world to chance
    """
    columns, rows = lamps.size[0], lamps.size[1]
    if columns != TEXELS or not 0 <= slots <= min(MAX_SLOTS, rows) or (world is not None and rows < 2):
        raise ValueError(
            f"{slots} lamps of {columns} texels; a lamp has {TEXELS}, at most {MAX_SLOTS} are aimed at, and a world "
            "takes a second row"
        )

    def texel(index: Any, column: int) -> tuple[Any, Any]:
        v = 1 - (index + 0.5) * (1 / rows)
        return expr.image_tap(lamps, (column + 0.5) / TEXELS, v, "Closest")

    def aim_and_power(index: Any, position: Any) -> tuple[Any, Any]:
        (centre, kind), (u, power), (v, _), (axis, fourth) = (texel(index, k) for k in range(4))
        return aim_at(expr, position, centre, kind, u, v, axis, fourth), power

    def build(position: Any, normal: Any, wi: Any, u_lamp: Any, u_aim: Any, u1: Any, u2: Any) -> tuple[Any, Any, Any]:
        if slots == 0 and world is None:
            texel(0.0, 0)  # linked to nothing, but the table is known to be this group's
            return wi, 0.0, 1.0
        seen = [aim_and_power(float(k), position) for k in range(slots)]
        light = [expected_light(expr, aim, normal, power) for aim, power in seen]
        if world is not None:
            light.append(expected_world_light(expr, *texel(1.0, 4), normal))
        total = sum(light[1:], start=light[0])
        sky, largest, _ = expr.components(texel(0.0, 4)[0])
        share = expr.minimum(expr.divide(total, total + sky), largest)
        # Which light: how many of the running sums the number has passed.
        threshold, passed, index = u_lamp * total, light[0], 0.0
        for part in light[1:]:
            index = (threshold > passed) + index
            passed = passed + part
        aimed = u_aim < share
        chosen, density = wi, 0.0
        if seen:
            target = seen[0][0] if slots == 1 else aim_and_power(index, position)[0]
            chosen = expr.where_vector(aimed, draw_towards(expr, target, u1, u2), chosen)
        if world is not None:
            # Below the share u_aim is even from 0 to it: it may decide about the alias too.
            at, cell, place = choose_cell(expr, *world.size, u1, u2)
            alias, acceptance = _world_texel(world, at)
            drawn = draw_in_world(expr, *world.size, cell, alias, u_aim < share * acceptance, place)
            chosen = expr.where_vector(aimed * (index > slots - 0.5) if seen else aimed, drawn, chosen)
            u, v = world_coordinates(expr, chosen)
            density = expr.components(_world_texel(world, expr.vec(u, v, 0.0))[0])[2] * light[slots]
        for k, ((aim, _), part) in enumerate(zip(seen, light)):
            here = aimed if len(light) == 1 else aimed * (_same(index, k))
            density = density_towards(expr, aim, chosen, here) * part + density
        return chosen, expr.divide(density * share, total), 1 - share

    numbers = dict.fromkeys(("Random Lamp", "Random Aim", "Random 1", "Random 2"), "float")
    group = node_group(
        NAME,
        {"Position": "vector", "Normal": "vector", "wi": "vector", **numbers},
        {"wi": "vector", "Aimed": "float", "Rest": "float"},
        build,
    )
    group[SLOTS_KEY], group[WORLD_KEY] = slots, world is not None
    group[FAMILY_KEY] = f"{NAME} by {lamps.name_full}"
    return group


def _world_texel(world: bpy.types.Image, at: Any) -> tuple[Any, Any]:
    made = expr.node("ShaderNodeTexImage", {"image": world, "interpolation": "Closest", "extension": "EXTEND"}, {0: at})
    return expr.Vector(made.outputs["Color"]), expr.Scalar(made.outputs["Alpha"])


def _same(index: Any, k: int) -> Any:
    """1 where the whole number `index` is k, else 0."""
    return (index > k - 0.5) * (index < k + 0.5)
