"""The four techniques of Kautz et al. 2004 for one swatch: errors, render times and pictures beside the truth."""

from __future__ import annotations

import base64
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...bake.bundle.bundle import Bundle, read_bundle
from ...bake.images.png import png_bytes
from ...bake.lobes.lobe_fit import fit_lobe
from ...bake.photographs.stack import PhotoStack
from ...bake.report.chart import Chart, Point
from ...bake.report.journal import Journal
from ...bake.report.page import Gallery, Picture, Section, Table
from ...bake.shading_maps.bake import ArcSettings, bake_stack
from ...bake.shading_maps.record import ShadingMapRecord
from ...bake.shading_maps.render_settings import RenderSettings
from ...bake.shading_maps.shading_map import averages_of
from ...bake.source import Array
from ...nodes.shading_map_material import build_shading_map
from ..gantry import techniques
from ..gantry.photograph_arc import gantry_scene
from ..gantry.scene import Gantry
from ..gantry.techniques import IN_ORDER, Case, MappedSwatch
from ..lights.light_tables import lamp_image, update_scene
from ..rendering.contact_sheet import to_display
from .pictures import SECONDS
from .swatches import ASIDE, BEHIND, BETWEEN, LEFT_OUT, Subject

LABELS = {**techniques.LABELS, "geometry": "the geometry itself"}
SLICES = 16
GAIN = 2.0  # of the difference images
# In Cycles "final_radiance" is "lookup".
_RENDERED = ("lit_texture", "angular", "lookup")
_SHOWN = (BETWEEN, ASIDE, LEFT_OUT)


@dataclass(frozen=True)
class TechniqueSizes:
    """Samples of the rendered pictures, the last of them shown."""

    samples: tuple[int, ...]


FULL = TechniqueSizes((4, 16, 64, 256))
QUICK = TechniqueSizes((4, 16))


def measure_techniques(
    subject: Subject, journal: Journal, sizes: TechniqueSizes, progress: Callable[[float], None]
) -> dict[str, Any]:
    """JSON-ready: "cases" (errors by case and technique), "rendered" (errors by technique and samples), "pictures"."""
    found: dict[str, Any] = {"cases": [], "rendered": [], "pictures": []}
    if not subject.cases:
        return found
    with tempfile.TemporaryDirectory() as folder:
        bundle = _baked(subject, Path(folder))
        swatch = techniques.mapped_swatch(bundle)
        cases = journal.measure(f"techniques {subject.name}", lambda: _compared(subject, swatch))
        found |= {"cases": cases["rows"], "pictures": cases["pictures"]}
        variants = (*_RENDERED, "geometry") if subject.swatch else _RENDERED
        for k, variant in enumerate(variants):
            progress(k / len(variants))
            key = f"technique times {subject.name} {variant} {sizes}"
            rows = journal.measure(key, lambda v=variant: _rendered(subject, bundle, v, sizes))
            found["rendered"] += rows["rows"]
            found["pictures"] += rows["pictures"]
    return found


def _baked(subject: Subject, folder: Path) -> Bundle:
    """A map lit by the f_r that an artist would choose for it, or that fits the photographs best."""
    assert subject.directions is not None
    seen = subject.directions[:, 2] > 1e-3
    elevations = np.arcsin(np.minimum(subject.directions[seen, 2], 1))
    averages = averages_of(subject.images)[seen]
    if subject.swatch:
        render = techniques.fitted_render(subject.swatch.lobe, elevations, averages)
    else:
        fit = fit_lobe(elevations, averages)
        render = RenderSettings(fit.lobe, fit.scale)
    names = tuple(str(k) for k in range(len(subject.images)))
    # To a scale of their own the photographs are as good as calibrated, for they are compared with each other.
    stack = PhotoStack(subject.images, names, subject.directions, True, ())
    return read_bundle(bake_stack(stack, folder / "swatch", ArcSettings(SLICES, render=render), name="swatch").path)


