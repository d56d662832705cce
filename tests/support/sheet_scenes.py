"""A sheet that lets light through in scenes whose light is known, and what it has to show there by quadrature."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix, Vector
from measured_materials.addon.lights.kept_surveys import surveyed
from measured_materials.addon.lights.light_tables import lamp_image, lamp_light_image, update_scene
from measured_materials.addon.lights.seen_world import surroundings_of
from measured_materials.addon.rendering.renderer import set_unbiased
from measured_materials.addon.studio import studio
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.bundle.result import BakeResult
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.source import Array
from measured_materials.bake.sources.analytic import ThinCloth
from measured_materials.nodes import compat
from measured_materials.nodes.material_tree import measured_nodes
from measured_materials.nodes.osl_material import build_osl_material
from measured_materials.nodes.osl_script import use_osl

from .monte_carlo import assert_same
from .scenes import TestScene

# Front and back differ, and so do the channels.
LINED = ThinCloth((0.3, 0.2, 0.1), (0.1, 0.2, 0.3), (0.2, 0.2, 0.1), (0.3, 0.3, 0.3), 8.0)
SETTINGS = BakeSettings(resolution=12, alpha=(0.5, 0.3), sampler=SamplerLayout(n_o=16, n_h=16, n_phi=8))
RESOLUTION, AZIMUTH = 16, 0.7
BELOW, TURNED = np.array([1.0, 1.0, -1.0]), np.array([1.0, -1.0, -1.0])
ACROSS = np.array([-1.0, -1.0, 1.0])
# Of light as dense as cos(theta) over the hemisphere.
NODES = 160
# Student's t of 23 degrees of freedom at a two-sided level of 1e-3.
T_OF_PARTS = 3.77
BEHIND, BEFORE = (1, 1, -3), (1, 1, 3)


class Glazed(ThinCloth):
    """A thin cloth whose reflection has a highlight too, so that both parts need a mirror."""

    def evaluate(self, wi: Array, wo: Array) -> Array:
        return super().evaluate(wi, wo) + 0.5 * self.transmitted(wi * BELOW, wo)

    def reflected_behind(self, wi: Array, wo: Array) -> Array:
        return super().reflected_behind(wi, wo) + 0.5 * self.transmitted(wi * BELOW, wo)


class Beaded(ThinCloth):
    """One that throws a little light back to where it came from, which no native closure carries: so little that the
    mirror of what it reflects is drawn beyond its share."""

    def evaluate(self, wi: Array, wo: Array) -> Array:
        return super().evaluate(wi, wo) + self.transmitted(-wi, wo) / 30

    def reflected_behind(self, wi: Array, wo: Array) -> Array:
        return super().reflected_behind(wi, wo) + self.transmitted(-wi, wo) / 30


class Shade(ThinCloth):
    """One that lets little light through, all but straight on, and reflects ten times as much, so that nearly all of
    white light that a viewer sees is reflected."""

    def evaluate(self, wi: Array, wo: Array) -> Array:
        return super().evaluate(wi, wo) + 10 * self.transmitted(wi * BELOW, wo)

    def reflected_behind(self, wi: Array, wo: Array) -> Array:
        return super().reflected_behind(wi, wo) + 10 * self.transmitted(wi * BELOW, wo)


class Prismatic(ThinCloth):
    """One whose light comes out on the viewer's side of the plane at right angles to him, where a Ray Portal leads."""

    def transmitted(self, wi: Array, wo: Array) -> Array:
        return super().transmitted(wi * ACROSS, wo)


PRISMATIC = Prismatic((0.2, 0.2, 0.2), None, (0.1, 0.1, 0.1), (0.5, 0.5, 0.5), 8.0)
GLAZED = Glazed((0.2, 0.1, 0.1), None, (0.1, 0.2, 0.1), (0.3, 0.3, 0.2), 8.0)
SHADE = Shade((0.1, 0.1, 0.1), None, (0.0, 0.0, 0.0), (0.03, 0.03, 0.03), 600.0)
BEADED = Beaded((0.03, 0.03, 0.03), None, (0.0, 0.0, 0.0), (0.9, 0.9, 0.9), 8.0)


def record_of(result: BakeResult) -> BrdfRecord:
    return BrdfRecord.read(read_bundle(result.path))


def sky(direction: Array) -> Array:
    """Different above and below, and on all sides."""
    return (0.6 + 0.4 * direction[..., 2:] + 0.2 * direction[..., :1]) * np.array([0.8, 0.9, 1.0])


