"""Figure 6 of Kautz et al. 2004 on the gantry's swatches: four techniques beside the geometry, and their errors.

Every swatch is photographed on an arc, from above, and baked. Under lights and from views that the arc does not hold,
each technique's picture is then compared with the rendered geometry, pixel by pixel.
"""

from __future__ import annotations

import json
import math
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

sys.path.insert(1, str(Path(__file__).resolve().parents[1]))

import gantry_frames
import numpy as np
from csv_rows import write_rows
from measured_materials.addon.gantry import techniques
from measured_materials.addon.gantry.photograph_arc import gantry_scene
from measured_materials.addon.gantry.swatches import SWATCHES
from measured_materials.addon.gantry.techniques import IN_ORDER, Case, Frames, MappedSwatch
from measured_materials.addon.rendering.contact_sheet import Cell, write_sheet
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.shading_maps.bake import ArcSettings, bake_stack
from record import put, put_range
from support.gantry_maps import ARC_CASES, AROUND_CASES, bytes_of, renders_of, stack_of

# Light of unit irradiance unless said otherwise: (elevation, azimuth, irradiance); views (theta, phi), all in degrees.
CASES = (
    *(Case("between the photographs", ((e, 0.0, 1.0),)) for e in (9.6, 28.0, 46.5, 65.0)),
    *(Case("azimuth 90", ((e, 90.0, 1.0),)) for e in (28.0, 46.5)),
    *(Case("azimuth 180", ((e, 180.0, 1.0),)) for e in (28.0, 46.5)),
    *(Case("grazing, below the arc", ((e, 0.0, 1.0),)) for e in (2.0, 3.5)),
    *(Case("view 30 degrees", ((46.5, 0.0, 1.0),), (30.0, phi)) for phi in (-90.0, 180.0)),
    *(Case("view 60 degrees", ((46.5, 0.0, 1.0),), (60.0, phi)) for phi in (-90.0, 180.0)),
    Case("two lights, low one brighter", ((28.0, 0.0, 4.0), (65.0, 0.0, 1.0))),
    Case("two lights, high one brighter", ((28.0, 0.0, 1.0), (65.0, 0.0, 4.0))),
    *(Case("between azimuths", ((37.0, a, 1.0),)) for a in (67.5, 202.5)),
)
# What the sheet shows: one sun, four times as bright as in the photographs.
SHOWN = Case("sheet", ((28.0, 0.0, 4.0),))
SLICES = (8, 16, 32, 64)
# Most of plastic_60's photographs are far darker than the brightest: eight even steps would hold one of them.
SLICES_OF = {"plastic_60": 64}
CHOSEN = "family"
OBLIQUE = ("view 30 degrees", "view 60 degrees")
OWN_LEVEL = "own level"
EVERY_SIDE = "every side"
ASIDE = ("azimuth 90", "azimuth 180")
BETWEEN = ("between azimuths",)
COLUMNS = (*IN_ORDER, OWN_LEVEL, EVERY_SIDE)
LABELS = {**techniques.LABELS, OWN_LEVEL: "r as it is", EVERY_SIDE: "over azimuth"}


@dataclass(frozen=True, eq=False)
class Material:
    """A swatch, its photographs and frames, and its map lit by three choices of f_r.

    lit : "family" the lobe that an artist would name for such a swatch, with the parameters that fit its averages;
        "auto" the lobe that fits them best; "suggested" the named lobe with its parameters as they stand
    slices : number of slices to the same map as "family"
    around : the map over azimuth of more photographs, lit as `lit`
    bytes : of the textures of the usual map of one arc, and of the map over azimuth, per texel of the swatch
    noise : of a frame, in parts of its RMS
    seconds : of photographs and bakes
    """

    name: str
    frames: Frames
    lit: dict[str, MappedSwatch]
    slices: dict[int, MappedSwatch]
    around: dict[str, MappedSwatch]
    bytes: tuple[float, float]
    noise: float
    seconds: float