# --- without noise, in numpy ----------------------------------------------------------------------------


def _compared(subject: Subject, swatch: MappedSwatch) -> dict[str, Any]:
    size = subject.images.shape[1]
    rows, pictures, drawn = [], [], set()
    for case in subject.cases:
        target = techniques.truth(case, subject.frames)
        gain = _exposure(target)
        shown = case.group in _SHOWN and case.group not in drawn
        drawn.add(case.group)
        if shown:
            words = "the geometry, photographed" if subject.swatch else "the photograph"
            pictures.append([case.group, _png(target * gain), words])
        for technique in IN_ORDER:
            picture = techniques.shown(technique, swatch, case, size)
            found = techniques.errors(picture, target)
            rows.append({"case": case.group, "technique": technique, **found})
            if shown:
                words = f"{LABELS[technique]}, RMS {found['rms']:.0%}, brightness {round(found['mean'], 2) + 0.0:+.0%}"
                pictures.append([case.group, _png(picture * gain), words])
    return {"rows": rows, "pictures": pictures}


# --- path traced ----------------------------------------------------------------------------------------


def _rendered(subject: Subject, bundle: Bundle, variant: str, sizes: TechniqueSizes) -> dict[str, Any]:
    """Error and seconds of the first case, the flat patch or the geometry under the same sun."""
    case, size = subject.cases[0], subject.images.shape[1]
    target = techniques.truth(case, subject.frames)
    gain, rows, pictures = _exposure(target), [], []
    with _lit(subject, bundle, variant, case, size) as gantry:
        _timed(gantry, 1)  # compiles the graph
        setup = min(_timed(gantry, 1)[1] for _ in range(2))
        for samples in sizes.samples:
            picture, seconds = _timed(gantry, samples)
            error = techniques.errors(picture, target)["rms"]
            spent = max(seconds - setup, 1e-3) * samples / (samples - 1)  # the set-up rendered one sample too
            rows.append({"technique": variant, "samples": samples, "seconds": spent, "error": error})
    words = f"{LABELS[variant]}, {samples} samples, {rows[-1]['seconds']:.2g} s, RMS {error:.0%}"
    difference = np.abs(picture - target) * gain * GAIN
    pictures.append(["Path traced in Cycles, like the first row", _png(picture * gain), words])
    pictures.append([f"Differences of these, {GAIN:g} times", _png(difference), LABELS[variant]])
    return {"rows": rows, "pictures": pictures}


@contextmanager
def _lit(subject: Subject, bundle: Bundle, variant: str, case: Case, size: int) -> Iterator[Gantry]:
    material = None
    if variant != "geometry":
        settings = replace(ShadingMapRecord.read(bundle).render, technique=variant)
        material = build_shading_map(bundle, settings=settings, lamps=lamp_image())
    target: Any = material or subject.swatch
    try:
        with gantry_scene(target, size=size, samples=1) as gantry:
            gantry.set_view(*case.view_radians)
            elevation, azimuth, _ = case.lights[0]
            gantry.set_light(np.radians(90 - elevation), np.radians(azimuth))
            update_scene(gantry.scene)
            yield gantry
    finally:
        if material:
            bpy.data.materials.remove(material)


def _timed(gantry: Gantry, samples: int) -> tuple[Array, float]:
    gantry.scene.cycles.samples = samples
    started = time.process_time()
    return gantry.render(seed=3).astype(np.float64), time.process_time() - started


def _exposure(target: Array) -> float:
    return 0.6 / max(float(np.percentile(target.max(-1), 90)), 1e-30)


def _png(linear: Array) -> str:
    return base64.b64encode(png_bytes(to_display(np.asarray(linear, np.float32)))).decode()


# --- report ---------------------------------------------------------------------------------------------

