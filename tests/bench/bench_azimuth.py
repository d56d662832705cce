"""Maps over azimuth on real stacks, lights left out by azimuth, beside PTM, hemispherical harmonics and RBF.

Every third light by azimuth is left out; of the rendered plates the stacks have lights of their own to be held against.
Each model of a texel is linear in the photographs, and predicts those left out from the direction of their light
alone. The map is looked up at the level of its own level curve, as under an f_r that fits the photographs perfectly.
"""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from bench_compression import PLATES
from csv_rows import write_rows
from materials import SHARED
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.images.image_io import load_openimageio
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.photographs.stack import PhotoStack, StackSettings, read_stack
from measured_materials.bake.shading_maps.azimuth.azimuth_basis import AzimuthBasis
from measured_materials.bake.shading_maps.azimuth.level_curve import LevelCurve
from measured_materials.bake.shading_maps.bake import ArcSettings, bake_stack
from measured_materials.bake.shading_maps.record import ShadingMapRecord
from record import put
from rich.console import Console
from rich.table import Table

Array = np.ndarray
_PHOTOGRAPHS = ("canvas", "painted_wood", "gold_icon")
# Half floats of a channel, and the channels of a texel.
_HALF, _CHANNELS = 2, 3
# Components of RBF; with its envelope a map of two curves less takes no more bytes.
_COMPONENTS = 16
_CURVES = _COMPONENTS - 2
_WIDTHS = (0.08, 0.1, 0.125, 0.16, 0.2, 0.25, 0.3, 0.4, 0.5)


@dataclass(frozen=True, eq=False)
class Split:
    """A stack in two: photographs to fit, (n, H, W, 3), and to hold against, with the directions of their lights."""

    name: str
    fitted: PhotoStack
    held_out: PhotoStack


def run(out: Path, quick: bool) -> int | None:
    """Tables and azimuth.csv; one line where the photographs are not at hand."""
    if not (SHARED / "data" / "stacks").is_dir() or load_openimageio() is None:
        print("SKIPPED azimuth: it needs the photographs beside the repository, and OpenImageIO")
        return 1
    plates = [f"rendered_plate/{plate}" for plate in PLATES]
    names = ("canvas", plates[1]) if quick else (*_PHOTOGRAPHS, *plates)
    rows = []
    for name in names:
        rows += compare(read(name))
    _print(rows)
    write_rows(out / "azimuth.csv", rows)
    return None


# --- stacks ---------------------------------------------------------------------------------------------


def read(name: str) -> Split:
    """A stack of the shared data, in two."""
    folder = SHARED / "data" / "stacks" / name
    if not name.startswith("rendered_plate"):
        stack = read_stack(folder, StackSettings(align="off").all_around())
        assert stack.directions is not None
        order = np.argsort(np.arctan2(stack.directions[:, 1], stack.directions[:, 0]), kind="stable")
        left = np.sort(order[2::3])
        return Split(name, _part(stack, np.setdiff1d(order, left)), _part(stack, left))
    parts = []
    for part in ("Dome", "Test"):
        settings = StackSettings(lights=folder / part / "dirs.lp", align="off").all_around()
        parts.append(read_stack(sorted((folder / part).glob("image*.jpg")), settings))
    return Split(name, *parts)


def _part(stack: PhotoStack, chosen: Array) -> PhotoStack:
    assert stack.directions is not None
    names = tuple(stack.names[k] for k in chosen)
    return PhotoStack(stack.images[chosen], names, stack.directions[chosen], stack.calibrated, ())


# --- models ---------------------------------------------------------------------------------------------


def polynomial(directions: Array) -> Array:
    """The six terms of a polynomial texture map (Malzbender et al. 2001), (n, 6)."""
    x, y, _ = directions.T
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], -1)


def harmonics(directions: Array, order: int = 4) -> Array:
    """Hemispherical harmonics (Gautron et al. 2004), (n, order^2): shifted associated Legendre functions."""
    from scipy.special import lpmv

    theta = np.arccos(np.clip(directions[:, 2], -1, 1))
    phi = np.arctan2(directions[:, 1], directions[:, 0])
    terms = []
    for degree in range(order):
        for m in range(-degree, degree + 1):
            k = abs(m)
            norm = (2 * degree + 1) * math.factorial(degree - k) / (2 * math.pi * math.factorial(degree + k))
            value = math.sqrt(norm) * lpmv(k, degree, 2 * np.cos(theta) - 1)
            turn = np.ones_like(phi) if m == 0 else math.sqrt(2) * (np.cos(k * phi) if m > 0 else np.sin(k * phi))
            terms.append(value * turn)
    return np.stack(terms, -1)


def of_basis(basis: Callable[[Array], Array], fitted: Array, wanted: Array) -> Array:
    """Weights (m, n) of photographs by least squares on the terms of a basis."""
    return basis(wanted) @ np.linalg.pinv(basis(fitted))


def of_gaussians(fitted: Array, wanted: Array, width: float) -> Array:
    """Weights (m, n) of photographs by normalised Gaussians of the distance between directions."""
    squared = np.square(wanted[:, None] - fitted[None]).sum(-1)
    weights = np.exp(-(squared - squared.min(1, keepdims=True)) / width**2)
    return weights / weights.sum(1, keepdims=True)


