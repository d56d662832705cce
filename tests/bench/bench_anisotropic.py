"""Anisotropic materials: error against bytes in both bases, and of envelope and residual; a brushed disc, and times."""

from __future__ import annotations

import math
import tempfile
import time
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix
from measured_materials.addon.rendering.renderer import set_unbiased
from measured_materials.addon.studio.studio import remove_studio, render_linear
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.preview_sphere import to_srgb
from measured_materials.bake.brdf.reflection import reflection_of
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.images.image_io import write_png
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.source import Array, BrdfSource
from measured_materials.bake.sources.analytic import AshikhminShirley, Ggx, Ward
from measured_materials.bake.tables.accuracy import direction_pairs, linear_estimate
from measured_materials.bake.tables.atlas import AtlasLayout
from measured_materials.bake.tables.grids.anisotropic_grids import NORMAL_KINDS
from measured_materials.bake.tables.search.grid_search import best_horizon, choose_grid
from measured_materials.bake.tables.treated_source import TreatedSource
from measured_materials.nodes import compat, expr
from measured_materials.nodes.material import build_material
from record import put

BRUSHED = Ggx(alpha=0.06, alpha_y=0.35, f0=(0.9, 0.75, 0.55))
SOURCES: dict[str, BrdfSource] = {
    "brushed metal": BRUSHED,
    "fine brushing": Ggx(alpha=0.02, alpha_y=0.15, fresnel="conductor", eta=(0.2, 0.9, 1.1), k=(3.9, 2.4, 2.2)),
    "satin": Ward(alpha=0.12, alpha_y=0.35, diffuse=(0.3, 0.1, 0.05), specular=0.4),
    "Ashikhmin-Shirley": AshikhminShirley(exponent=1000, exponent_y=20),
}


def run(out: Path, quick: bool) -> None:
    """All four; with --quick fewer resolutions and smaller pictures."""
    _errors((32, 48) if quick else (16, 24, 32, 48, 64, 96))
    _residuals(16 if quick else 32)
    with tempfile.TemporaryDirectory() as folder:
        result = bake_source(BRUSHED, Path(folder) / "brushed", BakeSettings(48 if quick else 64))
        bundle = read_bundle(result.path)
        sizes = {name: f"{bundle.image_path(name).stat().st_size / 1e6:.1f}" for name in bundle.material["images"]}
        print(f"brushed metal baked in {result.seconds} s; file MB: {sizes}")
        materials = {
            "Cycles' closure": _truth(),
            "Principled": anisotropic_principled(),
            "exact": build_material(bundle, mode="exact"),
            "reference": build_material(bundle, mode="reference"),
        }
        for material in materials.values():
            brush_around(material)
        _pictures(out, materials, 96 if quick else 240, 32 if quick else 256)
        _times(materials, 128 if quick else 256, 16 if quick else 64)


def _errors(resolutions: tuple[int, ...]) -> None:
    pairs = direction_pairs(8192, turned=True)
    heads = f"{'material':20s} {'basis':6s} {'spacing':8s} {'samples':>20s}"
    print(f"{heads} {'MB (half)':>9s} {'RMS 1/sr':>9s} {'energy off':>10s}")
    for name, source in SOURCES.items():
        truth = source.evaluate(pairs.wi, pairs.wo)
        for n in resolutions:
            for basis, kind in (("half", "auto"), *(("normal", kind) for kind in NORMAL_KINDS)):
                grid = choose_grid(source, n, (basis,), kind).grid  # type: ignore[arg-type]
                error = linear_estimate(source, grid, pairs) - truth
                width, height = AtlasLayout.of(grid).size
                memory = width * height * Storage.HALF.render_bytes(3) / 1e6
                size = " x ".join(map(str, grid.shape))
                words = f"{name:20s} {basis:6s} {'slopes' if kind == 'auto' else kind:8s} {size:>20s}"
                off = pairs.relative_error(error, truth)
                put(f"RMS, {name}, {basis} {kind}, {n}", pairs.rms(error))
                put(f"MB, {name}, {basis} {kind}, {n}", memory)
                print(f"{words} {memory:9.2f} {pairs.rms(error):9.5f} {off:10.2%}")


def _residuals(n: int) -> None:
    """RMS and energy off of E + R by grids of equal bytes: the table's, and the one that is chosen for R."""
    pairs = direction_pairs(8192, turned=True)
    for name, source in SOURCES.items():
        treated = TreatedSource(source)
        truth = treated.evaluate(pairs.wi, pairs.wo)
        choice = choose_grid(treated, n)
        grid = best_horizon(treated, choice.grid, pairs, truth)
        reflection = reflection_of(treated, grid, choice, BakeSettings(n))
        fit = reflection.fit_envelope(lambda _: None)
        left = reflection.residual(fit)
        envelope = fit.evaluate(pairs.wi, pairs.wo)
        for which, used in (("table's", grid), ("its own", reflection.residual_grid(left, grid, lambda _: None))):
            error = envelope + linear_estimate(left, used, pairs) - truth
            rms, off = pairs.rms(error), pairs.relative_error(error, truth)
            put(f"RMS of E + R, {name}, {which}, {n}", rms)
            size = " x ".join(map(str, used.shape))
            print(f"{name:20s} residual on {which:8s} grid {size:>18s} {rms:9.5f} {off:10.2%}", flush=True)


