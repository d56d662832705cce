"""Many materials in one scene: 10, 60 and 240 of 24 bundles beside as many of Principled BSDF without textures.

Preview is of the BRDFs among them, in mode Preview: a graph of few nodes, by which the first sample's time goes.
"""

from __future__ import annotations

import csv
import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import measured_materials
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.shading_maps.render_settings import RenderSettings
from measured_materials.bake.sources.analytic import MetallicPaint, Ward
from record import put
from rich.console import Console
from rich.table import Table

sys.path.insert(1, str(Path(__file__).resolve().parents[1]))

from support.bundles import tinted
from support.swatches import map_bundle, rough_map

PREVIEW, PRINCIPLED = "preview", "principled"
COUNTS, BUNDLES, EDGE = (10, 60, 240), 24, 128
_TIMEOUT = 1800
_COLUMNS = {
    "build s": lambda f: f"{f['build']:.2f}",
    "each, new": lambda f: _milli(f["new"]),
    "again": lambda f: _milli(f["again"]),
    "one by one": lambda f: f"{1e3 * f['one_by_one']:.1f}",
    "images": lambda f: str(f["images"]),
    "groups": lambda f: str(f["groups"]),
    "nodes": lambda f: str(f["nodes"]),
    "built MB": lambda f: f"{f['megabytes_built']:.0f}",
    "most MB": lambda f: f"{f['megabytes']:.0f}",
    "1 sample s": lambda f: f"{f['wall_1']:.2f} ({f['processor_1']:.2f})",
    "16 samples": lambda f: f"{f['wall_16']:.2f} ({f['processor_16']:.2f})",
    "moved ms": lambda f: f"{1e3 * f['moved']:.1f}",
    "added ms": lambda f: f"{1e3 * f['added']:.1f}",
}


def run(out: Path, quick: bool, before: str = "") -> None:
    """A table and scale.csv, of this clone, of Principled and, where asked for, of the commit `before`."""
    root = Path(measured_materials.__file__).parent
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sides = {"measured": _package(root, folder / "now"), PREVIEW: folder / "now", PRINCIPLED: folder / "now"}
        if before:
            sides = {f"at {before}": _exported(root, before, folder / "before"), **sides}
        bundles = [str(bundle.path) for bundle in _bundles(folder)]
        rows = []
        for count in COUNTS[:2] if quick else COUNTS:
            found = {side: _child(side, package, count, bundles) for side, package in sides.items()}
            rows += [{"materials": count, "side": side, **figures} for side, figures in found.items()]
            _put(count, found)
    _print(rows)
    with (out / "scale.csv").open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, rows[0])
        writer.writeheader()
        writer.writerows(rows)


def _child(side: str, package: Path, count: int, bundles: list[str]) -> dict[str, Any]:
    """Figures of a fresh process with the package that lies in a folder; ends the bench with its errors."""
    told = {"side": side if side in (PREVIEW, PRINCIPLED) else "measured", "count": count}
    if side == PREVIEW:  # photographs have none of closures alone
        bundles = bundles[: -BUNDLES // 3]
    script = Path(__file__).with_name("scale_child.py")
    done = subprocess.run(
        [sys.executable, "-P", str(script), json.dumps({**told, "bundles": bundles, "edge": EDGE})],
        env={**os.environ, "PYTHONPATH": str(package)},
        capture_output=True,
        text=True,
        timeout=_TIMEOUT,
    )
    lines = [line for line in done.stdout.splitlines() if line.startswith("FOUND")]
    if done.returncode or not lines:
        sys.exit(f"bench scale: {side}, {count} materials: {done.stderr[-2000:]}")
    print(f"{side}, {count} materials: done", flush=True)
    return dict(json.loads(lines[-1].removeprefix("FOUND")))


def _package(root: Path, folder: Path) -> Path:
    """A folder in which the package is found under its name."""
    folder.mkdir()
    (folder / "measured_materials").symlink_to(root)
    return folder


def _exported(root: Path, commit: str, folder: Path) -> Path:
    """The same, of a commit."""
    (folder / "measured_materials").mkdir(parents=True)
    packed = subprocess.run(["git", "-C", str(root), "archive", commit], capture_output=True)
    if packed.returncode:
        sys.exit(f"bench scale: {packed.stderr.decode(errors='replace').strip()}")
    subprocess.run(["tar", "x", "-C", str(folder / "measured_materials")], input=packed.stdout, check=True)
    return folder


def _bundles(folder: Path) -> Iterator[Bundle]:
    """A third each isotropic, anisotropic and shading maps; two are baked, and tinted for the others."""
    light = BakeSettings(resolution=12, alpha=(0.5, 0.3), sampler=SamplerLayout(n_o=16, n_h=16, n_phi=8))
    sources = {"paint": (MetallicPaint(), light), "satin": (Ward(alpha=0.4, alpha_y=0.2), BakeSettings(resolution=6))}
    for name, (source, settings) in sources.items():
        baked = read_bundle(bake_source(source, folder / name, settings).path)
        for k in range(BUNDLES // 3):
            yield tinted(baked, folder / f"{name} {k}", 1 - 0.05 * k)
    for k in range(BUNDLES // 3):
        yield map_bundle(folder / f"swatch {k}", rough_map(seed=k), RenderSettings())


def _milli(seconds: list[float]) -> str:
    """Mean in milliseconds."""
    return f"{1e3 * statistics.mean(seconds):.1f}" if seconds else "-"


def _put(count: int, found: dict[str, dict[str, Any]]) -> None:
    ours, plain, preview = found["measured"], found[PRINCIPLED], found[PREVIEW]
    spent = {side: found[side]["processor_1"] for side in (*found,)}
    # What a first sample takes beyond Principled's goes into images, and nodes, copied and compiled.
    each = 1e6 * (spent["measured"] - spent[PRINCIPLED]) / (ours["nodes"] - plain["nodes"])
    print(f"{count} materials: {ours['nodes']} nodes, {each:.0f} us of the processor each before the first sample")
    put(f"nodes, {count}", ours["nodes"])
    put(f"us a node, {count}", each)
    put(f"first sample in Preview beside Principled, {count}", preview["wall_1"] / plain["wall_1"])
    put(f"build s, {count}", ours["build"])
    put(f"images, {count}", ours["images"])
    put(f"groups, {count}", ours["groups"])
    put(f"MB, {count}", ours["megabytes"])
    put(f"first sample beside Principled, {count}", ours["wall_1"] / plain["wall_1"])
    if ours["again"]:
        put(f"again ms, {count}", 1e3 * statistics.mean(ours["again"]))


def _print(rows: list[dict[str, Any]]) -> None:
    table = Table(title="Materials of 24 bundles (ms each; seconds of pictures: wall, and of all processors)")
    for column in ("", "", *_COLUMNS):
        table.add_column(column, justify="right" if column else "left")
    for row in rows:
        table.add_row(str(row["materials"]), row["side"], *(show(row) for show in _COLUMNS.values()))
    Console(width=170).print(table)