def run(out: Path, quick: bool) -> None:
    """Photograph, bake, compare; writes techniques.png, .csv and .json."""
    names = ("plastic_60", "suede", "cloth") if quick else tuple(SWATCHES)
    size, samples = (96, 24) if quick else (144, 48)
    rows: list[dict[str, Any]] = []
    shown = []
    for name in names:
        material = make(name, size, samples, out / "gantry")
        shown.append(material)
        started = time.perf_counter()
        rows += list(compare(material, size))
        _print_material(material, rows, time.perf_counter() - started)
    _print_summary(rows)
    _print_sides(rows, shown)
    _print_slices(shown, size)
    _print_verdict(rows, shown)
    write_sheet(out / "techniques.png", [cell for m in shown for cell in _cells(m, size)], 1 + len(IN_ORDER), _TITLE)
    write_rows(out / "techniques.csv", rows)
    (out / "techniques.json").write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


# --- photograph and bake --------------------------------------------------------------------------------


def make(name: str, size: int, samples: int, frames_folder: Path) -> Material:
    """One swatch on the gantry, baked and lit."""
    started = time.perf_counter()
    swatch = SWATCHES[name](0)

    def photographed(cases: tuple[Case, ...], seed: int) -> Frames:
        def make_them() -> Frames:
            with gantry_scene(swatch, size=size, samples=samples) as gantry:
                return techniques.photograph(gantry, cases, seed)

        told = f"{size} {samples} {seed}"
        return gantry_frames.kept(frames_folder, f"{name}-seed{seed}", told, cases, make_them)

    frames = photographed((*AROUND_CASES, *CASES), 0)
    ((key, other),) = photographed(CASES[1:2], 1).items()
    noise = float(np.sqrt(np.square(frames[key] - other).mean() / 2 / np.square(other).mean()))
    arc, all_around = (stack_of(cases, frames) for cases in (ARC_CASES, AROUND_CASES))
    renders, renders_around = (renders_of(swatch, stack) for stack in (arc, all_around))
    made = {}
    with tempfile.TemporaryDirectory() as folder:
        for count in SLICES:
            path = Path(folder) / f"{name}_{count}"
            made[count] = read_bundle(bake_stack(arc, path, ArcSettings(slices=count), name=name).path)
        path = Path(folder) / f"{name}_around"
        over_azimuth = read_bundle(bake_stack(all_around, path, ArcSettings(azimuths="all"), name=name).path)
        lit = {
            key: techniques.mapped_swatch(made[SLICES_OF.get(name, SLICES[0])], render)
            for key, render in renders.items()
        }
        slices = {count: techniques.mapped_swatch(bundle, renders["family"]) for count, bundle in made.items()}
        around = {key: techniques.mapped_swatch(over_azimuth, render) for key, render in renders_around.items()}
        size_of = bytes_of(made[SLICES[0]]) / size**2, bytes_of(over_azimuth) / size**2
    return Material(name, frames, lit, slices, around, size_of, noise, time.perf_counter() - started)


# --- compare --------------------------------------------------------------------------------------------


def compare(material: Material, size: int) -> Iterator[dict[str, Any]]:
    """Errors of every technique, case and f_r."""
    for case in CASES:
        target = techniques.truth(case, material.frames)
        for kind, swatch in material.lit.items():
            for technique in COLUMNS:
                shown = material.around[kind] if technique == EVERY_SIDE else swatch
                picture = _picture(technique, shown, case, material.frames, size)
                yield {
                    "material": material.name,
                    "case": case.group,
                    "lights": "; ".join("/".join(f"{x:g}" for x in light) for light in case.lights),
                    "view": "/".join(f"{x:g}" for x in case.view),
                    "f_r": kind,
                    "lobe": _lobe_words(swatch),
                    "chosen": kind == CHOSEN,
                    "slices": len(swatch.map.slices),
                    "technique": technique,
                    **techniques.errors(picture, target),
                    "noise": material.noise,
                }


def _picture(technique: str, swatch: MappedSwatch, case: Case, frames: Frames, size: int) -> np.ndarray:
    if technique == OWN_LEVEL:
        return techniques.at_own_level(swatch, case, frames, size)
    return techniques.shown("lookup" if technique == EVERY_SIDE else technique, swatch, case, size)


def _lobe_words(swatch: MappedSwatch) -> str:
    facts = swatch.lobe.facts()
    return " ".join([facts.pop("name"), *(f"{key} {value:.3g}" for key, value in facts.items())])


# --- report ---------------------------------------------------------------------------------------------

_TITLE = (
    "Kautz et al. 2004, figure 6: flat patches under light 28 degrees high, four times as bright as in the photographs"
)


