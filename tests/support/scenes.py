"""Small Cycles scenes, rendered under many seeds for `monte_carlo.compare`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix, Vector
from measured_materials.addon.rendering.renderer import set_unbiased
from measured_materials.addon.studio import studio, studio_meshes
from measured_materials.nodes import compat
from numpy.typing import NDArray

Array = NDArray[np.float32]


class TestScene:
    """A sphere in some light. Use it as a context manager, or call `remove`.

    Attributes
    ----------
    scene : the Blender scene, for tests that change it further
    sphere : its one object of interest
    """

    __test__ = False  # for pytest, which collects by name

    def __init__(self, scene: bpy.types.Scene, sphere: bpy.types.Object, bystanders: Iterable[Any] = ()) -> None:
        self.scene, self.sphere, self._bystanders = scene, sphere, list(bystanders)

    def show(self, material: bpy.types.Material) -> None:
        """Put another material on the sphere."""
        self.sphere.data.materials.clear()
        self.sphere.data.materials.append(material)

    def leave_terminator(self) -> None:
        """Have Cycles shade the sphere's shadow terminator without its geometric offset, which is a bias."""
        self.set_terminator(2, 0.0)

    def set_terminator(self, kind: int, value: float) -> None:
        """The sphere's Shadow Terminator, wherever this Blender keeps it: 1 for the shading's, 2 for the geometry's."""
        owner, *names = compat.shadow_terminator(self.sphere)
        setattr(owner, names[kind - 1], value)

    def render(self, samples: int = 64, seeds: int | Iterable[int] = 8) -> Array:
        """Linear pictures (K, H, W, 3) under the seeds given, or under 0 to K - 1."""
        self.scene.cycles.samples = samples
        pictures = []
        with self.kept():
            for seed in range(seeds) if isinstance(seeds, int) else seeds:
                self.scene.cycles.seed = seed
                pictures.append(studio.render_linear(self.scene))
        return np.stack(pictures)

    @contextmanager
    def kept(self) -> Iterator[None]:
        """Within, Cycles keeps the scene from picture to picture: the same pictures, bit for bit, in half the time.

        It follows settings and places; pixels of an image that change within it does not read again.
        """
        before = self.scene.render.use_persistent_data
        self.scene.render.use_persistent_data = True
        try:
            yield
        finally:
            self.scene.render.use_persistent_data = before

    def mask(self) -> NDArray[np.bool_]:
        """Pixels (H, W) that the sphere fills, those next to its edge left out."""
        cycles = self.scene.cycles
        film, samples, seed = self.scene.render.film_transparent, cycles.samples, cycles.seed
        self.scene.render.film_transparent, cycles.samples, cycles.seed = True, 16, 0
        shown = [obj for obj in self._bystanders if not obj.hide_render]
        for obj in shown:
            obj.hide_render = True
        try:
            inside = np.pad(studio.render_rgba(self.scene)[..., 3] == 1, 1)
        finally:
            self.scene.render.film_transparent, cycles.samples, cycles.seed = film, samples, seed
            for obj in shown:
                obj.hide_render = False
        # The pixel filter reaches into the neighbours, more rarely than a few samples show.
        height, width = inside.shape
        shifts = [inside[y : height - 2 + y, x : width - 2 + x] for y in range(3) for x in range(3)]
        return np.logical_and.reduce(shifts)

    def remove(self) -> None:
        studio.remove_studio(self.scene)

    def __enter__(self) -> TestScene:
        return self

    def __exit__(self, *exception: object) -> None:
        self.remove()


def furnace(material: bpy.types.Material, radiance: float = 1.0, resolution: int = 64) -> TestScene:
    """A sphere under constant white light from everywhere: a pixel shows radiance times the albedo seen there."""
    scene, sphere = _sphere_scene(material, resolution, segments=64)
    scene.world, background = compat.new_world("furnace")
    background.inputs["Color"].default_value = (1, 1, 1, 1)
    background.inputs["Strength"].default_value = radiance
    return TestScene(scene, sphere)


