"""Shading maps in fewer numbers: time and error of a power law (Kautz et al. 2004), shared curves, coarser storage."""

from __future__ import annotations

import json
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from csv_rows import write_rows
from materials import SHARED
from measured_materials.bake.images.image_io import load_openimageio, read_image, write_image
from measured_materials.bake.images.storage import Storage, scale_for
from measured_materials.bake.shading_maps.power_law import PowerLaw, fit, fit_brute_force, rms_error
from measured_materials.bake.shading_maps.shading_map import at_level, averages_of, linearise
from measured_materials.bake.shading_maps.slice_basis import SliceBasis, fit_basis

SLICES = 8
PAPER = "0.040 to 0.065"
PLATES = ("single1", "single3", "single5", "multi2")
STACKS = ("canvas", "painted_wood", "gold_icon", *(f"rendered_plate/{plate}" for plate in PLATES))
Model = PowerLaw | SliceBasis
MODELS: dict[str, Callable[[np.ndarray], Model]] = {
    "power law": fit,
    "free k": lambda slices: fit(slices, free_k=True),
    "1 curve": lambda slices: fit_basis(slices, 1),
    "2 curves": lambda slices: fit_basis(slices, 2),
    "2 non-neg.": lambda slices: fit_basis(slices, 2, nonnegative=True),
    "3 curves": lambda slices: fit_basis(slices, 3),
}
NUMBERS = dict(zip(MODELS, (2, 2, 1, 2, 2, 3)))


def run(out: Path, quick: bool) -> None:
    """Times on made-up slices; errors and storage on photographs, where they are at hand."""
    _times(quick)
    if not (SHARED / "data" / "stacks").is_dir() or load_openimageio() is None:
        print("\nSKIPPED errors and storage: they need the photographs beside the repository, and OpenImageIO")
        return
    names = STACKS[:2] if quick else STACKS
    rows: list[dict[str, Any]] = []
    for kind in ("one side", "over the top"):
        arcs = {name: arc(name, one_side=kind == "one side") for name in names}
        rows += _fit_table(kind, arcs)
        rows += _held_out_table(kind, arcs)
    _storage_table(linearise(arc("painted_wood", one_side=True), SLICES).map.slices)
    write_rows(out / "compression.csv", rows)


# --- time -----------------------------------------------------------------------------------------------


def made_up(size: int) -> np.ndarray:
    """Slices (8, size, size, 3) that are power laws but for 10 % of noise."""
    rng = np.random.default_rng(1)
    shape = (size, size, 3)
    exponent, k = np.exp(rng.normal(0, 0.5, shape)), rng.gamma(3, 1 / 3, shape)
    x = np.linspace(0, 1, SLICES).reshape(-1, 1, 1, 1)
    return np.maximum(k * x**exponent * (1 + 0.1 * rng.normal(size=(SLICES, *shape))), 0).astype(np.float32)


def cpu_seconds(work: Callable[[], Any], repeats: int = 1) -> tuple[float, Any]:
    """Median processor time, and the result."""
    times, result = [], None
    for _ in range(repeats):
        started = time.process_time()
        result = work()
        times.append(time.process_time() - started)
    return statistics.median(times), result


def _times(quick: bool) -> None:
    size = 256 if quick else 512
    slices = made_up(size)
    print(
        f"{size} x {size} x 3 texels, {SLICES} slices; seconds of processor time (goal: 1 s and 20 times less at 512)"
    )
    for free_k in (False, True):
        slow, brute = cpu_seconds(lambda free_k=free_k: fit_brute_force(slices, free_k=free_k))
        coarse, rough = cpu_seconds(lambda free_k=free_k: fit_brute_force(slices, free_k=free_k, candidates=64))
        fast, newton = cpu_seconds(lambda free_k=free_k: fit(slices, free_k=free_k), 7)
        print("  k " + ("free" if free_k else "the last slice, as in the paper"))
        for name, seconds, law in (
            ("brute force, 512 exponents and golden section", slow, brute),
            ("brute force, 64 exponents and golden section", coarse, rough),
            ("fit", fast, newton),
        ):
            print(f"    {name:48s}{seconds:8.3f} s  RMS {law.rms(slices):.6f}  {slow / seconds:6.1f} times faster")
    for name, options in {"2 curves": {}, "2 curves, non-negative": {"nonnegative": True}}.items():
        seconds, _ = cpu_seconds(lambda options=options: fit_basis(slices, 2, **options))
        print(f"    {name:48s}{seconds:8.3f} s")


# --- error on photographs -------------------------------------------------------------------------------


def arc(name: str, *, one_side: bool) -> np.ndarray:
    """(n, H, W, 3) linear photographs of the arc with the most lights, decoded as sRGB, sorted by average.

    How a camera's JPEG came about is not documented, so sRGB is an assumption; all models share it.
    """
    folder = SHARED / "data" / "stacks" / name
    listing = next(path / "arcs.json" for path in (folder, folder.parent) if (path / "arcs.json").is_file())
    arcs = [entry["images"] for entry in json.loads(listing.read_text())["arcs"]]
    if one_side:
        arcs = [[image for image in images if image["arc_deg"] <= 90] for images in arcs]
    images = np.stack([read_srgb(folder / image["file"]) for image in max(arcs, key=len)])
    return images[np.argsort(averages_of(images))]


