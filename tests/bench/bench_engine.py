"""Noise and time of all modes beside a Principled BSDF of about the same look: 12 materials in 4 lightings.

Noise is the RMS over the material's pixels between pictures of different seeds, in parts of their mean, at the same
number of samples. At equal time it is that times the root of the time of a sample (processor time, set-up taken off).
Both are given as multiples of what Principled has in the same light. Where a highlight of a few pixels decides that,
the noise of each pixel in parts of its own brightness says what one sees: `local`.

Two things make Principled hard to follow. Cycles stratifies what it draws itself, so that its noise falls faster than
the root of the samples, and the multiples hold for the number of samples they are stated for. And under one small lamp
its direct light is free of noise: what it has there is bounce light's, here that of the ground.
"""

from __future__ import annotations

import csv
import math
import statistics
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from tempfile import TemporaryDirectory

import bpy
from engine_limits import LIMITS, noise_limits
from engine_materials import KINDS, QUICK, Kind, bake_all, bundle_path
from engine_plot import plot
from engine_scenes import FOLD, LIGHTS, Noise, Sizes, compare, lit, one_script
from materials import SHARED
from measured_materials.addon.material.build_brdf import build_brdf
from measured_materials.addon.material.choices import AUTO, NEVER, Choices
from measured_materials.addon.report.principled_match import Principled, fit_principled
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from record import put
from rich.console import Console
from rich.table import Table

PRINCIPLED, EXACT, UNAIMED_MIRROR = "Principled", "exact", "reference, not aimed"
# As one script of OSL, which can sample lamps in this Blender; nodes can from 5.1 on, or by rays of a script.
SAMPLED = "exact, lamps sampled"
VARIANTS = {
    "preview": Choices(mode="preview"),
    "balanced": Choices(mode="balanced", aim=AUTO),
    "balanced, not aimed": Choices(mode="balanced", aim=NEVER),
    EXACT: Choices(mode="exact", aim=AUTO),
    "exact, not aimed": Choices(mode="exact", aim=NEVER),
    "reference": Choices(mode="reference", aim=AUTO),
    UNAIMED_MIRROR: Choices(mode="reference", aim=NEVER),
}
SHOWN = (*VARIANTS, SAMPLED)
WITH_LAMPS = ("small lamp", "sun and sky")
SAMPLED_LIGHTS = (*WITH_LAMPS, "HDR world")
MOST_TIME, MOST_FIREFLY, LEAST_GAIN = 1.3, 20.0, 12.0


@dataclass(frozen=True)
class Row:
    """One material in one light by one variant; from `noise` on in parts of Principled's."""

    material: str
    source: str
    residual: float
    light: str
    variant: str
    rms: float
    local: float
    mean: float
    seconds: float
    firefly: float
    noise: float
    local_noise: float
    time: float
    equal_time: float


def goal(residual: float) -> float:
    """The most noise, in parts of Principled's, of a material whose residual carries this share of its light."""
    return 4.0 if residual <= 0.1 else 7.0 if residual <= 0.4 else 10.0


def run(out: Path, quick: bool) -> None:
    """Table, engine.csv and engine.png; --quick takes three materials in two lightings."""
    kinds = [kind for kind in KINDS if not quick or kind.name in QUICK]
    lights = ["sky", "small lamp"] if quick else list(LIGHTS)
    sizes = Sizes(samples=32, seeds=2) if quick else Sizes()
    if not (SHARED / "data").is_dir():
        print(f"SKIPPED measurements: there is no {SHARED}/data; materials of formulas stand in for them")
    rows = []
    # Written as it goes: the whole takes a quarter of an hour, and what was measured before a stop is worth reading.
    with (out / "engine.csv").open("w", newline="", encoding="utf-8") as stream, TemporaryDirectory() as folder:
        writer = csv.DictWriter(stream, [field.name for field in fields(Row)])
        writer.writeheader()
        for row in measure(kinds, lights, sizes, Path(folder)):
            rows.append(row)
            writer.writerow(asdict(row))
            stream.flush()
        limits = {
            kind.name: noise_limits(read_bundle(bundle_path(kind, Path(folder))), sizes.samples) for kind in kinds
        }
    report(rows, sizes)
    _print_limits(limits, sizes)
    goals = [(limit, goal(limit)) for limit in (0.1, 0.4, 1.0)]
    plot(out / "engine.png", rows, goals, MOST_TIME, (EXACT, UNAIMED_MIRROR))


