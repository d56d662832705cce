"""Measured fabrics lit from behind, in Cycles and by a quadrature that reads the files by itself: pictures and figures.

A shade in the plane z = 0 hangs before a square lamp. The quadrature takes a Klems matrix's patches as they are,
constant within each; of the light's angles it takes those of the way that it goes on, so that equal patches are
straight on.
"""

from __future__ import annotations

import re
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

sys.path.insert(0, str(Path(__file__).parents[1]))

import bpy
import numpy as np
from mathutils import Matrix, Vector
from measured_materials.addon.lights.light_tables import update_scene
from measured_materials.addon.material.build_brdf import build_brdf
from measured_materials.addon.material.choices import Choices
from measured_materials.addon.rendering.contact_sheet import Cell, write_sheet
from measured_materials.addon.rendering.renderer import set_unbiased
from measured_materials.addon.studio.studio import OWNED, remove_studio, render_linear
from measured_materials.bake.brdf.bake import bake_file
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.source import Array, SheetSource
from measured_materials.bake.sources import read_source
from measured_materials.bake.sources.lookup.sheet_lookup import SheetLookup
from measured_materials.bake.tables.accuracy import direction_pairs, linear_estimate
from measured_materials.bake.tables.search.grid_search import choose_grid
from measured_materials.bake.tables.sheet import sheet_views
from measured_materials.bake.tables.treated_source import TreatedSource
from measured_materials.nodes import compat
from measured_materials.nodes.osl_script import use_osl
from record import put
from support.scenes import TestScene, add_lamp

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
FABRICS = {"mecho shade": "klems/mecho_shade_fabric.xml", "2011-SA1": "formats/klems/2011-SA1.XML"}
# LBNL's full Klems basis: bounds of theta in degrees, and patches of phi.
_BOUNDS = np.radians([0, 5, 15, 25, 35, 45, 55, 65, 75, 90])
_PHIS = np.array([1, 8, 16, 20, 24, 24, 24, 16, 12])
_LAMP, _PLACE, _ENERGY = 0.5, (0.25, 0.1, -1.2), 40.0
_EYE, _LENS = (0.9, -0.7, 1.5), 40.0
_FEW = 64
# Points along each side of a pixel: patches end within it.
_SUB = 4


def run(out: Path, quick: bool) -> int | None:
    """All fabrics that are here."""
    cells = []
    for name, file in FABRICS.items():
        if not (DATA / file).is_file():
            print(f"{name}: not here ({file} of the shared data)")
            continue
        matrix = transmission_of(DATA / file)
        if matrix is None:
            print(f"{name}: holds no transmission")
            continue
        truth = quadrature(matrix, 24 if quick else 48)
        few = None if quick else rms(picture(DATA / file, 48, _FEW), truth)
        seen = picture(DATA / file, *((24, _FEW) if quick else (48, 1024)))
        error = rms(seen, truth)
        light = float(seen.mean() / truth.mean() - 1)
        read = read_error(DATA / file, matrix)
        for size, left in interpolated(DATA / file, (24, 160)).items():
            print(f"{name}: interpolated between {size} samples an RMS of {left:.2f} of the signal's would be left")
            put(f"{name}, {size} samples", left)
        if few is not None:
            print(f"{name}: RMS {few:.1%} at {_FEW} samples")
            put(f"{name}, RMS at {_FEW} samples", few)
        print(f"{name}: RMS {error:.1%} of the quadrature's, light {light:+.2%}; the reader's own RMS {read:.1%}")
        put(f"{name}, RMS", error)
        put(f"{name}, light", abs(light))
        put(f"{name}, reader", read)
        bright = 0.8 / float(np.percentile(truth, 99))
        for words, image in (("Cycles", seen), ("quadrature", truth), ("difference x 4", 4 * np.abs(seen - truth))):
            large = (image * bright).repeat(4, 0).repeat(4, 1).astype(np.float32)
            cells.append(Cell(np.broadcast_to(large[..., None], (*large.shape, 3)).copy(), f"{name}, {words}"))
    if cells:
        write_sheet(out / "behind.png", cells, 3)
    return None if cells else 1


def rms(seen: Array, truth: Array) -> float:
    """Of the difference, in parts of the truth's."""
    return float(np.sqrt(((seen - truth) ** 2).mean() / (truth**2).mean()))


def transmission_of(file: Path) -> Array | None:
    """(145, 145) in 1/sr by the viewer's patch and the light's; None where the file holds none of the visible."""
    tree = ElementTree.fromstring(re.sub(r'\sxmlns="[^"]+"', "", file.read_text(encoding="utf-8", errors="replace")))
    columns = "column" in (tree.findtext(".//IncidentDataStructure") or "").lower()
    for data in tree.iter("WavelengthData"):
        block = data.find("WavelengthDataBlock")
        told = (data.findtext("Wavelength") or "").strip(), (data.findtext(".//WavelengthDataDirection") or "").strip()
        if block is None or told != ("Visible", "Transmission Front"):
            continue
        numbers = np.array([float(x) for x in re.split(r"[\s,]+", block.findtext("ScatteringData") or "") if x])
        matrix = numbers.reshape(145, 145)
        return matrix if columns else matrix.T
    return None


def patch(direction: Array) -> Array:
    """Index of the patch (...) that holds a direction (..., 3), by the angle to the z axis on either side."""
    theta = np.arccos(np.clip(np.abs(direction[..., 2]), 0, 1))
    ring = np.clip(np.searchsorted(_BOUNDS, theta, side="right") - 1, 0, len(_PHIS) - 1)
    turn = np.mod(np.arctan2(direction[..., 1], direction[..., 0]) / (2 * np.pi), 1.0)
    place = np.mod(np.rint(turn * _PHIS[ring]), _PHIS[ring]).astype(int)
    return np.concatenate([[0], np.cumsum(_PHIS)])[ring] + place


