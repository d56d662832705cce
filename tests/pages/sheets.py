"""Light through cloth: a lampshade of voile that was photographed against the light, and a curtain of a formula."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from commands import baked, commands_of, run, save
from mathutils import Matrix, Vector
from measured_materials.addon.gantry.photograph_arc import photograph_arc
from measured_materials.addon.gantry.swatches.voile import voile
from measured_materials.addon.lights.light_tables import lamp_image, update_scene
from measured_materials.addon.material.bake_photographs import set_repeat
from measured_materials.addon.rendering.contact_sheet import to_display
from measured_materials.addon.rendering.denoising import denoise_renders
from measured_materials.addon.rendering.renderer import set_unbiased
from measured_materials.addon.scene_check.check import check_scene
from measured_materials.addon.scene_check.findings import WRONG
from measured_materials.addon.studio.studio import OWNED, remove_studio, render_linear
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.images.image_io import write_png
from measured_materials.bake.shading_maps.record import ShadingMapRecord
from measured_materials.nodes import compat
from measured_materials.nodes.material import build_material
from measured_materials.nodes.shading_map_material import build_shading_map
from PIL import Image

ELEVATIONS = (8.0, 18.0, 30.0, 42.0, 56.0, 70.0, 88.0)
_PHOTOGRAPH, _FRAMES = 192, 96
_SIZE, _SAMPLES = (320, 400), 40


def make(out: Path, folder: Path) -> None:
    """Both pictures."""
    for name, build in (("lampshade", lampshade), ("curtain", curtain)):
        scene = build(folder)
        try:
            wrong = [finding.line for finding in check_scene(scene) or () if finding.severity == WRONG]
            assert not wrong, wrong
            denoise_renders(scene)
            write_png(folder / f"{name}.png", to_display(render_linear(scene)))
        finally:
            remove_studio(scene)
        save(Image.open(folder / f"{name}.png"), out / f"{name}.jpg")


def photographed(folder: Path) -> Path:
    """The bundle of voile, from the front and against the light, as a reader of the page makes one."""
    bundle = folder / "voile.mmat"
    if not bundle.is_dir():
        for name, behind in (("voile", False), ("voile_behind", True)):
            photograph_arc(
                voile(), folder / name, elevations=ELEVATIONS, size=_PHOTOGRAPH, samples=_FRAMES, behind=behind
            )
        through = ["--through", str(folder / "voile_behind"), "--transmittance", "0.38"]
        run(["bake", "photographs", str(folder / "voile"), "--align", "off", "--albedo", "0.27", *through], bundle)
    return bundle


# --- a lampshade ----------------------------------------------------------------------------------------------------


def lampshade(folder: Path) -> bpy.types.Scene:
    """A lamp on a table by a wall, in the evening."""
    record = ShadingMapRecord.read(read_bundle(photographed(folder)))
    cloth = build_shading_map(record, lamps=lamp_image(), features=True)
    set_repeat(cloth, 3.0, record.map.layout)
    scene = _room("lampshade", (0.30, 0.42, 0.70), 0.25)
    _add(scene, _turned([(0.19, 0.30), (0.125, 0.54)], 160, 24), cloth)
    brass = compat.shader_material("brass", "ShaderNodeBsdfPrincipled", _metal((0.75, 0.55, 0.28), 0.32))
    stem = [(0.0, 0.0), (0.095, 0.0), (0.095, 0.012), (0.03, 0.03), (0.012, 0.06), (0.010, 0.33), (0.0, 0.33)]
    _add(scene, _turned(stem, 64, 6), brass)
    for radius, height in ((0.19, 0.30), (0.125, 0.54)):
        _add(scene, _turned([(radius - 0.002, height - 0.003), (radius + 0.002, height + 0.003)], 96, 1), brass)
    _add(scene, _plane((-3, -3, 0), (6, 0, 0), (0, 6, 0)), _matte("table", (0.20, 0.10, 0.055)))
    _add(scene, _plane((-3, 0.55, 0), (6, 0, 0), (0, 0, 3)), _matte("wall", (0.34, 0.36, 0.35)))
    bulb = _lamp(scene, "POINT", 4.2, (0, 0, 0.40), (1.0, 0.72, 0.45))
    bulb.data.shadow_soft_size = 0.03
    _camera(scene, (0.28, -1.55, 0.50), (0, 0, 0.295), 64)
    return _ready(scene)


# --- a curtain ------------------------------------------------------------------------------------------------------


def curtain(folder: Path) -> bpy.types.Scene:
    """A curtain drawn over most of a window, the sun behind it."""
    bundle = baked(next(c for c in commands_of("sheets.md") if "thin-cloth" in c), folder)
    cloth = build_material(read_bundle(bundle), mode="exact", lamps=lamp_image(), features=True)
    scene = _room("curtain", (0.60, 0.75, 1.0), 2.6)
    _add(scene, _folds(), cloth)
    wall, white = _matte("wall", (0.55, 0.52, 0.48)), _matte("frame", (0.7, 0.7, 0.68))
    for low, high in (((-3, 0.5, -0.2), (-0.75, 0.6, 3)), ((0.75, 0.5, -0.2), (3, 0.6, 3)),
                      ((-0.75, 0.5, 2.05), (0.75, 0.6, 3)), ((-0.75, 0.5, -0.2), (0.75, 0.6, 0.55))):  # fmt: skip
        _add(scene, _box(low, high), wall)
    bars = [((-0.03, 0.52, 0.60), (0.03, 0.57, 2.0)), ((-0.70, 0.53, 1.27), (0.70, 0.56, 1.32))]
    edges = [((-0.77, 0.49, 0.53), (0.77, 0.61, 0.60)), ((-0.77, 0.49, 2.00), (0.77, 0.61, 2.07)),
             ((-0.77, 0.49, 0.60), (-0.70, 0.61, 2.00)), ((0.70, 0.49, 0.60), (0.77, 0.61, 2.00))]  # fmt: skip
    for low, high in bars + edges:
        _add(scene, _box(low, high), white)
    _add(scene, _plane((-3, -4, 0), (6, 0, 0), (0, 4.6, 0)), _matte("floor", (0.26, 0.17, 0.10)))
    for corner, across in (((-3, -4, 0), (0, 4.6, 0)), ((3, -4, 0), (0, 4.6, 0))):
        _add(scene, _plane(corner, across, (0, 0, 3)), wall)
    _add(scene, _plane((-3, -4, 3), (6, 0, 0), (0, 4.6, 0)), wall)
    _add(scene, _turned([(0.012, -1.0), (0.012, 1.0)], 32, 1, Matrix.Rotation(math.pi / 2, 4, "Y")), white).location = (
        0, 0.30, 2.24)  # fmt: skip
    sun = _lamp(scene, "SUN", 9.0, (-0.9, 3.0, 3.7), (1.0, 0.86, 0.68))
    sun.data.angle = math.radians(1.5)
    _camera(scene, (0.35, -2.9, 1.35), (-0.02, 0.3, 1.16), 36)
    return _ready(scene)


def _folds() -> bpy.types.Mesh:
    """Cloth gathered at a rod, its folds wider towards the hem."""
    u, v = np.meshgrid(np.linspace(0, 1, 500), np.linspace(0, 1, 120))
    phase = 2 * np.pi * (9 * u + 0.25 * np.sin(2 * np.pi * 2.3 * u + 1.0) + 0.12 * np.sin(5 * v + 9 * u))
    depth = 0.030 + 0.025 * (1 - v) + 0.008 * np.sin(2 * np.pi * 3 * u)
    x = -0.92 + 1.25 * u + 0.012 * np.sin(2 * phase) + 0.02 * (1 - v) * np.sin(7 * u)
    points = np.stack([x, 0.30 + depth * np.sin(phase), 0.06 + 2.17 * v], -1)
    return _grid(points)


# --- what scenes are made of ----------------------------------------------------------------------------------------


def _room(name: str, sky: tuple[float, float, float], strength: float) -> bpy.types.Scene:
    compat.ensure_cycles()
    scene = bpy.data.scenes.new(name)
    scene[OWNED] = True
    scene.world, background = compat.new_world(name)
    background.inputs["Color"].default_value, background.inputs["Strength"].default_value = (*sky, 1), strength
    scene.render.resolution_x, scene.render.resolution_y = _SIZE
    set_unbiased(scene, _SAMPLES, 1)
    scene.cycles.max_bounces = scene.cycles.diffuse_bounces = 12
    return scene


def _ready(scene: bpy.types.Scene) -> bpy.types.Scene:
    scene.view_layers[0].update()
    update_scene(scene)
    return scene


def _add(scene: bpy.types.Scene, mesh: bpy.types.Mesh, material: bpy.types.Material) -> bpy.types.Object:
    mesh.materials.append(material)
    obj = bpy.data.objects.new(mesh.name, mesh)
    scene.collection.objects.link(obj)
    return obj


def _lamp(scene: bpy.types.Scene, kind: str, energy: float, place: Any, colour: Any) -> bpy.types.Object:
    """That looks at the origin's height one below its own; the camera sees it, as its rays through a sheet have to."""
    data = bpy.data.lights.new(kind, kind)
    data.energy, data.color = energy, colour
    data.cycles.use_multiple_importance_sampling = True
    obj = bpy.data.objects.new(kind, data)
    eye = Vector(place)
    obj.matrix_world = (
        Matrix.Translation(eye) @ (eye - Vector((0, 0, 0.6))).to_track_quat("Z", "Y").to_matrix().to_4x4()
    )
    obj.visible_camera = True
    scene.collection.objects.link(obj)
    return obj