def measure(kinds: list[Kind], lights: list[str], sizes: Sizes, folder: Path) -> Iterator[Row]:
    """Rows of all combinations, as they are measured; bundles that lie in `folder` already are taken from there."""
    print(f"baking {len(kinds)} materials")
    bake_all(kinds, folder, BakeSettings())
    for kind in kinds:
        started = time.perf_counter()
        bundle, stand_in = read_bundle(bundle_path(kind, folder)), fit_principled(kind.source(folder))
        residual = 1 - bundle.material["envelope"]["share"]
        for light in lights:
            found = _in_light(bundle, stand_in, light, sizes)
            base = found[PRINCIPLED]
            yield from (_row(kind, residual, light, variant, noise, base) for variant, noise in found.items())
        print(f"  {kind.name}, residual {residual:.1%}, beside {stand_in}: {time.perf_counter() - started:.0f} s")


def _in_light(bundle: Bundle, stand_in: Principled, light: str, sizes: Sizes) -> dict[str, Noise]:
    with lit(light) as scene:
        materials = {PRINCIPLED: stand_in.material()}
        for name, choices in VARIANTS.items():
            # Under an even sky there is nothing to aim at: both are one graph.
            if light != "sky" or choices.aim == AUTO:
                materials[name] = build_brdf(bundle, choices=choices, scene=scene)[0]
        if light in SAMPLED_LIGHTS:
            materials[SAMPLED] = one_script(bundle, scene)
        found = compare(scene, materials, sizes)
    for material in materials.values():
        bpy.data.materials.remove(material)
    for blocks in (bpy.data.node_groups, bpy.data.images, bpy.data.meshes, bpy.data.lights):
        for block in [block for block in blocks if not block.users]:
            blocks.remove(block)
    if light == "sky":
        found |= {name: found[name.removesuffix(", not aimed")] for name in VARIANTS if name not in found}
    # Under an even sky there is nothing to sample: what is aimed is the material.
    return {SAMPLED: found[EXACT]} | found


def _row(kind: Kind, residual: float, light: str, variant: str, noise: Noise, base: Noise) -> Row:
    ratio, slower = noise.rms / base.rms, noise.seconds / base.seconds
    source = kind.measured if (SHARED / "data").is_dir() else "formula"
    compared = (ratio, noise.local / base.local, slower, ratio * math.sqrt(slower))
    return Row(kind.name, source, residual, light, variant, *asdict(noise).values(), *compared)


def report(rows: list[Row], sizes: Sizes) -> None:
    """Tables, and how many combinations meet each goal."""
    console = Console(width=150)
    by_key = {(row.material, row.light, row.variant): row for row in rows}
    pairs = list(dict.fromkeys((row.material, row.light) for row in rows))
    for what, title in (
        ("noise", f"RMS noise at {sizes.samples} samples, in parts of Principled's"),
        (
            "local_noise",
            f"Noise of a pixel over its own brightness at {sizes.samples} samples, in parts of Principled's",
        ),
        ("equal_time", "RMS noise at equal time, in parts of Principled's"),
    ):
        table = Table("material", "residual", "light", "Principled", *SHOWN, title=title)
        for material, light in pairs:
            found = [by_key[material, light, variant] for variant in (PRINCIPLED, *SHOWN)]
            cells = [f"{getattr(row, what):.2f}" for row in found[1:]]
            table.add_row(material, f"{found[0].residual:.0%}", light, f"{found[0].rms:.2%}", *cells)
        console.print(table)
    table = Table("material", "light", *(f"{v}: time, firefly" for v in (PRINCIPLED, *SHOWN)))
    table.title = f"Time of a sample in parts of Principled's; largest of {FOLD**2} samples over the mean of its pixel"
    for material, light in pairs:
        found = [by_key[material, light, variant] for variant in (PRINCIPLED, *SHOWN)]
        table.add_row(material, light, *(f"{row.time:.2f}  {row.firefly:.0f}" for row in found))
    console.print(table)
    _print_medians(rows, console)
    _print_goals([row for row in rows if row.variant == EXACT], by_key)


