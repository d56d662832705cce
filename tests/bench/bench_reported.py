"""What `./run cli report` shows of pictures: whether Exact, as a user gets it, is closer than Preview, and is picked.

Of a paint by formula, a satin and a chrome vinyl. `render` denoises pictures of fewer than 256 samples; the report has
every mode with and without that, and Exact also as OSL, which samples the lamps in this Blender.
"""

from __future__ import annotations

import csv
from pathlib import Path
from tempfile import TemporaryDirectory

from materials import SHARED
from measured_materials.addon.report.pictures import QUIET, Rendered, Sizes, as_rendered, closest, measure_pictures
from measured_materials.bake.report.journal import Journal
from measured_materials.bake.source import BrdfSource
from measured_materials.bake.sources import analytic, read_source
from record import put
from rich.console import Console
from rich.table import Table

FULL, QUICK = Sizes(96, (16, 64, 256), 64, 2048), Sizes(48, (16, 64), 64, 512)
PREVIEWS = ("preview", QUIET["preview"])


def sources() -> dict[str, BrdfSource]:
    """By name; formulas of about the same look stand in for measurements that are not there."""
    folder = SHARED / "data" / "rgl"
    found: dict[str, BrdfSource] = {"paint": analytic.MetallicPaint()}
    stand_ins = {"satin_rosaline": (0.3, 60), "chm_orange": (0.6, 2000)}
    for name, (specular, exponent) in stand_ins.items():
        file = folder / f"{name}_rgb.bsdf"
        if file.is_file():
            found[name] = read_source(file)
        else:
            print(f"SKIPPED {name}: there is no {file.name}; a formula stands in for it")
            found[f"{name}, formula"] = analytic.BlinnPhong((0.3, 0.15, 0.1), (specular,) * 3, exponent)
    return found


def run(out: Path, quick: bool) -> None:
    """Tables of errors and reported.csv, and which of Exact and Preview is closer and which the report picks."""
    sizes = QUICK if quick else FULL
    rows: list[tuple[str, Rendered]] = []
    with TemporaryDirectory() as folder:
        for name, source in sources().items():
            kept = Path(folder) / name
            kept.mkdir()
            rendered, _ = measure_pictures(source, kept, Journal(kept / "journal.jsonl", {}), sizes, lambda share: None)
            rows += [(name, row) for row in rendered]
            _print(name, rendered, sizes)
    with (out / "reported.csv").open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(["material", *vars(rows[0][1])])
        writer.writerows([name, *vars(row).values()] for name, row in rows)


def _print(name: str, rendered: list[Rendered], sizes: Sizes) -> None:
    errors = {(row.variant, row.samples): row.error for row in rendered}
    table = Table(f"{name}: RMS error, relative", *(f"{samples} samples" for samples in sizes.samples))
    for variant in dict.fromkeys(row.variant for row in rendered):
        table.add_row(variant, *(f"{errors[variant, samples]:.2%}" for samples in sizes.samples))
    Console(width=120).print(table)
    usual = as_rendered(rendered)
    for samples, best in closest(usual).items():
        preview = min(row.error for row in usual if row.samples == samples and row.variant in PREVIEWS)
        exact = min(row.error for row in usual if row.samples == samples and row.variant not in PREVIEWS)
        put(f"{name}, preview, {samples}", preview)
        put(f"{name}, exact, {samples}", exact)
        verdict = "Exact is closer" if exact < preview else "Preview is closer"
        words = f"{verdict}, {exact:.2%} and {preview:.2%}; the report's pick is {best.variant}"
        print(f"  {samples} samples, as `render` makes them: {words}", flush=True)
