"""The scene of the virtual gantry: a target that repeats all around one tile, a camera and a sun.

One tile of the target, [0, tile] x [0, tile] about height 0, fills the frame and repeats all around it, so that
neighbours shade and light the tile as they would on a large swatch. The only light is a sun whose irradiance
on a plane facing it is 1 W/m^2: a pixel is then f_r cos(theta_i) in 1/sr, interreflections included.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator, Sequence, Set
from typing import Any, Protocol

import bpy
import numpy as np
from mathutils import Matrix, Vector
from numpy.typing import NDArray

from ...bake.errors import BakeError
from ...nodes import compat
from ..rendering.renderer import set_unbiased
from ..studio import studio

SUN_ANGLE = math.radians(0.5)  # the sun's own diameter
MAX_SIZE = 8192
_MAX_COPIES = 16  # tiles beside the one in the middle, in each direction
_STEEPEST_LIGHT, _STEEPEST_VIEW = math.radians(89), math.radians(86)

Builder = Callable[[bpy.types.Scene], Sequence[bpy.types.Object]]


class HasBuild(Protocol):
    """Whatever builds its objects in a scene on demand, as a `swatches.Swatch` does."""

    def build(self, scene: bpy.types.Scene) -> Sequence[bpy.types.Object]:
        """Build the objects in the scene and return them."""
        ...


Target = bpy.types.Material | bpy.types.Object | bpy.types.Collection | Sequence[bpy.types.Object] | Builder | HasBuild


class Gantry:
    """Scene, camera and sun around a tiled target; made and taken away by `gantry_scene`."""

    def __init__(self, scene: bpy.types.Scene, tile: float) -> None:
        self.scene, self.tile = scene, tile
        self._source = bpy.data.collections.new("Gantry tile")
        self.copies = [self._instance((0, 0))]
        self._low = self._high = Vector((0, 0, 0))
        self._reached = 0

        sun = bpy.data.lights.new("Gantry sun", "SUN")
        sun.energy, sun.angle = 1.0, SUN_ANGLE
        sun.cycles.use_multiple_importance_sampling = True
        self._sun = self._link(sun)
        camera = bpy.data.cameras.new("Gantry camera")
        camera.type, camera.sensor_fit, camera.ortho_scale = "ORTHO", "HORIZONTAL", tile
        self._camera = scene.camera = self._link(camera)

    def load(self, objects: Sequence[bpy.types.Object]) -> None:
        """Hang the objects into the tile that is repeated. Raises BakeError."""
        for obj in objects:
            self._source.objects.link(obj)
        layer = self.scene.view_layers[0]
        layer.update()
        corners = [
            instance.matrix_world @ Vector(corner)
            for instance in layer.depsgraph.object_instances
            if instance.is_instance
            and instance.object.type in {"MESH", "CURVES", "CURVE", "SURFACE", "META", "FONT", "POINTCLOUD", "VOLUME"}
            for corner in instance.object.bound_box
        ]
        if not corners:
            raise BakeError("target", "holds nothing that can be photographed", "give objects with surfaces")
        points = np.array(corners)
        if not np.isfinite(points).all():
            raise BakeError("target", "holds points that are not finite", "fix its geometry")
        self._low, self._high = Vector(points.min(axis=0)), Vector(points.max(axis=0))

    @property
    def sun(self) -> bpy.types.Light:
        """Data of the sun that lights the target."""
        return self._sun.data

    @property
    def tile_objects(self) -> list[bpy.types.Object]:
        """Objects in the tile."""
        return list(self._source.objects)

    def set_light(self, theta: float, phi: float, *, behind: bool = False) -> None:
        """Turn the sun to stand at angle theta from the normal, at azimuth phi from +u (radians), maybe behind."""
        direction = _direction(theta, phi, _STEEPEST_LIGHT)
        if behind:
            direction.z = -direction.z
        self._sun.matrix_world = direction.to_track_quat("Z", "Y").to_matrix().to_4x4()
        height = self._high.z - self._low.z
        self._reach(self.tile + height * math.tan(theta))

    def set_view(self, theta: float, phi: float) -> None:
        """Look from there at the middle of the tile, with +v upwards in the picture as far as it can be."""
        towards = _direction(theta, phi, _STEEPEST_VIEW)
        up = (Vector((0, 1, 0)) - towards.y * towards).normalized()
        right = up.cross(towards)
        frame = Matrix((right, up, towards)).transposed().to_4x4()
        height = max(abs(self._high.z), abs(self._low.z))
        # The frame's diagonal on the ground, and what stands beside it and leans into it.
        self._reach(self.tile * 0.71 / math.cos(theta) + height * math.tan(theta))
        distance = 2 * (self._reached + 2) * self.tile + height + (self._high - self._low).length
        middle = Vector((self.tile / 2, self.tile / 2, 0))
        self._camera.matrix_world = Matrix.Translation(middle + distance * towards) @ frame
        self._camera.data.clip_start, self._camera.data.clip_end = 1e-3 * distance, 2 * distance

    def render(self, seed: int = 0, progress: Callable[[float], None] | None = None) -> NDArray[np.float32]:
        """The picture, (H, W, 3) linear, in 1/sr (f_r cos theta_i), row 0 on top."""
        self.scene.cycles.seed = seed
        return studio.render_linear(self.scene, progress=progress)

    def _reach(self, distance: float) -> None:
        """Have copies of the tile up to this distance; they only ever become more, so that frames agree."""
        outside = max(0.0, -self._low.x, -self._low.y, self._high.x - self.tile, self._high.y - self.tile)
        wanted = min(_MAX_COPIES, math.ceil((distance + outside) / self.tile))
        if wanted <= self._reached:
            return
        steps = range(-wanted, wanted + 1)
        new = [(i, j) for i in steps for j in steps if max(abs(i), abs(j)) > self._reached]
        self.copies += [self._instance(place) for place in new]
        self._reached = wanted

    def _instance(self, place: tuple[int, int]) -> bpy.types.Object:
        empty = self._link(None)
        empty.instance_type, empty.instance_collection = "COLLECTION", self._source
        empty.location = (place[0] * self.tile, place[1] * self.tile, 0)
        return empty

    def _link(self, data: Any) -> bpy.types.Object:
        obj = bpy.data.objects.new(data.name if data else "Gantry copy", data)
        self.scene.collection.objects.link(obj)
        return obj


@contextlib.contextmanager
def gantry_scene(
    target: Target, *, size: int = 512, tile: float = 1.0, samples: int = 64, sun_angle: float = SUN_ANGLE
) -> Iterator[Gantry]:
    """A fresh scene with the target under the gantry; it goes, with all that was made for it, after the block.

    Parameters
    ----------
    target : what lies in [0, tile]^2 and may be repeated with that period: a function or an object with
        `build`, which is given the scene and returns objects; objects; a collection; or a material, which is put
        onto a flat tile with UV 0 to 1. Objects and materials that exist already are left as they are.
    size : pixels of the square frame's edge
    sun_angle : diameter of the sun in radians; a stochastic mirror needs a larger one to find it

    Raises
    ------
    BakeError : nothing to photograph, or a size, tile, number of samples or angle without sense
    """
    _check(size, tile, samples, sun_angle)
    compat.ensure_cycles()
    before = _datablocks().keys()
    try:
        gantry = _set_up(target, size, tile, samples)
        gantry.sun.angle = sun_angle
    except BaseException:
        _remove(_datablocks().keys() - before)
        raise
    # What the block itself makes is its own.
    made = _datablocks().keys() - before
    try:
        yield gantry
    finally:
        # Only this frees the renderer with its copy of the geometry, which would outlive the scene.
        gantry.scene.render.use_persistent_data = False
        _remove(made | {copy.session_uid for copy in gantry.copies})


def _set_up(target: Target, size: int, tile: float, samples: int) -> Gantry:
    scene = bpy.data.scenes.new("Measured Materials Gantry")
    set_unbiased(scene, samples, 0)
    scene.cycles.pixel_filter_type = "BOX"  # a pixel is its own texel's average, nothing of its neighbours
    scene.render.use_persistent_data = True  # between frames only the sun moves
    scene.render.resolution_x = scene.render.resolution_y = size
    gantry = Gantry(scene, tile)
    gantry.load(_objects(target, scene, tile))
    return gantry


# --- target ---------------------------------------------------------------------------------------------


def _objects(target: Target, scene: bpy.types.Scene, tile: float) -> list[bpy.types.Object]:
    if isinstance(target, bpy.types.Material):
        return [_flat_tile(target, tile)]
    if isinstance(target, bpy.types.Object):
        return [target]
    if isinstance(target, bpy.types.Collection):
        return list(target.all_objects)
    build = getattr(target, "build", target)
    objects = list(build(scene)) if callable(build) else list(target)
    for obj in set(objects) & set(scene.collection.objects):
        scene.collection.objects.unlink(obj)  # it is seen through its copies
    return list(dict.fromkeys(objects))


def _flat_tile(material: bpy.types.Material, tile: float) -> bpy.types.Object:
    mesh = bpy.data.meshes.new("Flat tile")
    mesh.from_pydata([(0, 0, 0), (tile, 0, 0), (tile, tile, 0), (0, tile, 0)], [], [(0, 1, 2, 3)])
    layer = mesh.uv_layers.new(name="UVMap")
    layer.data.foreach_set("uv", np.array([0, 0, 1, 0, 1, 1, 0, 1], np.float32))
    mesh.materials.append(material)
    return bpy.data.objects.new("Flat tile", mesh)


def _datablocks() -> dict[int, bpy.types.ID]:
    """Every datablock of the file by the number it keeps for the session."""
    collections = [p.identifier for p in bpy.data.bl_rna.properties if p.type == "COLLECTION"]
    return {block.session_uid: block for name in collections for block in getattr(bpy.data, name)}


def _remove(uids: Set[int]) -> None:
    """Delete datablocks; Blender's own Render Result, which comes with the first render, stays."""
    made = [block for uid, block in _datablocks().items() if uid in uids]
    scenes = [block for block in made if isinstance(block, bpy.types.Scene)]
    others = [block for block in made if block not in scenes and getattr(block, "type", "") != "RENDER_RESULT"]
    for scene in scenes:
        bpy.data.scenes.remove(scene)
    bpy.data.batch_remove(others)


# --- checks ---------------------------------------------------------------------------------------------


def _direction(theta: float, phi: float, steepest: float) -> Vector:
    if not (0 <= theta <= steepest + 1e-9 and math.isfinite(phi)):  # NaN fails as well
        remedy = f"stay between 0 and {steepest:.3f} rad ({math.degrees(steepest):.0f} degrees) from the normal"
        raise BakeError("angle", f"(theta, phi) is ({theta}, {phi}) rad", remedy)
    return Vector((math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta)))


def _check(size: int, tile: float, samples: int, sun_angle: float) -> None:
    if not 1 <= size <= MAX_SIZE:
        raise BakeError("size", f"of {size} pixels", f"choose 1 to {MAX_SIZE}")
    if not 1e-4 <= tile <= 1e4:
        raise BakeError("tile", f"of {tile} units", "scale the target to a tile between 0.0001 and 10000")
    if not 1 <= samples <= 1 << 20:
        raise BakeError("samples", f"of {samples}", f"choose 1 to {1 << 20}")
    if not 0 <= sun_angle <= math.pi:
        raise BakeError("sun_angle", f"of {sun_angle} rad", "choose 0 to pi")
