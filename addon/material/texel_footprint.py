"""How large a swatch's texels are in the camera's pixels."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import bpy
import numpy as np
from mathutils import Vector

from ..lights.motion import changes

_IGNORED = 0.002
_NOT_WORN = "no object of this scene wears it"
# What a mesh that is not one is asked for.
_KINDS = {"MESH", "CURVE", "SURFACE", "FONT", "META"}
_HIDING = frozenset({"hide_render", "hide_viewport"})


@dataclass(frozen=True)
class Footprint:
    """Pixels across the largest texel, or why that cannot be known: then `pixels` is infinite.

    Parameters
    ----------
    texels : of the largest, that a pixel is across at least at the end of a ray of length 1; 0 where pixels are no
        larger with distance, or where that cannot be known
    farthest : distance from the camera that no point of the material is beyond; infinite where the camera moves
    """

    pixels: float
    why_unknown: str = ""
    texels: float = field(default=0.0, kw_only=True)
    farthest: float = field(default=0.0, kw_only=True)


@dataclass(frozen=True)
class _Seen:
    """Of one object: extent of its largest texel in the world, and bounds of its distance from the camera."""

    name: str
    texel: float
    nearest: float
    farthest: float


@dataclass(frozen=True)
class Units:
    """How large the meshes that wear a material are seen, by which texels have grown as long as meshes stay.

    Parameters
    ----------
    pixels : by the mesh's full name, of the longest line in its bounding box; of no mesh that is hidden
    moves : why they may grow without an edit, or grew beyond any measure; empty where they do not
    """

    pixels: Mapping[str, float]
    moves: str = ""


class _UnknownError(Exception):
    """Why something cannot be known."""


def texel_footprint(
    material: bpy.types.Material, scene: bpy.types.Scene, texels: tuple[float, float] | None, *, hidden: bool = True
) -> Footprint:
    """The largest texel of a material in pixels of the scene's camera, at the point of its objects nearest to it.

    Parameters
    ----------
    texels : along u and v in a unit of the UV map; None where an artist has changed how it is mapped
    hidden : whether nothing can be known where objects are hidden that may be rendered
    """
    camera = scene.camera
    if texels is None:
        return _unknown("its texture coordinates are the artist's own")
    if not min(texels):
        return _unknown("its texture coordinates are scaled to nothing")
    if camera is None or camera.type != "CAMERA" or camera.data.type == "PANO":
        return _unknown("there is no camera with a flat picture")
    moves = _movement(camera)
    # Of a camera that only moves, a pixel at a given distance stays as large as it is.
    if moves and changes(camera.data):
        return _unknown(moves)
    if changes(scene):
        return _unknown("markers change the scene's camera")
    if changes(material.node_tree):
        return _unknown("its nodes are animated")
    if not material.users:
        return _unknown(_NOT_WORN)
    try:
        return _footprint(material, scene, texels, moves, hidden)
    except _UnknownError as error:
        return _unknown(str(error))


def units_seen(scene: bpy.types.Scene, materials: Collection[bpy.types.Material]) -> dict[bpy.types.Material, Units]:
    """How large what wears these materials is seen, without a look at its meshes and in one look at all instances.

    Of a camera with no flat picture nothing is seen.
    """
    camera = scene.camera
    if camera is None or camera.type != "CAMERA" or camera.data.type == "PANO":
        return {material: Units({}) for material in materials}
    common = _movement(camera)
    if not common and changes(scene):
        common = "markers change the scene's camera"
    moves = {m: common or ("its nodes are animated" if changes(m.node_tree) else "") for m in materials}
    sizes: dict[bpy.types.Material, dict[str, float]] = {material: {} for material in materials}
    still: dict[bpy.types.Object, bool] = {}
    for layer in [layer for layer in scene.view_layers if layer.use] or scene.view_layers[:1]:
        layer.update()
        graph, worn = layer.depsgraph, {}
        pixels_per_unit, perspective, _ = _projection(camera, scene, graph)
        eye = camera.evaluated_get(graph).matrix_world.translation
        for instance in graph.object_instances:
            obj = instance.object
            # Of one object, geometry nodes may show several meshes; of what is scattered most wears something else.
            key = obj.original, obj.data
            if key not in worn:
                worn[key] = [material for material in materials if _wears(obj, material)]
            if not worn[key]:
                continue
            for moved in (obj.original, *_instancers(instance)):
                if moved not in still:
                    still[moved] = not changes(moved)
                if not still[moved]:
                    moves |= {m: moves[m] or f"{moved.name} moves or changes its shape" for m in worn[key]}
            nearest, _ = _distances(obj, instance.matrix_world, eye)
            if perspective and nearest <= 0:
                moves |= {m: moves[m] or f"the camera is at {obj.original.name}" for m in worn[key]}
                continue
            longest = (Vector(obj.bound_box[6]) - Vector(obj.bound_box[0])).length
            longest *= float(np.linalg.norm(np.array(instance.matrix_world)[:3, :3], 2))
            size = longest * pixels_per_unit / (nearest if perspective else 1.0)
            name = (obj.original.data or obj.data).name_full
            for material in worn[key]:
                sizes[material][name] = max(size, sizes[material].get(name, 0.0))
    return {material: Units(sizes[material], moves[material]) for material in materials}


def texel_scale(scene: bpy.types.Scene, texels: tuple[float, float] | None) -> float:
    """Pixels, at a distance of 1, of a texel where the UV map's unit is one of the world; 0 where there is no telling.

    What of `texel_footprint` changes with the camera's lens, the picture's size and the swatch's, without a look at
    any mesh.
    """
    camera = scene.camera
    if texels is None or not min(texels) or camera is None or camera.type != "CAMERA" or camera.data.type != "PERSP":
        return 0.0
    pixels, _, aside = _projection(camera, scene, scene.view_layers[0].depsgraph)
    return pixels / (aside * min(texels))


def _footprint(
    material: bpy.types.Material, scene: bpy.types.Scene, texels: tuple[float, float], unknown: str, hidden: bool
) -> Footprint:
    """See `texel_footprint`; `unknown` is why the nearest cannot be known, if so. Raises _UnknownError."""
    pixels, by_distance, shown = 0.0, 0.0, set()
    # Of a camera that moves, where it will be is not asked.
    farthest = float("inf") if unknown else 0.0
    for layer in [layer for layer in scene.view_layers if layer.use] or scene.view_layers[:1]:
        layer.update()
        pixels_per_unit, perspective, aside = _projection(scene.camera, scene, layer.depsgraph)
        for seen in _seen_in(layer.depsgraph, material, scene, texels, shown):
            size = seen.texel * pixels_per_unit
            if perspective and seen.nearest <= 0:
                unknown = unknown or f"the camera is at {seen.name}"
            elif not unknown:
                pixels = max(pixels, size / (seen.nearest if perspective else 1.0))
            # At the end of a ray of this length, in whatever corner of the picture.
            by_distance, farthest = max(by_distance, size / aside * perspective), max(farthest, seen.farthest)
    for obj in scene.objects if hidden else ():
        if _wears(obj, material) and obj not in shown and (not obj.hide_render or changes(obj, _HIDING)):
            raise _UnknownError(f"{obj.name} is hidden here, but may be rendered")
    if not shown:
        raise _UnknownError(_NOT_WORN)
    if not (pixels or unknown):
        raise _UnknownError("what wears it is scaled to nothing")
    in_a_pixel = 1 / by_distance if by_distance else 0.0
    return Footprint(float("inf") if unknown else pixels, unknown, texels=in_a_pixel, farthest=farthest)


def _seen_in(
    graph: bpy.types.Depsgraph,
    material: bpy.types.Material,
    scene: bpy.types.Scene,
    texels: tuple[float, float],
    shown: set[bpy.types.Object],
) -> Iterator[_Seen]:
    """What wears the material in one view layer; these objects are added to `shown`. Raises _UnknownError."""
    eye = scene.camera.evaluated_get(graph).matrix_world.translation
    for instance in graph.object_instances:
        obj = instance.object
        if not _wears(obj, material):
            continue
        shown.add(obj.original)
        for moved in (obj.original, *_instancers(instance)):
            if changes(moved):
                raise _UnknownError(f"{moved.name} moves or changes its shape")
        size = _largest_texel(obj, np.array(instance.matrix_world)[:3, :3], texels)
        if size is None:
            raise _UnknownError(f"{obj.original.name} has no UV map")
        yield _Seen(obj.original.name, size, *_distances(obj, instance.matrix_world, eye))


def _movement(camera: bpy.types.Object) -> str:
    return "the camera moves or zooms" if changes(camera) else ""


def _unknown(why: str) -> Footprint:
    return Footprint(float("inf"), why)


def _wears(obj: bpy.types.Object, material: bpy.types.Material) -> bool:
    """Whether it has a surface that shows the material."""
    return obj.type in _KINDS and any(s.material and s.material.original == material for s in obj.material_slots)


def _instancers(instance: Any) -> list[bpy.types.Object]:
    """What an instance hangs on: the outermost instancer, which changes with all that it instances."""
    return [instance.parent.original] if instance.is_instance and instance.parent is not None else []


def _projection(camera: Any, scene: bpy.types.Scene, graph: Any) -> tuple[float, bool, float]:
    """Pixels per unit across, at depth 1 where the second is True; and the least squared cosine of a ray to the axis.

    A pixel of the corners is narrower than one in the middle: at the end of a ray of the same length by the cosine, as
    its depth is less, and towards the middle by the cosine once more.
    """
    render = scene.render
    # Less than the whole is for trying out; nothing is fitted anew when it is set back.
    share = max(render.resolution_percentage, 100) / 100
    matrix = camera.evaluated_get(graph).calc_matrix_camera(
        graph,
        x=render.resolution_x,
        y=render.resolution_y,
        scale_x=render.pixel_aspect_x,
        scale_y=render.pixel_aspect_y,
    )
    width, height = render.resolution_x * share, render.resolution_y * share
    corner = sum(((1 + abs(matrix[k][2])) / matrix[k][k]) ** 2 for k in (0, 1))
    return max(matrix[0][0] * width, matrix[1][1] * height) / 2, camera.data.type == "PERSP", 1 / (1 + corner)


def _distances(obj: Any, matrix: Any, eye: Vector) -> tuple[float, float]:
    """From the eye to the nearest and the farthest point of the bounding box, by bounds that are never too narrow."""
    corners = np.array([matrix @ Vector(corner) for corner in obj.bound_box])
    centre = corners.mean(0)
    middle = float(np.linalg.norm(np.array(eye) - centre))
    radius = float(np.linalg.norm(corners - centre, axis=1).max())
    return middle - radius, middle + radius


def _largest_texel(obj: Any, linear: np.ndarray, texels: tuple[float, float]) -> float | None:
    """Extent in the world of the texel that is stretched most; None without UVs."""
    triangles = uv_triangles(obj, linear)
    return None if triangles is None else _largest_stretch(triangles[0], triangles[1] * texels)


def uv_triangles(obj: Any, linear: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Corners in the world (n, 3, 3) and in the active UV map (n, 3, 2) of an object's triangles; None without UVs.

    Parameters
    ----------
    linear : (3, 3), from the object's axes to the world's
    """
    mesh = obj.to_mesh()
    try:
        layer = mesh.uv_layers.active if mesh is not None else None
        if layer is None or not len(mesh.polygons):
            return None
        mesh.calc_loop_triangles()
        count = len(mesh.loop_triangles)
        loops, vertices = np.empty(count * 3, np.int32), np.empty(count * 3, np.int32)
        mesh.loop_triangles.foreach_get("loops", loops)
        mesh.loop_triangles.foreach_get("vertices", vertices)
        places, uvs = np.empty(len(mesh.vertices) * 3), np.empty(len(mesh.loops) * 2)
        mesh.vertices.foreach_get("co", places)
        layer.uv.foreach_get("vector", uvs)
    finally:
        obj.to_mesh_clear()
    corners = places.reshape(-1, 3)[vertices].reshape(-1, 3, 3) @ linear.T
    return corners, uvs.reshape(-1, 2)[loops].reshape(-1, 3, 2)


def _largest_stretch(corners: np.ndarray, uv: np.ndarray) -> float | None:
    """Largest singular value of the maps from texels to the world, over triangles (n, 3, 3) and (n, 3, 2).

    Unwrapped meshes have a few triangles that are nearly a line in the UV map: the worst `_IGNORED` of the area is not
    asked.
    """
    edges, steps = corners[:, 1:] - corners[:, :1], uv[:, 1:] - uv[:, :1]
    determinant = steps[:, 0, 0] * steps[:, 1, 1] - steps[:, 0, 1] * steps[:, 1, 0]
    solid = np.abs(determinant) > 1e-12
    if not solid.any():
        return None
    # d position / d texel = edges^T inverse(steps)^T
    inverse = np.linalg.inv(steps[solid])
    jacobian = np.einsum("nkx,njk->nxj", edges[solid], inverse)
    stretch = np.linalg.norm(jacobian, 2, axis=(1, 2))
    areas = np.linalg.norm(np.cross(edges[solid, 0], edges[solid, 1]), axis=1)
    order = np.argsort(stretch)
    covered = np.cumsum(areas[order])
    return float(stretch[order][np.searchsorted(covered, (1 - _IGNORED) * covered[-1])])
