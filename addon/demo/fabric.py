"""The demonstration of shading maps: fabrics of real geometry, photographed, baked, and shown beside themselves.

The virtual gantry photographs two procedural swatches on a light arc. Their shading maps then stand in for them on a
flat patch, where the techniques of Kautz et al. 2004 can be compared pixel by pixel, and rolled up, where every place
sees the light at another elevation.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...bake.bundle.bundle import Bundle, read_bundle
from ...bake.errors import BakeError
from ...bake.photographs.stack import PhotoStack, StackSettings, read_stack
from ...bake.shading_maps.bake import ArcSettings, bake_stack
from ...bake.shading_maps.record import ShadingMapRecord
from ...bake.shading_maps.render_settings import RenderSettings
from ...bake.shading_maps.shading_map import averages_of
from ...nodes.shading_map_material import build_shading_map
from ..gantry import techniques
from ..gantry.photograph_arc import gantry_scene, photograph_arc
from ..gantry.swatches import SWATCHES, Swatch
from ..gantry.techniques import IN_ORDER, LABELS, Array, Case, Frames
from ..lights.light_tables import lamp_image, update_scene
from ..material.bake_photographs import set_repeat
from ..rendering.contact_sheet import Cell, write_sheet
from ..studio.studio import build_studio, remove_studio, render_linear
from .roll import roll

Progress = Callable[[str, float], None]

SHOWN = ("suede", "cloth")
ELEVATIONS = (5.0, 14.0, 23.0, 33.0, 42.0, 51.0, 60.0, 70.0, 79.0, 88.0)
# Held-out lights: elevation, azimuth, irradiance in terms of the photographs' light.
CASES = (
    Case("between two photographs", ((28.0, 0.0, 1.0),)),
    Case("the same, four times as bright", ((28.0, 0.0, 4.0),)),
    Case("and a second light", ((28.0, 0.0, 4.0), (65.0, 0.0, 1.0))),
    Case("from the other side", ((28.0, 180.0, 1.0),)),
)
_ON_SHEET = CASES[1]


@dataclass(frozen=True)
class _Effort:
    """Pixels and samples of photographs and of pictures."""

    photograph: tuple[int, int]
    roll: tuple[int, int]
    ball: tuple[int, int]


_FULL = _Effort((224, 48), (300, 64), (300, 64))
_QUICK = _Effort((128, 16), (200, 24), (200, 16))


@dataclass(frozen=True, eq=False)
class _Fabric:
    """One swatch with all that was made of it."""

    swatch: Swatch
    folder: Path
    photographs: Array
    bundle: Bundle
    frames: Frames
    errors: dict[str, dict[str, dict[str, float]]]  # by case and technique
    rolls: dict[str, Array]
    ball: Array


def run_arc_demo(out: Path, *, quick: bool = False, progress: Progress | None = None) -> dict[str, Any]:
    """Photograph, bake, render, compare; everything lands in `out`.

    Returns
    -------
    JSON-ready: "picture", "rows" (one per swatch, case and technique), "bundles", "photographs" and "lines" to print

    Raises
    ------
    BakeError : the folder cannot be written
    """
    say = progress or (lambda stage, share: None)
    out = Path(out).resolve()
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BakeError(out, f"cannot be written ({error.strerror})", "choose another folder") from error
    effort = _QUICK if quick else _FULL
    started = time.perf_counter()
    fabrics = [_fabric(SWATCHES[name](0), out, effort, _part(say, k)) for k, name in enumerate(SHOWN)]
    sheet = out / "demo_arc.png"
    columns = 1 + len(IN_ORDER)
    write_sheet(sheet, [cell for fabric in fabrics for cell in _cells(fabric)], columns, _TITLE)
    rows = [
        {"swatch": fabric.swatch.name, "case": case, "technique": technique, **found}
        for fabric in fabrics
        for case, each in fabric.errors.items()
        for technique, found in each.items()
    ]
    seconds = time.perf_counter() - started
    return {
        "picture": str(sheet),
        "rows": rows,
        "bundles": [str(fabric.bundle.path) for fabric in fabrics],
        "photographs": [str(fabric.folder) for fabric in fabrics],
        "seconds": round(seconds, 1),
        "lines": _lines(fabrics, sheet, seconds),
    }


def _part(say: Progress, index: int) -> Progress:
    """One swatch's part of every stage."""
    return lambda stage, share: say(f"{stage} {SHOWN[index]}", share)


def _fabric(swatch: Swatch, out: Path, effort: _Effort, say: Progress) -> _Fabric:
    size, samples = effort.photograph
    folder = out / f"{swatch.name}_photographs"
    photograph_arc(
        swatch,
        folder,
        elevations=ELEVATIONS,
        size=size,
        samples=samples,
        progress=lambda share: say("photographing", share),
    )
    say("baking", 0.0)
    # The gantry's pixels are f_r cos(theta_i) in 1/sr, what a camera needs a white card for.
    stack = replace(read_stack(folder, StackSettings(align="off")), calibrated=True)
    settings = ArcSettings(render=_fitted(swatch, stack))
    bundle = read_bundle(bake_stack(stack, out / f"{swatch.name}.mmat", settings, name=swatch.name).path)
    say("comparing", 0.0)
    with gantry_scene(swatch, size=size, samples=samples) as gantry:
        frames = techniques.photograph(gantry, CASES)
    mapped = techniques.mapped_swatch(bundle)
    errors = {
        case.group: {
            technique: techniques.errors(
                techniques.shown(technique, mapped, case, size), techniques.truth(case, frames)
            )
            for technique in IN_ORDER
        }
        for case in CASES
    }
    rolls, ball = _path_traced(swatch, bundle, effort, say)
    return _Fabric(swatch, folder, stack.images, bundle, frames, errors, rolls, ball)


