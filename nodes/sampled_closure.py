"""Mode Exact where the shader samples the lamps: closures, mirror and emission together (method.md, section 10)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from . import expr
from .adjustments import Adjustments
from .aimed_light_group import aimed_instead_group
from .drawn_direction import frame_of
from .gloss_group import lit_in_table, seen_above, seen_from_table
from .group import call
from .lamp_light_groups import LUMINANCE, LightTables, light_met_group, light_point_group
from .lens_group import lens_group
from .local_frame_group import to_world
from .native_closure import add_closures
from .stochastic_mirror_group import mirror_closure, more_random_numbers_group, random_numbers_group
from .table_groups import TableGroups
from .weighted_closures import WeightedClosures

_LEAST_FOLLOWED = 0.02


def sampled_closure(
    envelope: WeightedClosures, table: TableGroups, normal: Any, adjustments: Adjustments, tables: LightTables
) -> Any:
    """The envelope's closures, the residual's mirror and, of the lamps, the residual's light as emission.

    All are there on every sample: Cycles samples lamps for the closures, and follows one of closures and mirror by its
    weight. Where the mirror's direction meets a lamp, the lamp's light along it is emitted too, as far as the balance
    heuristic leaves it to the mirror. Its ray is then followed only now and then, for what is seen behind the lamp, and
    what it will bring of the lamp is taken off; there closures and mirror exclude each other, for the two to cancel.

    Parameters
    ----------
    table : of the residual, with its density
    """
    numbers = drawn_numbers()
    position, incoming, u, more, random = numbers
    frame = frame_of(normal, incoming, table.tangent)
    weights = envelope.weights(frame[0])
    # About how often the mirror is followed beside the closures: the balance heuristic may take any number.
    chance = weights[0][1]
    ahead = draw_ahead(table, normal, frame, numbers, tables)
    weight, aims = adjustments.apply(ahead.weight), ahead.aims
    drawing = chance, chance * ahead.of_table, u[5]
    met = met_light(tables, (position, normal), ahead.wi_world, drawing, aims)
    point = call(light_point_group(tables), position, normal, *random)
    surface = expr.Vector(expr.node("ShaderNodeNewGeometry", {}, {}).outputs["True Normal"])
    # As a mirror does, nothing reflects light that comes from below the surface proper.
    lit = expr.dot(point[0], surface) > 0
    direct, reached = direct_light(table, normal, frame, (*point, lit), u[4], chance, adjustments)
    return add_closures(
        [
            envelope.closure(weights, normal, adjustments, met.of_closures),
            mirror_closure(ahead.wi_world, incoming, expr.scale(weight, met.of_mirror), more[2], aims),
            emission(weight * met.rest, met.meets),
            emission(direct * adjustments.gain, reached),
        ]
    )


@dataclass(frozen=True)
class Ahead:
    """A direction in world space, f cos(theta_i) / pdf there, the table's own density of it, and 1 where it was aimed
    at what cannot be sampled."""

    wi_world: Any
    weight: Any
    of_table: Any
    aims: Any


def draw_ahead(table: TableGroups, up: Any, frame: tuple[Any, Any, Any], numbers: Any, tables: LightTables) -> Ahead:
    """Draw a direction by a table with its density; lights that cannot be sampled now are aimed at.

    Parameters
    ----------
    up : to the side of the surface from which the table's light comes
    frame : of `frame_of`
    numbers : of `drawn_numbers`
    """
    position, _, u, more, _ = numbers
    drawn, of_drawn = call(table.sampler, frame[0], *u[:4])
    seen, narrowed = (drawn, 1.0) if table.gloss is None else seen_from_table(drawn, frame[0], table.gloss)
    # What cannot be sampled now is aimed at instead, as another mirror does; else all of this is left out by Cycles.
    instead = aimed_instead_group(tables.lamps, tables.around is not None, tables.scripted, tables.most_lamps)
    ahead = to_world(seen, *frame[1:], up)
    wi_world, aimed, unaimed, aims = call(instead, position, up, ahead, *more[:2], *u[:2], table.concentration)
    turned = expr.vec(*(expr.dot(wi_world, axis) for axis in (*frame[1:], up)))
    stored, facing, spread = lit_in_table(turned, frame[0], table.gloss)
    wi = expr.where_vector(aims, stored, drawn)
    # The heuristic against what is sampled takes the table's own density all the same: it may take any.
    of_table = expr.where(aims, call(table.density, wi, frame[0]) * spread, of_drawn * narrowed)
    pdf = aimed + unaimed * of_table
    if table.gloss is None:
        facing = expr.maximum(expr.components(wi)[2], 0.0)
    else:
        straight = expr.maximum(expr.components(drawn)[2], 0.0) * narrowed * seen_above(seen, table.gloss)
        facing = expr.where(aims, facing, straight)
    weight = expr.scale(call(table.lookup, wi, frame[0], u[4]), expr.divide(facing, pdf))
    return Ahead(wi_world, weight, of_table, aims)


@dataclass(frozen=True)
class Met:
    """Factors of the mirror and of the closures, what is emitted of the mirror's weight, and 1 where anything is."""

    of_mirror: Any
    of_closures: Any
    rest: Any
    meets: Any


