"""Ours beside Mitsuba 3 `measured`: mean squared error times processor seconds, on the same RGL files and scenes.

Each side is held to its own truth, a long render with seeds of its own, whose noise is taken off: the two read the data
differently. RGL's tables are of incident light and outgoing view; Mitsuba, which follows paths from the eye, looks them
up with the two exchanged, and the measurements are not reciprocal. That both have the same scene and light is shown by
a material that is exchanged before it is baked: its picture is Mitsuba's.

Beside them stands a Principled BSDF of about the look, which is one of Cycles' own closures: error and time that Cycles
itself takes in these scenes, whatever a measured material costs on top.

Our truth is Reference, which shares no closures and no lamp sampling with what is judged, and Exact as OSL, weighted by
how little noise each has; how far apart their means are is shown. Errors are in parts of the truth's mean. Times are of
one thread, set-up taken off.
"""

from __future__ import annotations

import csv
import math
import statistics
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from tempfile import TemporaryDirectory

import bpy
import numpy as np
from engine_scenes import show
from materials import SHARED
from measured_materials.addon.lights.light_tables import update_scene
from measured_materials.addon.material.build_brdf import build_brdf
from measured_materials.addon.material.choices import Choices
from measured_materials.addon.report.principled_match import fit_principled
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.source import Array
from measured_materials.bake.sources import read_source
from mitsuba_environment import mitsuba_python, render
from peer_bakes import bake_all, bundle_path
from peer_scenes import SCENES, environment, facts, lit, on_sphere, timed
from record import put
from rich.console import Console
from rich.table import Table

NODES, OSL, REFERENCE = "exact", "exact, OSL", "reference"
STAND_IN = "Principled"
OURS, THEIRS = (NODES, OSL, REFERENCE, STAND_IN), ("scalar_rgb", "llvm_ad_rgb")
QUICK = ("paper_white_rgb", "satin_rosaline_rgb", "chm_orange_rgb")
MOST_APART, LEAST_MEDIAN = 0.005, 3.0
# Seeds from here on are those of truths.
_TRUTH = 1000
# A picture that takes less than this part of its set-up beyond it is timed by one of so many times the samples.
_MOST_OF_SETUP, _MORE = 0.5, 8


@dataclass(frozen=True)
class Sizes:
    """Edge in pixels, samples and seeds of what is judged, samples that set-up is told apart by, those of a truth."""

    edge: int = 56
    samples: int = 64
    seeds: int = 4
    few: int = 4
    truth_samples: int = 256
    truth_seeds: int = 4


@dataclass(frozen=True)
class Truth:
    """Pixels (P, 3) on the sphere, the mean variance that is left in them, and the means of single seeds."""

    pixels: Array
    variance: float
    means: Array

    @property
    def mean(self) -> float:
        """Of all pixels and channels."""
        return float(self.pixels.mean())

    @property
    def error(self) -> float:
        """Standard error of the mean, in parts of it."""
        return float(self.means.std(ddof=1) / math.sqrt(len(self.means)) / self.mean)


@dataclass(frozen=True)
class Row:
    """One renderer of a material in a scene; `error` is the mean squared one, in parts of the square of the mean."""

    material: str
    scene: str
    renderer: str
    mean: float
    error: float
    seconds: float

    @property
    def cost(self) -> float:
        """Error times seconds: what is left of it at equal time."""
        return self.error * self.seconds


def run(out: Path, quick: bool) -> None:
    """Tables and mitsuba.csv; --quick takes three materials and smaller pictures."""
    files = sorted((SHARED / "data" / "rgl").glob("*.bsdf"))
    if not files:
        print(f"SKIPPED: no RGL measurements in {SHARED}/data/rgl, which are not part of the repository")
        return
    files = [file for file in files if not quick or file.stem in QUICK]
    sizes = Sizes(edge=40) if quick else Sizes()
    python, rows = mitsuba_python(), []
    variants = _that_run(python, files[0])
    # Written as it goes: the whole takes half an hour, and what was measured before a stop is worth reading.
    with (out / "mitsuba.csv").open("w", newline="", encoding="utf-8") as stream, TemporaryDirectory() as name:
        writer = csv.DictWriter(stream, [field.name for field in fields(Row)])
        writer.writeheader()
        folder = Path(name)
        print(f"baking {len(files)} materials, each also with light and viewer exchanged", flush=True)
        bake_all(files, folder)
        np.save(folder / "world.npy", environment())
        apart = []
        for scene_name in SCENES:
            for file in files:
                bench = _Pair(file, scene_name, folder, sizes, python, variants)
                found = list(bench.rows())
                rows += found
                writer.writerows(asdict(row) for row in found)
                stream.flush()
                apart.append(bench.apart)
    _report(rows, sizes)
    good = sum(abs(difference) <= MOST_APART for difference in apart)
    print(
        f"read with light and viewer exchanged, as Mitsuba does: {good} of {len(apart)} within {MOST_APART:.1%} of it"
    )
    put("most apart, %", 100 * max(abs(difference) for difference in apart))


