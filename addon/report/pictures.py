"""Pictures of a report: error against render time for every mode and a Principled BSDF, on one scene."""

from __future__ import annotations

import base64
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...bake.atomic_write import replacing_file
from ...bake.brdf.bake import bake_source
from ...bake.brdf.modes import MODES
from ...bake.brdf.record import BrdfRecord
from ...bake.bundle.bundle import Bundle, read_bundle
from ...bake.images.png import png_bytes
from ...bake.report.chart import Chart, Point
from ...bake.report.journal import Journal
from ...bake.report.page import Gallery, Picture, Section, Table
from ...bake.source import Array, BrdfSource
from ...nodes.osl_script import use_osl, why_no_osl
from ..material.build_brdf import build_brdf
from ..material.choices import ALWAYS, OSL, Choices
from ..rendering.contact_sheet import to_display
from ..rendering.denoising import ENOUGH, denoise_by_twin, denoise_renders, twin_of, why_not_possible
from ..studio.studio import build_studio, remove_studio, render_linear
from .principled_match import fit_principled

PRINCIPLED = "Principled BSDF"
# Mode Exact as one OSL shader, which samples lamps in every version of Blender.
SAMPLED, SAMPLED_DENOISED = "exact, OSL, lamps sampled", "exact, OSL, denoised"
# Denoised by the materials' own albedo and normals.
DENOISED = {"preview, denoised": "preview", "exact, denoised": "exact"}
# What `render` makes of a mode by itself where samples are few.
QUIET = {"preview": "preview, denoised", "exact": "exact, denoised", SAMPLED: SAMPLED_DENOISED}
_Render = Callable[[int, int, int], Array]  # edge in pixels, samples and seed to the picture
# What else the machine does takes no part in it, as it would in time by the clock.
SECONDS = "seconds of processor, all threads together"
# Difference images are shown this much brighter than the pictures.
GAIN = 4.0


@dataclass(frozen=True)
class Sizes:
    """Edge in pixels, samples of the pictures, of those shown, and of the truth."""

    edge: int
    samples: tuple[int, ...]
    shown: int
    truth: int


FULL = Sizes(128, (4, 16, 64, 256), 64, 4096)
QUICK = Sizes(80, (4, 16, 64), 64, 512)


@dataclass(frozen=True)
class Rendered:
    """One picture: its samples, seconds of processor without set-up, and RMS error in parts of the truth's mean."""

    variant: str
    samples: int
    seconds: float
    error: float


def measure_pictures(
    source: BrdfSource, folder: Path, journal: Journal, sizes: Sizes, progress: Callable[[float], None]
) -> tuple[list[Rendered], list[Gallery]]:
    """Render all variants of one material; bundle and truth are kept in `folder` while the report is made."""
    path = folder / "material.mmat"
    bundle = read_bundle(path if path.is_dir() else bake_source(source, path).path)
    truth_file = folder / f"truth_{sizes.edge}_{sizes.truth}.npy"
    if not truth_file.is_file():
        with _shown(bundle, source, _least_noisy()) as render:
            truth, _ = _timed(render, sizes, sizes.truth, seed=1)
        with replacing_file(truth_file) as temporary, temporary.open("wb") as stream:
            np.save(stream, truth)
    truth = np.load(truth_file, allow_pickle=False)
    found: list[Rendered] = []
    pictures = [_picture(truth, f"exact, {sizes.truth} samples: taken as the truth")]
    differences: list[Picture] = []
    variants = [PRINCIPLED, *MODES]
    osl, denoiser = not why_no_osl(), not why_not_possible()
    variants += [SAMPLED] * osl + list(DENOISED) * denoiser + [SAMPLED_DENOISED] * (osl and denoiser)
    for k, variant in enumerate(variants):
        progress(k / len(variants))
        key = f"pictures {source.name} {variant} {sizes}"
        entry = journal.measure(key, partial(_measured, bundle, source, variant, sizes, truth))
        found += [Rendered(variant, **row) for row in entry["rows"]]
        shown = [Picture(base64.b64decode(data), caption) for data, caption in entry["pictures"]]
        pictures += shown[:1]
        differences += shown[1:]
    return found, [Gallery("Pictures", pictures), Gallery(f"Differences to the truth, {GAIN:g} times", differences)]


def _measured(bundle: Bundle, source: BrdfSource, variant: str, sizes: Sizes, truth: Array) -> dict[str, Any]:
    rows, pictures = [], []
    with _shown(bundle, source, variant) as render:
        _timed(render, sizes, 1, seed=2)  # compiles the graph
        setup = min(_timed(render, sizes, 1, seed=2)[1] for _ in range(2))
        for samples in sizes.samples:
            pixels, seconds = _timed(render, sizes, samples, seed=2)
            error = float(np.sqrt(((pixels - truth) ** 2).mean()) / truth.mean())
            rows.append({"samples": samples, "seconds": max(seconds - setup, 1e-3), "error": error})
            if samples == sizes.shown:
                difference = np.abs(pixels - truth) * GAIN
                caption = f"{variant}, {samples} samples, {rows[-1]['seconds']:.2g} s, error {100 * error:.3g}%"
                pictures = [_entry(pixels, caption), _entry(difference, variant)]
    return {"rows": rows, "pictures": pictures}


