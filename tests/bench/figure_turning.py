"""After figure 5 of Mallett & Yuksel 2016: anisotropic tables of equal bytes under a light that turns.

A sphere, brushed around its vertical axis, under a small distant light that goes from the camera's side to behind the
sphere. Light is summed in numpy over the light's directions, the same for truth and tables, so that a picture shows
what the table does and no noise; the nodes are tested to return what numpy returns. One row is the material itself,
path traced.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from bench_anisotropic import SOURCES, brush_around
from csv_rows import write_rows
from mathutils import Matrix, Vector
from measured_materials.addon.lights import light_tables
from measured_materials.addon.rendering.contact_sheet import Cell, write_sheet
from measured_materials.addon.rendering.renderer import set_unbiased
from measured_materials.addon.studio import studio_meshes
from measured_materials.addon.studio.studio import remove_studio, render_linear
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.directions import spherical
from measured_materials.bake.source import Array, BrdfSource
from measured_materials.bake.tables.grids.grid import Grid
from measured_materials.bake.tables.search.grid_search import choose_grid
from measured_materials.bake.tables.table import tabulate
from measured_materials.nodes import compat
from measured_materials.nodes.material import build_material
from rich.progress import track

CAPTIONS = {"brushed metal": "brushed-metal", "satin": "satin", "Ashikhmin-Shirley": "ashikhmin-shirley"}
_GAIN = 4.0
_ELEVATION, _LIGHT_RADIUS = np.radians(30), np.radians(6)
_ORTHO_SCALE = 2.1  # of the sphere's radius


def run(out: Path, quick: bool) -> None:
    """A sheet per material and figure-5.csv; --quick one material, four small pictures in a row."""
    size, lights, azimuths, n = (96, 24, 4, 24) if quick else (160, 48, 6, 48)
    rows: list[dict[str, Any]] = []
    names = list(CAPTIONS)[:1] if quick else list(CAPTIONS)
    for name in names:
        scene = Scene(size, lights, tuple(np.linspace(0, 150, azimuths)))
        rows += _sheet(out / f"figure-5-{CAPTIONS[name]}.png", name, SOURCES[name], scene, n, 32 if quick else 192)
    write_rows(out / "figure-5.csv", rows)


@dataclass(frozen=True)
class Scene:
    """Pixels (size, size) of a unit sphere seen along +y, and a light of `lights` directions at azimuths in degrees."""

    size: int
    lights: int
    azimuths: tuple[float, ...]

    @cached_property
    def seen(self) -> Array:
        """Which pixels show the sphere, (size, size)."""
        return np.hypot(*self._places) < 0.995

    @cached_property
    def _places(self) -> tuple[Array, Array]:
        x = ((np.arange(self.size) + 0.5) / self.size - 0.5) * _ORTHO_SCALE
        return tuple(np.meshgrid(x, -x))  # type: ignore[return-value]

    @cached_property
    def frames(self) -> Array:
        """Tangent around the z axis, bitangent and normal of the seen pixels, (P, 3, 3)."""
        x, z = (place[self.seen] for place in self._places)
        normal = np.stack([x, -np.sqrt(1 - x * x - z * z), z], -1)
        tangent = np.stack([-normal[:, 1], normal[:, 0], np.zeros_like(x)], -1)
        tangent /= np.linalg.norm(tangent, axis=-1, keepdims=True)
        return np.stack([tangent, np.cross(normal, tangent), normal], 1)

    def light(self, azimuth: float) -> tuple[Array, Array]:
        """Middle (3,) and directions (L, 3) of the light, spread evenly over its disc."""
        k = np.arange(self.lights) + 0.5
        radius, turn = np.sqrt(k / self.lights) * _LIGHT_RADIUS, k * np.pi * (3 - 5**0.5)
        around = spherical(radius, turn)
        middle = direction_of(azimuth)
        side = np.cross([0.0, 0.0, 1.0], middle)
        side /= np.linalg.norm(side)
        return middle, around @ np.stack([side, np.cross(middle, side), middle])

    def shade(self, material: Any, azimuth: float) -> Array:
        """Picture (size, size, 3) of a source or table, of irradiance pi on a surface that faces the light."""
        wo = self.frames @ np.array([0.0, -1.0, 0.0])
        sum_ = np.zeros_like(wo)
        for direction in self.light(azimuth)[1]:
            wi = self.frames @ direction
            lit = np.flatnonzero((wi[:, 2] > 0) & (wo[:, 2] > 0))
            sum_[lit] += material.evaluate(wi[lit], wo[lit]) * wi[lit, 2:]
        picture = np.zeros((self.size, self.size, 3))
        picture[self.seen] = np.pi * sum_ / self.lights
        return picture

    def relative_rms(self, picture: Array, truth: Array) -> float:
        """Of the difference over the seen pixels, as a share of the truth's own."""
        return float(np.sqrt(((picture - truth)[self.seen] ** 2).mean() / (truth[self.seen] ** 2).mean()))


