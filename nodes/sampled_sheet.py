"""A side of a sheet whose shader samples lamps on both sides: closures, mirrors, emission (method.md, section 10)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from . import expr
from .adjustments import Adjustments
from .brdf_group import BrdfParts
from .drawn_direction import frame_of
from .group import call
from .lamp_light_groups import LightTables, light_point_group, light_side_group
from .native_closure import add_closures, choose_closure
from .sampled_closure import direct_light, draw_ahead, drawn_numbers, emission, met_light
from .stochastic_mirror_group import mirror_closure
from .table_groups import TableGroups
from .through_closure import is_bent, through_closure

# Neither of two mirrors is drawn more rarely than this, nor light from either side.
_LEAST = 0.1


@dataclass(frozen=True)
class _Mirror:
    """A part's residual as a mirror.

    Parameters
    ----------
    followed : about how often one is followed beside the closures, whichever it is
    drawn : how often this one is, of the two. By this and nothing else the balance heuristic has to count it, wherever
        it does, or what it leaves of a light's points and of what the mirror meets does not add up to 1. Whether it is
        followed does not matter: what it meets is shown on every sample that draws it
    number : even in [0, 1] where it is
    """

    table: TableGroups
    followed: Any
    drawn: Any
    number: Any


def sampled_sheet(
    reflected: BrdfParts | None,
    through: BrdfParts | None,
    reflected_share: float,
    normal: Any,
    adjustments: Adjustments,
    tables: LightTables,
) -> Any:
    """As `nodes.sampled_closure`, of what the surface reflects and what it lets through.

    Native closures of both are there on every sample. Of the two mirrors one is, and one point of light is sampled: it
    lies on either side of the sheet, and the table of that side alone is looked up. Light is chosen by the shares of an
    even one that the residuals are for this viewer, and the mirror by what the lights then bring on either side: a
    shade that a lamp stands behind is seen by what it lets through, however little of white light that is.

    Parameters
    ----------
    reflected, through : as far as there are any; one has a table
    reflected_share : of the light under a white sky
    tables : of a sheet
    """
    numbers = drawn_numbers()
    position, incoming, u, _, random = numbers
    parts = [(part, share) for part, share in ((reflected, reflected_share), (through, 1 - reflected_share)) if part]
    envelopes = [part.envelope for part, _ in parts if part.envelope is not None]
    frame = frame_of(normal, incoming, envelopes[0].tangent)
    native: list[Callable[[Any], Any]] = []
    residuals: list[tuple[TableGroups, Any]] = []
    for (part, share), envelope in zip(parts, envelopes, strict=True):
        weights = envelope.weights(frame[0])
        native.append(partial(envelope.closure, weights, normal, adjustments))
        if part.table is not None:
            residuals.append((part.table, weights[0][1] * share))
    front, followed = _shares(residuals)
    place = position, normal, front
    mirrors = _drawn(residuals, followed, place, u[5], tables)
    traced = [_mirrored(mirror, native, numbers, frame, place, adjustments, tables) for mirror in mirrors]
    world, density, light = call(light_point_group(tables), *place, *random)
    surface = expr.Vector(expr.node("ShaderNodeNewGeometry", {}, {}).outputs["True Normal"])
    side = expr.dot(world, normal)
    # What is above or below must be so of the surface proper too, as for the mirrors.
    point = world, density, light, side * expr.dot(world, surface) > 0
    shown = []
    for mirror in mirrors:
        direct, reached = direct_light(mirror.table, _up(mirror, normal), frame, point, u[4], mirror.drawn, adjustments)
        shown.append(emission(direct * adjustments.gain, reached))
    if len(mirrors) == 1:
        return add_closures([*traced, *shown])
    chosen = choose_closure(u[5] < mirrors[0].drawn, traced[1], traced[0])
    return add_closures([chosen, choose_closure(side > 0, shown[1], shown[0])])


def _shares(residuals: list[tuple[TableGroups, Any]]) -> tuple[Any, Any]:
    """Of the light that residuals are, the part that is reflected, and of all light that which they are."""
    if len(residuals) == 1:
        ((table, share),) = residuals
        return 0.0 if table.through else 1.0, share
    above, below = (share for _, share in residuals)
    front = expr.minimum(expr.maximum(expr.divide(above, above + below), _LEAST), 1 - _LEAST)
    return front, above + below


def _drawn(
    residuals: list[tuple[TableGroups, Any]],
    followed: Any,
    place: tuple[Any, Any, Any],
    number: Any,
    tables: LightTables,
) -> list[_Mirror]:
    """Their mirrors, of which one is drawn: by the light that is expected from either side.

    Parameters
    ----------
    number : random
    """
    if len(residuals) == 1:
        return [_Mirror(residuals[0][0], followed, 1.0, number)]
    (reflected, _), (through, _) = residuals
    side = call(light_side_group(tables, _LEAST), *place)
    # What the choice between the mirrors leaves of the number is even again.
    return [
        _Mirror(reflected, followed, side, expr.divide(number, side)),
        _Mirror(through, followed, 1 - side, expr.divide(number - side, 1 - side)),
    ]


def _up(mirror: _Mirror, normal: Any) -> Any:
    """To the side from which the mirror's light comes."""
    return expr.scale(normal, -1.0) if mirror.table.through else normal


def _mirrored(
    mirror: _Mirror,
    native: list[Callable[[Any], Any]],
    numbers: Any,
    frame: tuple[Any, Any, Any],
    place: tuple[Any, Any, Any],
    adjustments: Adjustments,
    tables: LightTables,
) -> Any:
    """One of the mirrors, the native closures beside it, and what is emitted of the light that the mirror meets."""
    (_, incoming, _, more, _), (_, normal, _) = numbers, place
    ahead = draw_ahead(mirror.table, _up(mirror, normal), frame, numbers, tables)
    weight = adjustments.apply(expr.scale(ahead.weight, expr.divide(1.0, mirror.drawn)))
    bent = is_bent(ahead.wi_world, incoming) if mirror.table.through else None
    drawing = mirror.followed, ahead.of_table * mirror.drawn, mirror.number
    met = met_light(tables, place, ahead.wi_world, drawing, ahead.aims, bent)
    lead = through_closure if mirror.table.through else mirror_closure
    return add_closures(
        [
            *(closure(met.of_closures) for closure in native),
            lead(ahead.wi_world, incoming, expr.scale(weight, met.of_mirror), more[2], ahead.aims),
            emission(weight * met.rest, met.meets),
        ]
    )
