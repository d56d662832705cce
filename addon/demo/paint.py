"""The demonstration: one simulated measurement, three tables of equal size, and the truth beside them."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
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
from ...nodes.material import build_material
from ...nodes.material_tree import assemble
from ...nodes.metallic_paint_group import metallic_paint_group
from ...nodes.table_groups import TableGroups, sampler_groups
from ..rendering.contact_sheet import Cell, to_display, write_sheet
from ..studio.studio import build_studio, remove_studio, render_linear

Progress = Callable[[str, float], None]

PAINT = MetallicPaint(diffuse=(0.01, 0.02, 0.07), flake=(0.12, 0.25, 0.62), flake_alpha=0.28, coat_alpha=0.05)
TABLES = ("identity", "uniform", "bezier")
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
    size, samples = (240, 64) if quick else (360, 160)
    started = time.perf_counter()
    say("simulating a measurement", 0.0)
    measurement = out / "metallic_paint.binary"
    write_merl(measurement, PAINT)
    bakes = {}
    for k, kind in enumerate(TABLES):
        say("baking", k / len(TABLES))
        # Tables are compared here, each shown whole by mirror alone.
        settings = BakeSettings(parameterization=kind, basis="normal", envelope=False)
        bakes[kind] = bake_file(measurement, out / f"metallic_paint_{kind}.mmat", settings)
    shown = []
    for k, kind in enumerate((*TABLES, "truth")):
        step = (k / 4, lambda share, k=k: say("rendering", (k + share) / 4))
        say("rendering", step[0])
        bake = bakes.get(kind)
        material = build_material(read_bundle(bake.path)) if bake else _truth_material(bakes["bezier"].path)
        picture, seconds = _render(material, size, samples, step[1])
        shown.append(_Shown(kind, picture, seconds, bake))
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


def _truth_material(bundle_path: Path) -> bpy.types.Material:
    """The analytic paint evaluated in the shader, drawn from the same sampler."""
    bundle = read_bundle(bundle_path)
    layout = BrdfRecord.read(bundle).sampler
    image = bundle_image(bundle, "sampler", "truth sampler")
    sampler = sampler_groups(layout)[0]("MM Sampler truth", image, layout)
    material = bpy.data.materials.new("truth")
    truth = BrdfParts(TableGroups(metallic_paint_group(PAINT), sampler))
    assemble(material, brdf_group("Analytic truth", "reference", truth), (0.1, 0.2, 0.5))
    return material


def _render(
    material: bpy.types.Material, size: int, samples: int, progress: Callable[[float], None]
) -> tuple[Array, float]:
    scene = build_studio(material, resolution=(size, size), samples=samples, seed=1)
    started = time.perf_counter()
    try:
        picture = render_linear(scene, progress=progress)
    finally:
        remove_studio(scene)
    return picture, time.perf_counter() - started


def _difference(picture: Array, truth: Array) -> Array:
    return np.abs(picture - truth) * _DIFFERENCE_GAIN


def _detail(picture: Array) -> Array:
    """The highlight of the ball, twice as large."""
    size = len(picture)
    top, left = int(0.16 * size), int(0.14 * size)
    part = picture[top : top + size // 3, left : left + size // 3]
    return np.repeat(np.repeat(part, 3, 0), 3, 1)[:size, :size]


def _write(path: Path, shown: list[_Shown]) -> None:
    truth = shown[-1].picture
    cells = []
    for column in shown:
        below = "evaluated in the shader, no table"
        if column.bake:
            below = f"RMS {_errors_of(column.bake).rms:.3f} 1/sr"
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
    return "analytic truth" if kind == "truth" else f"{kind} parameterisation"


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


def _lines(rows: list[dict[str, Any]], truth: _Shown, sheet: Path, measurement: Path, seconds: float) -> list[str]:
    header = f"{'table':10s} {'RMS 1/sr':>9s} {'energy off':>10s} {'picture RMS':>11s} {'bake s':>7s} {'render s':>8s}"
    lines = [header + f" {'MB on disk':>10s}"]
    for row in rows:
        lines.append(
            f"{row['parameterization']:10s} {row['rms']:9.4f} {row['relative_error']:10.2%} {row['picture_rms']:11.4f} "
            f"{row['bake_seconds']:7.1f} {row['render_seconds']:8.1f} {row['bytes'] / 1e6:10.1f}"
        )
    lines.append(f"{'truth':10s} {'':9s} {'':10s} {'':11s} {'':7s} {truth.render_seconds:8.1f}")
    lines += [
        "",
        "RMS and energy: the stored table against the measurement, at directions it was not built from.",
        "picture RMS: as displayed, 0 to 1, against the picture of the analytic truth, noise of both included.",
        "",
        f"picture       {sheet}",
        f"measurement   {measurement} (MERL layout, simulated)",
        *(f"bundle        {row['bundle']}" for row in rows),
        f"all of it took {seconds:.0f} s",
    ]
    return lines
