"""Figures 3 to 7 of Mallett & Yuksel 2016, from one command.

Figures 3 (intensity), 5 (a light that turns) and 6 (resolution) have modules of their own; here are the picture sheets
of figures 4 (parameterisations) and 7 (filters). Without measurements analytic materials stand in for them.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import bpy
import figure_intensity
import figure_resolution
import figure_turning
import numpy as np
from materials import SHARED, has_measurements, merl_file
from measured_materials.addon.rendering.contact_sheet import Cell, write_sheet
from measured_materials.addon.studio.studio import build_studio, remove_studio, render_linear
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.images.image_io import read_image, write_image
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.source import Array, BrdfSource
from measured_materials.bake.sources import read_source
from measured_materials.bake.sources.analytic import MetallicPaint, Ward
from measured_materials.nodes import compat, expr
from measured_materials.nodes.data_image import load_data_image
from measured_materials.nodes.group import call
from measured_materials.nodes.local_frame_group import viewer_frame_group
from measured_materials.nodes.material_tree import remove_unused
from measured_materials.nodes.table_lookup_group import table_lookup_group
from pictures import picture

_GAIN = 4.0


def run(out: Path, quick: bool) -> None:
    """Sheets, plots and tables of all five; --quick takes fewer materials and resolutions and renders small."""
    with tempfile.TemporaryDirectory() as folder:
        _figure_4(out, Path(folder), quick)
        _figure_7(out, Path(folder), quick)
    figure_turning.run(out, quick)
    figure_intensity.run(out, quick)
    figure_resolution.run(out, quick)


def _figure_4(out: Path, folder: Path, quick: bool) -> None:
    """Uniform and Bezier at 64 x 64 x 128 beside a 256 x 256 x 512 reference under an environment."""
    environment: Path | None = None
    sources: dict[str, BrdfSource] = {"metallic paint": MetallicPaint(coat_alpha=0.1)}
    if has_measurements():
        environment = _soft(SHARED / "data" / "envmaps" / "sunset.exr", folder)
        sources = {name: read_source(merl_file(name, folder)) for name in ("alum-bronze", "blue-metallic-paint2")}
    size, samples = (160, 48) if quick else (240, 160)
    cells = []
    for name, source in list(sources.items())[: 1 if quick else None]:
        arguments = {"size": size, "samples": samples, "environment": environment}
        reference, _ = picture(source, BakeSettings(resolution=256, storage=Storage.HALF), **arguments)
        for kind in ("uniform", "bezier"):
            pixels, result = picture(source, BakeSettings(parameterization=kind, basis="normal"), **arguments)
            rms = float(np.sqrt(((pixels - reference) ** 2).mean()))
            cells.append(
                Cell(pixels, f"{name}, {kind} 64 x 64 x 128", f"table RMS {result.facts['errors']['rms']:.3g}")
            )
            cells.append(Cell(_GAIN * np.abs(pixels - reference), f"difference x {_GAIN:g}", f"picture RMS {rms:.4f}"))
        cells.append(Cell(reference, f"{name}, bytes of 256 x 256 x 512", "reference"))
    _save(
        out / "figure-4.png",
        cells,
        5,
        f"Mallett & Yuksel, figure 4: equal sizes under {'sunset.exr, softened' if environment else 'soft light'}",
    )


def _soft(file: Path, folder: Path) -> Path:
    """The environment at 32 x 16: the small lamps of the original would drown a mirror-only picture in noise."""
    pixels = read_image(file)[..., :3]
    height, width = (size // n for size, n in zip(pixels.shape[:2], (16, 32), strict=True))
    small = pixels.reshape(16, height, 32, width, 3).mean((1, 3))
    write_image(folder / "environment.exr", small, Storage.FLOAT32)
    return folder / "environment.exr"


def _figure_7(out: Path, folder: Path, quick: bool) -> None:
    """Where linear interpolation shows its contours: coarse tables under one distant light, without noise.

    The lookup group itself is rendered: f cos towards a fixed light, as emission. Path tracing's noise would hide the
    very kinks that the picture is about.
    """
    size = 600 if quick else 900
    source: BrdfSource = Ward(alpha=0.25, diffuse=(0.02,) * 3, specular=(0.3,) * 3)
    if has_measurements():
        source = read_source(merl_file("black-oxidized-steel", folder))
    paper: dict[str, Any] = {"basis": "normal", "parameterization": "bezier"}
    coarse = {"resolution": 14, **paper}
    variants = [
        ("nearest, 14 x 14 x 28", BakeSettings(**coarse, filter="nearest")),
        ("trilinear", BakeSettings(**coarse)),
        ("B-spline, plain as in the paper", BakeSettings(**coarse, filter="bspline", spline="plain")),
        ("B-spline, fitted >= 0", BakeSettings(**coarse, filter="bspline", spline="fitted")),
        ("trilinear, 128 x 128 x 256", BakeSettings(resolution=128, **paper)),
    ]
    cells = []
    shaded = []
    for k, (label, settings) in enumerate(variants):
        result = bake_source(source, folder / f"figure-7-{k}", settings)
        shaded.append(_shade(read_bundle(result.path), size))
        cells.append(
            Cell(shaded[-1] * (0.8 / shaded[-1].max()), label, f"table RMS {result.facts['errors']['rms']:.2g} 1/sr")
        )
    cells += [Cell(_slope(pixels), "slope of the brightness", "contours show as edges") for pixels in shaded]
    _save(
        out / "figure-7.png",
        cells,
        len(variants),
        f"Mallett & Yuksel, figure 7: filters, {source.name}, one distant light",
    )


def _shade(bundle: Bundle, size: int) -> Array:
    """A sphere that emits f cos of the material towards one light direction, linear (size, size, 3)."""
    material = compat.new_material("figure 7")
    facts = bundle.material["table"]
    half = facts["storage"] == "half"
    image = load_data_image(bundle.image_path("table"), "figure 7", half=half, pack=True)
    table = BrdfRecord.read(bundle).table
    scale, offset = 1 / table.scale, table.offset
    lookup = table_lookup_group("Figure 7", image, table.grid, facts["filter"], scale, offset=offset)
    with expr.building(material.node_tree) as tree:
        geometry = expr.node("ShaderNodeNewGeometry", {}, {})
        normal, incoming = (expr.Vector(geometry.outputs[name]) for name in ("Normal", "Incoming"))
        wo, tangent, bitangent = call(viewer_frame_group(), normal, incoming)
        light = expr.vec(-0.42, -0.62, 0.66)
        wi = expr.vec(*(expr.dot(light, axis) for axis in (tangent, bitangent, normal)))
        value = expr.scale(call(lookup, wi, wo, 0.5), expr.maximum(expr.components(wi)[2], 0.0))
        emission, output = tree.nodes.new("ShaderNodeEmission"), tree.nodes.new("ShaderNodeOutputMaterial")
        expr.feed(tree, emission.inputs["Color"], value)
        tree.links.new(emission.outputs[0], output.inputs["Surface"])
    scene = build_studio(material, resolution=(size, size), samples=9, shape="sphere")
    try:
        pixels = render_linear(scene)
        return pixels[int(0.2 * size) : int(0.6 * size), int(0.23 * size) : int(0.63 * size)]
    finally:
        remove_studio(scene)
        bpy.data.materials.remove(material)
        remove_unused(lookup)


def _slope(pixels: Array) -> Array:
    """Magnitude of the gradient of log brightness: a kink of the interpolation is an edge in it."""
    log = np.log(np.maximum(pixels.mean(-1), 1e-3))
    slope = np.hypot(*np.gradient(log))
    return np.repeat(np.clip(slope * (len(pixels) / 12), 0, 1)[..., None] ** 2.2, 3, -1)


def _save(path: Path, cells: list[Cell], columns: int, title: str) -> None:
    write_sheet(path, cells, columns, title)
    print(f"  {path}")