def set_sky(scene: bpy.types.Scene) -> None:
    scene.world, background = compat.new_world("sky")
    tree = scene.world.node_tree
    slope, strength = tree.nodes.new("ShaderNodeVectorMath"), tree.nodes.new("ShaderNodeMath")
    slope.operation, slope.inputs[1].default_value = "DOT_PRODUCT", (0.2, 0, 0.4)
    tree.links.new(tree.nodes.new("ShaderNodeTexCoord").outputs["Generated"], slope.inputs[0])
    tree.links.new(slope.outputs["Value"], strength.inputs[0])
    strength.inputs[1].default_value = 0.6
    tree.links.new(strength.outputs[0], background.inputs["Strength"])
    background.inputs["Color"].default_value = (0.8, 0.9, 1, 1)
    scene.world.cycles.sampling_method, scene.world.cycles.sample_map_resolution = "MANUAL", 64


def spread(scene: TestScene) -> float:
    """Noise of a pixel of 64 samples, over the mean."""
    pictures = scene.render(64, 4).astype(float)
    found = math.sqrt(pictures.var(0, ddof=1).mean()) / float(pictures.mean())
    print(f"noise {found:.3g}")
    return found


def viewer(theta: float) -> Array:
    """Direction to a viewer at so many degrees from the front's normal; beyond 90 he sees the back."""
    t = math.radians(theta)
    return np.array([math.sin(t) * math.cos(AZIMUTH), math.sin(t) * math.sin(AZIMUTH), math.cos(t)])


@contextmanager
def sheet_scene(material: bpy.types.Material, theta: float) -> Iterator[TestScene]:
    """A large sheet in the plane z = 0, seen along one direction: all pixels show one radiance."""
    compat.ensure_cycles()
    scene = bpy.data.scenes.new("sheet")
    mesh = bpy.data.meshes.new("sheet")
    # Off the middle: a ray that starts on the diagonal of the two triangles may be held up by the other one.
    mesh.from_pydata([(-20, -20, 0), (21, -20, 0), (21, 20, 0), (-20, 20, 0)], [], [(0, 1, 2, 3)])
    layer = mesh.uv_layers.new()
    for loop, corner in zip(layer.data, [(0, 0), (1, 0), (1, 1), (0, 1)], strict=True):
        loop.uv = corner
    mesh.materials.append(material)
    plane = bpy.data.objects.new("sheet", mesh)
    scene.collection.objects.link(plane)
    camera = bpy.data.cameras.new("camera")
    camera.type, camera.ortho_scale = "ORTHO", 0.004  # so small that a lamp lights all of it alike
    scene.camera = bpy.data.objects.new("camera", camera)
    scene.collection.objects.link(scene.camera)
    eye = Vector(viewer(theta) * 5)
    scene.camera.matrix_world = Matrix.Translation(eye) @ (-eye).to_track_quat("-Z", "Y").to_matrix().to_4x4()
    scene.render.resolution_x = scene.render.resolution_y = RESOLUTION
    set_unbiased(scene, samples=64, seed=0)
    scene.world, background = compat.new_world("dark")
    background.inputs["Strength"].default_value = 0
    try:
        yield TestScene(scene, plane)
    finally:
        studio.remove_studio(scene)


def osl_that_samples(scene: TestScene, record: BrdfRecord, mode: str = "exact", points: int = 1) -> bpy.types.Material:
    """Put the sheet into the scene as OSL that samples what lights it now, so many points of each lamp."""
    use_osl(scene.scene)
    update_scene(scene.scene)
    around = surroundings_of(surveyed(scene.scene))
    tables = {"lamps": lamp_image(), "lights": lamp_light_image(), "surroundings": around}
    material = build_osl_material(record, mode=mode, points=points, **tables)
    scene.show(material)
    update_scene(scene.scene)
    return material


def adjust(material: bpy.types.Material, **values: Any) -> None:
    """Set inputs of the material's measured group."""
    (node,) = (node for _, node in measured_nodes(material.node_tree))
    for name, value in values.items():
        node.inputs[name].default_value = value


def upper_hemisphere() -> Array:
    """Directions (n, 3), each of the same projected solid angle pi / n."""
    u, v = ((np.arange(n) + 0.5) / n for n in (NODES, 2 * NODES))
    radius, phi = np.sqrt(u)[:, None], 2 * np.pi * v
    up = np.broadcast_to(np.sqrt(1 - u)[:, None], (len(u), len(v)))
    return np.stack([radius * np.cos(phi), radius * np.sin(phi), up], -1).reshape(-1, 3)


