"""Node groups: light that the shader itself samples, and that which a drawn direction meets (method.md, section 10).

A ray of the shader (`nodes.light_ray`) says whether a point of a lamp, or the world, is seen. The shader then shows
what its light gives as emission, on every sample, and need not wait for a mirror to meet it.

Both groups have room for as many lamps as are ever aimed at, as `nodes.aimed_light_group` has, and for the world where
it is one picture, and are switched alike.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import bpy

from ..bake.sampling.lamp_light import ENDLESS, SHORT, beam_factor, distance_along, facing_aim
from ..bake.sampling.lamps import (
    TEXELS,
    Aim,
    aim_at,
    density_towards,
    draw_towards,
    expected_light,
    expected_light_on_sheet,
)
from ..bake.sampling.world import expected_world_light, expected_world_light_on_sheet
from ..bake.source import LUMINANCE
from . import expr
from .aimed_light_group import (
    MAX_SLOTS,
    ON_SHEET,
    SLOTS_KEY,
    WORLD_KEY,
    aim_by,
    made_before,
    targets,
    which_light,
    world_density_group,
    world_draw_group,
)
from .group import FAMILY_KEY, active_output, call, node_group
from .light_images import texel, world_table
from .light_ray import light_ray
from .osl_script import SCRIPTED_KEY
from .world_picture import Surroundings, lit_group, radiance_group

# Custom property of a group that samples lamps, which has to know their light, rather than aims at them.
SAMPLED_KEY = "measured_materials_sampled"
# Of a lamp's radiance: what may stand behind it, which its surroundings throw back.
_BEHIND = 0.01
# Of radiances: a lamp's over the sky's from which on less than a hundredth of its light is lost with what is behind.
_FAR_BRIGHTER = 100.0
_SWITCHED = "mute extension"
_AIM = {f.name: "float" if f.name in ("kind", "fourth", "m") else "vector" for f in fields(Aim)}
_SEEN = _AIM | {"Light": "float", "Radiance": "vector", "Beam": "vector", "Facing": "float"}
_MET = {"All": "vector", "Towards": "float", "Distance": "float"}
_POINT = {"wi": "vector", "Density": "float", "Light": "vector", "Length": "float"}


@dataclass(frozen=True)
class LightTables:
    """The tables of `bake.sampling.lamps` and of `bake.sampling.lamp_light`, and the world's picture, if it is one.

    `scripted` where an OSL script asks what rays meet, in place of Cycles' Raycast node. `sheet` where light of both
    sides is sampled, for a sheet that lets it through: groups then take, as Front, the part of its light that comes
    from where the normal points.
    """

    lamps: bpy.types.Image
    lights: bpy.types.Image
    around: Surroundings | None = None
    scripted: bool = False
    sheet: bool = False

    @property
    def most_lamps(self) -> int:
        """That there is room to sample, or to aim at instead."""
        return ON_SHEET if self.sheet else MAX_SLOTS

    @property
    def place(self) -> dict[str, str]:
        """Inputs of groups that are lit."""
        return {"Position": "vector", "Normal": "vector"} | ({"Front": "float"} if self.sheet else {})


def light_point_group(tables: LightTables) -> bpy.types.ShaderNodeTree:
    """(place, three random numbers) to a direction towards a lamp's point or the world's bright parts.

    Its density, by the light's share of all of it too, and the radiance that comes from there, 0 where something stands
    between; below the horizon of the normal nobody asks.
    """

    def results(slots: int, world: bool, position: Any, *arguments: Any) -> tuple[Any, ...]:
        wi, density, radiance, length = call(chosen_group(tables, slots, world), position, *arguments)
        if not tables.sheet:  # from below the horizon nothing is reflected, whatever the ray would meet
            length = length * (expr.dot(wi, arguments[0]) > 0)
        return wi, density, expr.scale(radiance, light_ray(position, wi, length, tables.scripted)[0])

    inputs = tables.place | dict.fromkeys(("Random Light", "Random 1", "Random 2"), "float")
    outputs = {"wi": "vector", "Density": "float", "Light": "vector"}
    nothing = expr.vec(0.0, 0.0, 1.0), 1.0, expr.vec(0.0, 0.0, 0.0)
    return _switched_group("MM Light Point", inputs, outputs, results, lambda *_: nothing, tables)


def light_side_group(tables: LightTables, least: float) -> bpy.types.ShaderNodeTree:
    """(place of a sheet) to the part of the light that comes from where the normal points and is reflected, of all that
    the viewer gets.

    It is that of lamps, world and an even sky, as far as they are known, and lies between `least` and 1 - `least`:
    other light may come from anywhere. Where none is known it is Front.
    """

    def results(slots: int, world: bool, position: Any, normal: Any, front: Any) -> tuple[Any, ...]:
        sky, _, _ = expr.components(texel(tables.lamps, 0.0, TEXELS - 1)[0])
        above, total = sky * front, sky
        for k in range(slots):
            found = dict(zip(_SEEN, call(_seen_group(tables), float(k), position, normal, front)))
            above = found["Light"] * (expr.dot(found["axis"], normal) > 0) + above
            total = found["Light"] + total
        if world:
            known = call(lit_group(_around(tables).table))[0] > 0
            over = expected_world_light(expr, *texel(tables.lamps, 1.0, TEXELS - 1), normal)
            above = over * front * known + above
            total = call(_world_light_group(tables), normal, front) + total
        part = expr.where(total > 0, expr.divide(above, total), front)
        return (expr.minimum(expr.maximum(part, least), 1 - least),)

    return _switched_group("MM Light Side", tables.place, {"Reflected": "float"}, results, lambda *lit: lit[2:], tables)


def chosen_group(tables: LightTables, slots: int, world: bool) -> bpy.types.ShaderNodeTree:
    """As `light_point_group`, before anybody has asked whether the point is seen, and how far away it is.

    Here ends what needs no Raycast node.
    """
    seen_group, point_group = _seen_group(tables), _point_group()

    def build(position: Any, *arguments: Any) -> tuple[Any, ...]:
        lit, (u_light, u1, u2) = arguments[:-3], arguments[-3:]
        seen = [call(seen_group, float(k), position, *lit)[: len(_SEEN)] for k in range(slots)]
        light = [found[len(_AIM)] for found in seen]
        if world:
            light.append(call(_world_light_group(tables), *lit))
        if slots == 0:
            return *call(_world_point_group(tables), u1, u2, u_light, 1.0), ENDLESS
        target, share = seen[0], 1.0
        if len(light) == 1:
            return call(point_group, *target, position, u1, u2)
        total = sum(light[1:], start=light[0])
        number = u_light * total
        index = which_light(number, light)
        if slots > 1:
            target = call(seen_group, index, position, *lit)[: len(_SEEN)]
        found = call(point_group, *target, position, u1, u2)
        brought = target[len(_AIM)]
        if world:
            # What choosing leaves of the number chooses within the world too.
            of_world = call(_world_point_group(tables), u1, u2, number - sum(light[1:-1], start=light[0]), light[-1])
            far = index > slots - 0.5
            found = [expr.where(far, theirs, own) for theirs, own in zip((*of_world, ENDLESS), found, strict=True)]
            brought = expr.where(far, light[-1], brought)
        share = expr.divide(brought, total)
        return found[0], found[1] * share, *found[2:]

    inputs = tables.place | dict.fromkeys(("Light", "Random 1", "Random 2"), "float")
    return node_group(f"MM Point of {targets(slots, world)}", inputs, _POINT, build, switched=_SWITCHED)


def light_met_group(tables: LightTables) -> bpy.types.ShaderNodeTree:
    """(place, wi, density of the sampler for wi) to lamps' and world's light along wi, and what is counted.

    Counted is the part that `light_point_group` gives by the balance heuristic; both are 0 where wi meets no light, or
    something stands between. Behind is about the radiance of what is seen past the lamp, or 0 where a ray that is sent
    there may end before it arrives. Together is 1 where it should be sent even so, beside the closures. Of a sheet,
    Straight is the part of all light that a ray meets which goes on as what it is, as one of a Ray Portal does, and
    Bent that which one of transmission meets.
    """

    def results(slots: int, world: bool, position: Any, *arguments: Any) -> tuple[Any, ...]:
        lit, (wi, density) = arguments[:-2], arguments[-2:]
        seen = [call(_seen_group(tables), float(k), position, *lit) for k in range(slots)]
        rays = [found[len(_SEEN)] for found in seen] if tables.sheet else []
        seen = [found[: len(_SEEN)] for found in seen]
        light = [found[len(_AIM)] for found in seen]
        if world:
            light.append(call(_world_light_group(tables), *lit))
            rays.append(call(lit_group(_around(tables).table))[-1])
        total = sum(light[1:], start=light[0])
        clear: Any = None
        distance: Any = None
        if world:  # without one each lamp has a ray of its own
            clear, distance = light_ray(position, wi, ENDLESS, tables.scripted)
        leaves = _leaves(wi, lit[0] if tables.sheet else None) if world or tables.sheet else 1.0
        out: Any = 0.0
        every: list[Any] = []
        counted: list[Any] = []
        for found, own in zip(seen, light):
            radiance, towards, length = call(_met_group(), *found, position, wi)
            if world:
                # One ray for all: what it meets is behind the lamp.
                shown = expr.maximum(clear, distance > length)
            else:
                shown, _ = light_ray(position, wi, length, tables.scripted)
            every.append(expr.scale(radiance, shown * leaves if tables.sheet else shown))
            towards = towards * expr.divide(own, total)
            counted.append(expr.scale(every[-1], expr.divide(towards, towards + density)))
        if world:
            radiance = expr.scale(call(radiance_group(_around(tables)), wi), clear * leaves)
            towards = call(world_density_group(world_table()), wi) * expr.divide(light[-1], total)
            out = (expr.dot(radiance, expr.vec(1.0, 1.0, 1.0)) > 0) * 1.0
            every.append(radiance)
            counted.append(expr.scale(radiance, expr.divide(towards, towards + density)))
        whole = sum(every[1:], start=every[0])
        sky, _, _ = expr.components(texel(tables.lamps, 0.0, TEXELS - 1)[0])
        found = whole, sum(counted[1:], start=counted[0]), *_behind(whole, sky, out)
        if not tables.sheet:
            return found
        met = [[expr.scale(light, by) for by in _met_by(which)] for light, which in zip(every, rays, strict=True)]
        return *found, *(sum(lights[1:], start=lights[0]) for lights in zip(*met, strict=True))

    inputs = tables.place | {"wi": "vector", "Density": "float"}
    outputs = {"All": "vector", "Counted": "vector", "Behind": "float", "Together": "float"}
    dark = expr.vec(0.0, 0.0, 0.0)
    nothing: tuple[Any, ...] = (dark, dark, 0.0, 0.0)
    if tables.sheet:
        outputs, nothing = outputs | {"Straight": "vector", "Bent": "vector"}, (*nothing, dark, dark)
    return _switched_group("MM Light Met", inputs, outputs, results, lambda *_: nothing, tables)


def _leaves(wi: Any, normal: Any = None) -> Any:
    """Whether a direction is one in which a mirror reflects: none from below the surface proper, which a ray may pass.

    Of a sheet, whose normal is given, what is above or below must be so of the surface proper too: nothing else keeps
    rays of an open surface from a lamp.
    """
    facing = expr.dot(wi, expr.Vector(expr.node("ShaderNodeNewGeometry", {}, {}).outputs["True Normal"]))
    return (facing if normal is None else facing * expr.dot(wi, normal)) > 0


def _met_by(rays: Any) -> tuple[Any, Any]:
    """Whether a ray that is still what it was meets a light, and whether one of transmission does, by the number of
    `bake.sampling.lamp_light`."""
    path = expr.node("ShaderNodeLightPath", {}, {}).outputs
    transmission = rays > 3.5
    rays = rays - transmission * 4
    diffuse = rays > 1.5
    camera = rays - diffuse * 2
    # Rays from a Translucent BSDF are both.
    straight = expr.where(expr.Scalar(path["Is Diffuse Ray"]), diffuse, 1.0)
    straight = straight * expr.where(expr.Scalar(path["Is Transmission Ray"]), transmission, 1.0)
    return expr.where(expr.Scalar(path["Is Camera Ray"]), camera, straight), transmission


def _behind(every: Any, sky: Any, out: Any) -> tuple[Any, Any]:
    """Expected radiance behind a lamp, and whether its ray goes on beside the closures.

    Cycles ends paths at random once they have bounced or passed something transparent, and then what is taken off the
    mirror's ray no longer cancels what it brings: of a lamp that is not much brighter than the sky that is bearable.
    Where the ray leaves for a world whose light is known, out is 1, and nothing else is behind.
    """
    path = expr.node("ShaderNodeLightPath", {}, {}).outputs
    certain = (expr.Scalar(path["Ray Depth"]) + expr.Scalar(path["Transparent Depth"])) < 0.5
    lamp, background = expr.dot(every, expr.vec(*LUMINANCE)), sky * (1 / math.pi) * (1 - out)
    together = (lamp < background * _FAR_BRIGHTER) * (1 - certain)
    return (lamp * _BEHIND + background) * certain, together


def _switched_group(
    name: str,
    inputs: dict[str, str],
    outputs: dict[str, str],
    results: Any,
    nothing: Callable[..., tuple[Any, ...]],
    tables: LightTables,
) -> bpy.types.ShaderNodeTree:
    """A group of one Group Output for each number of lamps, without and with the world; the first gives `nothing`, of
    its inputs."""

    def build(*arguments: Any) -> tuple[Any, ...]:
        for slots in range(min(tables.most_lamps, tables.lamps.size[1]) + 1):
            for world in (False, True) if tables.around else (False,):
                if slots or world:
                    found = results(slots, world, *arguments)
                    made = expr.node("NodeGroupOutput", {}, dict(zip(outputs, found, strict=True)))
                    made.is_active_output = False
                    made[SLOTS_KEY], made[WORLD_KEY] = slots, world
                    made.label = targets(slots, world)
        return nothing(*arguments)

    family = f"{name} by {tables.lamps.name_full} and {tables.lights.name_full}"
    if (around := tables.around) is not None:
        family += f", {around.image.name_full} {around.interpolation} by {around.table.name_full}"
    if tables.scripted:
        family += ", rays by OSL"
    if tables.sheet:
        family += ", of both sides"
    if (known := made_before(family)) is not None:
        return known
    group = node_group(name, inputs, outputs, build, switched=_SWITCHED)
    first = active_output(group)
    first[SLOTS_KEY], first[WORLD_KEY], first.label = 0, False, "No lamp"
    group[SAMPLED_KEY], group[FAMILY_KEY] = True, family
    if tables.scripted:
        group[SCRIPTED_KEY] = True
    aim_by(group, 0, False)
    return group


def _seen_group(tables: LightTables) -> bpy.types.ShaderNodeTree:
    """(Row, Position, Normal) to what `Aim` holds of a lamp, about the irradiance it brings, and what it emits."""
    lamps, lights = tables.lamps, tables.lights

    def build(row: Any, position: Any, normal: Any, front: Any = None) -> tuple[Any, ...]:
        (centre, kind), (u, power), (v, _), (axis, fourth) = (texel(lamps, row, k) for k in range(4))
        (radiance, facing), (beam, rays) = (texel(lights, row, k) for k in range(2))
        aim = facing_aim(expr, aim_at(expr, position, centre, kind, u, v, axis, fourth), facing)
        known = (*(getattr(aim, name) for name in _AIM),)
        if front is None:
            return *known, expected_light(expr, aim, normal, power), radiance, beam, facing
        light = expected_light_on_sheet(expr, aim, normal, power, front)
        return *known, light, radiance, beam, facing, rays

    outputs = _SEEN | ({"Rays": "float"} if tables.sheet else {})
    return node_group("MM Lamp Seen", {"Row": "float"} | tables.place, outputs, build, switched=_SWITCHED)


def _point_group() -> bpy.types.ShaderNodeTree:
    """(a lamp, Position, two numbers) to a direction, its density, the radiance from there, and how far to look."""

    def build(*values: Any) -> tuple[Any, ...]:
        *lamp, _light, radiance, beam, facing, _position, u1, u2 = values
        aim = Aim(*lamp)
        wi = draw_towards(expr, aim, u1, u2)
        density = density_towards(expr, aim, wi, 1.0)
        shone = beam_factor(expr, aim.normal, beam, wi) * (density > 0)
        return wi, density, expr.scale(radiance, shone), _length(aim, facing, wi, shone > 0)

    inputs = _SEEN | {"Position": "vector", "Random 1": "float", "Random 2": "float"}
    return node_group("MM Lamp Point", inputs, _POINT, build)


def _met_group() -> bpy.types.ShaderNodeTree:
    """(a lamp, Position, wi) to its radiance along wi, the density of drawing wi towards it, and how far to look."""

    def build(*values: Any) -> tuple[Any, ...]:
        *lamp, _light, radiance, beam, facing, _position, wi = values
        aim = Aim(*lamp)
        towards = density_towards(expr, aim, wi, 0.0)
        shone = beam_factor(expr, aim.normal, beam, wi) * (towards > 0)
        return expr.scale(radiance, shone), towards, _length(aim, facing, wi, shone > 0)

    inputs = _SEEN | {"Position": "vector", "wi": "vector"}
    return node_group("MM Lamp Met", inputs, _MET, build)


def _world_light_group(tables: LightTables) -> bpy.types.ShaderNodeTree:
    """(Normal, and Front of a sheet) to about the irradiance of what stands out of the world; 0 where its light is not
    known exactly."""
    lit = lit_group(_around(tables).table)

    def build(*side: Any) -> Any:
        expected = expected_world_light_on_sheet if tables.sheet else expected_world_light
        return expected(expr, *texel(tables.lamps, 1.0, TEXELS - 1), *side) * (call(lit)[0] > 0)

    inputs = {name: kind for name, kind in tables.place.items() if name != "Position"}
    return node_group("MM World Light", inputs, {"Light": "float"}, build, switched=_SWITCHED)


def _world_point_group(tables: LightTables) -> bpy.types.ShaderNodeTree:
    """(two random numbers, a third and how far it reaches) to a direction, its density, and the radiance from there."""
    draw, density, radiance = (
        world_draw_group(world_table()),
        world_density_group(world_table()),
        radiance_group(_around(tables)),
    )

    def build(u1: Any, u2: Any, number: Any, most: Any) -> tuple[Any, ...]:
        wi = call(draw, u1, u2, number, most)
        return wi, call(density, wi), call(radiance, wi)

    inputs = dict.fromkeys(("Random 1", "Random 2", "Random Alias", "Share"), "float")
    outputs = {"wi": "vector", "Density": "float", "Light": "vector"}
    return node_group("MM World Point", inputs, outputs, build, switched=_SWITCHED)


def _around(tables: LightTables) -> Surroundings:
    assert tables.around is not None
    return tables.around


def _length(aim: Aim, facing: Any, wi: Any, wanted: Any) -> Any:
    """How far to look for what stands before a lamp; where it is not `wanted` 0, and no ray is traced."""
    return distance_along(expr, aim, facing, wi) * SHORT * wanted