def drawn_numbers() -> tuple[Any, Any, tuple[Any, ...], tuple[Any, ...], tuple[Any, Any, Any]]:
    """Position, Incoming, six random numbers and three more, and the three that choose a light and a point of it."""
    geometry = expr.node("ShaderNodeNewGeometry", {}, {})
    incoming, position = (expr.Vector(geometry.outputs[name]) for name in ("Incoming", "Position"))
    u, more = call(random_numbers_group()), call(more_random_numbers_group())
    # The lens may place both: what the mirror and the lamps bring is added, and no product is made of the two.
    u, random = (*call(lens_group(), *u[:2]), *u[2:]), (more[0], *call(lens_group(), *more[1:]))
    return position, incoming, u, more, random


def met_light(
    tables: LightTables,
    place: tuple[Any, ...],
    wi_world: Any,
    drawing: tuple[Any, Any, Any],
    aims: Any,
    bent: Any = None,
) -> Met:
    """What becomes of a mirror whose direction may meet a light that is sampled too.

    Parameters
    ----------
    place : of the tables
    drawing : about how often the mirror is followed, the density of the direction as the balance heuristic counts it,
        and a random number
    aims : 1 where the direction was aimed at what cannot be sampled
    bent : of what leads through a sheet, 1 where its ray becomes one of transmission, else a Ray Portal's stays what it
        was; either may meet fewer lights
    """
    chance, counted_as, number = drawing
    found = call(light_met_group(tables), *place, wi_world, counted_as)
    every, counted, behind, together = found[:4]
    brought = every if bent is None else expr.where_vector(bent, found[5], found[4])
    lamp = expr.dot(brought, expr.vec(*LUMINANCE))
    followed = expr.maximum(expr.divide(behind, behind + lamp), _LEAST_FOLLOWED) * (behind > 0)
    # Of a mirror that is aimed the weight says nothing of its light: Cycles would hardly ever follow one at the sun.
    followed = expr.where(aims, chance, followed)
    mirrored, meets = number < followed, lamp > 0
    apart = expr.where(aims, 1.0, meets * (1 - together))
    of_mirror = expr.where(apart, expr.divide(mirrored, followed), 1.0)
    of_closures = expr.where(apart, expr.divide(1 - mirrored, 1 - followed), 1.0)
    if bent is None:
        return Met(of_mirror, of_closures, expr.scale(every, 1 - of_mirror) - counted, meets)
    rest = every - expr.scale(brought, of_mirror) - counted
    return Met(of_mirror, of_closures, rest, expr.dot(every, expr.vec(1.0, 1.0, 1.0)) > 0)


def direct_light(
    table: TableGroups,
    up: Any,
    frame: tuple[Any, Any, Any],
    point: tuple[Any, Any, Any, Any],
    u_slice: Any,
    chance: Any,
    adjustments: Adjustments,
) -> tuple[Any, Any]:
    """What the table, saturated, reflects of one point of a lamp or the world, and 1 where any of its light arrives.

    Parameters
    ----------
    up, frame : as of `draw_ahead`
    point : its direction in world space, density and light, and 1 where that may be reflected
    chance : how often a direction of the table counts as drawn
    """
    world, density, light, lit = point
    wo, along, across = frame
    local = expr.vec(*(expr.dot(world, axis) for axis in (along, across, up)))
    stored, facing, spread = lit_in_table(local, wo, table.gloss)
    facing = facing * lit
    shared = density + chance * call(table.density, stored, wo) * spread
    reflectance = adjustments.saturated(call(table.lookup, stored, wo, u_slice))
    direct = reflectance * expr.scale(light, expr.divide(facing, shared))
    return direct, expr.dot(light, expr.vec(1.0, 1.0, 1.0)) * facing > 0


def emission(colour: Any, shown: Any) -> Any:
    """Emission, whose nodes Cycles skips where `shown` is 0."""
    made = expr.node("ShaderNodeEmission", {}, {"Color": colour, "Strength": 1.0}).outputs[0]
    return expr.Scalar(expr.node("ShaderNodeMixShader", {}, {0: shown, 2: expr.Scalar(made)}).outputs[0])
