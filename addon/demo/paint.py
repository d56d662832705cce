"""The demonstration: one simulated measurement, three tables of equal size, what a bake makes of it by itself, and the
truth beside them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...bake.brdf.bake import bake_file
from ...bake.brdf.parts import ErrorsRecord
from ...bake.brdf.record import BrdfRecord
from ...bake.brdf.settings import BakeSettings
from ...bake.bundle.bundle import read_bundle
from ...bake.bundle.result import BakeResult
from ...bake.source import Array
from ...bake.sources.analytic import MetallicPaint
from ...bake.sources.merl import write_merl
from ...nodes.brdf_group import BrdfParts, brdf_group
from ...nodes.data_image import bundle_image
from ...nodes.feature_passes import albedo_polynomial, with_feature_outputs
from ...nodes.material import build_material
from ...nodes.material_tree import assemble
from ...nodes.metallic_paint_group import metallic_paint_group
from ...nodes.osl_script import use_osl, why_no_osl
from ...nodes.table_groups import TableGroups, sampler_groups
from ..lights.light_tables import lamp_image
from ..material.build_brdf import build_brdf
from ..material.choices import ALWAYS, OSL, Choices
from ..rendering.contact_sheet import Cell, to_display, write_sheet
from ..rendering.denoising import denoise_by_twin, denoise_renders, twin_of, why_not_possible
from ..studio.studio import build_studio, remove_studio, render_linear

Progress = Callable[[str, float], None]

PAINT = MetallicPaint(diffuse=(0.01, 0.02, 0.07), flake=(0.12, 0.25, 0.62), flake_alpha=0.28, coat_alpha=0.05)
TABLES = ("identity", "uniform", "bezier")
# The bake that nothing was asked of, rendered in mode Exact.
USUAL, TRUTH = "usual", "truth"
# How many times enlarged the differences of the sheet's third row are.
_DIFFERENCE_GAIN = 8.0


@dataclass(frozen=True)
class _Shown:
    """One column of the sheet."""

    label: str
    picture: Array
    render_seconds: float
    bake: BakeResult | None = None


def run_demo(out: Path, *, quick: bool = False, progress: Progress | None = None) -> dict[str, Any]:
    """Simulate, bake, render, compare; everything lands in `out`.

    Returns
    -------
    JSON-ready: "picture", "measurement", "rows" (one per table) and "lines" to print
    """
    say = progress or (lambda stage, share: None)
    out = Path(out).resolve()
    out.mkdir(parents=True, exist_ok=True)
    size, samples = (240, 16) if quick else (360, 32)
    started = time.perf_counter()
    say("simulating a measurement", 0.0)
    measurement = out / "metallic_paint.binary"
    write_merl(measurement, PAINT)
    bakes = {}
    for k, kind in enumerate((*TABLES, USUAL)):
        say("baking", k / (len(TABLES) + 1))
        # Tables are compared here, each shown whole by mirror alone.
        settings = BakeSettings(parameterization=kind, basis="normal", envelope=False) if kind != USUAL else None
        name = f"metallic_paint_{kind}.mmat" if kind != USUAL else "metallic_paint.mmat"
        bakes[kind] = bake_file(measurement, out / name, settings or BakeSettings())
    shown = []
    kinds = (*TABLES, USUAL, TRUTH)
    for k, kind in enumerate(kinds):
        step = partial(_step, say, k, len(kinds))
        step(0.0)
        bake = bakes.get(kind)
        began = time.perf_counter()
        if kind == USUAL:
            picture = _render_usual(bakes[USUAL].path, size, samples, step)
        elif bake is None:
            # Of random numbers of its own, lest a table share the truth's noise and look better than it is.
            picture = _render(_truth_material(bakes["bezier"].path), size, 2 * samples, step, seed=2)
        else:
            picture = _render(_table_material(bake.path), size, samples, step)
        shown.append(_Shown(kind, picture, time.perf_counter() - began, bake))
    sheet = out / "demo.png"
    _write(sheet, shown)
    rows = [_row(column, shown[-1].picture) for column in shown if column.bake]
    seconds = time.perf_counter() - started
    return {
        "picture": str(sheet),
        "measurement": str(measurement),
        "rows": rows,
        "seconds": round(seconds, 1),
        "lines": _lines(rows, shown[-1], sheet, measurement, seconds),
    }


def _step(say: Progress, k: int, count: int, share: float) -> None:
    say("rendering", (k + share) / count)


def _table_material(path: Path) -> bpy.types.Material:
    """The whole table by a mirror that aims at the lamp."""
    return build_material(read_bundle(path), mode="reference", lamps=lamp_image(), features=True)


def _truth_material(bundle_path: Path) -> bpy.types.Material:
    """The analytic paint evaluated in the shader, drawn from the same sampler."""
    bundle = read_bundle(bundle_path)
    record = BrdfRecord.read(bundle)
    image = bundle_image(bundle, "sampler", "truth sampler")
    make_sampler, make_density = sampler_groups(record.sampler)
    sampler = make_sampler("MM Sampler truth", image, record.sampler)
    density = make_density("MM Sampler Density truth", image, record.sampler)
    material = bpy.data.materials.new("truth")
    truth = BrdfParts(TableGroups(metallic_paint_group(PAINT), sampler, density), lamps=lamp_image())
    group = with_feature_outputs(brdf_group("Analytic truth", "reference", truth), albedo_polynomial(record))
    assemble(material, group, (0.1, 0.2, 0.5))
    return material


def _render(
    material: bpy.types.Material, size: int, samples: int, progress: Callable[[float], None], seed: int = 1
) -> Array:
    """A material of nodes that writes the denoiser's passes."""
    with _studio(material, size, samples, seed) as scene:
        if not why_not_possible():
            denoise_renders(scene)
        return render_linear(scene, progress=progress)