def shown(record: BrdfRecord | None, mode: str, wi: Array, wo: Array) -> Array:
    """What a part of the material has to show, of its own tables and closures."""
    if record is None:
        return np.zeros(wi.shape)
    if mode == "reference":
        return record.load_table().evaluate(wi, wo, "trilinear")
    if mode == "preview":
        return record.load_preview().evaluate(wi, wo)
    closures = record.load_envelope().evaluate(wi, wo)
    assert record.envelope is not None
    return closures if record.envelope.suffices else closures + record.load_table("residual").evaluate(wi, wo)


def seen(record: BrdfRecord, theta: float) -> tuple[BrdfRecord | None, BrdfRecord | None, Array]:
    """Reflection and transmission that such a viewer sees, and what turns directions into the frame of his side."""
    assert record.sheet is not None
    if theta < 90:
        return record, record.part("through"), np.ones(3)
    if record.sheet.alike:
        return record, record.part("through"), TURNED
    return record.part("behind"), record.part("through_behind"), TURNED


def under_sky(record: BrdfRecord, mode: str, theta: float, radiance: Callable[[Array], Array] = sky) -> Array:
    """Radiance (3,) by quadrature, of a world by direction."""
    reflected, through, turn = seen(record, theta)
    wi, wo = upper_hemisphere(), (viewer(theta) * turn)[None]
    light = shown(reflected, mode, wi, wo) * radiance(wi * turn) + shown(through, mode, wi, wo) * radiance(
        wi * BELOW * turn
    )
    return math.pi * light.mean(0)


def lit_by(record: BrdfRecord, mode: str, theta: float, lamp: bpy.types.Object) -> Array:
    """The same of one square area lamp that faces the origin, by a grid of points on it."""
    reflected, through, turn = seen(record, theta)
    u = (np.arange(40) + 0.5) / 40 - 0.5
    across = np.stack(np.meshgrid(u, u), -1).reshape(-1, 2) * lamp.data.size
    matrix = np.array(lamp.matrix_world)
    place = matrix[:3, 3] + across @ matrix[:3, :2].T
    distance = np.linalg.norm(place, axis=-1, keepdims=True)
    world = place / distance
    facing = np.abs(world @ matrix[:3, 2:3])
    radiance = lamp.data.energy / (math.pi * lamp.data.size**2)
    wi, wo = world * turn, (viewer(theta) * turn)[None]
    behind = wi[:, 2:] < 0
    wi = np.where(behind, wi * BELOW, wi)
    value = np.where(behind, shown(through, mode, wi, wo), shown(reflected, mode, wi, wo))
    solid = facing * lamp.data.size**2 / len(u) ** 2 / distance**2
    return (value * wi[:, 2:] * solid * radiance).sum(0)


def assert_shows(scene: TestScene, truth: Array, samples: int = 64, seeds: int = 24, tolerance: float = 1e-3) -> None:
    """By a t-test of tiles that finds 1 %, and that a planted 2 % fails."""
    pictures = scene.render(samples, seeds)
    expected = np.broadcast_to(truth.astype(np.float32), (3, RESOLUTION, RESOLUTION, 3))
    assert_same(expected, pictures, np.ones((RESOLUTION, RESOLUTION), bool), tolerance, 0.01)


def assert_mean(scene: TestScene, truth: Array, samples: int, tolerance: float = 2e-3) -> None:
    """By Student's t-test of the parts of one picture, which finds 1 %, and that a planted 2 % fails.

    One, since scripts are compiled for every picture; all pixels of it show the same. Where a point of light is sampled
    for every sample of a pixel nearly all of these are equal, and a few are not: too skewed for a test of tiles.

    Parameters
    ----------
    tolerance : relative, of tables that are read in half precision
    """
    count, settings = 24, scene.scene.render
    settings.resolution_x = RESOLUTION * count
    try:
        whole = scene.render(samples, 1)[0].astype(float)
    finally:
        settings.resolution_x = RESOLUTION
    parts = np.stack([part.mean((0, 1)) for part in np.split(whole, count, axis=1)]) / truth
    reach = T_OF_PARTS * parts.std(0, ddof=1) / math.sqrt(count) + tolerance
    off = parts.mean(0) - 1
    print(f"off by {off}, of which {reach} may be noise")
    assert (reach < 0.01).all(), "too noisy to find 1 %"
    assert (np.abs(off) < reach).all()
    assert (np.abs(1.02 * parts.mean(0) - 1) > reach).all(), "a planted 2 % was not found"