def read_srgb(path: Path) -> np.ndarray:
    """An 8-bit photograph in linear light, (H, W, 3)."""
    oiio = load_openimageio()
    assert oiio is not None
    stream = oiio.ImageInput.open(str(path))
    value = stream.read_image(0, 0, 0, 3, oiio.FLOAT)
    stream.close()
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4).astype(np.float32)


def _heading(title: str, columns: list[str]) -> None:
    print(f"\n{title}\n{'':26s}" + "".join(f"{column:>12s}" for column in columns))


def _line(label: str, values: list[float], mark: bool = True) -> None:
    least = min(values)
    print(f"{label:26s}" + "".join(f"{v:11.4f}" + ("*" if mark and v == least else " ") for v in values))


def _fit_table(kind: str, arcs: dict[str, np.ndarray]) -> list[dict[str, Any]]:
    title = f"RMS on the {SLICES} slices themselves, lights on {kind}, relative to a_max"
    _heading(title, list(MODELS))
    rows, display = [], {}
    for name, images in arcs.items():
        slices = linearise(images, SLICES).map.slices
        errors = {model: make(slices).rms(slices) for model, make in MODELS.items()}
        _line(f"{name} ({len(images)})", list(errors.values()), mark=False)
        display[name] = [error / float(slices.max()) for error in errors.values()]
        rows.append({"table": "fit", "lights": kind, "stack": name, **errors, "slices": 0.0})
    _heading(f"the same relative to the largest value, the display range (the paper: {PAPER})", list(MODELS))
    for name, values in display.items():
        _line(name, values, mark=False)
    return rows


def held_out(images: np.ndarray) -> dict[str, float]:
    """RMS, relative to a_max, of photographs predicted from the others: all but the darkest and the brightest."""
    squares: dict[str, list[float]] = {name: [] for name in (*MODELS, "slices")}
    averages = averages_of(images)
    for k in range(1, len(images) - 1):
        rest = linearise(np.delete(images, k, axis=0), SLICES)
        truth, x = images[k] / np.float32(rest.a_max), averages[k] / rest.a_max
        for name, make in MODELS.items():
            squares[name].append(float(np.square(make(rest.map.slices).evaluate(x) - truth).mean(dtype=float)))
        squares["slices"].append(float(np.square(at_level(rest.map, x) - truth).mean(dtype=float)))
    return {name: float(np.sqrt(np.mean(values))) for name, values in squares.items()}


def _held_out_table(kind: str, arcs: dict[str, np.ndarray]) -> list[dict[str, Any]]:
    _heading(f"RMS at photographs left out, lights on {kind}, relative to a_max; * least", [*MODELS, "slices"])
    rows = []
    for name, images in arcs.items():
        errors = held_out(images)
        _line(f"{name} ({len(images)})", list(errors.values()))
        rows.append({"table": "held out", "lights": kind, "stack": name, **errors})
    medians = {model: float(np.median([row[model] for row in rows])) for model in (*MODELS, "slices")}
    _line("median", list(medians.values()))
    print(f"{'numbers per texel':26s}" + "".join(f"{n:11d} " for n in (*NUMBERS.values(), SLICES - 1)))
    for rival in ("power law", "free k"):
        wins = sum(row["2 curves"] < row[rival] for row in rows)
        ratio = float(np.median([row["2 curves"] / row[rival] for row in rows]))
        print(f"2 curves against {rival}, as many numbers: better on {wins} of {len(rows)}, median ratio {ratio:.2f}")
    return rows


# --- storage --------------------------------------------------------------------------------------------


def _storage_table(slices: np.ndarray) -> None:
    law, basis = fit(slices), fit_basis(slices, 2, nonnegative=True)
    levels = len(slices) - 1
    bounded = law.exponent / (1 + law.exponent)
    # Images to store, and how the values come back from them.
    stored: dict[str, tuple[list[np.ndarray], Callable[[list[np.ndarray]], Callable[[float], np.ndarray]]]] = {
        "slices": (list(slices[1:]), lambda p: lambda x: p[round(x * levels) - 1] if x else np.zeros_like(p[0])),
        "power law: k, K": ([law.k, law.exponent], lambda p: PowerLaw(*p).evaluate),
        "power law: k, K/(1+K)": ([law.k, bounded], lambda p: PowerLaw(p[0], p[1] / (1 - p[1])).evaluate),
        "2 non-negative curves": (
            [basis.coefficients[..., 0], basis.coefficients[..., 1]],
            lambda p: SliceBasis(np.stack(p, -1), basis.curves).evaluate,
        ),
    }
    print("\nstorage, painted wood: bytes per texel while rendering, kB of files, RMS against the slices, in a_max")
    with tempfile.TemporaryDirectory() as folder:
        for name, (parts, model) in stored.items():
            for storage in (Storage.FLOAT32, Storage.HALF, Storage.BYTE):
                size, back = 0, []
                for part in parts:
                    path, scale = Path(folder) / f"image{storage.suffix}", scale_for(part, storage)
                    write_image(path, part * np.float32(scale), storage)
                    back.append(read_image(path) / np.float32(scale))
                    size += path.stat().st_size
                memory = len(parts) * storage.render_bytes(3)
                rms = rms_error(slices, model(back))
                print(f"  {name:24s}{storage:9s}{memory:5d} B{size / 1e3:9.0f} kB   RMS {rms:.6f}")
