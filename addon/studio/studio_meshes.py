"""Meshes of the built-in studio, made of formulas: smooth, finely tessellated, with clean texture coordinates."""

from __future__ import annotations

from collections.abc import Callable

import bpy
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

RESTING_HEIGHT = 1.075  # of the unit ball's centre, in the ring
UV_UNIT = 1.4  # ball radii along a unit of texture coordinates, on every shape but the backdrop
_FRONT = np.array([0.13, -0.97, 0.2]) / np.linalg.norm([0.13, -0.97, 0.2])  # where the camera of the studio stands
_GROOVE_COLATITUDE, _GROOVE_WIDTH, _GROOVE_DEPTH = 0.98, 0.10, 0.07  # radians, radians, ball radii


def sphere_mesh(segments: int = 256, rings: int = 128, *, grooved: bool = False) -> bpy.types.Mesh:
    """Unit sphere about the origin, on demand with a rounded groove along a circle of latitude.

    Texture coordinates are azimuthal about the side that the studio's camera sees: true along every great circle
    through its middle, without a pole or a seam until the far end.
    """
    colatitude = np.linspace(np.pi, 0, rings + 1)
    radius = np.ones_like(colatitude)
    if grooved:
        # An even power of a Lorentz curve: flat floor, soft lips, no kink that a mirror would betray.
        radius -= _GROOVE_DEPTH / (1 + ((colatitude - _GROOVE_COLATITUDE) / _GROOVE_WIDTH) ** 8)
    profile = np.stack([radius * np.sin(colatitude), radius * np.cos(colatitude)], axis=1)
    profile[[0, -1], 0] = 0
    return _lathe("ball", profile, segments, _azimuthal)


def ring_mesh(segments: int = 256, rings: int = 64) -> bpy.types.Mesh:
    """The ring the ball rests in: a torus with a flattened section, its foot at z = 0.

    Texture coordinates repeat 4 times around; their seams lie at the back and below.
    """
    angle = np.linspace(0, 2 * np.pi, rings + 1) - np.pi / 2
    section = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    section = np.sign(section) * np.abs(section) ** 0.75  # between a circle and a square
    profile = np.stack([0.70 + 0.20 * section[:, 0], 0.15 + 0.15 * section[:, 1]], axis=1)
    around = np.linspace(0, 1, rings + 1)[:, None] * _length(profile)

    def unrolled(points: Array) -> Array:
        u = np.linspace(0, 4, points.shape[1])
        return np.stack(np.broadcast_arrays(u, around / UV_UNIT), axis=-1)

    return _lathe("ring", profile, segments, unrolled)


def swatch_mesh(side: int = 160) -> bpy.types.Mesh:
    """A square of cloth, 1.4 by 1.4, laid in soft folds that die away towards one corner; lowest point near z = 0.

    Texture coordinates cover it once.
    """
    v, u = np.meshgrid(*[np.linspace(0, 1, side)] * 2, indexing="ij")
    fold = 0.5 + 0.5 * np.sin(2 * np.pi * (1.55 * u + 0.35 * v) + 0.6)
    height = 0.012 + 0.15 * fold * (0.35 + 0.65 * v)
    points = np.stack([UV_UNIT * (u - 0.5), UV_UNIT * (v - 0.5), height], axis=-1)
    return _grid("swatch", points, np.stack([u, v], axis=-1))


def backdrop_mesh(curved: bool = True) -> bpy.types.Mesh:
    """Matte ground, on demand rising behind in a wide quarter circle."""
    near, far, bend, half_width = -14.0, 5.5, 3.4, 16.0
    profile = [(near, 0.0), (far - bend, 0.0)]
    if curved:
        turn = np.linspace(0, np.pi / 2, 65)[1:]
        profile += [(far - bend + bend * np.sin(t), bend * (1 - np.cos(t))) for t in turn]
    else:
        profile[-1] = (-near, 0.0)
    y, z = np.array(profile).T
    x = np.array([-half_width, half_width])
    points = np.stack([np.broadcast_to(c, (len(y), 2)) for c in (x, y[:, None], z[:, None])], axis=-1)
    return _grid("backdrop", points, points[..., :2])


def _lathe(name: str, profile: Array, segments: int, mapping: Callable[[Array], Array]) -> bpy.types.Mesh:
    """Surface of revolution about z from a profile (N, 2) of radius and height, outside on its right.

    `mapping` gives texture coordinates (N, segments + 1, 2) of its points (N, segments + 1, 3), which start at +y.
    """
    angle = np.linspace(0, 2 * np.pi, segments + 1) + np.pi / 2
    radius, height = profile[:, :1], profile[:, 1:]
    points = np.stack(
        [radius * np.cos(angle), radius * np.sin(angle), np.broadcast_to(height, (len(profile), segments + 1))],
        axis=-1,
    )
    return _grid(name, points, mapping(points), weld=True)


def _azimuthal(points: Array) -> Array:
    """Azimuthal equidistant texture coordinates of points around the origin, upright as seen from the front."""
    right = np.cross([0, 0, 1], _FRONT)
    right /= np.linalg.norm(right)
    up = np.cross(_FRONT, right)
    directions = points / np.linalg.norm(points, axis=-1, keepdims=True)
    x, y, z = (directions @ axis for axis in (right, up, _FRONT))
    across = np.hypot(x, y)
    scale = np.arctan2(across, z) / np.maximum(across, 1e-9) / UV_UNIT
    return 0.5 + np.stack([x * scale, y * scale], axis=-1)


def _length(profile: Array) -> float:
    return float(np.linalg.norm(np.diff(profile, axis=0), axis=1).sum())


def _grid(name: str, points: Array, uv: Array, weld: bool = False) -> bpy.types.Mesh:
    """Smooth quads over points (M, N, 3) with uv (M, N, 2); `weld` joins what coincides, for smooth normals."""
    rows, columns, _ = points.shape
    index = np.arange(rows * columns).reshape(rows, columns)
    quads = np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], axis=-1).reshape(-1, 4)
    flat = points.reshape(-1, 3)
    if weld:
        _, first, inverse = np.unique(np.round(flat, 9) + 0.0, axis=0, return_index=True, return_inverse=True)
        flat, vertices = flat[first], inverse.reshape(-1)[quads]
    else:
        vertices = quads
    # A quad at a pole has two equal corners: drop one of them.
    distinct = vertices != np.roll(vertices, 1, axis=1)
    corners, loops, sides = quads[distinct], vertices[distinct], distinct.sum(axis=1)
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(len(flat))
    mesh.vertices.foreach_set("co", flat.astype(np.float32).ravel())
    mesh.loops.add(len(loops))
    mesh.loops.foreach_set("vertex_index", loops.astype(np.int32))
    mesh.polygons.add(len(sides))
    mesh.polygons.foreach_set("loop_start", (np.cumsum(sides) - sides).astype(np.int32))
    mesh.update(calc_edges=True)
    layer = mesh.uv_layers.new(name="UVMap")
    layer.data.foreach_set("uv", uv.reshape(-1, 2)[corners].astype(np.float32).ravel())
    mesh.shade_smooth()
    return mesh