def camera_frame() -> Array:
    """Right, up and back of the camera (3, 3), in rows."""
    turned = (-Vector(_EYE)).to_track_quat("-Z", "Y").to_matrix()
    return np.array(turned).T


def quadrature(matrix: Array, edge: int) -> Array:
    """Radiance (edge, edge) of the shade's points, by a grid of points on the lamp and 16 of each pixel."""
    sub = (np.arange(_SUB * edge) + 0.5) / (_SUB * edge) - 0.5
    x, y = np.meshgrid(sub, -sub)
    right, up, back = camera_frame()
    rays = x[..., None] * 36 / _LENS * right + y[..., None] * 36 / _LENS * up - back
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    points = np.array(_EYE) - rays * (_EYE[2] / rays[..., 2:])
    lamp = np.array(Matrix.Translation(_PLACE) @ _facing().to_4x4())
    u = ((np.arange(24) + 0.5) / 24 - 0.5) * _LAMP
    places = lamp[:3, 3] + np.stack(np.meshgrid(u, u), -1).reshape(-1, 2) @ lamp[:3, :2].T
    seen_in, total = patch(-rays), np.zeros(points.shape[:2])
    radiance = _ENERGY / (np.pi * _LAMP**2)
    for place in places:
        away = place - points
        distance = np.linalg.norm(away, axis=-1)
        wi = away / distance[..., None]
        facing = np.maximum((wi @ lamp[:3, 2]), 0) * (_LAMP / 24) ** 2 / distance**2
        total += matrix[seen_in, patch(-wi)] * np.abs(wi[..., 2]) * facing * radiance
    return total.reshape(edge, _SUB, edge, _SUB).mean((1, 3))


def _facing() -> Any:
    """Turns the lamp towards the origin."""
    return (-Vector(_PLACE)).to_track_quat("-Z", "Y").to_matrix()


def picture(file: Path, edge: int, samples: int) -> Array:
    """The same as the material shows it, a grey."""
    compat.ensure_cycles()
    scene = bpy.data.scenes.new("behind")
    scene[OWNED] = True
    scene.world, background = compat.new_world("dark")
    background.inputs["Strength"].default_value = 0
    mesh = bpy.data.meshes.new("shade")
    mesh.from_pydata([(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)], [], [(0, 1, 2, 3)])
    shade = bpy.data.objects.new("shade", mesh)
    scene.collection.objects.link(shade)
    camera = bpy.data.cameras.new("camera")
    camera.lens, camera.sensor_width = _LENS, 36
    scene.camera = bpy.data.objects.new("camera", camera)
    scene.camera.matrix_world = Matrix.Translation(_EYE) @ (-Vector(_EYE)).to_track_quat("-Z", "Y").to_matrix().to_4x4()
    scene.collection.objects.link(scene.camera)
    scene.render.resolution_x = scene.render.resolution_y = edge
    set_unbiased(scene, samples, 0)
    scene.cycles.pixel_filter_type = "BOX"
    with tempfile.TemporaryDirectory() as folder:
        record = BrdfRecord.of(read_bundle(bake_file(file, Path(folder) / "shade", BakeSettings()).path))
        add_lamp(TestScene(scene, shade), "AREA", _PLACE, energy=_ENERGY, size=_LAMP)
        mesh.materials.append(compat.new_material("stand-in"))
        scene.view_layers[0].update()
        update_scene(scene)
        material, plan = build_brdf(record, choices=Choices(mode="exact", shader="osl"), scene=scene, pack=True)
        assert plan.sample
        mesh.materials[0] = material
        use_osl(scene)
        scene.view_layers[0].update()
        update_scene(scene)
        try:
            return render_linear(scene).mean(-1).astype(float)
        finally:
            remove_studio(scene)


def interpolated(file: Path, sizes: tuple[int, ...]) -> dict[int, float]:
    """RMS of the best table of each size that is linear between its samples, in parts of the signal's."""
    source = read_source(file)
    assert isinstance(source, SheetLookup)
    view = TreatedSource(sheet_views(replace(source, patches=""))["through"])
    pairs = direction_pairs(20000, turned=True)
    truth = view.evaluate(pairs.wi, pairs.wo)
    found = {}
    for size in sizes:
        grid = choose_grid(view, size).grid
        found[size] = pairs.rms(linear_estimate(view, grid, pairs) - truth) / pairs.rms(truth)
    return found


def read_error(file: Path, matrix: Array) -> float:
    """RMS of what our reader says between the patches, in parts of theirs, at directions of its own choice."""
    source = read_source(file)
    assert isinstance(source, SheetSource)
    rng = np.random.default_rng(1)
    cosine, phi = np.sqrt(rng.uniform(0.03, 1, (2, 20000))), rng.uniform(0, 2 * np.pi, (2, 20000))
    sine = np.sqrt(1 - cosine**2)
    wi, wo = np.stack([sine * np.cos(phi), sine * np.sin(phi), cosine], -1)
    lit = wi * np.array([1.0, 1.0, -1.0])
    truth = matrix[patch(wo), patch(-lit)]
    found = source.transmitted(lit, wo).mean(-1)
    return float(np.sqrt(((found - truth) ** 2).mean() / (truth**2).mean()))
