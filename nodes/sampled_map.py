"""A shading map whose shader samples the lamps: closure, mirror and emission together (method.md, section 11)."""

from __future__ import annotations

from typing import Any

from . import expr
from .adjustments import Adjustments
from .aimed_light_group import aimed_instead_group
from .drawn_direction import frame_of
from .group import call
from .lamp_light_groups import light_point_group
from .local_frame_group import to_world
from .map_lighting import Lighting, MapGroups, Place
from .native_closure import add_closures
from .sampled_closure import drawn_numbers, emission, met_light
from .stochastic_mirror_group import mirror_closure

# Share of draws that go to the mirror where there is nothing left of the residual, and to the closure where it is all.
MIN_CHOICE = 0.04


def sampled_map(groups: MapGroups, lighting: Lighting, normal: Any, adjustments: Adjustments, place: Place) -> Any:
    """As `nodes.sampled_closure`, of S(r) a_max in the place of f cos(theta_i); all of it without a native closure.

    S is taken at the level r of the one direction, as for the mirror: the light of all directions is the sum over S(r),
    whoever has drawn them.

    Parameters
    ----------
    lighting : with `lights`, tables of lamps and of what they emit
    """
    tables = lighting.lights
    assert tables is not None
    position, incoming, u, more, random = drawn_numbers()
    frame = frame_of(normal, incoming)
    wo, along, across = frame
    drawn, of_drawn = lighting.sample(wo, *u[:4])
    # What cannot be sampled now is aimed at instead, as another mirror does; else all of this is left out by Cycles.
    instead = aimed_instead_group(tables.lamps, tables.around is not None, tables.scripted)
    ahead = to_world(drawn, along, across, normal)
    wi_world, aimed, unaimed, aims = call(instead, position, normal, ahead, *more[:2], *u[:2], lighting.concentration)
    turned = expr.vec(*(expr.dot(wi_world, axis) for axis in (along, across, normal)))
    wi = expr.where_vector(aims, turned, drawn)
    # The heuristic against what is sampled takes the lobe's own density all the same: it may take any.
    of_lobe = expr.where(aims, lighting.density(wi, wo), of_drawn)
    parts = _at(groups, lighting, place, (wi, wi_world), wo, u[4])
    chance = _chance(lighting, parts.share)
    weight = expr.scale(parts.traced, expr.divide(lighting.a_max, aimed + unaimed * of_lobe))
    weight = adjustments.apply(weight)
    met = met_light(tables, (position, normal), wi_world, (chance, chance * of_lobe, u[5]), aims)
    closures = [mirror_closure(wi_world, incoming, expr.scale(weight, met.of_mirror), more[2], aims)]
    if lighting.exact:
        closures.insert(0, lighting.closure(parts, normal, adjustments, met.of_closures * lighting.native_sigma))
    closures.append(emission(weight * met.rest, met.meets))
    # One point of a lamp or the world.
    world, density, light = call(light_point_group(tables), position, normal, *random)
    local = expr.vec(*(expr.dot(world, axis) for axis in (along, across, normal)))
    surface = expr.Vector(expr.node("ShaderNodeNewGeometry", {}, {}).outputs["True Normal"])
    # As a mirror does, nothing reflects light that comes from below the surface proper.
    facing = (expr.dot(world, surface) > 0) * (expr.components(local)[2] > 0)
    shared = density + chance * lighting.density(local, wo)
    reflected = adjustments.saturated(_at(groups, lighting, place, (local, world), wo, u[4]).traced)
    direct = reflected * expr.scale(light, expr.divide(facing * lighting.a_max, shared))
    reached = expr.dot(light, expr.vec(1.0, 1.0, 1.0)) * facing > 0
    closures.append(emission(direct * adjustments.gain, reached))
    return add_closures(closures)


def _at(groups: MapGroups, lighting: Lighting, place: Place, light: tuple[Any, Any], wo: Any, random: Any) -> Any:
    """`Lighting.split` of one direction of light, local and in world space; nothing is reflected of what comes from
    below the horizon."""
    wi, wi_world = light
    cosine = expr.maximum(expr.components(wi)[2], 0.0)
    return lighting.split(groups, place, wo, wi_world, lighting.f_cos(wi, wo, cosine), cosine, random)


def _chance(lighting: Lighting, share: Any) -> Any:
    """About how often the mirror is followed beside the closure: the balance heuristic may take any number."""
    return share * (1 - 2 * MIN_CHOICE) + MIN_CHOICE if lighting.exact else 1.0
