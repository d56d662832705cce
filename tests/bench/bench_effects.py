"""Effort follows the scene: nodes, time per sample and picture of the graph fitted to it, beside the full graph."""

from __future__ import annotations

import math
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import bpy
import numpy as np
from bench_arc import ELEVATIONS, cloth_photographs
from csv_rows import write_rows
from engine_scenes import lit, on_sphere, show
from measured_materials import addon
from measured_materials.addon.lights import light_tables
from measured_materials.addon.material.bake_photographs import set_repeat
from measured_materials.addon.material.build_brdf import build_brdf
from measured_materials.addon.material.build_shading_map import build_map
from measured_materials.addon.material.choices import Choices, show_choices
from measured_materials.addon.studio.studio import render_linear
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.errors import BakeError
from measured_materials.bake.images.image_io import write_image
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.shading_maps.bake import bake_arc
from measured_materials.bake.shading_maps.record import ShadingMapRecord
from measured_materials.bake.source import Array
from measured_materials.bake.sources.analytic import MetallicPaint, by_name
from measured_materials.nodes.aimed_light_group import MAX_SLOTS, aim_by, aimed_light_group
from measured_materials.nodes.shading_map_material import build_shading_map
from rich.console import Console
from rich.table import Table
from scipy import stats

sys.path.insert(1, str(Path(__file__).resolve().parents[1]))

from support.node_count import count_nodes

EDGE, SAMPLES, SEEDS = 64, 64, 8


@dataclass(frozen=True)
class Case:
    """A scene of `engine_scenes.LIGHTS`, what is changed in it, and the material."""

    light: str
    change: Callable[[bpy.types.Scene], None] | None = None
    material: str = "paint"


def _two_more_lamps(scene: bpy.types.Scene) -> None:
    for k, side in enumerate((-1, 1)):
        lamp = bpy.data.lights.new(f"lamp {k}", "POINT" if k else "SPOT")
        lamp.energy, lamp.shadow_soft_size = 40, 0.2
        obj = bpy.data.objects.new(lamp.name, lamp)
        obj.location = (2 * side, -2, 2)
        obj.rotation_euler = (0.78, 0, 0.78 * side)
        scene.collection.objects.link(obj)


CASES = {
    "sky only": Case("sky"),
    "one lamp": Case("small lamp"),
    "sun and sky": Case("sun and sky"),
    "three lamps": Case("small lamp", _two_more_lamps),
    "HDR world": Case("HDR world"),
    "chalk under a lamp": Case("small lamp", None, "chalk"),
}


def run(out: Path, quick: bool) -> None:
    """A table and effects.csv; then what is refused."""
    names = list(CASES)[:2] if quick else list(CASES)
    with tempfile.TemporaryDirectory() as folder:
        # Chalk is nearly Lambertian: the case in which no residual is worth a mirror.
        sources = {"paint": MetallicPaint(), "chalk": by_name("lambert")}
        bundles = {name: _baked(source, Path(folder) / name) for name, source in sources.items()}
        rows = [_row(name, CASES[name], bundles[CASES[name].material], quick) for name in names]
        if not quick:
            rows.append(_far_row(Path(folder)))
        refusal = _refusal(bundles["paint"])
    _print(rows, refusal)
    write_rows(out / "effects.csv", rows)


def _baked(source: object, path: Path) -> Bundle:
    return read_bundle(bake_source(source, path, BakeSettings(resolution=32, alpha=(0.5, 0.2))).path)


def _row(name: str, case: Case, bundle: Bundle, quick: bool) -> dict[str, object]:
    """One scene: the fitted graph beside the full one, turn by turn."""
    with lit(case.light) as scene:
        if case.change:
            case.change(scene)
        fitted, plan = build_brdf(bundle, choices=Choices(), scene=scene)
        full, _ = build_brdf(bundle, choices=Choices(aim="always", residual="always"), scene=scene)
        return _beside(name, scene, fitted, full, [e.name for e in plan.effects if not e.kept], quick)


def _far_row(folder: Path) -> dict[str, object]:
    """A cloth whose texels are a tenth of a pixel."""
    source = folder / "cloth"
    source.mkdir()
    for elevation, picture in zip(ELEVATIONS, cloth_photographs(512)):
        write_image(source / f"el{elevation:02d}.exr", picture.astype(np.float32), Storage.FLOAT32)
    bundle = read_bundle(bake_arc(source, folder / "cloth.mmat").path)
    addon.register()
    try:
        with lit("sun and sky") as scene:
            built = {}
            for name, choices in (("fitted", Choices()), ("full", Choices(aim="always", detail="always"))):
                material = build_shading_map(bundle)
                scene.render.resolution_x = scene.render.resolution_y = EDGE
                set_repeat(material, 12.0, ShadingMapRecord.read(bundle).map.layout)
                show_choices(material.measured_quality, choices)
                show(scene, material)
                account = build_map(bundle, material, ShadingMapRecord.read(bundle).render, pack=False, scene=scene)
                built[name] = material, [e["name"] for e in account["effects"] if not e["kept"]]
            (fitted, left_out), (full, _) = built["fitted"], built["full"]
            return _beside("far away (cloth)", scene, fitted, full, left_out, False)
    finally:
        addon.unregister()