def _cells(material: Material, size: int) -> list[Cell]:
    target = techniques.truth(SHOWN, material.frames)
    gain = 0.55 / float(np.percentile(target.max(-1), 90))
    swatch = material.lit[CHOSEN]
    cells = [
        Cell(
            _enlarged(target * gain),
            f"{material.name}: geometry",
            f"{len(swatch.map.slices)} slices, {_lobe_words(swatch)}",
        )
    ]
    for technique in IN_ORDER:
        picture = techniques.shown(technique, swatch, SHOWN, size)
        found = techniques.errors(picture, target)
        below = f"RMS {found['rms']:.0%}, brightness {found['mean']:+.0%}"
        cells.append(Cell(_enlarged(picture * gain), LABELS[technique], below))
    return cells


def _enlarged(picture: np.ndarray) -> np.ndarray:
    factor = max(1, math.ceil(200 / len(picture)))
    return picture.repeat(factor, 0).repeat(factor, 1)


def _groups() -> list[str]:
    return list(dict.fromkeys(case.group for case in CASES))


def _names(rows: list[dict[str, Any]]) -> list[str]:
    return list(dict.fromkeys(row["material"] for row in rows))


def _heading(title: str) -> None:
    print(f"\n{title}\n{'':34s}" + "".join(f"{LABELS[column]:>16s}" for column in COLUMNS))


def _line(label: str, rows: list[dict[str, Any]], key: str) -> None:
    values = [_median([row for row in rows if row["technique"] == technique], key) for technique in COLUMNS]
    print(f"  {label:32s}" + "".join(f"{v:15.1%} " for v in values))


def _median(rows: list[dict[str, Any]], key: str) -> float:
    """Over the materials, of the root mean square over each one's pictures."""
    names = {row["material"] for row in rows}
    each = [np.mean([row[key] ** 2 for row in rows if row["material"] == name]) for name in names]
    return float(np.sqrt(np.median(each)))


def _print_material(material: Material, rows: list[dict[str, Any]], seconds: float) -> None:
    swatch = material.lit[CHOSEN]
    slices = len(swatch.map.slices)
    own = [row for row in rows if row["material"] == material.name and row["chosen"]]
    words = f"{slices} slices, f_r {_lobe_words(swatch)}, sigma {swatch.sigma:.3f}"
    basis = material.around[CHOSEN].around
    assert basis is not None
    words += f"; over azimuth rank {basis.rank}, {material.bytes[1] / material.bytes[0]:.2f} of the bytes"
    _heading(
        f"{material.name}: {words}; noise of the truth {material.noise:.1%}; {material.seconds:.0f} + {seconds:.0f} s"
    )
    for group in _groups():
        _line(group, [row for row in own if row["case"] == group], "rms")


def _print_summary(rows: list[dict[str, Any]]) -> None:
    chosen = [row for row in rows if row["chosen"]]
    for key, title in (
        ("rms", "median of the materials: RMS of the difference, in parts of the truth's RMS"),
        ("tones", "median of the materials: the same of the tones alone, wherever they lie"),
        ("mean", "median of the materials: brightness off"),
        ("display", "median of the materials: RMS as displayed in sRGB, of the range from 0 to 1"),
    ):
        _heading(title)
        for group in _groups():
            _line(group, [row for row in chosen if row["case"] == group], key)
    _heading("choice of f_r, seen from above and obliquely: RMS")
    for name in dict.fromkeys(row["material"] for row in rows):
        for kind in dict.fromkeys(row["f_r"] for row in rows):
            own = [row for row in rows if row["material"] == name and row["f_r"] == kind]
            print(f"  {name}, {kind}: {own[0]['lobe']}")
            _line("    between the photographs", [row for row in own if row["case"] == _groups()[0]], "rms")
            _line("    oblique views", [row for row in own if row["case"] in OBLIQUE], "rms")


def _print_slices(materials: list[Material], size: int) -> None:
    print(f"\nlookup between the photographs, RMS, by number of slices\n{'':20s}" + "".join(f"{n:8d}" for n in SLICES))
    for material in materials:
        print(f"  {material.name:18s}", end="")
        for swatch in material.slices.values():
            found = [
                techniques.errors(
                    techniques.shown("lookup", swatch, case, size), techniques.truth(case, material.frames)
                )
                for case in CASES
                if case.group == _groups()[0]
            ]
            print(f"{techniques.mean_errors(found)['rms']:8.1%}", end="")
        print()


