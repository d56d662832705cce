"""Node groups: lamps that the shader itself samples, and those that a drawn direction meets (method.md, section 10).

From Blender 5.1 on a Raycast node says whether a point of a lamp is seen. The shader then shows what the lamp's light
gives as emission, on every sample, and need not wait for a mirror to meet the lamp.

Both groups have room for as many lamps as are ever aimed at, as `nodes.aimed_light_group` has, and are switched alike.
"""

from __future__ import annotations

import math
from dataclasses import fields
from typing import Any

import bpy

from ..bake.sampling.lamp_light import (
    SHORT,
    beam_factor,
    distance_along,
    facing_aim,
    opposite,
)
from ..bake.sampling.lamps import TEXELS, Aim, aim_at, density_towards, draw_towards, expected_light
from ..bake.source import LUMINANCE
from . import expr
from .aimed_light_group import MAX_SLOTS, SLOTS_KEY, WORLD_KEY, aim_by, made_before, which_light
from .group import FAMILY_KEY, active_output, call, node_group
from .light_images import texel

POINTS = 1
# Custom property of a group that samples lamps, which has to know their light, rather than aims at them.
SAMPLED_KEY = "measured_materials_sampled"
# Of a lamp's radiance: what may stand behind it, which its surroundings throw back.
_BEHIND = 0.01
# Of radiances: a lamp's over the sky's from which on less than a hundredth of its light is lost with what is behind.
_FAR_BRIGHTER = 100.0
_SWITCHED = "mute extension"
_AIM = {f.name: "float" if f.name in ("kind", "fourth", "m") else "vector" for f in fields(Aim)}
_SEEN = _AIM | {"Light": "float", "Radiance": "vector", "Beam": "vector", "Facing": "float"}
_MET = {"All": "vector", "Counted": "vector"}
_POINT = {"wi": "vector", "Density": "float", "Light": "vector"}
POINT_OUTPUTS = {f"{name} {j}": kind for j in range(1, POINTS + 1) for name, kind in _POINT.items()}


def can_raycast() -> bool:
    """Whether this Blender's shaders can ask what a ray meets."""
    return hasattr(bpy.types, "ShaderNodeRaycast")


def lamp_points_group(lamps: bpy.types.Image, lights: bpy.types.Image) -> bpy.types.ShaderNodeTree:
    """(Position, Normal, three random numbers) to `POINTS` points of one lamp, the second opposite of the first.

    Of each the direction, the density of having drawn it, by the lamp's share of the light too, and the radiance that
    comes from there, 0 where something stands between.

    Parameters
    ----------
    lamps : the table of `bake.sampling.lamps.lamp_table`
    lights : that of `bake.sampling.lamp_light.lamp_light_table`
    """
    seen_group, point_group = _seen_group(lamps, lights), _point_group()

    def results(slots: int, position: Any, normal: Any, *numbers: Any) -> tuple[Any, ...]:
        u_lamp, u1, u2 = numbers
        seen = [call(seen_group, float(k), position, normal) for k in range(slots)]
        light = [found[len(_AIM)] for found in seen]
        target, share = seen[0], 1.0
        if slots > 1:
            total = sum(light[1:], start=light[0])
            target = call(seen_group, which_light(u_lamp * total, light), position, normal)
            share = expr.divide(target[len(_AIM)], total)
        points: list[Any] = []
        for j in range(POINTS):
            wi, density, radiance = call(point_group, *target, position, *opposite(expr, target[0], j, u1, u2))
            points += [wi, density * share, radiance]
        return tuple(points)

    inputs = {
        "Position": "vector",
        "Normal": "vector",
        "Random Lamp": "float",
        "Random 1": "float",
        "Random 2": "float",
    }
    nothing = expr.vec(0.0, 0.0, 1.0), 1.0, expr.vec(0.0, 0.0, 0.0)
    return _switched_group("MM Lamp Points", inputs, POINT_OUTPUTS, results, nothing * POINTS, lamps, lights)


def lamp_met_group(lamps: bpy.types.Image, lights: bpy.types.Image) -> bpy.types.ShaderNodeTree:
    """(Position, Normal, wi, density of the sampler for wi) to the lamps' light along wi, and what of it is counted.

    Counted is the part that `lamp_points_group` gives by the balance heuristic; both are 0 where wi meets no lamp, or
    something stands between. Behind is about the radiance of what is seen past the lamp, or 0 where a ray that is sent
    there may end before it arrives. Together is 1 where it should be sent even so, beside the closures.
    """
    seen_group, met_group = _seen_group(lamps, lights), _met_group()

    def results(slots: int, position: Any, normal: Any, wi: Any, density: Any) -> tuple[Any, ...]:
        seen = [call(seen_group, float(k), position, normal) for k in range(slots)]
        light = [found[len(_AIM)] for found in seen]
        total = sum(light[1:], start=light[0])
        every: Any = None
        counted: Any = None
        for found, own in zip(seen, light):
            part, shared = call(met_group, *found, position, wi, density, expr.divide(own, total))
            every, counted = (part, shared) if every is None else (every + part, counted + shared)
        sky, _, _ = expr.components(texel(lamps, 0.0, TEXELS - 1)[0])
        return every, counted, *_behind(every, sky)

    inputs = {"Position": "vector", "Normal": "vector", "wi": "vector", "Density": "float"}
    dark, outputs = expr.vec(0.0, 0.0, 0.0), _MET | {"Behind": "float", "Together": "float"}
    return _switched_group("MM Lamps Met", inputs, outputs, results, (dark, dark, 0.0, 0.0), lamps, lights)


