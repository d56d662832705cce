"""What the time of a sample in mode Exact is made of: its parts are taken away one after the other.

As OSL, whose shader samples lamps and world, the shader's text loses a part in each step; as nodes, which aim their
mirror in this Blender, the graph is built with less. What is left is no longer the material; only its time is looked
at. All variants take turns, one thread renders, and of each the time that an eighth of its turns stay below counts:
whatever else the machine does makes a turn longer, never shorter.
"""

from __future__ import annotations

import csv
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

import bpy
from engine_materials import KINDS, Kind, bake_all, bundle_path
from engine_scenes import lit, one_script, show
from materials import SHARED
from measured_materials.addon.material.build_brdf import build_brdf
from measured_materials.addon.material.choices import NEVER, Choices
from measured_materials.addon.report.principled_match import fit_principled
from measured_materials.addon.studio.studio import render_linear
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.source import BrdfSource
from measured_materials.bake.sources import analytic
from measured_materials.nodes import exact_closure, osl_material
from measured_materials.nodes.osl_script import shader_source
from record import put
from rich.console import Console
from rich.table import Table

PRINCIPLED, PRINCIPLED_OSL, WHOLE, NODES = "Principled", "Principled by OSL", "exact, OSL", "exact, nodes"
BY_SCRIPT = "exact, nodes and rays by OSL"
_FEW, _EDGE = 2, 40
# (step, text of the shader, what stands there instead), each on top of those before.
_FIXED = 'BSDF += 0.2 * (diffuse(Normal) + microfacet("ggx", Normal, vector(0), 0.02, 0.02, 0.0, 0))'
CUTS = (
    (
        "no ray to a sampled lamp",
        'return !trace(position, wi, "maxdist", mm_distance_along(aim, wi, lamp.facing) * MM_SHORT);',
        "return 1;",
    ),
    ("no light sampled at lamps", "j < points; ++j)", "j < 0; ++j)"),
    ("no light sampled at the world", "if (Lit > 0)\n        emitted +=", "if (0)\n        emitted +="),
    ("no ray of the mirror to the world", "if (Lit > 0 && mm_leaves(P, wi_world))", "if (0)"),
    (
        "mirror of a constant, no table",
        "weight = mm_lookup(table, grid, wi, frame.wo, xi[4]) * (wi[2] / pdf)",
        "weight = color(0.1)",
    ),
    ("no mirror", "if (wi[2] > 0 && seen[2] > 0) {", "if (0) {"),
    (
        "closures of fixed weights",
        "BSDF += mm_weighted_closures(envelope, first, frame, Normal, Saturation, gain * of_closures)",
        _FIXED,
    ),
)


def cut(steps: int) -> str:
    """The material's shader without the first so many parts. Raises ValueError where a text is not in it."""
    text = shader_source(osl_material.SHADER)
    for name, old, new in CUTS[:steps]:
        if old not in text:
            raise ValueError(f"{name}: {old!r} is not in the shader")
        text = text.replace(old, new)
    return text


def run(out: Path, quick: bool) -> None:
    """A table for every light, and sample_time.csv; --quick takes one material in one light."""
    samples, turns = (32, 6) if quick else (48, 16)
    rows: list[dict[str, object]] = []
    with TemporaryDirectory() as name:
        for kind, bundle, source in _materials(Path(name), quick):
            for light in ("small lamp",) if quick else ("small lamp", "HDR world"):
                rows += [
                    {"material": kind, "light": light} | row for row in _measured(bundle, source, light, samples, turns)
                ]
                _print([row for row in rows if row["material"] == kind and row["light"] == light])
    with (out / "sample_time.csv").open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, rows[0])
        writer.writeheader()
        writer.writerows(rows)