def _print_sides(rows: list[dict[str, Any]], materials: list[Material]) -> None:
    """The map of one arc beside the map over azimuth, swatch by swatch, and what of it the texts state."""
    groups = {"along the arc": (_groups()[0],), "aside": ASIDE[:1], "behind": ASIDE[1:], "between azimuths": BETWEEN}
    print("\nlight from every side: RMS of the map of one arc (lookup) and of the map over azimuth; bytes of a texel")
    print(f"{'':20s}" + "".join(f"{name:>22s}" for name in (*groups, "bytes")))
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in groups}
    for material in materials:
        print(f"  {material.name:18s}", end="")
        own = [row for row in rows if row["material"] == material.name and row["chosen"]]
        for name, cases in groups.items():
            both = [
                _median([row for row in own if row["case"] in cases and row["technique"] == technique], "rms")
                for technique in ("lookup", EVERY_SIDE)
            ]
            found[name].append((both[0], both[1]))
            print(f"{both[0]:13.1%} {both[1]:8.1%}", end="")
        print(f"{material.bytes[0]:14.1f} {material.bytes[1]:7.1f}")
    for name, pairs in found.items():
        put_range(f"every side less lookup, {name}", [every - arc for arc, every in pairs])
    put_range("bytes, every side over arc", [every / arc for arc, every in (m.bytes for m in materials)])


def _print_verdict(rows: list[dict[str, Any]], materials: list[Material]) -> None:
    """What the lookup can do and where it fails, in words with this run's medians."""

    def median(technique: str, case: str, key: str = "rms") -> str:
        chosen = [row for row in rows if row["chosen"] and (row["case"], row["technique"]) == (case, technique)]
        return f"{_median(chosen, key):.0%}"

    for technique in (*IN_ORDER, EVERY_SIDE):
        for group in _groups():
            own = [row for row in rows if row["chosen"] and (row["case"], row["technique"]) == (group, technique)]
            each = [_median([row for row in own if row["material"] == name], "rms") for name in _names(rows)]
            put_range(f"RMS, {technique}, {group}", each)
            put(f"RMS, {technique}, {group}, median", _median(own, "rms"))
    for technique in ("lookup", EVERY_SIDE):
        aside = [row for row in rows if row["chosen"] and row["technique"] == technique and row["case"] in ASIDE]
        by_case = [[r for r in aside if (r["material"], r["case"]) == (n, c)] for n in _names(rows) for c in ASIDE]
        put_range(f"RMS, {technique}, aside or behind", [_median(own, "rms") for own in by_case])
        put(f"RMS, {technique}, aside or behind, median", float(np.median([_median(own, "rms") for own in by_case])))
    put("swatches", len(_names(rows)))
    lookup, texture = partial(median, "lookup"), partial(median, "lit_texture")
    between, across, behind, grazing, tilted, oblique, low, high, askew = _groups()
    bright = median("final_radiance", high)
    aside, opposite, flat, tones = lookup(across), lookup(behind), texture(behind), lookup(behind, "tones")
    seen_30, seen_60, flat_60 = lookup(tilted), lookup(oblique), texture(oblique)
    print("\nverdict on the lookup by r (medians)")
    for line in (
        f"holds  between the photographs: {lookup(between)}, a lit texture {texture(between)}",
        f"holds  under lights of different strength: {lookup(low)} and {lookup(high)}, final radiance {bright}",
        f"fails  azimuth: {aside} at 90 degrees, {opposite} at 180, where even a lit texture has {flat}. As many",
        f"       shadows as should be (tones {tones}), but on the wrong side, plainly on large features",
        f"fails  below the arc: {lookup(grazing)}; from the lowest photograph to black the map can only fade",
        f"fails  parallax: {seen_30} seen at 30 degrees, {seen_60} at 60 (lit texture {flat_60}):",
        "       what stands out neither shifts nor hides, and an f_r that was found from above is a guess there",
        f"       (brightness off by {lookup(oblique, 'mean')})",
        f"over azimuth: {median(EVERY_SIDE, across)} at 90 degrees, {median(EVERY_SIDE, behind)} at 180,",
        f"       {median(EVERY_SIDE, askew)} between the azimuths that were photographed (one arc: {lookup(askew)}),",
        f"       {median(EVERY_SIDE, between)} along the arc",
        "fails  gloss in few slices: photographs of a glossy swatch crowd near black, see plastic_60 above",
    ):
        print(f"  {line}")
