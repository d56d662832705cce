"""Direct light on a sphere by quadrature: what a renderer must show, without a renderer and without our nodes.

A pinhole camera looks at the unit sphere about the origin, of which every ray knows position and normal exactly. Each
pixel is the mean over its square (Cycles' box filter of one pixel) of

    L_o = integral of f(wi, wo) max(n . wi, 0) L(wi) d omega,

in float64. Lamps are integrated over their own surface, worlds in polar coordinates about the mirror direction. The
nodes are a Fibonacci lattice, moved for every point of a pixel by a term of Roberts' R2 sequence: no two points err
alike, so that the mean over a tile converges where a lobe is narrower than the space between nodes. (Gauss-Legendre
nodes, the same for every point, were 2 % off on a metallic paint with a lobe of 0.01 under an ellipse of 0.4 rad.)

Radiance L of Blender's lamps of energy W, as `test_unbiased.py` finds it with a Diffuse BSDF:
    area     W / (pi A), A the area of rectangle or ellipse; shines to the side of its -z only
    point    W / (4 pi^2 r^2) on a disk of radius r that faces the point lit (with Soft Falloff, Blender's default), or
             on a sphere of that radius
    spot     that of a point, times smoothstep((cos t - cos h) / (b (1 - cos h))) at the angle t between the ray and the
             spot's axis, h half the spot size, b the blend
    sun      W / (pi sin^2(h)) within the angle h of its direction, h half its angle
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
Brdf = Callable[[Array, Array], Array]
"""(wi, wo), unit and local with z the normal, (..., 3), to 1/sr (..., 3); isotropic."""

_CHUNK = 1 << 18  # evaluations at a time


@dataclass(frozen=True)
class Points:
    """Where camera rays meet the sphere: its position, which is its normal, and wo, both (P, 3) and of length 1.

    `shift` (P, 2) in [0, 1) moves the nodes of a quadrature.
    """

    normal: Array
    wo: Array
    shift: Array

    @classmethod
    def of(cls, normal: Array, wo: Array) -> Points:
        """Each with a shift of its own (Roberts 2018, The unreasonable effectiveness of quasirandom sequences)."""
        steps = 1.3247179572447460 ** np.array([-1, -2])
        return cls(normal, wo, (np.arange(len(normal))[:, None] * steps) % 1)

    def part(self, start: int, stop: int) -> Points:
        """Those from `start` to before `stop`."""
        return Points(self.normal[start:stop], self.wo[start:stop], self.shift[start:stop])

    def lattice(self, nodes: int) -> Array:
        """(P, nodes, 2) in [0, 1); `nodes` is a Fibonacci number."""
        smaller, larger = 1, 1
        while larger < nodes:
            smaller, larger = larger, smaller + larger
        if larger != nodes:
            raise ValueError(f"{nodes} is no Fibonacci number")
        index = np.arange(nodes)
        plain = np.stack([index / nodes, index * smaller % nodes / nodes], -1)
        return (plain + self.shift[:, None]) % 1

    @property
    def cos_o(self) -> Array:
        """(P,)"""
        return np.sum(self.normal * self.wo, -1)


@dataclass(frozen=True)
class Camera:
    """A pinhole.

    Parameters
    ----------
    matrix : (4, 4) to world space; it looks along its -z with +y up, as Blender's does
    half_width : of the picture at distance 1: half the sensor over the focal length
    resolution : pixels along each edge of the square picture
    """

    matrix: Array
    half_width: float
    resolution: int

    def points(self, rows: Array, columns: Array) -> Points:
        """Of rays through pixel positions (P,), row 0 on top and 0.5 the first pixel's middle; NaN where they miss."""
        x, y = (self.half_width * (2 * p / self.resolution - 1) for p in (columns, rows))
        turn, eye = np.asarray(self.matrix)[:3, :3], np.asarray(self.matrix)[:3, 3]
        ray = _unit(np.stack([x, -y, -np.ones_like(x)], -1)) @ turn.T
        along = -ray @ eye
        with np.errstate(invalid="ignore"):
            distance = along - np.sqrt(along**2 - eye @ eye + 1)
        return Points.of(eye + distance[..., None] * ray, -ray)

    def mask(self, least_cosine: float) -> NDArray[np.bool_]:
        """(H, W) pixels of which every corner sees the sphere at a cos(theta_o) of at least this."""
        edges = np.arange(self.resolution + 1.0)
        corners = self.points(*(c.ravel() for c in np.meshgrid(edges, edges, indexing="ij")))
        seen = (corners.cos_o >= least_cosine).reshape(len(edges), -1)
        return seen[1:, 1:] & seen[1:, :-1] & seen[:-1, 1:] & seen[:-1, :-1]

    def pixel_points(self, mask: Array, grid: int) -> Points:
        """In the pixels of a mask, row by row: grid x grid points each, midpoints of equal squares."""
        rows, columns = (k[:, None, None] for k in np.nonzero(mask))
        part = (np.arange(grid) + 0.5) / grid
        rows, columns = np.broadcast_arrays(rows + part[:, None], columns + part)
        return self.points(rows.ravel(), columns.ravel())