def lit_sphere(
    material: bpy.types.Material,
    segments: int = 64,
    *,
    lamp: bool = True,
    lamp_size: float = 1.0,
    ground: bool = True,
    resolution: int = 64,
) -> TestScene:
    """A smooth-shaded sphere under a sky that brightens upwards and an area lamp, on matte ground.

    Parameters
    ----------
    segments : around the sphere; 12 makes shading and true normals differ by up to 15 degrees
    lamp_size : edge in sphere radii; the power does not depend on it
    ground : lets light reach the sphere after a diffuse bounce
    """
    scene, sphere = _sphere_scene(material, resolution, segments)
    scene.world, background = compat.new_world("sky")
    tree = scene.world.node_tree
    direction = tree.nodes.new("ShaderNodeTexCoord").outputs["Generated"]
    height = tree.nodes.new("ShaderNodeSeparateXYZ")
    ramp = tree.nodes.new("ShaderNodeMapRange")
    ramp.inputs["From Min"].default_value = -1
    tree.links.new(direction, height.inputs[0])
    tree.links.new(height.outputs["Z"], ramp.inputs["Value"])
    tree.links.new(ramp.outputs["Result"], background.inputs["Strength"])
    background.inputs["Color"].default_value = (0.8, 0.9, 1.0, 1)
    # Cycles would tabulate 2 million directions of this smooth sky before every render.
    scene.world.cycles.sampling_method, scene.world.cycles.sample_map_resolution = "MANUAL", 64
    bystanders = []
    if lamp:
        light = bpy.data.lights.new("lamp", "AREA")
        light.energy, light.size = 100, lamp_size
        light.cycles.use_multiple_importance_sampling = True
        _add(scene, light, _look_at((2, -1.5, 3)))
    if ground:
        mesh = studio_meshes.backdrop_mesh(curved=False)
        mesh.materials.append(_owned(diffuse_material((0.5, 0.5, 0.5))))
        bystanders.append(_add(scene, mesh, Matrix.Translation((0, 0, -1))))
    return TestScene(scene, sphere, bystanders)


def diffuse_material(albedo: tuple[float, float, float] | float = (0.8, 0.5, 0.3)) -> bpy.types.Material:
    """Lambertian reflection."""
    return compat.shader_material("diffuse", "ShaderNodeBsdfDiffuse", {"Color": _rgba(albedo)})


def principled_material(**inputs: Any) -> bpy.types.Material:
    """Principled BSDF with inputs by name, underscores for spaces: `principled_material(Base_Color=(1, 0, 0))`."""
    values = {name.replace("_", " "): value for name, value in inputs.items()}
    if "Base Color" in values:
        values["Base Color"] = _rgba(values["Base Color"])
    return compat.shader_material("principled", "ShaderNodeBsdfPrincipled", values)


def _rgba(colour: tuple[float, float, float] | float) -> tuple[float, float, float, float]:
    red, green, blue = (colour,) * 3 if isinstance(colour, float | int) else colour
    return red, green, blue, 1.0


def _owned(material: bpy.types.Material) -> bpy.types.Material:
    material[studio.OWNED] = True
    return material


def _sphere_scene(
    material: bpy.types.Material, resolution: int, segments: int
) -> tuple[bpy.types.Scene, bpy.types.Object]:
    compat.ensure_cycles()
    scene = bpy.data.scenes.new("test")
    mesh = studio_meshes.sphere_mesh(segments, segments // 2)
    mesh.materials.append(material)
    sphere = _add(scene, mesh, Matrix.Identity(4))
    camera = bpy.data.cameras.new("camera")
    camera.lens = 50
    scene.camera = _add(scene, camera, _look_at((0, -3.6, 1.2)))
    scene.render.resolution_x = scene.render.resolution_y = resolution
    set_unbiased(scene, samples=64, seed=0)
    return scene, sphere


def _look_at(position: tuple[float, float, float]) -> Matrix:
    eye = Vector(position)
    return Matrix.Translation(eye) @ (-eye).to_track_quat("-Z", "Y").to_matrix().to_4x4()


def _add(scene: bpy.types.Scene, data: Any, matrix: Matrix) -> bpy.types.Object:
    obj = bpy.data.objects.new(data.name, data)
    obj.matrix_world = matrix
    scene.collection.objects.link(obj)
    return obj


def purge_groups() -> None:
    """Remove every node group that nothing uses."""
    while unused := [tree for tree in bpy.data.node_groups if not tree.users]:
        for tree in unused:
            bpy.data.node_groups.remove(tree)


def add_lamp(scene: TestScene, kind: str, place: tuple[float, float, float], **settings: Any) -> bpy.types.Object:
    """A lamp that looks at the origin and that mirrors meet."""
    data = bpy.data.lights.new(kind, kind)
    data.cycles.use_multiple_importance_sampling = True
    for name, value in settings.items():
        setattr(data, name, value)
    eye = Vector(place)
    obj = bpy.data.objects.new(kind, data)
    obj.matrix_world = Matrix.Translation(eye) @ (-eye).to_track_quat("-Z", "Y").to_matrix().to_4x4()
    scene.scene.collection.objects.link(obj)
    return obj