def _camera(scene: bpy.types.Scene, place: Any, at: Any, lens: float) -> None:
    data = bpy.data.cameras.new("camera")
    data.lens, data.sensor_fit, data.sensor_height = lens, "VERTICAL", 36
    obj = bpy.data.objects.new("camera", data)
    eye = Vector(place)
    obj.matrix_world = Matrix.Translation(eye) @ (Vector(at) - eye).to_track_quat("-Z", "Y").to_matrix().to_4x4()
    scene.collection.objects.link(obj)
    scene.camera = obj


def _matte(name: str, colour: tuple[float, float, float]) -> bpy.types.Material:
    return compat.shader_material(name, "ShaderNodeBsdfDiffuse", {"Color": (*colour, 1)})


def _metal(colour: tuple[float, float, float], roughness: float) -> dict[str, Any]:
    return {"Base Color": (*colour, 1), "Metallic": 1.0, "Roughness": roughness}


def _turned(
    profile: list[tuple[float, float]], around: int, along: int, matrix: Matrix | None = None
) -> bpy.types.Mesh:
    """A profile of (radius, height) turned about the z axis."""
    places = np.linspace(0, len(profile) - 1, along * (len(profile) - 1) + 1)
    radius, height = (np.interp(places, range(len(profile)), part) for part in zip(*profile, strict=True))
    phi = np.linspace(0, 2 * np.pi, around + 1)
    ring = np.stack([np.cos(phi), np.sin(phi)], -1)
    points = np.concatenate(
        [radius[:, None, None] * ring[None], np.broadcast_to(height[:, None, None], (len(height), len(phi), 1))], -1
    )
    mesh = _grid(points)
    if matrix is not None:
        mesh.transform(matrix)
    return mesh


def _plane(corner: Any, across: Any, up: Any) -> bpy.types.Mesh:
    at, u, v = (np.array(part, float) for part in (corner, across, up))
    return _grid(np.array([[at, at + u], [at + v, at + u + v]]))


def _box(low: Any, high: Any) -> bpy.types.Mesh:
    mesh = bpy.data.meshes.new("box")
    corners = [(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
    mesh.from_pydata(corners, [], [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
    return mesh


def _grid(points: Any) -> bpy.types.Mesh:
    """A smooth mesh over points (rows, columns, 3), its UV running from 0 to 1 along each."""
    rows, columns = points.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    quads = np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], -1).reshape(-1, 4)
    mesh = bpy.data.meshes.new("grid")
    mesh.from_pydata(points.reshape(-1, 3).tolist(), [], quads.tolist())
    v, u = np.meshgrid(np.linspace(0, 1, rows), np.linspace(0, 1, columns), indexing="ij")
    uv = np.stack([u, v], -1).reshape(-1, 2)[quads.ravel()]
    mesh.uv_layers.new(name="UVMap").data.foreach_set("uv", uv.astype(np.float32).ravel())
    mesh.shade_smooth()
    return mesh