def _render_usual(path: Path, size: int, samples: int, progress: Callable[[float], None]) -> Array:
    """Mode Exact: as OSL, which samples the lamp in the shader, or of nodes where this Blender has no OSL."""
    record = BrdfRecord.read(read_bundle(path))
    material = bpy.data.materials.new("usual")
    with _studio(material, size, samples) as scene:
        if why_no_osl():
            if not why_not_possible():
                denoise_renders(scene)
            build_brdf(record, material, choices=Choices(), scene=scene)
            return render_linear(scene, progress=progress)
        build_brdf(record, material, choices=Choices(sample=ALWAYS, shader=OSL), scene=scene)
        use_osl(scene)
        noisy = render_linear(scene, progress=progress)
        return noisy if why_not_possible() else denoise_by_twin(twin_of(record), scene, material, noisy)


@contextmanager
def _studio(material: bpy.types.Material, size: int, samples: int, seed: int = 1) -> Iterator[bpy.types.Scene]:
    scene = build_studio(material, resolution=(size, size), samples=samples, seed=seed)
    try:
        yield scene
    finally:
        remove_studio(scene)


def _difference(picture: Array, truth: Array) -> Array:
    return np.abs(picture - truth) * _DIFFERENCE_GAIN


def _detail(picture: Array) -> Array:
    """The highlight of the ball, twice as large."""
    size = len(picture)
    top, left = int(0.18 * size), int(0.15 * size)
    part = picture[top : top + size // 3, left : left + size // 3]
    return np.repeat(np.repeat(part, 3, 0), 3, 1)[:size, :size]


def _write(path: Path, shown: list[_Shown]) -> None:
    truth = shown[-1].picture
    cells = []
    for column in shown:
        below = "evaluated in the shader, no table"
        if column.bake:
            below = f"RMS {_errors_of(column.bake).rms:.2g} 1/sr"
        cells.append(Cell(column.picture, _label(column.label), below))
    cells += [Cell(_detail(column.picture), "highlight, enlarged 3 times") for column in shown]
    cells += [
        Cell(_difference(column.picture, truth), f"difference to the truth x {_DIFFERENCE_GAIN:g}")
        if column.bake
        else Cell(np.zeros_like(truth), "no difference")
        for column in shown
    ]
    title = "Metallic paint, measured on the MERL grid, as 64 x 64 x 128 tables, path-traced in stock Cycles"
    write_sheet(path, cells, len(shown), title)


def _errors_of(bake: BakeResult) -> ErrorsRecord:
    return BrdfRecord.read(read_bundle(bake.path)).errors


def _label(kind: str) -> str:
    named = {TRUTH: "analytic truth", USUAL: "best table, mode Exact"}
    return named.get(kind, f"{kind} parameterisation")


def _row(column: _Shown, truth: Array) -> dict[str, Any]:
    assert column.bake is not None
    errors, path = _errors_of(column.bake), column.bake.path
    # As displayed: a table that reflects more than arrives has single pixels of any brightness.
    shown, target = (to_display(picture).astype(float) / 255 for picture in (column.picture, truth))
    return {
        "parameterization": column.label,
        "rms": errors.rms,
        "relative_error": errors.relative,
        "picture_rms": float(np.sqrt(((shown - target) ** 2).mean())),
        "bake_seconds": column.bake.seconds,
        "render_seconds": round(column.render_seconds, 2),
        "bytes": sum(f.stat().st_size for f in path.iterdir()),
        "bundle": str(path),
    }


def _noise_words() -> str:
    if lacking := why_not_possible():
        return f"Nothing is denoised: {lacking}."
    return "All pictures are denoised by the materials' albedo and normals."


def _lines(rows: list[dict[str, Any]], truth: _Shown, sheet: Path, measurement: Path, seconds: float) -> list[str]:
    header = f"{'table':10s} {'RMS 1/sr':>9s} {'energy off':>10s} {'picture RMS':>11s} {'bake s':>7s} {'render s':>8s}"
    lines = [header + f" {'MB on disk':>10s}"]
    for row in rows:
        lines.append(
            f"{row['parameterization']:10s} {row['rms']:9.4f} {row['relative_error']:10.2%} {row['picture_rms']:11.4f} "
            f"{row['bake_seconds']:7.1f} {row['render_seconds']:8.1f} {row['bytes'] / 1e6:10.1f}"
        )
    lines.append(f"{TRUTH:10s} {'':9s} {'':10s} {'':11s} {'':7s} {truth.render_seconds:8.1f}")
    lines += [
        "",
        "RMS and energy: the stored table against the measurement, at directions it was not built from.",
        "picture RMS: as displayed, 0 to 1, against the picture of the analytic truth, what noise is left included.",
        "usual: the table that a bake chooses by itself, in mode Exact; the others and the truth by mirror alone.",
        _noise_words(),
        "",
        f"picture       {sheet}",
        f"measurement   {measurement} (MERL layout, simulated)",
        *(f"bundle        {row['bundle']}" for row in rows),
        f"all of it took {seconds:.0f} s",
    ]
    return lines