def _fitted(swatch: Swatch, stack: PhotoStack) -> RenderSettings:
    assert stack.directions is not None
    return techniques.fitted_render(swatch.lobe, np.arcsin(stack.directions[:, 2]), averages_of(stack.images))


def _path_traced(swatch: Swatch, bundle: Bundle, effort: _Effort, say: Progress) -> tuple[dict[str, Array], Array]:
    """Rolls of the geometry, the shading map and the lit texture; the map in the studio."""
    say("rendering", 0.0)
    record = ShadingMapRecord.read(bundle)
    usual = record.render
    rolls = {"geometry": roll(swatch, *effort.roll)}
    for k, technique in enumerate(("lookup", "lit_texture")):
        say("rendering", 0.35 + 0.2 * k)
        material = build_shading_map(bundle, settings=replace(usual, technique=technique), lamps=lamp_image())
        with _removed(material):
            rolls[technique] = roll(material, *effort.roll)
    say("rendering", 0.75)
    size, samples = effort.ball
    material = build_shading_map(bundle, lamps=lamp_image())
    with _removed(material):
        set_repeat(material, 2.0, record.map.layout)
        scene = build_studio(material, resolution=(size, size), samples=samples, seed=1)
        update_scene(scene)
        try:
            ball = render_linear(scene, progress=lambda share: say("rendering", 0.75 + 0.25 * share))
        finally:
            remove_studio(scene)
    return rolls, ball


@contextlib.contextmanager
def _removed(material: bpy.types.Material) -> Iterator[None]:
    try:
        yield
    finally:
        bpy.data.materials.remove(material)


# --- report ---------------------------------------------------------------------------------------------

_TITLE = "Shading maps of photographed fabric (Kautz et al. 2004): light 28 degrees high; rolled up; in the studio"


def _cells(fabric: _Fabric) -> list[Cell]:
    """A row of flat patches, and one of curved shapes with four of the photographs."""
    name = fabric.swatch.name
    target = techniques.truth(_ON_SHEET, fabric.frames)
    gain = 0.6 / float(np.percentile(target.max(-1), 90))
    wide = fabric.rolls["geometry"].shape[0]
    mapped = techniques.mapped_swatch(fabric.bundle)
    cells = [Cell(_fit(target * gain, wide), f"{name}: geometry", fabric.swatch.description)]
    for technique in reversed(IN_ORDER):
        picture = techniques.shown(technique, mapped, _ON_SHEET, len(target))
        found = fabric.errors[_ON_SHEET.group][technique]
        below = f"RMS {found['rms']:.0%}, brightness {found['mean']:+.0%}"
        cells.append(Cell(_fit(picture * gain, wide), LABELS[technique], below))
    bright = 0.7 / float(np.percentile(fabric.rolls["geometry"].max(-1), 95))
    for key, label in (("geometry", "geometry"), ("lookup", "shading map"), ("lit_texture", "lit texture")):
        cells.append(Cell(fabric.rolls[key] * bright, f"roll: {label}", "path-traced in Cycles"))
    cells.append(Cell(fabric.ball, "shading map in the studio", "path-traced in Cycles"))
    chosen = [int(k) for k in np.linspace(0, len(ELEVATIONS) - 1, 4)]
    quarters = [_fit(fabric.photographs[k], wide // 2) * (0.6 / fabric.photographs[-1].max(-1).mean()) for k in chosen]
    photographs = np.concatenate([np.concatenate(quarters[:2], 1), np.concatenate(quarters[2:], 1)])
    heights = ", ".join(f"{ELEVATIONS[k]:g}" for k in chosen)
    cells.append(Cell(photographs, f"4 of the {len(ELEVATIONS)} photographs", f"light {heights} degrees high"))
    return cells


def _fit(picture: Array, size: int) -> Array:
    """The picture in size x size pixels: its middle, or every pixel repeated."""
    have = len(picture)
    if have < size:
        times = -(-size // have)
        picture = picture.repeat(times, 0).repeat(times, 1)
    start = (len(picture) - size) // 2
    return np.asarray(picture[start : start + size, start : start + size])


def _lines(fabrics: list[_Fabric], sheet: Path, seconds: float) -> list[str]:
    lines = ["RMS of a flat patch against the geometry, in parts of the geometry's own RMS (brightness off)"]
    for fabric in fabrics:
        lobe = ShadingMapRecord.read(fabric.bundle).render.lobe.name
        lines.append(f"{fabric.swatch.name + ', f_r ' + lobe:32s}" + "".join(f"{LABELS[t]:>18s}" for t in IN_ORDER))
        for case, found in fabric.errors.items():
            cells = (f"{found[t]['rms']:.1%} ({found[t]['mean']:+.0%})" for t in IN_ORDER)
            lines.append(f"  {case:30s}" + "".join(f"{cell:>18s}" for cell in cells))
    lines += [
        "",
        "The light of the photographs came from one side; from the other one shadows fall where the map has none.",
        "",
        f"picture       {sheet}",
        *(f"photographs   {fabric.folder}" for fabric in fabrics),
        *(f"bundle        {fabric.bundle.path}" for fabric in fabrics),
        f"all of it took {seconds:.0f} s",
    ]
    return lines
