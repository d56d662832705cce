"""Height fields and bundles of fibres as arrays, and their way into Blender meshes."""

from __future__ import annotations

from typing import NamedTuple

import bpy
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Surface(NamedTuple):
    """points (V, 3), quads (F, 4) of indices, colour (V, 3) linear, normals (V, 3) or None for Blender's own."""

    points: Array
    quads: NDArray[np.int64]
    colour: Array
    normals: Array | None = None


def height_field(height: Array, colour: Array) -> Surface:
    """The tile's surface over a periodic field of heights (side, side) and colours (side, side, 3) or (3,).

    Its normals know the neighbours, so that no seam shows.
    """
    side = len(height)
    u, v = np.meshgrid(np.linspace(0, 1, side + 1), np.linspace(0, 1, side + 1))
    wrap = np.arange(side + 1) % side
    slope_u = (np.roll(height, -1, 1) - np.roll(height, 1, 1)) * side / 2
    slope_v = (np.roll(height, -1, 0) - np.roll(height, 1, 0)) * side / 2
    normals = np.stack([-slope_u, -slope_v, np.ones_like(height)], -1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    colour = np.broadcast_to(colour, (side, side, 3))
    closed = [field[wrap][:, wrap] for field in (height, colour, normals)]
    points = np.stack([u, v, closed[0]], -1)
    index = np.arange((side + 1) ** 2).reshape(side + 1, side + 1)
    return Surface(points.reshape(-1, 3), _patches(index), closed[1].reshape(-1, 3), closed[2].reshape(-1, 3))


def backing(height: float, colour: tuple[float, float, float]) -> Surface:
    """A flat tile that nothing can be seen through."""
    return height_field(np.full((2, 2), height), np.array(colour))


def tubes(centres: Array, radii: Array, colour: Array, sides: int) -> Surface:
    """Open tubes along polylines.

    Parameters
    ----------
    centres : (N, M, 3)
    radii : broadcast to (N, M)
    colour : broadcast to (N, M, 3)
    """
    count, length, _ = centres.shape
    tangent = np.gradient(centres, axis=1)
    tangent /= np.linalg.norm(tangent, axis=-1, keepdims=True)
    first = np.cross(tangent, _transported(tangent))
    second = np.cross(tangent, first)
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = np.cos(angle)[:, None] * first[:, :, None] + np.sin(angle)[:, None] * second[:, :, None]
    radii = np.broadcast_to(radii, (count, length))
    points = centres[:, :, None] + radii[:, :, None, None] * ring
    colour = np.broadcast_to(np.broadcast_to(colour, (count, length, 3))[:, :, None], points.shape)
    index = np.arange(count * length * sides).reshape(count, length, sides)
    around = np.concatenate([index, index[:, :, :1]], axis=2)
    quads = np.concatenate([_patches(tube) for tube in around]) if count < 512 else _tube_quads(around)
    return Surface(points.reshape(-1, 3), quads, colour.reshape(-1, 3))


def join(*surfaces: Surface) -> Surface:
    """One surface of several, without normals of their own."""
    starts = np.cumsum([0, *(len(surface.points) for surface in surfaces)])
    return Surface(
        np.concatenate([surface.points for surface in surfaces]),
        np.concatenate([surface.quads + start for surface, start in zip(surfaces, starts)]),
        np.concatenate([surface.colour for surface in surfaces]),
    )


def visible_height(surface: Surface, side: int = 96) -> float:
    """Mean over the tile of the highest point above each place, the neighbours' overhang included."""
    place = np.floor(surface.points[:, :2] * side).astype(int) % side
    top = np.full(side * side, -np.inf)
    np.maximum.at(top, place[:, 1] * side + place[:, 0], surface.points[:, 2])
    return float(top[np.isfinite(top)].mean())


def add_object(
    scene: bpy.types.Scene, name: str, surface: Surface, material: bpy.types.Material, lower: float = 0.0
) -> bpy.types.Object:
    """Link a smooth-shaded mesh with UV map (u, v) and colour attribute "Col", lowered by `lower`."""
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(len(surface.points))
    mesh.vertices.foreach_set("co", (surface.points - (0, 0, lower)).astype(np.float32).ravel())
    mesh.loops.add(surface.quads.size)
    mesh.loops.foreach_set("vertex_index", surface.quads.astype(np.int32).ravel())
    mesh.polygons.add(len(surface.quads))
    mesh.polygons.foreach_set("loop_start", np.arange(0, surface.quads.size, 4, dtype=np.int32))
    mesh.update(calc_edges=True)
    uv = mesh.uv_layers.new(name="UVMap")
    uv.data.foreach_set("uv", surface.points[surface.quads.ravel(), :2].astype(np.float32).ravel())
    colour = mesh.attributes.new("Col", "FLOAT_COLOR", "POINT")
    rgba = np.concatenate([surface.colour, np.ones((len(surface.colour), 1))], axis=1)
    colour.data.foreach_set("color", rgba.astype(np.float32).ravel())
    mesh.shade_smooth()
    if surface.normals is not None:
        mesh.normals_split_custom_set_from_vertices(surface.normals.tolist())
    mesh.materials.append(material)
    obj = bpy.data.objects.new(name, mesh)
    scene.collection.objects.link(obj)
    return obj


def _patches(index: NDArray[np.int64]) -> NDArray[np.int64]:
    """Quads (F, 4) between the points of a grid (M, N)."""
    return np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], -1).reshape(-1, 4)


def _tube_quads(around: NDArray[np.int64]) -> NDArray[np.int64]:
    low, high = around[:, :-1], around[:, 1:]
    return np.stack([low[..., :-1], low[..., 1:], high[..., 1:], high[..., :-1]], -1).reshape(-1, 4)


def _transported(tangent: Array) -> Array:
    """For each point of polylines (N, M, 3) a vector across, turned as little as possible from its predecessor."""
    across = np.empty_like(tangent)
    # Start from the axis that is furthest from the tangent.
    start = np.eye(3)[np.abs(tangent[:, 0]).argmin(axis=-1)]
    for step in range(tangent.shape[1]):
        here = tangent[:, step]
        start = start - (start * here).sum(-1, keepdims=True) * here
        start = start / np.linalg.norm(start, axis=-1, keepdims=True)
        across[:, step] = start
    return across