_WHAT_FOR = (
    "Four ways to light the photographs (Kautz et al. 2004, figure 6). A lit texture multiplies the brightest "
    "photograph with the light: for swatches far away. Final radiance chooses the photograph by the light that the "
    "flat material would send out: it works in real time (EEVEE), and is right as long as the lights are about as "
    "strong as in the photographs. The angular lookup takes the photograph of the light's own elevation: for one light "
    "that lies low. The lookup by r, the usual one, takes the photograph of the same reflected light, for each light "
    "anew: it follows curved surfaces, many lights and any f_r."
)


_GEOMETRY = (
    "The geometry itself is shown for comparison. A flat patch of it renders about as fast as its map; what a map "
    "saves is the modelling and the memory, and it can be made of things that nobody has modelled."
)


def techniques_section(subject: Subject, found: Mapping[str, Any]) -> Section:
    """Errors, curve and pictures; or why there are none."""
    title = f"Techniques: {subject.name}"
    if not subject.cases:
        why = "photographs whose lights are known, six or more" if len(subject.images) else "photographs"
        return Section(title, [_WHAT_FOR], notes=[f"Not compared: techniques need {why}."])
    means = _means(found["cases"])
    section = Section(title, [_WHAT_FOR, _verdict(means)])
    series: dict[str, list[Point]] = {}
    for row in found["rendered"]:
        point = Point(row["seconds"], row["error"], f"{row['samples']} samples")
        series.setdefault(LABELS[row["technique"]], []).append(point)
    title = f"{subject.name}: error against render time, light {subject.cases[0].lights[0][0]:.0f} degrees high"
    section.charts = [
        Chart(title, SECONDS, "RMS difference to the truth, relative", series, knee=False, apart=(LABELS["geometry"],))
    ]
    groups = dict.fromkeys(group for group, _, _ in found["pictures"])
    section.galleries = [
        Gallery(
            group[0].upper() + group[1:],
            [Picture(base64.b64decode(png), words) for g, png, words in found["pictures"] if g == group],
        )
        for group in groups
    ]
    head = ("light and view", *(LABELS[t] for t in IN_ORDER))
    section.tables = [Table(head, [(case, *(row[t] for t in IN_ORDER)) for case, row in means.items()])]
    section.notes = [
        "In the table, RMS differences in parts of the truth's RMS, without noise. Rendered in Cycles, final radiance "
        "is the lookup by r."
    ]
    if subject.swatch:
        section.notes += [
            _GEOMETRY,
            "The truth is a render of the geometry at few samples; its own noise is part of every error.",
        ]
    return section


def _means(rows: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, float]]:
    """RMS error by case and technique, over the pictures of a case."""
    cases = dict.fromkeys(row["case"] for row in rows)
    return {
        case: {
            t: float(np.sqrt(np.mean([r["rms"] ** 2 for r in rows if (r["case"], r["technique"]) == (case, t)])))
            for t in IN_ORDER
        }
        for case in cases
    }


def _verdict(means: Mapping[str, Mapping[str, float]]) -> str:
    """What holds and what fails, with this run's figures."""
    if LEFT_OUT in means:
        row = means[LEFT_OUT]
        return (
            f"Of photographs that the map was made without, the lookup by r is {row['lookup']:.0%} off and a lit "
            f"texture {row['lit_texture']:.0%}. These lights lie on the arc; from another side the method fails, since "
            "shadows stay where they were photographed."
        )
    held, aside, behind = (means[case] for case in (BETWEEN, ASIDE, BEHIND))
    return (
        f"Between two photographs the lookup by r is {held['lookup']:.0%} off, a lit texture "
        f"{held['lit_texture']:.0%}. It fails with light from another azimuth, for shadows stay where they were "
        f"photographed: {aside['lookup']:.0%} off with light from the side, {behind['lookup']:.0%} from behind (a lit "
        f"texture: {behind['lit_texture']:.0%}); and seen obliquely, where nothing shifts or hides."
    )
