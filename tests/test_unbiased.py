"""No mode is biased: Cycles against a quadrature of the direct light in numpy, of four materials in five lightings.

A sphere alone reflects direct light only, so that the quadrature of `support.direct_light` is the whole truth: it
shares neither nodes nor sampling with what it judges, and integrates the very tables that the material holds. A mode
that draws wrongly, loses what a sampler never proposes, or counts a density twice, differs.
"""

from __future__ import annotations

import contextlib
import functools
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Matrix, Vector
from measured_materials.addon.lights.light_tables import lamp_image
from measured_materials.bake.bundle.bundle import Bundle
from measured_materials.nodes.material import build_material
from measured_materials.nodes.osl_material import build_osl_material
from measured_materials.nodes.osl_script import use_osl
from numpy.typing import NDArray
from support import bundles
from support.clean_blend import clean_blend  # noqa: F401
from support.direct_light import (
    AreaLamp,
    Brdf,
    Camera,
    Light,
    PointLamp,
    Points,
    Sun,
    World,
    environment,
    picture,
    reflected,
)
from support.monte_carlo import SKEWNESS_LIMIT, Result, assert_agree, compare
from support.osl import skip_without_osl
from support.scenes import Array, TestScene, diffuse_material, lit_sphere
from support.scenes import add_lamp as lamp_towards_origin

RESOLUTION, LENS = 32, 70  # the sphere fills the picture but for its corners
# Near its rim the sphere of facets ends before the true one, and a pixel sees too many angles for a grid of points.
LEAST_COSINE = 0.2
ALBEDO = 0.5
FINDS = 0.01
# Facets lean by up to 0.7 degrees: grazing light loses 0.02 % of the whole. Against ten times the nodes the quadrature
# of the stand-ins is good to 0.06 %, that of the measurements, of lobes as narrow as 0.006, to 0.12 %.
TOLERANCE, TOLERANCE_MEASURED = 1e-3, 2e-3
SEEDS, MOST_SEEDS = 10, 240
# Of the mean: what shows less is lit at angles at which the facets shade each other.
DARK = 0.005
STEP = 2e-6  # of the picture's width; 240 of them are 0.015 pixels


# --- the same light twice: in Blender, and in numpy ------------------------------------------------------


def sky(direction: Array) -> Array:
    """The sky of `lit_sphere`."""
    return (0.5 + 0.5 * direction[..., 2:]) * np.array([0.8, 0.9, 1.0])


def room() -> Array:
    """Dim walls (16, 32, 3), a window that gives half of their light, and a lamp of one texel."""
    rows, columns = np.mgrid[:16, :32]
    walls = 0.15 + 0.1 * np.cos(columns / 3) * np.sin(rows / 2) + 0.05 * (rows < 8)
    pixels = walls[..., None] * np.array([1.0, 0.9, 0.75])
    pixels[4:8, 20:24] = 4.0, 5.0, 6.5
    pixels[5, 29] = 30.0, 24.0, 14.0
    return pixels.astype(np.float32)


def add_lamp(scene: TestScene, kind: str, place: tuple[float, float, float], **settings: Any) -> Light:
    """A lamp that looks at the origin, and its twin."""
    obj = lamp_towards_origin(scene, kind, place, **settings)
    data = obj.data
    matrix, colour = np.array(obj.matrix_world), tuple(data.energy * c for c in data.color)
    if kind == "AREA":
        oblong = data.shape in ("RECTANGLE", "ELLIPSE")
        sizes = data.size, data.size_y if oblong else data.size
        return AreaLamp(matrix, sizes, colour, round=data.shape in ("DISK", "ELLIPSE"))
    if kind == "SUN":
        return Sun(matrix, data.angle, colour)
    spot = (data.spot_size, data.spot_blend) if kind == "SPOT" else None
    return PointLamp(matrix, data.shadow_soft_size, colour, spot, data.use_soft_falloff)


def add_world(scene: TestScene, pixels: Array) -> Light:
    """An equirectangular image all around."""
    image = bpy.data.images.new("room", pixels.shape[1], pixels.shape[0], float_buffer=True, is_data=True)
    rgba = np.concatenate([pixels[::-1], np.ones_like(pixels[..., :1])], -1)
    image.pixels.foreach_set(rgba.ravel())
    image.pack()
    tree = scene.scene.world.node_tree
    background = next(n for n in tree.nodes if n.type == "BACKGROUND")
    around = tree.nodes.new("ShaderNodeTexEnvironment")
    around.image = image
    tree.links.new(around.outputs["Color"], background.inputs["Color"])
    background.inputs["Strength"].default_value = 1
    return World(environment(pixels))