def _materials(folder: Path, quick: bool) -> Iterator[tuple[str, Bundle, BrdfSource]]:
    """Name, bundle and source: a paint, and unless `quick` a satin, a chrome vinyl and an anisotropic Ward."""

    def ward() -> BrdfSource:
        return analytic.Ward(diffuse=(0.1,) * 3, specular=(0.4,) * 3, alpha=0.15, alpha_y=0.3)

    kinds = [Kind("paint", "", analytic.MetallicPaint)]
    if not quick:
        vinyl = Kind("chrome vinyl", "chm_orange_rgb", lambda: analytic.Ward(specular=(0.6,) * 3, alpha=0.02))
        kinds += [next(kind for kind in KINDS if kind.name == "satin"), vinyl, Kind("brushed Ward", "", ward)]
    for kind in kinds:
        source = kind.source(folder) if kind.measured and (SHARED / "data").is_dir() else kind.formula()
        path = bundle_path(kind, folder) if kind.measured else folder / f"{kind.name}.mmat"
        if kind.measured:
            bake_all([kind], folder, BakeSettings())
        else:
            bake_source(source, path, BakeSettings())
        yield kind.name, read_bundle(path), source


@contextmanager
def _without(steps: int) -> Iterator[None]:
    with patch.object(osl_material, "shader_source", lambda name: cut(steps)):
        yield


def _variants(bundle: Bundle, source: BrdfSource, scene: bpy.types.Scene) -> dict[str, bpy.types.Material]:
    stand_in = fit_principled(source)
    found = {PRINCIPLED: stand_in.material(), PRINCIPLED_OSL: stand_in.material()}
    for steps, name in enumerate((WHOLE, *(name for name, _, _ in CUTS))):
        with _without(steps):
            found[name] = one_script(bundle, scene)
    found[BY_SCRIPT] = build_brdf(bundle, choices=Choices(mode="exact", shader="osl"), scene=scene)[0]
    found[NODES] = build_brdf(bundle, choices=Choices(mode="exact"), scene=scene)[0]
    found["nodes, not aimed"] = build_brdf(bundle, choices=Choices(mode="exact", aim=NEVER), scene=scene)[0]
    with patch.object(exact_closure, "choose_closure", lambda mirrored, native, mirror: native):
        found["nodes, no mirror"] = build_brdf(bundle, choices=Choices(mode="exact", aim=NEVER), scene=scene)[0]
    return found


def _measured(bundle: Bundle, source: BrdfSource, light: str, samples: int, turns: int) -> list[dict[str, object]]:
    short: dict[str, list[float]] = defaultdict(list)
    long: dict[str, list[float]] = defaultdict(list)
    with lit(light) as scene:
        scene.render.threads_mode, scene.render.threads = "FIXED", 1
        scene.render.resolution_x = scene.render.resolution_y = _EDGE
        materials = _variants(bundle, source, scene)
        for turn in range(turns):
            for name, material in materials.items():
                show(scene, material)
                if name == PRINCIPLED_OSL:
                    scene.cycles.shading_system = True
                scene.cycles.seed = turn
                _seconds(scene, 1)  # compiles the graph
                short[name].append(_seconds(scene, _FEW))
                long[name].append(_seconds(scene, samples))
    counted = (samples - _FEW) * _EDGE**2 / 1e6
    micro = {name: (_low(long[name]) - _low(short[name])) / counted for name in materials}
    return [{"variant": name, "microseconds": t, "time": t / micro[PRINCIPLED]} for name, t in micro.items()]


def _seconds(scene: bpy.types.Scene, samples: int) -> float:
    scene.cycles.samples = samples
    started = time.process_time()
    render_linear(scene)
    return time.process_time() - started


def _low(values: list[float]) -> float:
    return sorted(values)[len(values) // 8]


def _print(rows: list[dict[str, object]]) -> None:
    about = f"{rows[0]['material']}, {rows[0]['light']}"
    table = Table(about, "microseconds", "Principled = 1", "taken away")
    before = None
    for row in rows:
        spent = float(str(row["microseconds"]))
        step = row["variant"] in {name for name, _, _ in CUTS}
        gone = f"{before - spent:.2f}" if step and before is not None else ""
        table.add_row(str(row["variant"]), f"{spent:.2f}", f"{row['time']:.2f}", gone)
        put(f"{about}, {row['variant']}", float(str(row["time"])))
        before = spent
    Console(width=120).print(table)