@contextmanager
def _shown(bundle: Bundle, source: BrdfSource, variant: str) -> Iterator[_Render]:
    """What renders the studio with the material; Principled is fitted to the source."""
    material = fit_principled(source).material() if variant == PRINCIPLED else bpy.data.materials.new("report")
    try:
        scene = build_studio(material)
        try:
            if variant in (SAMPLED, SAMPLED_DENOISED):
                build_brdf(bundle, material, choices=Choices(sample=ALWAYS, shader=OSL), scene=scene)
                use_osl(scene)
            elif variant != PRINCIPLED:
                if variant in DENOISED:
                    denoise_renders(scene)
                build_brdf(bundle, material, choices=Choices(mode=DENOISED.get(variant, variant)), scene=scene)
            record = BrdfRecord.read(bundle)

            def render(edge: int, samples: int, seed: int) -> Array:
                scene.render.resolution_x = scene.render.resolution_y = edge
                scene.cycles.samples, scene.cycles.seed = samples, seed
                picture = render_linear(scene)
                return (
                    picture
                    if variant != SAMPLED_DENOISED
                    else denoise_by_twin(twin_of(record), scene, material, picture)
                )

            yield render
        finally:
            remove_studio(scene)
    finally:
        bpy.data.materials.remove(material)


def _least_noisy() -> str:
    """Variant of mode Exact whose pictures need the fewest samples."""
    return "exact" if why_no_osl() else SAMPLED


def _timed(render: _Render, sizes: Sizes, samples: int, seed: int) -> tuple[Array, float]:
    started = time.process_time()
    return render(sizes.edge, samples, seed).astype(np.float64), time.process_time() - started


def _entry(linear: Array, caption: str) -> list[str]:
    return [base64.b64encode(png_bytes(to_display(linear.astype(np.float32)))).decode(), caption]


def _picture(linear: Array, caption: str) -> Picture:
    return Picture(png_bytes(to_display(linear.astype(np.float32))), caption)


def as_rendered(rendered: list[Rendered]) -> list[Rendered]:
    """Of modes that `render` denoises, its pictures, of nodes or of OSL: denoised where samples are few."""
    there = {row.variant for row in rendered}
    return [
        row
        for row in rendered
        for plain, quiet in QUIET.items()
        if row.variant == (quiet if row.samples < ENOUGH and quiet in there else plain)
    ]


def closest(rendered: list[Rendered]) -> dict[int, Rendered]:
    """By samples, the picture of least error."""
    return {
        samples: min((row for row in rendered if row.samples == samples), key=lambda row: row.error)
        for samples in sorted({row.samples for row in rendered})
    }


def _picked_as_rendered(rendered: list[Rendered]) -> str:
    """The closest of what a user gets, in words."""
    usual = as_rendered(rendered)
    found = [f"at {samples} samples {best.variant} ({best.error:.2%})" for samples, best in closest(usual).items()]
    return (
        f"As `render` makes pictures, with or without --osl, denoised unasked below {ENOUGH} samples, the closest are "
        f"{', '.join(found)}."
    )


def pictures_section(name: str, rendered: list[Rendered], galleries: list[Gallery]) -> Section:
    """The curve, and what it looks like."""
    series: dict[str, list[Point]] = {}
    for row in rendered:
        series.setdefault(row.variant, []).append(Point(row.seconds, row.error, f"{row.samples} samples"))
    words = [
        "The studio scene in each of the four modes, and with a Principled BSDF fitted to the material; Exact also as "
        "an OSL shader that samples the lamps itself, as nodes do from Blender 5.1 on; Preview and Exact also denoised "
        "by the material's albedo and normals, as `render` does. Error is the RMS difference to a picture of many "
        "samples in mode Exact, in parts of its mean. Noise falls with time; where "
        "a curve levels out, what is left is how far the closures are from the measurement, which no time reduces. "
        "Seconds are of the samples alone, without loading, compiling and denoising, and of all threads together."
    ]
    section = Section(f"Pictures: {name}", words, galleries=galleries)
    section.charts = [Chart(f"{name}: error against render time", SECONDS, "RMS error, relative", series, knee=False)]
    rows = [list(vars(row).values()) for row in rendered]
    section.tables = [Table(("mode", "samples", "seconds", "error"), rows)]
    section.notes = [
        "Exact and Reference differ from the truth by hardly more than noise, which four times the samples halve. A "
        f"pick of another mode holds for pictures of {max(row.samples for row in rendered)} samples or fewer, in which "
        "noise outweighs its difference from the measurement.",
        _picked_as_rendered(rendered),
    ]
    return section