class Light(Protocol):
    """A lamp or a world."""

    def arriving(self, points: Points) -> tuple[Array, Array]:
        """Directions (P, Q, 3) in world space, and radiance times solid angle (P, Q, 3) of each."""
        ...


def picture(brdf: Brdf, camera: Camera, mask: Array, lights: Sequence[Light], grid: int) -> Array:
    """Radiance (H, W, 3) float64 of the sphere's pixels in the mask, 0 elsewhere; grid x grid points to a pixel."""
    points = camera.pixel_points(mask, grid)
    total = sum(reflected(brdf, points, light) for light in lights)
    result = np.zeros((*mask.shape, 3))
    result[mask] = np.reshape(total, (-1, grid * grid, 3)).mean(1)
    return result


def reflected(brdf: Brdf, points: Points, light: Light) -> Array:
    """Radiance (P, 3) that leaves each point along its wo."""
    result = np.empty_like(points.normal)
    step = max(1, _CHUNK // light.arriving(points.part(0, 1))[0].shape[1])
    for start in range(0, len(result), step):
        part = points.part(start, start + step)
        world, arriving = light.arriving(part)
        # As columns of a matrix for each point: x towards the viewer, z the normal.
        frame = np.stack([*_frame(part), part.normal], -1)
        wi, wo = world @ frame, part.wo[:, None] @ frame
        value = brdf(wi, np.broadcast_to(wo, wi.shape))
        result[start : start + step] = np.sum(value * np.maximum(wi[..., 2:], 0) * arriving, 1)
    return result


@dataclass(frozen=True)
class AreaLamp:
    """Rectangle or ellipse that shines along -z of its matrix; `sizes` full edges or diameters, `watts` by channel."""

    matrix: Array
    sizes: tuple[float, float]
    watts: tuple[float, float, float]
    round: bool = False
    nodes: int = 34

    def arriving(self, points: Points) -> tuple[Array, Array]:
        u = points.lattice(self.nodes)
        area = self.sizes[0] * self.sizes[1] * (math.pi / 4 if self.round else 1)
        across = (0.5 * _disk(u) if self.round else u - 0.5) * self.sizes
        to_lamp = self.matrix[:3, 3] + across @ self.matrix[:3, :2].T - points.normal[:, None]
        distance = np.linalg.norm(to_lamp, axis=-1)
        wi = to_lamp / distance[..., None]
        facing = np.maximum(wi @ self.matrix[:3, 2], 0)
        solid = facing / distance**2 * (area / self.nodes)
        return wi, solid[..., None] * (np.array(self.watts) / (math.pi * area))


@dataclass(frozen=True)
class PointLamp:
    """A point lamp of some radius, or a spot where `spot` gives its full angle and blend; it shines along -z then."""

    matrix: Array
    radius: float
    watts: tuple[float, float, float]
    spot: tuple[float, float] | None = None
    soft: bool = True
    nodes: int = 34

    def arriving(self, points: Points) -> tuple[Array, Array]:
        u = points.lattice(self.nodes)
        to_centre = self.matrix[:3, 3] - points.normal
        distance = np.linalg.norm(to_centre, axis=-1)[:, None]
        axis = to_centre / distance
        if self.soft:
            first, second = _across(axis)
            sheet = self.radius * _disk(u)
            wi = _unit(to_centre[:, None] + sheet[..., :1] * first[:, None] + sheet[..., 1:] * second[:, None])
            # The disk's cosine and the longer way at its rim: cos^3 of the angle to its middle.
            solid = math.pi * (self.radius / distance) ** 2 * np.sum(wi * axis[:, None], -1) ** 3
        else:
            lean = 1 - np.sqrt(1 - (self.radius / distance) ** 2)
            wi, solid = _cone(axis, lean, u), 2 * math.pi * lean
        radiance = np.array(self.watts) / (4 * math.pi**2 * self.radius**2)
        return wi, (solid * self._falling_off(wi) / self.nodes)[..., None] * radiance

    def _falling_off(self, wi: Array) -> Array:
        if self.spot is None:
            return np.ones(wi.shape[:-1])
        edge = math.cos(self.spot[0] / 2)
        t = np.clip((wi @ self.matrix[:3, 2] - edge) / ((1 - edge) * self.spot[1]), 0, 1)
        return t * t * (3 - 2 * t)


@dataclass(frozen=True)
class Sun:
    """A sun of full angle `angle`, whose light comes from +z of its matrix; `irradiance` is its energy times colour."""

    matrix: Array
    angle: float
    irradiance: tuple[float, float, float]
    nodes: int = 34

    def arriving(self, points: Points) -> tuple[Array, Array]:
        lean = 2 * math.sin(self.angle / 4) ** 2
        axis = np.broadcast_to(self.matrix[:3, 2], points.normal.shape)
        wi = _cone(axis, np.full((len(axis), 1), lean), points.lattice(self.nodes))
        radiance = np.array(self.irradiance) / (math.pi * math.sin(self.angle / 2) ** 2)
        return wi, np.broadcast_to(2 * math.pi * lean / self.nodes * radiance, wi.shape)


@dataclass(frozen=True)
class World:
    """Light from everywhere: `radiance` maps unit directions (..., 3) to (..., 3).

    About the mirror direction r the angle gamma runs up to the horizon, which lies at tan(gamma) =
    -cos(theta_o) / (sin(theta_o) cos(psi)) on the meridian psi. Nodes gather at r, where highlights are: gamma follows
    the square of one coordinate. The integrand vanishes at both its ends, as a lattice likes it.
    """

    radiance: Callable[[Array], Array]
    nodes: int = 233

    def arriving(self, points: Points) -> tuple[Array, Array]:
        t, turn = np.moveaxis(points.lattice(self.nodes), -1, 0)
        psi = 2 * math.pi * turn
        cosine = points.cos_o[:, None]
        sine = np.sqrt(np.maximum(1 - cosine**2, 0))
        horizon = np.arctan2(cosine, -sine * np.cos(psi))
        gamma = horizon * t**2
        solid = np.sin(gamma) * horizon * 2 * t * (2 * math.pi / self.nodes)
        along, lift = np.cos(gamma), np.sin(gamma) * np.cos(psi)
        local = [cosine * lift - sine * along, np.sin(gamma) * np.sin(psi), cosine * along + sine * lift]
        wi = np.stack(local, -1) @ np.stack([*_frame(points), points.normal], 1)
        return wi, self.radiance(wi) * solid[..., None]


def environment(pixels: Array) -> Callable[[Array], Array]:
    """Radiance by direction of an equirectangular image (H, W, 3), row 0 at the zenith, as Cycles reads it.

    The middle of the picture lies at +x and azimuth falls from left to right. Texels are joined linearly, and the
    image repeats both ways: above the first row's middle it meets the last row.
    """
    height, width = pixels.shape[:2]

    def radiance(direction: Array) -> Array:
        column = (0.5 - np.arctan2(direction[..., 1], direction[..., 0]) / (2 * math.pi)) * width - 0.5
        row = np.arccos(np.clip(direction[..., 2], -1, 1)) / math.pi * height - 0.5
        left, top = np.floor(column).astype(int), np.floor(row).astype(int)
        s, t = (column - left)[..., None], (row - top)[..., None]
        tap = [[pixels[(top + j) % height, (left + i) % width] for i in (0, 1)] for j in (0, 1)]
        return (1 - t) * ((1 - s) * tap[0][0] + s * tap[0][1]) + t * ((1 - s) * tap[1][0] + s * tap[1][1])

    return radiance


def _disk(u: Array) -> Array:
    """Even in the unit square to even in the unit disk, (..., 2)."""
    angle = 2 * math.pi * u[..., 1:]
    return np.sqrt(u[..., :1]) * np.concatenate([np.cos(angle), np.sin(angle)], -1)


def _cone(axis: Array, lean: Array, u: Array) -> Array:
    """Directions (P, Q, 3), even in solid angle, about (P, 3) unit axes up to 1 - cos = lean (P, 1)."""
    part, angle = (lean * u[..., 0])[..., None], 2 * math.pi * u[..., 1:]
    first, second = _across(axis)
    across = np.cos(angle) * first[:, None] + np.sin(angle) * second[:, None]
    return (1 - part) * axis[:, None] + np.sqrt(part * (2 - part)) * across


def _frame(points: Points) -> tuple[Array, Array]:
    """Unit tangent towards the viewer, and the one that makes with it and the normal a right-handed frame."""
    tangent = points.wo - points.cos_o[:, None] * points.normal
    length = np.linalg.norm(tangent, axis=-1, keepdims=True)
    # Seen from straight above, any tangent will do.
    tangent = np.where(length > 1e-9, tangent / np.maximum(length, 1e-300), _across(points.normal)[0])
    return tangent, np.cross(points.normal, tangent)


def _across(axis: Array) -> tuple[Array, Array]:
    """Two unit vectors (P, 3) at right angles to the unit axes and to each other."""
    first = _unit(np.cross(axis, np.where(np.abs(axis[:, :1]) > 0.7, [0, 1, 0], [1, 0, 0])))
    return first, np.cross(axis, first)


def _unit(v: Array) -> Array:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)