def _behind(every: Any, sky: Any) -> tuple[Any, Any]:
    """Expected radiance behind a lamp, and whether its ray goes on beside the closures.

    Cycles ends paths at random once they have bounced or passed something transparent, and then what is taken off the
    mirror's ray no longer cancels what it brings: of a lamp that is not much brighter than the sky that is bearable.
    """
    path = expr.node("ShaderNodeLightPath", {}, {}).outputs
    certain = (expr.Scalar(path["Ray Depth"]) + expr.Scalar(path["Transparent Depth"])) < 0.5
    lamp, background = expr.dot(every, expr.vec(*LUMINANCE)), sky * (1 / math.pi)
    together = (lamp < background * _FAR_BRIGHTER) * (1 - certain)
    return (lamp * _BEHIND + background) * certain, together


def _switched_group(
    name: str,
    inputs: dict[str, str],
    outputs: dict[str, str],
    results: Any,
    nothing: tuple[Any, ...],
    lamps: bpy.types.Image,
    lights: bpy.types.Image,
) -> bpy.types.ShaderNodeTree:
    """A group of one Group Output for each number of lamps; the first, of none, gives `nothing`."""

    def build(*arguments: Any) -> tuple[Any, ...]:
        for slots in range(1, min(MAX_SLOTS, lamps.size[1]) + 1):
            made = expr.node("NodeGroupOutput", {}, dict(zip(outputs, results(slots, *arguments), strict=True)))
            made.is_active_output = False
            made[SLOTS_KEY], made[WORLD_KEY] = slots, False
            made.label = f"{slots} lamp{'s' * (slots > 1)}"
        return nothing

    family = f"{name} by {lamps.name_full} and {lights.name_full}"
    if (known := made_before(family)) is not None:
        return known
    group = node_group(name, inputs, outputs, build, switched=_SWITCHED)
    first = active_output(group)
    first[SLOTS_KEY], first[WORLD_KEY], first.label = 0, False, "No lamp"
    group[SAMPLED_KEY], group[FAMILY_KEY] = True, family
    aim_by(group, 0, False)
    return group


def _seen_group(lamps: bpy.types.Image, lights: bpy.types.Image) -> bpy.types.ShaderNodeTree:
    """(Row, Position, Normal) to what `Aim` holds of a lamp, about the irradiance it brings, and what it emits."""

    def build(row: Any, position: Any, normal: Any) -> tuple[Any, ...]:
        (centre, kind), (u, power), (v, _), (axis, fourth) = (texel(lamps, row, k) for k in range(4))
        (radiance, facing), (beam, _) = (texel(lights, row, k) for k in range(2))
        aim = facing_aim(expr, aim_at(expr, position, centre, kind, u, v, axis, fourth), facing)
        light = expected_light(expr, aim, normal, power)
        return *(getattr(aim, name) for name in _AIM), light, radiance, beam, facing

    inputs = {"Row": "float", "Position": "vector", "Normal": "vector"}
    return node_group("MM Lamp Seen", inputs, _SEEN, build, switched=_SWITCHED)


def _point_group() -> bpy.types.ShaderNodeTree:
    """(a lamp, Position, two numbers) to a direction, its density, and the radiance that arrives from there."""

    def build(*values: Any) -> tuple[Any, ...]:
        *lamp, _light, radiance, beam, facing, position, u1, u2 = values
        aim = Aim(*lamp)
        wi = draw_towards(expr, aim, u1, u2)
        density = density_towards(expr, aim, wi, 1.0)
        seen = _visible(aim, facing, position, wi, density > 0) * beam_factor(expr, aim.normal, beam, wi)
        return wi, density, expr.scale(radiance, seen)

    inputs = _SEEN | {"Position": "vector", "Random 1": "float", "Random 2": "float"}
    return node_group("MM Lamp Point", inputs, _POINT, build)


def _met_group() -> bpy.types.ShaderNodeTree:
    """(a lamp, Position, wi, density of the sampler, the lamp's share) to its light along wi, and what is counted."""

    def build(*values: Any) -> tuple[Any, ...]:
        *lamp, _light, radiance, beam, facing, position, wi, density, share = values
        aim = Aim(*lamp)
        towards = density_towards(expr, aim, wi, 0.0) * share * float(POINTS)
        seen = _visible(aim, facing, position, wi, towards > 0) * beam_factor(expr, aim.normal, beam, wi)
        every = expr.scale(radiance, seen)
        return every, expr.scale(every, expr.divide(towards, towards + density))

    inputs = _SEEN | {"Position": "vector", "wi": "vector", "Sampler": "float", "Share": "float"}
    return node_group("MM Lamp Met", inputs, _MET, build)


def _visible(aim: Aim, facing: Any, position: Any, wi: Any, wanted: Any) -> Any:
    """1 where `wanted` and nothing stands between; elsewhere no ray is traced."""
    length = distance_along(expr, aim, facing, wi) * SHORT
    made = expr.node("ShaderNodeRaycast", {}, {"Position": position, "Direction": wi, "Length": length * wanted})
    return wanted * (1 - expr.Scalar(made.outputs["Is Hit"]))