class _Pair:
    """One material in one scene by both renderers."""

    def __init__(self, file: Path, scene: str, folder: Path, sizes: Sizes, python: str, variants: list[str]) -> None:
        self.file, self.scene, self.folder, self.sizes = file, scene, folder, sizes
        self.python, self.variants = python, variants
        self.mask = on_sphere(sizes.edge)
        self.apart = math.nan

    def rows(self) -> Iterator[Row]:
        """Of all renderers that run here; then `apart` is how far the exchanged material is from Mitsuba."""
        judged, truth, exchanged, reference, of_stand_in = self._ours()
        words = [f"Reference {reference.mean / truth.mean - 1:+.2%} (+- {reference.error:.2%}) from our truth"]
        for name, (pictures, seconds) in judged.items():
            yield self._row(name, pictures, seconds, of_stand_in if name == STAND_IN else truth)
        pictures, seconds, theirs = self._theirs(self.variants[0], with_truth=True)
        self.apart, sure = exchanged.mean / theirs.mean - 1, math.hypot(exchanged.error, theirs.error)
        words.append(
            f"exchanged {self.apart:+.2%} (+- {sure:.2%}) from Mitsuba, as it is {truth.mean / theirs.mean - 1:+.2%}"
        )
        yield self._row(self.variants[0], pictures, seconds, theirs)
        for variant in self.variants[1:]:
            pictures, seconds, _ = self._theirs(variant)
            yield self._row(variant, pictures, seconds, theirs)
        print(f"  {self.file.stem}, {self.scene}: {'; '.join(words)}", flush=True)

    def _row(self, name: str, pictures: Array, seconds: float, truth: Truth) -> Row:
        error = float(((pictures - truth.pixels) ** 2).mean()) - truth.variance
        return Row(self.file.stem, self.scene, name, float(pictures.mean()), error / truth.mean**2, seconds)

    # --- ours --------------------------------------------------------------------------------------------

    def _ours(self) -> tuple[dict[str, tuple[Array, float]], Truth, Truth, Truth, Truth]:
        """Pictures and seconds of `OURS`; the truth, the exchanged material's, Reference's alone, the stand-in's."""
        bundle = read_bundle(bundle_path(self.file, self.folder))
        with lit(self.scene) as scene:
            update_scene(scene)
            materials = {
                NODES: build_brdf(bundle, choices=Choices(mode="exact"), scene=scene)[0],
                OSL: _sampled(bundle, scene),
                REFERENCE: build_brdf(bundle, choices=Choices(mode="reference"), scene=scene)[0],
                STAND_IN: fit_principled(read_source(self.file)).material(),
            }
            judged = {name: self._judge(scene, material) for name, material in materials.items()}
            by_mirror, by_lamp, native = (self._truth(scene, materials[name]) for name in (REFERENCE, OSL, STAND_IN))
            other = _sampled(read_bundle(bundle_path(self.file, self.folder, exchanged=True)), scene)
            exchanged = self._truth(scene, other)
        for material in (*materials.values(), other):
            bpy.data.materials.remove(material)
        for blocks in (bpy.data.node_groups, bpy.data.images, bpy.data.meshes, bpy.data.lights, bpy.data.worlds):
            for block in [block for block in blocks if not block.users]:
                blocks.remove(block)
        return judged, _together(by_mirror, by_lamp), exchanged, by_mirror, native

    def _judge(self, scene: bpy.types.Scene, material: bpy.types.Material) -> tuple[Array, float]:
        sizes = self.sizes
        show(scene, material)
        timed(scene, sizes.edge, 1, 0)  # also compiles the graph
        short = min(timed(scene, sizes.edge, sizes.few, seed)[1] for seed in range(sizes.seeds))
        found = [timed(scene, sizes.edge, sizes.samples, seed) for seed in range(sizes.seeds)]
        pictures, seconds = np.stack([picture[self.mask] for picture, _ in found]), min(s for _, s in found)
        if seconds - short > _MOST_OF_SETUP * short:
            return pictures, self._seconds(short, seconds, sizes.samples)
        # Where setting up takes longest, as in OSL, a busy machine makes the difference vanish.
        many = _MORE * sizes.samples
        return pictures, self._seconds(short, timed(scene, sizes.edge, many, 0)[1], many)

    def _seconds(self, short: float, long: float, samples: int) -> float:
        """Of all samples of a picture, set-up taken off, of a longer one of so many."""
        return max(long - short, 1e-3) * self.sizes.samples / (samples - self.sizes.few)

    def _truth(self, scene: bpy.types.Scene, material: bpy.types.Material) -> Truth:
        sizes = self.sizes
        show(scene, material)
        scene.render.threads_mode = "AUTO"
        seeds = range(_TRUTH, _TRUTH + sizes.truth_seeds)
        pictures = [timed(scene, sizes.edge, sizes.truth_samples, seed)[0][self.mask] for seed in seeds]
        scene.render.threads_mode = "FIXED"
        return _truth_of(np.stack(pictures))

    # --- theirs ------------------------------------------------------------------------------------------

    def _theirs(self, variant: str, with_truth: bool = False) -> tuple[Array, float, Truth]:
        """Pictures, seconds and the truth, which means something only where it is wanted."""
        sizes, seeds, pictures = self.sizes, range(self.sizes.seeds), self.folder / "theirs.npy"
        jobs = [(samples, seed) for samples in (sizes.few, sizes.samples) for seed in seeds]
        jobs += [(sizes.truth_samples, _TRUTH + k) for k in range(with_truth * sizes.truth_seeds)]
        told = {"variant": variant, "file": str(self.file), "facts": facts(self.scene), "edge": sizes.edge}
        world = str(self.folder / "world.npy") if self.scene == "HDR world" else ""
        seconds = render(self.python, {**told, "world": world, "jobs": jobs, "out": str(pictures)})
        found = np.load(pictures)[:, self.mask].astype(np.float64)
        few, many, rest = (found[k : k + len(seeds)] for k in (0, len(seeds), 2 * len(seeds)))
        taken = self._seconds(min(seconds[: len(few)]), min(seconds[len(few) : 2 * len(few)]), sizes.samples)
        return many, taken, _truth_of(rest if with_truth else many)