def best_width(split: Split) -> float:
    """The width of Gaussians that predicts each of the photographs best from the others."""
    assert split.fitted.directions is not None
    directions = split.fitted.directions
    flat = split.fitted.images.reshape(len(directions), -1)[:, ::7]
    products = flat @ flat.T
    errors = []
    for width in _WIDTHS:
        total = 0.0
        for k in range(len(directions)):
            rest = np.delete(np.arange(len(directions)), k)
            signed = np.zeros(len(directions))
            signed[rest] = of_gaussians(directions[rest], directions[k : k + 1], width)[0]
            signed[k] = -1
            total += float(signed @ products @ signed)
        errors.append(total)
    return _WIDTHS[int(np.argmin(errors))]


def reduced(images: Array, rank: int) -> Array:
    """Photographs by the principal components of texels' channels, which take `rank` numbers of each."""
    flat = images.reshape(len(images), -1)
    products = (flat @ flat.T).astype(np.float64)
    vectors = np.linalg.eigh(products)[1][:, ::-1][:, :rank]
    return ((vectors @ vectors.T).astype(np.float32) @ flat).reshape(images.shape)


# --- compare --------------------------------------------------------------------------------------------


def compare(split: Split) -> list[dict[str, Any]]:
    """RMS of every model in parts of that of the photographs left out."""
    fitted, wanted = split.fitted.directions, split.held_out.directions
    assert fitted is not None and wanted is not None
    rows: list[dict[str, Any]] = []

    def add(model: str, pictures: Array, numbers: int) -> None:
        truth = split.held_out.images
        off = np.sqrt(np.square(pictures - truth).mean((1, 2, 3), dtype=np.float64))
        own = np.sqrt(np.square(truth).mean((1, 2, 3), dtype=np.float64))
        rows.append(
            {
                "stack": split.name,
                "photographs": len(split.fitted.images),
                "left out": len(truth),
                "model": model,
                "bytes per texel": numbers * _HALF,
                "rms": float(np.sqrt(np.square(off).sum() / np.square(own).sum())),
                "median": float(np.median(off / own)),
                "seconds": 0.0,
            }
        )

    def mixed(weights: Array, images: Array) -> Array:
        found = np.tensordot(weights.astype(np.float32), images, 1)
        return np.maximum(found, 0)

    images = split.fitted.images
    add("PTM, 6 terms", mixed(of_basis(polynomial, fitted, wanted), images), 6 * _CHANNELS)
    add("HSH, 16 terms", mixed(of_basis(harmonics, fitted, wanted), images), 16 * _CHANNELS)
    rank = min(_COMPONENTS, len(images))
    width = best_width(split)
    add("RBF, 16 components", mixed(of_gaussians(fitted, wanted, width), reduced(images, rank)), rank * _CHANNELS)
    started = time.process_time()
    basis, curve = baked(split)
    seconds = time.process_time() - started
    numbers = basis.rank * _CHANNELS
    levels, azimuths = curve.level(wanted[:, 2]), np.arctan2(wanted[:, 1], wanted[:, 0])
    shown = [basis.evaluate(x, phi) for x, phi in zip(levels.tolist(), azimuths.tolist(), strict=True)]
    add("map over azimuth", np.stack(shown) * np.float32(curve.a_max), numbers + _CHANNELS + 1)
    rows[-1]["seconds"] = seconds
    return rows


def baked(split: Split) -> tuple[AzimuthBasis, LevelCurve]:
    """The map as a bundle holds it, of `_CURVES` curves at most, and the levels of lights by their angle to the normal
    that it was made by."""
    with tempfile.TemporaryDirectory() as folder:
        for rank in (None, _CURVES):
            settings = ArcSettings(azimuths="all", azimuth_rank=rank, storage=Storage.HALF)
            result = bake_stack(split.fitted, Path(folder) / f"swatch_{rank}", settings)
            basis = ShadingMapRecord.read(read_bundle(result.path)).load_azimuth()
            if basis.rank <= _CURVES:
                break
    curve = result.facts["map"]["level_curve"]
    return basis, LevelCurve(np.array(curve["cosines"]), np.array(curve["levels"]), curve["a_max"])


def _print(rows: list[dict[str, Any]]) -> None:
    stacks = list(dict.fromkeys(row["stack"] for row in rows))
    models = list(dict.fromkeys(row["model"] for row in rows))
    table = Table("stack", *map(str, models), "rank", "s", title="RMS of photographs left out, % of their own (median)")
    kinds: dict[str, list[bool]] = {}
    for stack in stacks:
        own = {row["model"]: row for row in rows if row["stack"] == stack}
        ours = own["map over azimuth"]
        best = min((row for row in own.values() if row is not ours), key=lambda row: row["rms"])
        kinds.setdefault(str(stack).split("/")[0], []).append(ours["rms"] < best["rms"])
        rank = (ours["bytes per texel"] // _HALF - _CHANNELS - 1) // _CHANNELS
        cells = [f"{row['rms']:.1%} ({row['median']:.1%}), {row['bytes per texel']} B" for row in own.values()]
        table.add_row(str(stack), *cells, str(rank), f"{ours['seconds']:.1f}")
        for model, row in own.items():
            put(f"RMS, {stack}, {model}", row["rms"])
            put(f"median, {stack}, {model}", row["median"])
        put(f"bytes, {stack}", ours["bytes per texel"])
        put(f"over the best, {stack}", ours["rms"] / best["rms"])
    ahead = sum(all(found) for found in kinds.values())
    put("stacks", len(kinds))
    put("stacks ahead of the best", ahead)
    Console(width=150).print(table)
    print(f"ahead of the best of the others on {ahead} of {len(kinds)} stacks; Gaussians' width by leaving one out")
