"""What Cycles' denoiser makes of a stochastic mirror: by colour alone, by Cycles' own passes, by the material's."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from csv_rows import write_rows
from measured_materials.addon.lights.light_tables import lamp_image
from measured_materials.addon.rendering.contact_sheet import Cell, write_sheet
from measured_materials.addon.studio.studio import build_studio, remove_studio, render_linear, render_rgba
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.source import Array, BrdfSource
from measured_materials.bake.sources import analytic
from measured_materials.nodes import compat
from measured_materials.nodes.feature_passes import (
    albedo_polynomial,
    denoise_by_features,
    stop_denoising,
    with_feature_outputs,
)
from measured_materials.nodes.material import build_material

# Residuals of 9, 35 and 91 % of the light: with more, more samples are mirrors.
SOURCES: dict[str, BrdfSource] = {
    "felt": analytic.OrenNayar(diffuse=(0.55, 0.12, 0.2), sigma=0.6),
    "metallic paint": analytic.MetallicPaint((0.05, 0.1, 0.3), (0.1, 0.2, 0.4), flake_alpha=0.3, coat_alpha=0.1),
    "chrome": analytic.Ward(diffuse=(0, 0, 0), specular=(0.8, 0.78, 0.75), alpha=0.05),
}
# Of similar look, no fit.
PRINCIPLED = "ShaderNodeBsdfPrincipled"
STAND_INS: dict[str, dict[str, Any]] = {
    "felt": {"Base Color": (0.4, 0.09, 0.15, 1), "Roughness": 1.0, "Specular IOR Level": 0.0},
    "metallic paint": {"Base Color": (0.16, 0.28, 0.6, 1), "Metallic": 0.7, "Coat Weight": 1.0, "Coat Roughness": 0.3},
    "chrome": {"Base Color": (0.8, 0.78, 0.75, 1), "Metallic": 1.0, "Roughness": 0.22},
}
# How Cycles denoises: the passes it is given, and their prefilter.
STOCK = {
    "colour": ("RGB", "ACCURATE"),
    "albedo": ("RGB_ALBEDO", "ACCURATE"),
    "both": ("RGB_ALBEDO_NORMAL", "ACCURATE"),
    "alb. fast": ("RGB_ALBEDO", "FAST"),
    "both raw": ("RGB_ALBEDO_NORMAL", "NONE"),
}
OURS = {"ours": "ACCURATE", "ours raw": "NONE"}
# Pixels along an edge, samples, samples of the picture that stands for the truth.
FULL, QUICK = (160, 64, 4096), (96, 16, 512)
Denoised = dict[str, Array]


def run(out: Path, quick: bool) -> None:
    """A table, a CSV and a sheet."""
    size, samples, many = QUICK if quick else FULL
    print(f"error of {size} x {size} pixels at {samples} samples on the material, against {many} samples:")
    print("root of the mean of (a - b)^2 / (b^2 + 0.01); in brackets the plain RMS")
    print("stock: passes of Cycles, prefilter accurate, fast as in the viewport, or none (raw); ours: this material's")
    heads = ["noisy", *STOCK, *OURS]
    print(f"{'':24s}" + "".join(f"{head:>16s}" for head in heads))
    rows: list[dict[str, Any]] = []
    cells: list[Cell] = []
    with tempfile.TemporaryDirectory() as folder:
        for name in ("metallic paint",) if quick else SOURCES:
            bundle = read_bundle(bake_source(SOURCES[name], Path(folder) / name.replace(" ", "-")).path)
            makers: dict[str, Callable[[], bpy.types.Material]] = {
                "exact": lambda bundle=bundle: _measured(bundle, "exact"),
                "reference": lambda bundle=bundle: _measured(bundle, "reference"),
                "Principled": lambda name=name: compat.shader_material("stand-in", PRINCIPLED, STAND_INS[name]),
            }
            truth = on = None
            for mode, make in makers.items():
                # The exact material stands for both of its modes; at these samples it is the quieter one.
                pictures, truth = _pictures(make, size, samples, many, truth if mode == "reference" else None)
                if on is None:  # the same pixels for the stand-in, which writes no passes of ours
                    on = pictures["coverage"][..., 0] > 0.99
                rows.append({"material": name, "mode": mode} | _errors(pictures, truth, on))
                _print_row(rows[-1], heads)
                cells += _row_of_cells(f"{name}, {mode}", pictures, truth, rows[-1])
    write_rows(out / "denoise.csv", rows)
    title = f"Denoising at {samples} samples: passes of Cycles and of the material, beside {many} samples"
    write_sheet(out / "denoise.png", cells, len(cells) // len(rows), title)
    print(f"  {out / 'denoise.png'}")


def _measured(bundle: Bundle, mode: str) -> bpy.types.Material:
    material = build_material(bundle, mode=mode, lamps=lamp_image())
    node = next(n for n in material.node_tree.nodes if n.bl_idname == "ShaderNodeGroup")
    node.node_tree = with_feature_outputs(node.node_tree, albedo_polynomial(BrdfRecord.read(bundle)))
    return material


def _pictures(
    make: Callable[[], bpy.types.Material], size: int, samples: int, many: int, truth: Array | None
) -> tuple[Denoised, Array]:
    """Linear pictures by what denoised them, and the passes; and the picture of many samples."""
    scene = build_studio(make(), resolution=(size, size), samples=samples, seed=1)
    try:
        pictures = {"noisy": render_linear(scene)}
        cycles = scene.cycles
        cycles.use_denoising, cycles.denoiser = True, "OPENIMAGEDENOISE"
        for name, (cycles.denoising_input_passes, cycles.denoising_prefilter) in STOCK.items():
            pictures[name] = render_linear(scene)
        for name, prefilter in OURS.items():
            denoise_by_features(scene, prefilter=prefilter)
            pictures[name] = render_linear(scene)
        pictures |= _passes(scene)
        if truth is None:
            stop_denoising(scene)
            scene.render.use_compositing = False
            cycles.samples, cycles.seed = many, 2
            truth = render_linear(scene)
    finally:
        remove_studio(scene)
    return pictures, truth


def _passes(scene: bpy.types.Scene) -> Denoised:
    """Albedo and normal as Cycles writes them and as the denoiser gets them, shown through the compositor."""
    tree = denoise_by_features(scene)
    denoise = next(n for n in tree.nodes if n.bl_idname == "CompositorNodeDenoise")
    source = denoise.inputs["Image"].links[0].from_node
    shown = denoise.outputs[0].links[0].to_socket
    found = {}
    for kind in ("Albedo", "Normal"):
        for name, socket in (
            (f"stock {kind}", source.outputs[f"Denoising {kind}"]),
            (f"our {kind}", denoise.inputs[kind].links[0].from_socket),
        ):
            tree.links.new(socket, shown)
            found[name] = render_linear(scene)
    tree.links.new(source.outputs["MM Albedo"], shown)
    found["coverage"] = render_rgba(scene)[..., 3:]
    return found


def _errors(pictures: Denoised, truth: Array, on: Array) -> dict[str, Any]:
    """By what denoised them, on the pixels `on`."""
    found: dict[str, Any] = {}
    for name in ("noisy", *STOCK, *OURS):
        difference = (pictures[name] - truth)[on]
        found[name] = float(np.sqrt((difference**2 / (truth[on] ** 2 + 0.01)).mean()))
        found[f"{name} rms"] = float(np.sqrt((difference**2).mean()))
    return found


def _print_row(row: dict[str, Any], heads: list[str]) -> None:
    cells = "".join(f"{row[head]:8.4f} {'(' + format(row[f'{head} rms'], '.4f') + ')':7s}" for head in heads)
    print(f"{row['material'] + ', ' + row['mode']:24s}" + cells, flush=True)


def _row_of_cells(label: str, pictures: Denoised, truth: Array, row: dict[str, Any]) -> list[Cell]:
    cells = [Cell(pictures["noisy"], label, f"noisy, error {row['noisy']:.3f}")]
    for whose in ("stock", "our"):
        title = "of Cycles" if whose == "stock" else "with the material's"
        cells.append(Cell(np.clip(pictures[f"{whose} Albedo"], 0, 1), "albedo", title))
        cells.append(Cell(np.clip(0.5 + 0.5 * pictures[f"{whose} Normal"], 0, 1), "normal", title))
    for name, by in (("both", "passes of Cycles"), ("ours", "the material's")):
        cells.append(Cell(pictures[name], "denoised", f"{by}, error {row[name]:.3f}"))
    return [*cells, Cell(truth, "many samples", "not denoised")]