def _print_medians(rows: list[Row], console: Console) -> None:
    """The README's table, and the times that the panel shows before a render, `cost_estimate.MODE_TIME`."""
    lights = list(dict.fromkeys(row.light for row in rows))
    table = Table("mode", *lights, "time of a sample", title="Noise in parts of Principled's, medians; geometric mean")
    for variant in SHOWN:
        own = [row for row in rows if row.variant == variant]
        medians = [statistics.median_high(row.noise for row in own if row.light == light) for light in lights]
        for light, median in zip(lights, medians):
            put(f"noise, {variant}, {light}", median)
        times = [row.time for row in own if variant != SAMPLED or row.light in WITH_LAMPS]
        if times:
            put(f"time, {variant}", _geometric(times))
            table.add_row(variant, *(f"{m:.2g}" for m in medians), f"{_geometric(times):.2f}")
    console.print(table)
    for light in lights:
        own = [row.rms for row in rows if row.variant == PRINCIPLED and row.light == light]
        put(f"Principled's own noise, {light}", statistics.median_high(own))


def _print_goals(rows: list[Row], by_key: dict[tuple[str, str, str], Row]) -> None:
    def tell(words: str, missed: list[Row], of: int) -> None:
        names = ", ".join(f"{row.material} in {row.light}" for row in missed)
        print(f"{words}: {of - len(missed)} of {of}" + (f"; missed by {names}" if missed else ""))

    print("\ngoals, mode exact")
    for low, high in ((0.0, 0.1), (0.1, 0.4), (0.4, 1.0)):
        group = [row for row in rows if low < row.residual <= high or low == row.residual == 0]
        most = goal(high)
        words = f"at most {most:g} times Principled's noise, residual {low:.0%} to {high:.0%}"
        tell(words, [row for row in group if row.noise > most], len(group))
        tell("  by each pixel's own brightness", [row for row in group if row.local_noise > most], len(group))
    tell(f"at most {MOST_TIME} times the time of a sample", [row for row in rows if row.time > MOST_TIME], len(rows))
    flashes = [row for row in rows if row.firefly > MOST_FIREFLY]
    tell(f"no sample above {MOST_FIREFLY:g} times its pixel's mean", flashes, len(rows))
    own = [row for row in flashes if by_key[row.material, row.light, PRINCIPLED].firefly > MOST_FIREFLY]
    print(f"  in {len(own)} of these {len(flashes)} Principled has such samples too")
    lamp = [row for row in rows if row.light == "small lamp"]
    gains = {row.material: by_key[row.material, row.light, UNAIMED_MIRROR].rms / row.rms for row in lamp}
    short = [row for row in lamp if gains[row.material] < LEAST_GAIN]
    tell(f"at least {LEAST_GAIN:g} times less noise than mirror only, not aimed, under a small lamp", short, len(lamp))
    ratios = sorted(row.noise / goal(row.residual) for row in rows)
    print(f"noise over its goal: median {ratios[len(ratios) // 2]:.2f}, worst {ratios[-1]:.2f}")
    print(f"time of a sample over Principled's: geometric mean {_geometric([row.time for row in rows]):.2f}")


def _print_limits(limits: dict[str, dict[str, float]], sizes: Sizes) -> None:
    title = f"What limits it: noise of direct light under the small lamp at {sizes.samples} samples, worked out"
    table = Table("material", *LIMITS, title=title)
    for name, noise in limits.items():
        table.add_row(name, *(f"{noise[key]:.2%}" for key in LIMITS))
    Console(width=150).print(table)
    for key in LIMITS[1:]:
        gains = [noise[LIMITS[0]] / noise[key] for noise in limits.values()]
        print(f"{key}: {_geometric(gains):.2f} times less noise in the geometric mean, at best {max(gains):.2f}")


def _geometric(values: list[float]) -> float:
    return math.exp(sum(math.log(max(v, 1e-9)) for v in values) / len(values))