def _that_run(python: str, file: Path) -> list[str]:
    """Of `THEIRS`, after a look at a small picture; the first has to, and of the others it is said why not."""
    found = []
    with TemporaryDirectory() as folder:
        told = {"file": str(file), "facts": facts(SCENES[0]), "world": "", "edge": 8, "out": f"{folder}/look.npy"}
        for variant in THEIRS:
            try:
                render(python, {**told, "variant": variant, "jobs": [(1, 1)]})
            except ChildProcessError as error:
                print(f"SKIPPED: Mitsuba's {variant} does not run here: {str(error)[:100]}")
            else:
                found.append(variant)
    if THEIRS[0] not in found:
        sys.exit(f"bench mitsuba: needs {THEIRS[0]}")
    return found


def _sampled(bundle: Bundle, scene: bpy.types.Scene) -> bpy.types.Material:
    """As OSL, with the lamps and the world's picture sampled."""
    return build_brdf(bundle, choices=Choices(mode="exact", shader="osl"), scene=scene)[0]


def _truth_of(pictures: Array) -> Truth:
    """Of pictures (K, P, 3) of independent seeds."""
    pictures = pictures.astype(np.float64)
    variance = float(pictures.var(0, ddof=1).mean()) / len(pictures)
    return Truth(pictures.mean(0), variance, pictures.mean((1, 2)))


def _together(a: Truth, b: Truth) -> Truth:
    """Two pictures of the same, each by how little noise it has."""
    share = b.variance / max(a.variance + b.variance, 1e-30)
    variance = share**2 * a.variance + (1 - share) ** 2 * b.variance
    return Truth(share * a.pixels + (1 - share) * b.pixels, variance, share * a.means + (1 - share) * b.means)


# --- report --------------------------------------------------------------------------------------------


def _report(rows: list[Row], sizes: Sizes) -> None:
    """A table for each scene, and how often and by how much ours is ahead."""
    for scene in dict.fromkeys(row.scene for row in rows):
        found: dict[str, dict[str, Row]] = {}
        for row in rows:
            if row.scene == scene:
                found.setdefault(row.material, {})[row.renderer] = row
        theirs = [name for name in THEIRS if all(name in of for of in found.values())]
        title = f"{scene}: RMS at {sizes.samples} samples and seconds; the better Mitsuba's error x seconds over ours"
        table = Table("material", *OURS, *theirs, *(f"gain, {name}" for name in OURS), title=title)
        gains: dict[str, list[float]] = {name: [] for name in OURS}
        for material, of in found.items():
            peer = min(of[name].cost for name in theirs)
            for name in OURS:
                gains[name].append(peer / max(of[name].cost, 1e-30))
            cells = [f"{math.sqrt(max(of[name].error, 0)):.2%} {of[name].seconds:.2f}" for name in (*OURS, *theirs)]
            table.add_row(material.removesuffix("_rgb"), *cells, *(f"{gains[name][-1]:.2f}" for name in OURS))
        Console(width=190).print(table)
        for name, values in gains.items():
            for what in ("error", "seconds"):
                pairs = (
                    (getattr(of[name], what), min(getattr(of[peer], what) for peer in theirs)) for of in found.values()
                )
                put(f"{scene}, {name}, median {what}", statistics.median(ours / peer for ours, peer in pairs))
            middle, ahead = statistics.median(values), sum(value > 1 for value in values)
            goal = f"median {middle:.2f} (goal {LEAST_MEDIAN:g}), least {min(values):.2f} (goal 1)"
            print(f"{scene}, {name}: ahead on {ahead} of {len(values)}, {goal}")
            put(f"{scene}, {name}, median gain", middle)
            put(f"{scene}, {name}, least gain", min(values))