def direction_of(azimuth: float) -> Array:
    """Unit vector to the light; at azimuth 0 degrees it stands above the camera."""
    phi = np.radians(azimuth) - np.pi / 2
    return np.array([*(np.cos(_ELEVATION) * np.array([np.cos(phi), np.sin(phi)])), np.sin(_ELEVATION)])


def grids(source: BrdfSource, n: int) -> dict[str, Grid]:
    """Of about equal bytes."""
    kinds: tuple[Any, ...] = ("identity", "uniform", "bezier", "fitted")
    normal = {kind: choose_grid(source, n, ("normal",), kind).grid for kind in kinds}
    return normal | {"half vectors": choose_grid(source, n, ("half",)).grid}


def _sheet(path: Path, name: str, source: BrdfSource, scene: Scene, n: int, samples: int) -> list[dict[str, Any]]:
    """Rows: truth, path traced, then every table and what it is off by."""
    truth = [scene.shade(source, azimuth) for azimuth in scene.azimuths]
    exposure = 0.8 / float(np.percentile(np.stack(truth)[:, scene.seen], 99))
    pictures: dict[str, list[Array]] = {"path traced, Exact": _path_traced(source, scene, n, samples)}
    sizes = {"path traced, Exact": "by Cycles"}
    for kind, grid in track(grids(source, n).items(), name):
        table = tabulate(source, grid)
        pictures[kind] = [scene.shade(table, azimuth) for azimuth in scene.azimuths]
        sizes[kind] = " x ".join(map(str, grid.shape))
    cells = [Cell(p * exposure, "truth", f"light {a:g} degrees") for p, a in zip(truth, scene.azimuths)]
    rows = []
    for kind, shown in pictures.items():
        rms = [scene.relative_rms(p, t) for p, t in zip(shown, truth)]
        cells += [Cell(p * exposure, kind, f"{sizes[kind]}: RMS {r:.1%}") for p, r in zip(shown, rms)]
        cells += [Cell(_GAIN * exposure * np.abs(p - t), f"error x {_GAIN:g}") for p, t in zip(shown, truth)]
        rows += [
            {"material": name, "table": kind, "shape": sizes[kind], "azimuth": a, "relative rms": r}
            for a, r in zip(scene.azimuths, rms)
        ]
        print(f"  {name:18s} {kind:20s} {sizes[kind]:18s} RMS " + " ".join(f"{r:8.2%}" for r in rms))
    write_sheet(path, cells, len(truth), f"Mallett & Yuksel, figure 5: {name}, brushed, under a light that turns")
    print(f"  {path}")
    return rows


def _path_traced(source: BrdfSource, shown: Scene, n: int, samples: int) -> list[Array]:
    """The same pictures by Cycles, of the material in mode Exact, aimed at the light."""
    with tempfile.TemporaryDirectory() as folder:
        bundle = read_bundle(bake_source(source, Path(folder) / "material", BakeSettings(n)).path)
        material = build_material(bundle, mode="exact", lamps=light_tables.lamp_image())
        brush_around(material)
        pictures = []
        for azimuth in shown.azimuths:
            scene = _cycles_scene(shown, material, azimuth, samples)
            light_tables.update_scene(scene)
            pictures.append(render_linear(scene))
            remove_studio(scene)
        bpy.data.materials.remove(material)
    return pictures


def _cycles_scene(shown: Scene, material: bpy.types.Material, azimuth: float, samples: int) -> bpy.types.Scene:
    compat.ensure_cycles()
    scene = bpy.data.scenes.new("turning light")
    mesh = studio_meshes.sphere_mesh()
    mesh.materials.append(material)
    scene.collection.objects.link(bpy.data.objects.new("sphere", mesh))
    light = bpy.data.lights.new("sun", "SUN")
    light.energy, light.angle = np.pi, 2 * _LIGHT_RADIUS
    lamp = bpy.data.objects.new("sun", light)
    lamp.matrix_world = Vector(direction_of(azimuth)).to_track_quat("Z", "Y").to_matrix().to_4x4()
    scene.collection.objects.link(lamp)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.type, camera.data.ortho_scale = "ORTHO", _ORTHO_SCALE
    camera.matrix_world = Matrix.Translation((0, -5, 0)) @ Matrix.Rotation(np.pi / 2, 4, "X")
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.world, background = compat.new_world("dark")
    background.inputs["Color"].default_value = (0, 0, 0, 1)
    scene.render.resolution_x = scene.render.resolution_y = shown.size
    set_unbiased(scene, samples=samples, seed=0)
    scene.cycles.filter_width = 0.01  # at the middle of each pixel, as in numpy
    return scene
