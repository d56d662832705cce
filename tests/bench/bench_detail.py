"""A swatch on a plane that runs to the horizon: noise, shimmer and mean by texels in a pixel, and what EEVEE shows.

Each piece of the picture is compared with itself at very many samples without levels of detail. Shimmer is the RMS of
the difference between two frames whose camera has turned by a quarter of a pixel.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import bpy
import horizon
import numpy as np
from csv_rows import write_rows
from horizon import BANDS, TILTED, Horizon, Piece
from measured_materials.addon.lights.light_tables import lamp_image
from measured_materials.addon.rendering.contact_sheet import Cell, write_sheet
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.maps.folder import MapsFolder, read_maps_folder
from measured_materials.bake.shading_maps.record import ShadingMapRecord
from measured_materials.bake.source import Array
from measured_materials.nodes.principled_maps import build_principled
from measured_materials.nodes.shading_map_material import build_shading_map
from record import put
from rich.console import Console
from rich.table import Table

_SHOWN = (1, 4, 16, 64)
_SEEDS, _MANY = 4, 512
# Samples of the means that EEVEE's are held against.
_TRUTH = 256
_SHIFT = 0.25  # pixels
_KEPT = ("noise at 16", "noise at 16, levels", "shimmer", "shimmer, levels", "mean, levels", "time, levels")
VIEWS = {"horizon": BANDS, "tilted": TILTED}
Make = Callable[[Piece], bpy.types.Material]


@dataclass(frozen=True)
class Sources:
    """What the swatch was baked to."""

    arc: Bundle
    around: Bundle
    maps: MapsFolder

    @classmethod
    def within(cls, folder: Path) -> Sources:
        """Those that lie in a folder."""
        return cls(
            read_bundle(folder / "arc.mmat"), read_bundle(folder / "around.mmat"), read_maps_folder(folder / "maps")
        )


def run(out: Path, quick: bool) -> None:
    """Tables and detail.csv."""
    with tempfile.TemporaryDirectory() as folder:
        horizon.map_bundle(Path(folder), arc=True)
        horizon.map_bundle(Path(folder), arc=False)
        horizon.plain_maps(Path(folder))
        rows = _rows(Sources.within(Path(folder)), quick)
        _print(rows)
        write_rows(out / "detail.csv", rows)
        _sheet(Sources.within(Path(folder)), out / "detail.png")
        if not quick:
            _eevee(Path(folder))


def materials(sources: Sources) -> dict[str, tuple[Make, Make | None]]:
    """How each is built, and with levels of detail."""

    def maps(bundle: Bundle, mode: str, levels: bool) -> Make:
        settings = replace(ShadingMapRecord.read(bundle).render, mode=mode)

        def make(piece: Piece) -> bpy.types.Material:
            texels = piece.texels / piece.distance if levels else 0.0
            return build_shading_map(bundle, settings=settings, lamps=lamp_image(), texels=texels)

        return make

    made: dict[str, tuple[Make, Make | None]] = {
        "arc": (maps(sources.arc, "exact", False), maps(sources.arc, "exact", True)),
        "over azimuth": (maps(sources.around, "exact", False), maps(sources.around, "exact", True)),
        "arc, Preview": (maps(sources.arc, "preview", False), maps(sources.arc, "preview", True)),
        "Principled of maps": (lambda piece: build_principled(sources.maps, pack=True), None),
    }
    return made


def _rows(sources: Sources, quick: bool) -> list[dict[str, Any]]:
    rows = []
    with horizon.horizon() as scene:
        for kind, (plain, levelled) in materials(sources).items():
            for view, pieces in VIEWS.items():
                for piece in pieces[-1:] if quick else pieces:
                    rows.append(_row(scene, kind, view, piece, plain, levelled, quick))
                    print(".", end="", flush=True)
    print()
    return rows


def _row(
    scene: Horizon, kind: str, view: str, piece: Piece, plain: Make, levelled: Make | None, quick: bool
) -> dict[str, Any]:
    """One piece of the picture, without levels and with them."""
    row: dict[str, Any] = {"material": kind, "view": view, "texels": piece.texels}
    material = plain(piece)
    scene.show(material, piece)
    many = _MANY // 8 if quick else _MANY
    exact = scene.render(many, 1000)
    row["mean"] = exact.mean()
    row["contrast"] = float(exact.mean(-1).std() / exact.mean())
    for name, made in (("", plain), (", levels", levelled)):
        if made is None:
            continue
        if name:
            material = made(piece)
            scene.show(material, piece)
            again = scene.render(many, 2000)
            row["mean, levels"] = again.mean() / exact.mean()
            row["difference, levels"] = float(np.sqrt(np.mean((again - exact) ** 2)) / exact.mean())
        seeds = 3 if quick else _SEEDS
        for samples in _SHOWN[::2] if quick else _SHOWN:
            found = np.array([scene.render(samples, seed) for seed in range(seeds)])
            row[f"noise at {samples}{name}"] = _rms(found, exact)
            if samples == 1:
                # Of every sample on its own: what a picture of so many is biased by, where it is.
                row[f"mean at 1{name}"] = found.mean() / exact.mean()
        shifted = [scene.render(16, 100 + seed, _SHIFT) - scene.render(16, 200 + seed) for seed in range(seeds)]
        row[f"shimmer{name}"] = float(np.sqrt(np.mean(np.square(shifted))) / exact.mean())
        began = time.process_time()
        scene.render(256, 0)
        whole = time.process_time() - began
        began = time.process_time()
        scene.render(16, 0)
        row[f"seconds{name}"] = whole - (time.process_time() - began)
        bpy.data.materials.remove(material)
    if levelled is not None:
        row["time, levels"] = row["seconds, levels"] / row["seconds"]
    return row


def _rms(found: Array, exact: Array) -> float:
    """Of pixels against the picture of many samples, over its mean."""
    return float(np.sqrt(np.mean((found - exact) ** 2)) / exact.mean())


def _print(rows: list[dict[str, Any]]) -> None:
    for kind in dict.fromkeys(row["material"] for row in rows):
        table = Table(
            "view", "texels in a pixel", "noise at 1", "at 4", "at 16", "at 64", "shimmer", "mean", title=kind
        )
        for row in (row for row in rows if row["material"] == kind):
            cells = [_two(row, f"noise at {samples}") for samples in _SHOWN] + [_two(row, "shimmer")]
            mean = row.get("mean, levels")
            told = f"{100 * (mean - 1):+.2f} %" if mean else ""
            table.add_row(row["view"], f"{row['texels']:g}", *cells, told)
            where = f"{kind}, {row['view']}, {row['texels']:g}"
            for key in _KEPT:
                if key in row:
                    put(f"{where}, {key}", row[key])
        Console(width=130).print(table)


def _two(row: dict[str, Any], name: str) -> str:
    """A figure without levels, and with them."""
    found = [row.get(f"{name}{with_}") for with_ in ("", ", levels")]
    return " -> ".join(f"{100 * value:.1f} %" for value in found if value is not None)


def _sheet(sources: Sources, path: Path) -> None:
    """The whole plane at few samples and at many, without levels and with them."""
    size, repeat, pixel = (360, 180), 3.0, 2e-3
    settings = replace(ShadingMapRecord.read(sources.around).render, mode="exact")
    cells = []
    with horizon.horizon() as scene:
        for label, texels in (("every texel", 0.0), ("levels of detail", repeat * horizon.SIDE * pixel)):
            material = build_shading_map(sources.around, settings=settings, lamps=lamp_image(), texels=texels)
            scene.whole(material, repeat, size, pixel)
            for samples in (2, 64):
                picture = scene.render(samples, 0)
                cells.append(Cell(picture.astype(np.float32), label, f"{samples} samples"))
    write_sheet(path, cells, 2, "A map over azimuth, to the horizon")


# --- EEVEE ----------------------------------------------------------------------------------------------


def _eevee(folder: Path) -> None:
    """Means of the pieces in EEVEE over those in Cycles; in a process of its own: without OpenGL it ends there."""
    out = folder / "eevee.json"
    done = subprocess.run([sys.executable, __file__, str(folder), str(out)], capture_output=True, text=True)
    if done.returncode:
        print("SKIPPED EEVEE:", (done.stderr.strip() or "it ended by a signal").splitlines()[-1][:200])
        return
    rows: list[dict[str, Any]] = json.loads(out.read_text())
    table = Table("material", "view", *(f"{piece.texels:g}" for piece in BANDS), title="EEVEE ÷ Cycles")
    for kind in dict.fromkeys(row["material"] for row in rows):
        for view in VIEWS:
            found = [row for row in rows if (row["material"], row["view"]) == (kind, view)]
            table.add_row(kind, view, *(f"{row['EEVEE ÷ Cycles']:.3f}" for row in found))
    Console(width=110).print(table)
    for row in rows:
        put(f"{row['material']}, {row['view']}, {row['texels']:g}, EEVEE by Cycles", row["EEVEE ÷ Cycles"])


def _eevee_child(folder: Path, out: Path) -> None:
    """Of all materials under the sun aside; of the maps, against the sun too."""
    sources = Sources.within(folder)
    made = materials(sources)
    maps = made["Principled of maps"][0]
    filtered: Make = lambda piece: build_principled(sources.maps, relief="filtered", pack=True)  # noqa: E731
    cases = {kind: (False, made[kind][0], made[kind][0]) for kind in ("arc", "over azimuth", "Principled of maps")}
    cases |= {"Principled, to the sun": (True, maps, maps), "filtered, to the sun": (True, filtered, maps)}
    rows = []
    for kind, (ahead, make, reference) in cases.items():
        with horizon.horizon(ahead=ahead) as scene:
            for view, pieces in VIEWS.items():
                for piece in pieces:
                    scene.show(reference(piece), piece)
                    exact = scene.render(_TRUTH, 0).mean()
                    scene.show(make(piece), piece)
                    scene.use_eevee()
                    ratio = float(scene.render_as_it_is().mean() / exact)
                    rows.append({"material": kind, "view": view, "texels": piece.texels, "EEVEE ÷ Cycles": ratio})
    out.write_text(json.dumps(rows))


if __name__ == "__main__":
    _eevee_child(Path(sys.argv[1]), Path(sys.argv[2]))
    os._exit(0)  # Blender's own end may hang once OpenGL has been used
