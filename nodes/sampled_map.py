"""A shading map whose shader samples the lamps: closure, mirror and emission together (method.md, section 11)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from . import expr
from .adjustments import Adjustments
from .aimed_light_group import aimed_instead_group
from .drawn_direction import frame_of
from .group import call
from .lamp_light_groups import LightTables, light_point_group, light_side_group
from .local_frame_group import to_world
from .map_lighting import Lighting, MapGroups, Parts, Place
from .native_closure import add_closures, choose_closure
from .sampled_closure import drawn_numbers, emission, met_light
from .stochastic_mirror_group import mirror_closure
from .through_closure import is_bent, through_closure

# Share of draws that go to the mirror where there is nothing left of the residual, and to the closure where it is all.
MIN_CHOICE = 0.04
# Neither of two mirrors is drawn more rarely than this, nor light from either side.
_LEAST = 0.1


@dataclass(frozen=True)
class MapSide:
    """What a swatch reflects, or what it lets through.

    Parameters
    ----------
    groups, lighting : of its map; with `Lighting.through` light comes from the far side
    """

    groups: MapGroups
    lighting: Lighting

    def up(self, normal: Any) -> Any:
        """To the side from which light comes."""
        return expr.scale(normal, -1.0) if self.lighting.through else normal

    def at(self, place: Place, light: tuple[Any, Any], wo: Any, random: Any) -> Parts:
        """`Lighting.split` of one direction of light, local and in world space; nothing is shown of what comes from
        below the horizon."""
        wi, wi_world = light
        cosine = expr.maximum(expr.components(wi)[2], 0.0)
        f_cos = self.lighting.f_cos(wi, wo, cosine)
        return self.lighting.split(self.groups, place, wo, wi_world, f_cos, cosine, random)

    def chance(self, parts: Parts) -> Any:
        """About how often the mirror is followed beside the closure: the balance heuristic may take any number."""
        return parts.share * (1 - 2 * MIN_CHOICE) + MIN_CHOICE if self.lighting.exact else 1.0


@dataclass(frozen=True)
class _Ahead:
    """A direction in world space, S a_max / pdf there and what else the map holds, the lobe's own density of it, and 1
    where it was aimed at what cannot be sampled."""

    wi_world: Any
    weight: Any
    parts: Parts
    of_lobe: Any
    aims: Any


def sampled_map(groups: MapGroups, lighting: Lighting, normal: Any, adjustments: Adjustments, place: Place) -> Any:
    """As `nodes.sampled_closure`, of S(r) a_max in the place of f cos(theta_i); all of it without a native closure.

    S is taken at the level r of the one direction, as for the mirror: the light of all directions is the sum over S(r),
    whoever has drawn them.

    Parameters
    ----------
    lighting : with `lights`, tables of lamps and of what they emit
    """
    tables = _tables(lighting)
    side, numbers = MapSide(groups, lighting), drawn_numbers()
    position, incoming, u, more, random = numbers
    frame = frame_of(normal, incoming)
    ahead = _draw_ahead(side, normal, frame, numbers, place, tables)
    chance = side.chance(ahead.parts)
    weight = adjustments.apply(ahead.weight)
    drawing = chance, chance * ahead.of_lobe, u[5]
    met = met_light(tables, (position, normal), ahead.wi_world, drawing, ahead.aims)
    closures = [mirror_closure(ahead.wi_world, incoming, expr.scale(weight, met.of_mirror), more[2], ahead.aims)]
    if lighting.exact:
        closures.insert(0, _native(side, ahead.parts, normal, adjustments, met.of_closures))
    closures.append(emission(weight * met.rest, met.meets))
    # One point of a lamp or the world.
    world, density, light = call(light_point_group(tables), position, normal, *random)
    # As a mirror does, nothing reflects light that comes from below the surface proper.
    point = world, density, light, expr.dot(world, _surface()) > 0
    closures.append(_direct(side, normal, frame, point, u[4], chance, adjustments, place))
    return add_closures(closures)


def sampled_swatch(
    reflected: MapSide, through: MapSide, reflected_share: float, normal: Any, adjustments: Adjustments, place: Place
) -> Any:
    """The same of a swatch that lets light through, as `nodes.sampled_sheet` does it: of the two mirrors one is drawn,
    by the light that is expected from either side, and one point of light is sampled, on either side.

    Parameters
    ----------
    reflected_share : of the light under a white sky
    """
    tables = _tables(reflected.lighting)
    sides, numbers = (reflected, through), drawn_numbers()
    position, incoming, u, more, random = numbers
    frame = frame_of(normal, incoming)
    front = min(max(reflected_share, _LEAST), 1 - _LEAST)
    lit = position, normal, front
    of_reflected = call(light_side_group(tables, _LEAST), *lit)
    aheads = [_draw_ahead(side, side.up(normal), frame, numbers, place, tables) for side in sides]
    chances = [side.chance(ahead.parts) for side, ahead in zip(sides, aheads, strict=True)]
    followed = chances[0] * front + chances[1] * (1 - front)
    # What the choice between the mirrors leaves of the number is even again.
    drawn = of_reflected, 1 - of_reflected
    left = expr.divide(u[5], drawn[0]), expr.divide(u[5] - drawn[0], drawn[1])
    traced = []
    for side, ahead, part, number in zip(sides, aheads, drawn, left, strict=True):
        weight = adjustments.apply(expr.scale(ahead.weight, expr.divide(1.0, part)))
        bent = is_bent(ahead.wi_world, incoming) if side.lighting.through else None
        met = met_light(tables, lit, ahead.wi_world, (followed, ahead.of_lobe * part, number), ahead.aims, bent)
        lead = through_closure if side.lighting.through else mirror_closure
        closures = [lead(ahead.wi_world, incoming, expr.scale(weight, met.of_mirror), more[2], ahead.aims)]
        for other, own in zip(sides, aheads, strict=True):
            if other.lighting.exact:
                closures.append(_native(other, own.parts, normal, adjustments, met.of_closures))
        traced.append(add_closures([*closures, emission(weight * met.rest, met.meets)]))
    world, density, light = call(light_point_group(tables), *lit, *random)
    above = expr.dot(world, normal)
    # What is above or below must be so of the surface proper too, as for the mirrors.
    point = world, density, light, above * expr.dot(world, _surface()) > 0
    shown = [
        _direct(side, side.up(normal), frame, point, u[4], part, adjustments, place)
        for side, part in zip(sides, drawn, strict=True)
    ]
    chosen = choose_closure(u[5] < drawn[0], traced[1], traced[0])
    return add_closures([chosen, choose_closure(above > 0, shown[1], shown[0])])


def _tables(lighting: Lighting) -> LightTables:
    assert lighting.lights is not None
    return lighting.lights


def _surface() -> Any:
    return expr.Vector(expr.node("ShaderNodeNewGeometry", {}, {}).outputs["True Normal"])


def _draw_ahead(
    side: MapSide, up: Any, frame: tuple[Any, Any, Any], numbers: Any, place: Place, tables: LightTables
) -> _Ahead:
    """Draw a direction by f_r with what the map holds there; lights that cannot be sampled now are aimed at."""
    position, _, u, more, _ = numbers
    wo, along, across = frame
    lighting = side.lighting
    drawn, of_drawn = lighting.sample(wo, *u[:4])
    # What cannot be sampled now is aimed at instead, as another mirror does; else all of this is left out by Cycles.
    instead = aimed_instead_group(tables.lamps, tables.around is not None, tables.scripted, tables.most_lamps)
    straight = to_world(drawn, along, across, up)
    wi_world, aimed, unaimed, aims = call(instead, position, up, straight, *more[:2], *u[:2], lighting.concentration)
    turned = expr.vec(*(expr.dot(wi_world, axis) for axis in (along, across, up)))
    wi = expr.where_vector(aims, turned, drawn)
    # The heuristic against what is sampled takes the lobe's own density all the same: it may take any.
    of_lobe = expr.where(aims, lighting.density(wi, wo), of_drawn)
    parts = side.at(place, (wi, wi_world), wo, u[4])
    weight = expr.scale(parts.traced, expr.divide(lighting.a_max, aimed + unaimed * of_lobe))
    return _Ahead(wi_world, weight, parts, of_lobe, aims)


def _native(side: MapSide, parts: Parts, normal: Any, adjustments: Adjustments, factor: Any) -> Any:
    """The closure under a map, by the factor of its weight."""
    return side.lighting.closure(parts, normal, adjustments, factor * side.lighting.native_sigma)


def _direct(
    side: MapSide,
    up: Any,
    frame: tuple[Any, Any, Any],
    point: tuple[Any, Any, Any, Any],
    u_slice: Any,
    chance: Any,
    adjustments: Adjustments,
    place: Place,
) -> Any:
    """Emission of what the map shows of one point of a lamp or the world.

    Parameters
    ----------
    point : its direction in world space, density and light, and 1 where that may be shown
    chance : how often a direction of the lobe counts as drawn
    """
    world, density, light, lit = point
    wo, along, across = frame
    local = expr.vec(*(expr.dot(world, axis) for axis in (along, across, up)))
    facing = lit * (expr.components(local)[2] > 0)
    shared = density + chance * side.lighting.density(local, wo)
    shown = adjustments.saturated(side.at(place, (local, world), wo, u_slice).traced)
    direct = shown * expr.scale(light, expr.divide(facing * side.lighting.a_max, shared))
    reached = expr.dot(light, expr.vec(1.0, 1.0, 1.0)) * facing > 0
    return emission(direct * adjustments.gain, reached)