def darken(scene: TestScene) -> None:
    """Take the sky away; what lamps or an image add remains."""
    tree = scene.scene.world.node_tree
    strength = next(n for n in tree.nodes if n.type == "BACKGROUND").inputs["Strength"]
    tree.links.remove(strength.links[0])
    strength.default_value = 0


Lamp = tuple[str, tuple[float, float, float], dict[str, Any]]


@dataclass(frozen=True)
class Lighting:
    """Lamps, or else a world; samples to a pixel and seed, and points of the quadrature along a pixel's edge."""

    lamps: tuple[Lamp, ...] = ()
    world: str = ""
    samples: int = 24
    grid: int = 4

    def place(self, scene: TestScene) -> list[Light]:
        """Light the scene so, and return the twins."""
        if self.world == "sky":
            return [World(sky)]
        darken(scene)
        if self.world == "room":
            return [add_world(scene, room())]
        return [add_lamp(scene, kind, place, **settings) for kind, place, settings in self.lamps]


SPOT = {"energy": 90, "shadow_soft_size": 0.2, "spot_size": 0.7, "spot_blend": 0.4}
LIGHTINGS = {
    "sky": Lighting(world="sky", samples=16, grid=2),
    "small lamp": Lighting((("AREA", (1.6, -2.2, 2.4), {"energy": 100, "size": 0.25}),)),
    "sun": Lighting((("SUN", (1, -1.5, 1.5), {"energy": 2, "angle": math.radians(3)}),)),
    "default sun": Lighting((("SUN", (1, -1.5, 1.5), {"energy": 2, "angle": math.radians(0.526)}),)),
    "three lamps": Lighting(
        (
            ("AREA", (2, -1.5, 2), {"energy": 60, "shape": "ELLIPSE", "size": 1.2, "size_y": 0.3}),
            ("SUN", (-2, -1.5, 2), {"energy": 1, "angle": math.radians(10), "color": (1, 0.8, 0.6)}),
            ("SPOT", (0.2, -2.5, 1.5), SPOT),
        )
    ),
    "room": Lighting(world="room", samples=48, grid=2),
}
# Kinds of lamp of which the lightings above hold no example.
OTHER_LAMPS = {
    "disk": Lighting((("AREA", (2, -1.5, 1), {"energy": 60, "shape": "DISK", "size": 2.0}),)),
    "point": Lighting((("POINT", (1.5, -2, 2), {"energy": 150, "shadow_soft_size": 0.5}),)),
    "hard point": Lighting(
        (("POINT", (1.5, -2, 2), {"energy": 150, "shadow_soft_size": 0.5, "use_soft_falloff": False}),)
    ),
    "hard spot": Lighting((("SPOT", (0.2, -2.5, 1.5), {**SPOT, "use_soft_falloff": False}),)),
}


# --- a sphere in such light ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Stage:
    """The scene and its twin."""

    scene: TestScene
    camera: Camera
    mask: NDArray[np.bool_]
    lights: list[Light]
    lighting: Lighting

    def truth(self, brdf: Brdf, finer: int = 1, nodes: int | None = None) -> Array:
        """The picture by quadrature; `finer` for lobes much narrower than a pixel of the sphere, more `nodes`, a
        Fibonacci number, for those much narrower than a lamp."""
        lights: list[Any] = self.lights
        if nodes is not None:
            lights = [replace(light, nodes=nodes) for light in lights]
        return picture(brdf, self.camera, self.mask, lights, finer * self.lighting.grid)

    def judged(self, truth: Array, finer: int = 1) -> Result:
        """What the scene shows against the truth, under so many seeds as it takes to find 1 %.

        `finer` takes its square times the samples, and judges narrow lobes, by `TOLERANCE_MEASURED`.
        """
        tolerance = TOLERANCE if finer == 1 else TOLERANCE_MEASURED
        light = truth.mean(-1)
        mask = self.mask & (light > DARK * light[self.mask].mean())
        pictures = np.empty((0, *truth.shape), np.float32)
        while True:
            seeds = range(len(pictures), len(pictures) + SEEDS)
            pictures = np.concatenate([pictures, self.rendered(finer**2 * self.lighting.samples, seeds)])
            found = compare(np.stack([truth] * 3), pictures, mask, tolerance=tolerance)
            quiet = found.detectable_effect <= FINDS and found.skewness < SKEWNESS_LIMIT
            if quiet or len(pictures) >= MOST_SEEDS:
                break
        planted = compare(np.stack([1.02 * truth] * 3), pictures, mask, tolerance=tolerance)
        assert not planted.passed, f"a planted 2 % was not found: {planted}"
        return found

    def rendered(self, samples: int, seeds: Iterable[int]) -> Array:
        """Pictures (K, H, W, 3), each of a camera moved by a few bits.

        Cycles sends the first sample of a pixel through its middle whatever the seed is. Random numbers that a shader
        takes from the place it shades would repeat there, and seeds agree too well: 0.3 % of error in all of them (the
        default sun, 24 samples).
        """
        pictures = []
        with self.scene.kept():
            for seed in seeds:
                self.scene.scene.camera.data.shift_x = STEP * seed
                pictures.append(self.scene.render(samples, [seed])[0])
        return np.stack(pictures)


