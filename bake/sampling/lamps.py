"""Directions towards the lamps of a scene, and the density of drawing them: for aimed sampling.

A sample is aimed at one lamp, chosen by how much light each is expected to bring to this point, or it is not aimed. Its
density is that of the whole mixture: of every lamp aimed at and of the material's own sampler. (With the drawn lamp's
density alone the other lamps are found by chance only, and shine as fireflies.)

A lamp is five RGBA texels, one row of the table:
    centre, kind          kinds: rectangle 0, ellipse 1, sphere 2, sun 3
    u, power              full edge or diameter; irradiance at distance 1, or of a sun
    v, -                  the same, across
    axis, extent          unit emission direction, 1 / area | -, radius | towards the sun, 1 - cos(half its angle)
    the scene's own       sky, largest share, lamps, strength | toward, flux, in the first two rows: irradiance of all
                          that is not aimed at, the most draws to aim, how many lamps there are, a part of the first's
                          irradiance at distance 1; light of the world's structure, as `expected_world_light` takes it
The centre of a sun lies `FAR` away, and its strength is meant for there: whoever asks only where the first lamp is, and
about how bright, need not ask for its kind.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import xp_numpy
from ..source import Array

RECTANGLE, ELLIPSE, SPHERE, SUN = range(4)
TEXELS = 5
FAR = 1e6
# Of a lamp's light, where it decides about the mirror's probability: few mirrors are left for other light, and each of
# them counts for so much more (tried: bronze under sun and sky is noisier with more).
_BESIDE = 0.05
# Part of an extended lamp stands higher, or faces more, than its middle.
_LEAST_COSINE = 0.05
# Of the largest share, how often a lamp is aimed at that is far wider than the sampler's lobes; and how many times as
# wide as these it is halfway to there (what both are worth: `./run bench softbox`).
_LEAST_AIMED, _LOBES_ACROSS = 0.5, 10.0


@dataclass(frozen=True)
class Lamp:
    """A lamp in world space.

    Parameters
    ----------
    kind : RECTANGLE, ELLIPSE, SPHERE or SUN
    centre : of the first three; not that of a sun
    u, v : edges or diameters of rectangle and ellipse, at right angles
    axis : unit vector; where an area lamp shines to, or towards the sun
    extent : radius of a sphere, full angle of a sun in radians
    power : irradiance that it gives face to face at distance 1, or anywhere if a sun
    """

    kind: int
    power: float
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    u: tuple[float, float, float] = (0.0, 0.0, 0.0)
    v: tuple[float, float, float] = (0.0, 0.0, 0.0)
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    extent: float = 0.0

    def place(self) -> tuple[float, float, float]:
        """Centre of the lamp, or where a sun may be taken to stand."""
        x, y, z = self.axis
        return (FAR * x, FAR * y, FAR * z) if self.kind == SUN else self.centre

    def fourth(self) -> float:
        """Last number of the lamp's texels: 1 / area, radius, or 1 - cos of half a sun's angle."""
        if self.kind == SUN:
            return 2 * math.sin(self.extent / 4) ** 2
        if self.kind == SPHERE:
            return self.extent
        area = float(np.linalg.norm(self.u) * np.linalg.norm(self.v))
        return 1 / (area * (math.pi / 4 if self.kind == ELLIPSE else 1))


def lamp_table(
    lamps: list[Lamp],
    rows: int,
    sky: float = 0.0,
    largest_share: float = 0.9,
    world: tuple[tuple[float, float, float], float] | None = None,
) -> Array:
    """Texels (rows, 5, 4) float32; rows without a lamp have no power and are never aimed at.

    Parameters
    ----------
    sky : irradiance of all light that is not aimed at, about; the more, the fewer draws are aimed
    largest_share : of draws to aim, below 1, so that everything else is found too
    world : `toward` and `flux` of the world's structure, if it is aimed at; needs a second row
    """
    table = np.zeros((rows, TEXELS, 4), np.float32)
    # Whatever formula meets an empty row stays finite.
    table[:, 0, :3], table[:, 0, 3], table[:, 3] = 1, SPHERE, (0, 0, 1, 0.01)
    for k, lamp in enumerate(lamps):
        table[k, 0] = (*lamp.place(), lamp.kind)
        table[k, 1] = (*lamp.u, lamp.power)
        table[k, 2, :3] = lamp.v
        table[k, 3] = (*lamp.axis, lamp.fourth())
    table[0, 4, :2] = sky, largest_share
    if lamps and world is None:
        table[0, 4, 2:] = len(lamps), _BESIDE * lamps[0].power * (FAR**2 if lamps[0].kind == SUN else 1)
    if world is not None:
        toward, flux = world
        table[1, 4] = (*(0.5 * c for c in toward), 0.25 * flux)
    return table


@dataclass(frozen=True)
class Aim:
    """A lamp as seen from a point: what drawing and density share.

    `to_centre` leads to its centre; `axis` and `m`, 1 - cos of the half angle, are of the cone of a sphere or sun; the
    others are the lamp's texels as scalars and vectors of `xp`.
    """

    kind: Any
    u: Any
    v: Any
    normal: Any
    fourth: Any
    to_centre: Any
    axis: Any
    m: Any


def aim_at(xp: Any, position: Any, centre: Any, kind: Any, u: Any, v: Any, normal: Any, fourth: Any) -> Aim:
    """Look at a lamp, whose four texels are given, from a position."""
    to_centre = centre - position
    distance2 = xp.dot(to_centre, to_centre)
    is_sun = kind > SUN - 0.5
    # From inside a sphere every direction meets it: m = 2.
    ratio = xp.divide(fourth * fourth, distance2)
    sphere_m = xp.where(ratio < 1.0, ratio / (1 + xp.sqrt(1 - ratio)), 2.0)
    m = xp.where(is_sun, fourth, sphere_m)
    axis = xp.where_vector(is_sun, normal, xp.normalize(to_centre))
    return Aim(kind, u, v, normal, fourth, to_centre, axis, m)


def draw_towards(xp: Any, aim: Aim, u1: Any, u2: Any) -> Any:
    """Unit direction to a point of the lamp, even in area (rectangle, ellipse) or solid angle (sphere, sun)."""
    angle = u2 * (2 * math.pi)
    cosine, sine = xp.cos(angle), xp.sin(angle)
    radius = xp.sqrt(u1) * 0.5
    is_ellipse = aim.kind > ELLIPSE - 0.5
    s = xp.where(is_ellipse, radius * cosine, u1 - 0.5)
    t = xp.where(is_ellipse, radius * sine, u2 - 0.5)
    to_point = aim.to_centre + xp.scale(aim.u, s) + xp.scale(aim.v, t)
    # A little inside the edge, where rounding decides whether the ray meets the lamp.
    lean = aim.m * u1 * 0.99999
    across = xp.sqrt(lean * (2 - lean))
    first, second = _tangents(xp, aim.axis)
    in_cone = xp.scale(aim.axis, 1 - lean) + xp.scale(first, across * cosine) + xp.scale(second, across * sine)
    return xp.where_vector(aim.kind > SPHERE - 0.5, in_cone, xp.normalize(to_point))


def density_towards(xp: Any, aim: Aim, wi: Any, drawn: Any) -> Any:
    """Density per solid angle with which `draw_towards` gives wi; 0 for one that misses the lamp.

    `drawn` is 1 where wi was drawn towards this lamp: then it meets it, whatever rounding says.
    """
    facing = xp.dot(aim.normal, wi)
    distance = xp.divide(xp.dot(aim.normal, aim.to_centre), facing)
    hit = xp.scale(wi, distance) - aim.to_centre
    s = xp.divide(xp.dot(hit, aim.u), xp.dot(aim.u, aim.u))
    t = xp.divide(xp.dot(hit, aim.v), xp.dot(aim.v, aim.v))
    is_ellipse = aim.kind > ELLIPSE - 0.5
    reach = xp.where(is_ellipse, xp.sqrt(s * s + t * t), xp.maximum(xp.maximum(s, -s), xp.maximum(t, -t)))
    # An area lamp shines to one side, so that wi must run against its emission.
    shone = (facing < 0) * (distance > 0)
    on_plane = xp.maximum(drawn, reach < 0.5) * shone
    planar = xp.divide(distance * distance * aim.fourth, xp.maximum(-facing, 1e-12)) * on_plane
    apart = wi - aim.axis
    in_cone = xp.maximum(drawn, xp.dot(apart, apart) < 2 * aim.m)
    cone = xp.divide(in_cone * (1 / (2 * math.pi)), aim.m)
    return xp.where(aim.kind > SPHERE - 0.5, cone, planar)


def expected_light(xp: Any, aim: Aim, surface_normal: Any, power: Any) -> Any:
    """About the irradiance that the lamp brings here; 0 only where none of it can reach the surface.

    It depends on the point alone, not on the sample: lamps, and whether to aim at all, may be chosen by it.
    """
    along = xp.dot(aim.to_centre, surface_normal)
    half_u, half_v = xp.dot(aim.u, surface_normal), xp.dot(aim.v, surface_normal)
    half = 0.5 * (xp.maximum(half_u, -half_u) + xp.maximum(half_v, -half_v))
    # A cone reaches above the horizon where its axis leans below it by less than its half angle.
    sine = xp.sqrt(xp.maximum(aim.m * (2 - aim.m), 0.0))
    leaning = xp.dot(aim.axis, surface_normal)
    reaches_cone = xp.maximum(leaning + sine > 0, aim.m > 1.0)
    reaches = xp.where(aim.kind > SPHERE - 0.5, reaches_cone, along + half > 0)
    return reaches * xp.maximum(leaning, _LEAST_COSINE) * _face_to_face(xp, aim, power)


def aimed_part(xp: Any, aim: Aim, concentration: Any) -> Any:
    """How often to aim at a lamp that much light comes from, as a part of the largest share.

    The wider the lamp beside the lobes of the material's own sampler, the more often these find it, and by the weights
    that are best where they are bright.

    Parameters
    ----------
    concentration : of the sampler, `bake.sampling.concentration`; 0 aims as often as may be
    """
    lobes = concentration * _solid_angle(xp, aim) * (1 / _LOBES_ACROSS)
    return _LEAST_AIMED + (1 - _LEAST_AIMED) / (1 + lobes)


def expected_light_on_sheet(xp: Any, aim: Aim, surface_normal: Any, power: Any, front: Any) -> Any:
    """The same of both sides of a sheet, of whose light the viewer gets the part `front` from where the normal points,
    and the rest through the sheet."""
    leaning = xp.dot(aim.axis, surface_normal)
    side = xp.where(leaning > 0, front, 1 - front)
    # Of a lamp that stands on both sides each is to be found.
    sides = xp.maximum(side, _LEAST_COSINE) * xp.maximum(xp.maximum(leaning, -leaning), _LEAST_COSINE)
    return sides * _face_to_face(xp, aim, power)


def _face_to_face(xp: Any, aim: Aim, power: Any) -> Any:
    """About the irradiance of a surface that faces the lamp."""
    distance2 = xp.dot(aim.to_centre, aim.to_centre)
    is_cone = aim.kind > SPHERE - 0.5
    shone = 0 - xp.dot(aim.normal, aim.to_centre)
    facing = xp.maximum(shone * xp.divide(1.0, xp.sqrt(distance2)), _LEAST_COSINE) * (shone > 0)
    near2 = xp.where(is_cone, aim.fourth * aim.fourth, xp.divide(0.25, aim.fourth))
    falloff = xp.where(aim.kind > SUN - 0.5, 1.0, 1 / xp.maximum(xp.maximum(distance2, near2), 1e-12))
    return xp.where(is_cone, 1.0, facing) * falloff * power


def _solid_angle(xp: Any, aim: Aim) -> Any:
    """Of the whole lamp, about; of an area lamp at most as near as its estimated light is."""
    distance2 = xp.dot(aim.to_centre, aim.to_centre)
    shone = xp.maximum(0 - xp.dot(aim.normal, aim.to_centre), 0.0)
    planar = xp.divide(shone * xp.divide(1.0, xp.sqrt(distance2)), xp.maximum(distance2 * aim.fourth, 0.25))
    return xp.where(aim.kind > SPHERE - 0.5, aim.m * (2 * math.pi), planar)


def _tangents(xp: Any, axis: Any) -> tuple[Any, Any]:
    x, _, _ = xp.components(axis)
    helper = xp.where_vector(x * x > 0.5, xp.vec(0.0, 1.0, 0.0), xp.vec(1.0, 0.0, 0.0))
    first = xp.normalize(xp.cross(axis, helper))
    return first, xp.cross(axis, first)


def aim_numpy(lamp: Array, position: Array) -> Aim:
    """`aim_at` for one row (5, 4) of the table and positions (..., 3)."""
    row = np.asarray(lamp, np.float64)
    shape = np.shape(position)[:-1]
    vectors = [np.broadcast_to(row[k, :3], (*shape, 3)) for k in range(4)]
    kind, fourth = (np.broadcast_to(row[k, 3], shape) for k in (0, 3))
    return aim_at(xp_numpy, position, vectors[0], kind, vectors[1], vectors[2], vectors[3], fourth)