def _truth() -> bpy.types.Material:
    """Cycles' own lobe of the brushed metal, without its Fresnel: close, but darker at grazing angles."""
    material = compat.new_material("truth")
    with expr.building(material.node_tree) as tree:
        tangent = expr.Vector(expr.node("ShaderNodeTangent", {"direction_type": "UV_MAP"}, {}).outputs[0])
        inputs = {
            "Color": expr.vec(*BRUSHED.f0),
            "Roughness": (0.06 * 0.35) ** 0.25,
            "Anisotropy": 1 - (0.06 / 0.35) ** 0.5,
            "Tangent": tangent,
        }
        made = expr.node("ShaderNodeBsdfAnisotropic", {"distribution": "GGX"}, inputs)
        expr.feed(tree, tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"], expr.Scalar(made.outputs[0]))
    return material


def anisotropic_principled() -> bpy.types.Material:
    """A Principled BSDF that looks about like the brushed metal."""
    material = compat.new_material("Principled")
    with expr.building(material.node_tree) as tree:
        tangent = expr.Vector(expr.node("ShaderNodeTangent", {"direction_type": "UV_MAP"}, {}).outputs[0])
        inputs = {"Metallic": 1.0, "Roughness": 0.38, "Anisotropic": 0.9, "Tangent": tangent}
        made = expr.node("ShaderNodeBsdfPrincipled", {}, {"Base Color": expr.vec(*BRUSHED.f0), **inputs})
        expr.feed(tree, tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"], expr.Scalar(made.outputs[0]))
    return material


def brush_around(material: bpy.types.Material) -> None:
    """Tangents about the z axis, as on a turned disc."""
    for node in material.node_tree.nodes:
        if node.bl_idname == "ShaderNodeTangent":
            node.direction_type, node.axis = "RADIAL", "Z"


def _disc_scene(material: bpy.types.Material, azimuth: float, size: int, samples: int) -> bpy.types.Scene:
    compat.ensure_cycles()
    scene = bpy.data.scenes.new("disc")
    mesh = bpy.data.meshes.new("disc")
    angle = np.linspace(0, 2 * np.pi, 97)[:-1]
    mesh.from_pydata([(math.cos(a), math.sin(a), 0) for a in angle], [], [tuple(range(96))])
    mesh.uv_layers.new()
    mesh.materials.append(material)
    scene.collection.objects.link(bpy.data.objects.new("disc", mesh))
    light = bpy.data.lights.new("lamp", "AREA")
    light.energy, light.size = 120, 0.7
    lamp = bpy.data.objects.new("lamp", light)
    lamp.matrix_world = Matrix.Rotation(azimuth, 4, "Z") @ Matrix.Rotation(0.7, 4, "X") @ Matrix.Translation((0, 0, 3))
    scene.collection.objects.link(lamp)
    scene.world, background = compat.new_world("dim")
    background.inputs["Color"].default_value = (0.1, 0.1, 0.12, 1)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.matrix_world = Matrix.Rotation(0.5, 4, "X") @ Matrix.Translation((0, 0, 5.2))
    camera.data.lens = 75
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.render.resolution_x = scene.render.resolution_y = size
    set_unbiased(scene, samples=samples, seed=0)
    return scene


def _pictures(out: Path, materials: dict[str, bpy.types.Material], size: int, samples: int) -> None:
    rows: list[Array] = []
    for name in ("Cycles' closure", "exact", "reference"):
        pictures = []
        for azimuth in np.arange(4) * (math.pi / 4):
            scene = _disc_scene(materials[name], float(azimuth), size, samples)
            pictures.append(render_linear(scene))
            remove_studio(scene)
        rows.append(np.concatenate(pictures, 1))
    sheet = np.concatenate(rows, 0)
    exposure = 0.8 / max(float(np.percentile(sheet, 97)), 1e-6)
    write_png(out / "anisotropic.png", (to_srgb(sheet * exposure) * 255 + 0.5).astype(np.uint8))
    print(
        f"rows: Cycles' closure, exact, reference; the light a quarter turn in three steps: {out / 'anisotropic.png'}"
    )


def _times(materials: dict[str, bpy.types.Material], size: int, samples: int) -> None:
    times: dict[str, list[float]] = {name: [] for name in materials}
    # Interleaved, so that whatever else the machine does meets all alike; the first round warms up.
    for _ in range(4):
        for name, material in materials.items():
            scene = _disc_scene(material, 0.4, size, samples)
            started = time.perf_counter()
            render_linear(scene)
            times[name].append(time.perf_counter() - started)
            remove_studio(scene)
    base = float(np.median(times["Principled"][1:]))
    for name, seconds in times.items():
        median = float(np.median(seconds[1:]))
        print(f"  {name:18s} {size * size * samples / median / 1e6:6.3f} million samples/s   x {median / base:.2f}")