@contextlib.contextmanager
def stage(name: str, zoom: float = 1.0) -> Iterator[Stage]:
    """A grey sphere in one of the lightings; with a zoom, only where its first lamp is mirrored."""
    lighting = (LIGHTINGS | OTHER_LAMPS)[name]
    grey = diffuse_material(ALBEDO)
    # Facets lie 1e-4 under the sphere on average; seen closely that moves highlights by 2.5e-5 rad, 0.7 % in a tile.
    segments = 256 if zoom == 1 else 768
    with lit_sphere(grey, segments, lamp=False, ground=False, resolution=RESOLUTION) as scene:
        scene.leave_terminator()
        scene.scene.cycles.pixel_filter_type = "BOX"
        eye = scene.scene.camera
        eye.data.lens = LENS * zoom
        lights = lighting.place(scene)
        if zoom > 1:
            place = eye.matrix_world.translation
            at = highlight(place, *lighting.lamps[0][:2])
            eye.matrix_world = Matrix.Translation(place) @ (at - place).to_track_quat("-Z", "Y").to_matrix().to_4x4()
        camera = Camera(np.array(eye.matrix_world), 0.5 * eye.data.sensor_width / eye.data.lens, RESOLUTION)
        yield Stage(scene, camera, camera.mask(LEAST_COSINE), lights, lighting)


def highlight(eye: Vector, kind: str, lamp: tuple[float, float, float]) -> Vector:
    """Where the unit sphere mirrors the middle of a lamp."""
    at = Vector((0, 0, 0))
    for _ in range(50):
        at = ((eye - at).normalized() + (Vector(lamp) - (0 if kind == "SUN" else 1) * at).normalized()).normalized()
    return at


def test_world_quadrature_knows_what_it_integrates() -> None:
    """Solid angle of the hemisphere, albedo of a Lambertian, and a narrow highlight."""
    cosine = np.array([0.2, 0.5, 0.9, 1.0])
    normal = np.tile([0.6, 0.0, 0.8], (4, 1))
    aside = np.array([0.8, 0.0, -0.6])
    points = Points.of(normal, cosine[:, None] * normal + np.sqrt(1 - cosine**2)[:, None] * aside)
    white = World(lambda wi: np.ones_like(wi), nodes=10946)
    wi, solid = white.arriving(points)
    assert solid.sum(1) == pytest.approx(2 * np.pi, rel=1e-3)
    assert np.sum(wi * normal[:, None], -1).min() > 0
    assert reflected(lambda wi, wo: np.full(wi.shape, 1 / np.pi), points, white) == pytest.approx(1, rel=1e-3)

    def mirrored(wi: Array, wo: Array) -> Array:
        away = np.sum((wi - wo * [-1, -1, 1]) ** 2, -1, keepdims=True)
        return np.exp(-away / 0.02**2) / (np.pi * 0.02**2) / np.maximum(wi[..., 2:], 1e-9) * np.ones(3)

    assert reflected(mirrored, points, white) == pytest.approx(1, rel=1e-3)


@pytest.mark.parametrize("name", [*LIGHTINGS, *OTHER_LAMPS])
def test_quadrature_knows_blenders_lights(name: str) -> None:
    """The instrument itself: radiance, shape and place of every light, on Cycles' own Diffuse BSDF."""
    with stage(name) as lit:
        assert_agree(lit.judged(lit.truth(lambda wi, wo: np.full(wi.shape, ALBEDO / np.pi))), FINDS)


