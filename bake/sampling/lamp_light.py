"""Exact light of a scene's lamps along a direction, for a shader that samples them itself.

`bake.sampling.lamps` needs only know about where a lamp is: a wrong guess there costs noise. Here its radiance, by
channel, enters the picture. A lamp is two RGBA texels more, in a table beside that of `lamps`:
    radiance, facing      along the lamp's axis, by channel; 1 of a disk that faces whoever looks at it, 0 of a sphere
    beam, rays            kind, where it ends, how steep it is; which rays meet it besides those of mirrors
Cycles takes a point or spot lamp with soft falloff for the disk.

The beam's factor, by the cosine c between the lamp's axis and the ray that leaves it (Cycles' `spot_light_attenuation`
and `area_light_spread_attenuation`):
    SPREAD, of an area lamp   max((tan h - tan(arccos c)) steepness, 0), h half the spread
    SPOT                      smoothstep((c - cos h) steepness), h half the cone
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..source import Array
from .lamps import ELLIPSE, SPHERE, SUN, Aim, Lamp

LIGHT_TEXELS = 2
EVEN, SPREAD, SPOT = range(3)
# Of the way to a lamp, so that what stands just behind it casts no shadow.
SHORT = 0.9999
ENDLESS = 1e30


@dataclass(frozen=True)
class LampLight:
    """What a lamp of `bake.sampling.lamps` emits.

    Parameters
    ----------
    radiance : along its axis, by channel
    facing : a sphere's stand-in, a disk that faces whoever looks at it
    beam : kind, end and steepness
    rays : 1 if the camera's meet it, 2 more if those from diffuse surfaces do, and 4 more if those of transmission do
    """

    radiance: tuple[float, float, float] = (0.0, 0.0, 0.0)
    facing: bool = False
    beam: tuple[float, float, float] = (float(EVEN), 0.0, 0.0)
    rays: int = 0


def spread_beam(spread: float) -> tuple[float, float, float]:
    """Beam of an area lamp of this full spread in radians; EVEN at the half circle."""
    half = spread / 2
    if half > math.pi / 2 - 1e-6:
        return float(EVEN), 0.0, 0.0
    return float(SPREAD), math.tan(half), 1 / (math.tan(half) - half)


def spot_beam(angle: float, blend: float) -> tuple[float, float, float]:
    """Beam of a spot lamp of this full cone in radians, soft over the part `blend` of it."""
    edge = math.cos(angle / 2)
    return float(SPOT), edge, 1 / max((1 - edge) * blend, 1e-6)


def radiance_of(lamp: Lamp) -> float:
    """Luminance along the axis of a lamp of this power, in Cycles' units of radiance."""
    if lamp.kind == SUN:
        return lamp.power / (math.pi * max(math.sin(lamp.extent / 2) ** 2, 1e-12))
    if lamp.kind == SPHERE:
        return lamp.power / (math.pi * max(lamp.extent**2, 1e-12))
    return lamp.power * lamp.fourth()


def lamp_light_table(lights: list[LampLight], rows: int) -> Array:
    """Texels (rows, 2, 4) float32, one lamp a row as in `lamps.lamp_table`; rows without a lamp are dark."""
    table = np.zeros((rows, LIGHT_TEXELS, 4), np.float32)
    for row, light in enumerate(lights):
        table[row, 0] = (*light.radiance, light.facing)
        table[row, 1] = (*light.beam, light.rays)
    return table


def facing_aim(xp: Any, aim: Aim, facing: Any) -> Aim:
    """The aim at a lamp with the cone of a disk that faces the point, where it is one: half angle atan(r / d).

    A sphere of the same radius fills asin(r / d).
    """
    square = aim.fourth * aim.fourth
    distance2 = xp.dot(aim.to_centre, aim.to_centre)
    ratio = xp.divide(square, distance2 + square)
    is_disk = facing * (aim.kind > SPHERE - 0.5) * (aim.kind < SUN - 0.5)
    return replace(aim, m=xp.where(is_disk, ratio / (1 + xp.sqrt(1 - ratio)), aim.m))


def distance_along(xp: Any, aim: Aim, facing: Any, wi: Any) -> Any:
    """Distance to the lamp of a direction that meets it; `ENDLESS` to a sun."""
    along = xp.dot(aim.to_centre, wi)
    square = xp.dot(aim.to_centre, aim.to_centre)
    inside = xp.maximum(aim.fourth * aim.fourth - square + along * along, 0.0)
    # From inside a ball the ray meets its far side.
    side = xp.where(square < aim.fourth * aim.fourth, 1.0, -1.0)
    sphere = xp.where(facing, xp.divide(square, along), along + side * xp.sqrt(inside))
    plane = xp.divide(xp.dot(aim.normal, aim.to_centre), xp.dot(aim.normal, wi))
    near = xp.where(aim.kind > SPHERE - 0.5, sphere, plane)
    return xp.where(aim.kind > SUN - 0.5, ENDLESS, near)


def beam_factor(xp: Any, axis: Any, beam: Any, wi: Any) -> Any:
    """What of the radiance along its axis the lamp sends against direction wi.

    Parameters
    ----------
    axis : of the lamp, unit vector
    beam : kind, end and steepness as a vector
    """
    kind, end, steepness = xp.components(beam)
    cosine = 0 - xp.dot(axis, wi)
    t = xp.minimum(xp.maximum((cosine - end) * steepness, 0.0), 1.0)
    tangent = xp.divide(xp.sqrt(xp.maximum(1 - cosine * cosine, 0.0)), xp.maximum(cosine, 1e-6))
    spread = xp.maximum((end - tangent) * steepness, 0.0)
    shaped = xp.where(kind > SPOT - 0.5, t * t * (3 - 2 * t), spread)
    return xp.where(kind > EVEN + 0.5, shaped, 1.0)


def opposite(xp: Any, kind: Any, j: int, u1: Any, u2: Any) -> tuple[Any, Any]:
    """The two numbers of a lamp's point j, 0 to 3: the second lies opposite of the first, the others beside them.

    What grows across a lamp, as the cosine to the surface does, then cancels in their mean (antithetic variates,
    Hammersley & Morton 1956).
    """
    if j == 0:
        return u1, u2
    is_round = kind > ELLIPSE - 0.5
    across = 1 - u1 if j in (1, 2) else u1
    along = 1 - u2 if j in (1, 3) else u2
    return xp.where(is_round, u1, across), xp.where(is_round, u2 + {1: 0.5, 2: 0.25, 3: 0.75}[j], along)