def _beside(
    name: str,
    scene: bpy.types.Scene,
    fitted: bpy.types.Material,
    full: bpy.types.Material,
    left_out: list[str],
    quick: bool,
) -> dict[str, object]:
    """Both graphs in turn."""
    graphs = {"fitted": fitted, "full": full}
    pictures: dict[str, list[Array]] = {graph: [] for graph in graphs}
    seconds: dict[str, list[float]] = {graph: [] for graph in graphs}
    nodes = {}
    for seed in range(3 if quick else SEEDS):
        for graph, material in graphs.items():
            with _holding(scene, material, everything=graph == "full"):
                nodes[graph] = count_nodes(material.node_tree)
                _render(scene, 1, seed)  # compiles
                few = _render(scene, 4, seed)[1]
                pixels, whole = _render(scene, SAMPLES, seed + 1000 * (graph == "full"))
            pictures[graph].append(pixels)
            seconds[graph].append((whole - few) / (SAMPLES - 4))
    difference, p = _compare(pictures["fitted"], pictures["full"])
    time_ratio = statistics.median(a / b for a, b in zip(seconds["fitted"], seconds["full"]))
    return {
        "scene": name,
        "left out": "; ".join(left_out) or "-",
        "nodes": nodes["fitted"],
        "nodes of the full graph": nodes["full"],
        "time": round(time_ratio, 3),
        "noise": round(_noise(pictures["fitted"]) / _noise(pictures["full"]), 3),
        "difference_percent": round(100 * difference, 3),
        "p": p,
    }


@contextmanager
def _holding(scene: bpy.types.Scene, material: bpy.types.Material, *, everything: bool) -> Iterator[None]:
    """Show a material; with `everything` its graph aims at as many lamps and at a world as it ever could."""
    slots = next(obj for obj in scene.objects if obj.name.startswith("sphere")).data.materials
    slots.clear()
    slots.append(material)
    light_tables.update_scene(scene)
    before = light_tables.keep_current
    if everything:
        aim_by(aimed_light_group(light_tables.lamp_image()), MAX_SLOTS, world=True)
        # Rendering would bring the graph back in line with the scene.
        light_tables.keep_current = lambda scene: None
    try:
        yield
    finally:
        light_tables.keep_current = before


def _render(scene: bpy.types.Scene, samples: int, seed: int) -> tuple[Array, float]:
    scene.render.resolution_x = scene.render.resolution_y = EDGE
    scene.cycles.samples, scene.cycles.seed = samples, seed
    began = time.process_time()
    pixels = render_linear(scene)
    return pixels, time.process_time() - began


def _compare(a: list[Array], b: list[Array]) -> tuple[float, float]:
    """Relative difference of the means, and the p of Welch's t-test over 8 x 8 tiles after Sidak."""
    mask = on_sphere(EDGE)
    tiles = [np.array([_tiles(pixels, mask) for pixels in pictures]) for pictures in (a, b)]
    p = stats.ttest_ind(*tiles, equal_var=False).pvalue
    lowest = float(np.nanmin(p))
    means = [np.mean([pixels[mask].mean() for pixels in pictures]) for pictures in (a, b)]
    return float(means[0] / means[1] - 1), -math.expm1(p.size * math.log1p(-min(lowest, 1 - 1e-12)))


def _tiles(pixels: Array, mask: Array) -> Array:
    inside = np.where(mask[..., None], pixels, 0).reshape(8, EDGE // 8, 8, EDGE // 8, 3).sum((1, 3))
    count = mask.reshape(8, EDGE // 8, 8, EDGE // 8).sum((1, 3))
    return inside[count > 16] / count[count > 16][:, None]


def _noise(pictures: list[Array]) -> float:
    mask = on_sphere(EDGE)
    return float(np.sqrt(np.var([pixels[mask] for pixels in pictures], axis=0, ddof=1).mean()))


def _refusal(bundle: Bundle) -> str:
    """What a wish to leave out a residual that carries light comes to."""
    try:
        build_brdf(bundle, choices=replace(Choices(), residual="never"))
    except BakeError as error:
        return f"{error.cause}; {error.remedy}"
    return "NOT REFUSED"


def _print(rows: list[dict[str, object]], refusal: str) -> None:
    table = Table(title="Fitted to the scene, beside the full graph (time per sample and noise relative to it)")
    for column in ("scene", "left out", "nodes", "time", "noise", "difference", "p"):
        table.add_column(column, justify="left" if column in ("scene", "left out") else "right")
    for row in rows:
        nodes = f"{row['nodes']} of {row['nodes of the full graph']}"
        table.add_row(
            str(row["scene"]),
            str(row["left out"]),
            nodes,
            f"{row['time']:.2f}",
            f"{row['noise']:.2f}",
            f"{row['difference_percent']:+.2f} %",
            f"{row['p']:.2g}",
        )
    Console(width=150).print(table)
    print(f"paint without its residual: {refusal}")