# --- the modes -------------------------------------------------------------------------------------------

Bundles = Callable[[str], Bundle]


@pytest.fixture(scope="module")
def stand_in(tmp_path_factory: pytest.TempPathFactory) -> Bundles:
    """Bundles of `bundles.ANALYTIC`, each baked once."""
    folder = tmp_path_factory.mktemp("analytic")
    return functools.cache(lambda name: bundles.baked(bundles.ANALYTIC[name], folder))


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory, shared_tools: Path) -> Bundles:
    """Bundles of `bundles.MEASURED`, each baked once."""
    folder = tmp_path_factory.mktemp("measured")
    return functools.cache(lambda name: bundles.baked(bundles.measured_source(name, shared_tools, folder), folder))


def assert_unbiased(bundle: Bundle, lit: Stage, mode: str, finer: int = 1, osl: bool = False) -> None:
    if osl:
        use_osl(lit.scene.scene)
        material = build_osl_material(bundle, mode=mode, lamps=lamp_image())
    else:
        material = build_material(bundle, mode=mode, lamps=lamp_image(), lamp_share=True)
    lit.scene.show(material)
    found = lit.judged(lit.truth(bundles.brdf_of(bundle, mode), finer), finer)
    print(found)
    assert_agree(found, FINDS)


# Every material and every kind of light; the whole matrix, of measurements, takes a quarter of an hour.
DIAGONAL = [
    ("felt", "small lamp"),
    ("felt", "three lamps"),
    ("fabric", "sun"),
    ("metallic paint", "room"),
    ("phenolic", "sky"),
]
# A lamp, several and a sky are looked at each time, suns and pictures by the slow tests.
QUICK = {("felt", "small lamp"), ("felt", "three lamps"), ("phenolic", "sky")}


@pytest.mark.parametrize("mode", ["exact", pytest.param("reference", marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "material, name", [pytest.param(*pair, marks=[pytest.mark.slow] * (pair not in QUICK)) for pair in DIAGONAL]
)
def test_mode_is_unbiased(stand_in: Bundles, material: str, name: str, mode: str) -> None:
    with stage(name) as lit:
        assert_unbiased(stand_in(material), lit, mode)


@pytest.mark.parametrize("material, name", DIAGONAL)
def test_balanced_is_exact_on_the_first_bounce(stand_in: Bundles, material: str, name: str) -> None:
    """Sample by sample, which says more than any test of means."""
    bundle = stand_in(material)
    with stage(name) as lit:
        pictures = []
        for mode in ("exact", "balanced"):
            lit.scene.show(build_material(bundle, mode=mode, lamps=lamp_image()))
            pictures.append(lit.scene.render(4, 1)[0][lit.mask])
    assert pictures[0].any()
    np.testing.assert_allclose(pictures[1], pictures[0], rtol=1e-6)


@pytest.mark.slow
def test_osl_twin_is_unbiased(stand_in: Bundles) -> None:
    skip_without_osl()
    with stage("small lamp") as lit:
        assert_unbiased(stand_in("felt"), lit, "exact", osl=True)


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["exact", "reference"])
@pytest.mark.parametrize("material, name", DIAGONAL)
def test_osl_twin_is_unbiased_along_the_diagonal(stand_in: Bundles, material: str, name: str, mode: str) -> None:
    skip_without_osl()
    with stage(name) as lit:
        assert_unbiased(stand_in(material), lit, mode, osl=True)


# Coats as smooth as these mirror a lamp into a few pixels of a whole sphere, and the noise of a sample is 30 times the
# mean. So the camera looks there.
ZOOMS = {"small lamp": 20, "sun": 15, "default sun": 30, "three lamps": 10}


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["exact", "reference"])
@pytest.mark.parametrize("name", LIGHTINGS)
@pytest.mark.parametrize("material", bundles.MEASURED)
def test_mode_is_unbiased_on_measurements(measured: Bundles, material: str, name: str, mode: str) -> None:
    zoom = ZOOMS.get(name, 1) if material in ("metallic paint", "phenolic") else 1
    with stage(name, zoom) as lit:
        assert_unbiased(measured(material), lit, mode, finer=2 if zoom > 1 else 3)
