"""Picture sheets after Mallett & Yuksel 2016: figure 4 (parameterisations) and figure 7 (filters)."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from materials import merl_file, require_shared
from measured_materials.addon.picture_sheet import Cell, write_sheet
from measured_materials.bake.bake_brdf import BakeSettings
from measured_materials.bake.source import Array
from measured_materials.bake.sources import read_source
from measured_materials.bake.storage import Storage
from pictures import picture

_GAIN = 4.0


def run(out: Path, quick: bool) -> None:
    """Both sheets; --quick renders small and with one material."""
    with tempfile.TemporaryDirectory() as folder:
        _figure_4(out, Path(folder), quick)
        _figure_7(out, Path(folder), quick)


def _figure_4(out: Path, folder: Path, quick: bool) -> None:
    """Uniform and Bezier at 64 x 64 x 128 beside a 256 x 256 x 512 reference under an environment."""
    environment = require_shared() / "data" / "envmaps" / "interior.exr"
    size, samples = (160, 64) if quick else (320, 256)
    cells = []
    for name in ("alum-bronze",) if quick else ("alum-bronze", "blue-metallic-paint", "specular-orange-phenolic"):
        source = read_source(merl_file(name, folder))
        arguments = {"size": size, "samples": samples, "environment": environment}
        reference, _ = picture(source, BakeSettings(resolution=256, storage=Storage.HALF), **arguments)
        for kind in ("uniform", "bezier"):
            pixels, result = picture(source, BakeSettings(parameterization=kind), **arguments)
            rms = float(np.sqrt(((pixels - reference) ** 2).mean()))
            cells.append(
                Cell(pixels, f"{name}, {kind} 64 x 64 x 128", f"table RMS {result.facts['errors']['rms']:.3g}")
            )
            cells.append(Cell(_GAIN * np.abs(pixels - reference), f"difference x {_GAIN:g}", f"picture RMS {rms:.4f}"))
        cells.append(Cell(reference, f"{name}, Bezier 256 x 256 x 512", "reference"))
    _save(out / "figure-4.png", cells, 5, "After MY16 figure 4: tables of equal size under an environment")


def _figure_7(out: Path, folder: Path, quick: bool) -> None:
    """Where linear interpolation shows its contours: a coarse table, seen close, against the cubic B-spline."""
    size, samples = (200, 128) if quick else (480, 1024)
    source = read_source(merl_file("alum-bronze", folder))
    arguments = {"size": size, "samples": samples, "shape": "sphere"}
    cells = []
    coarse = {"resolution": 20, "alpha": (0.5, 0.25)}
    variants = [
        ("trilinear", BakeSettings(**coarse)),
        ("B-spline, plain (as in the paper)", BakeSettings(**coarse, filter="bspline", spline="plain")),
        ("B-spline, fitted >= 0", BakeSettings(**coarse, filter="bspline", spline="fitted")),
        ("128 x 128 x 256, trilinear", BakeSettings(resolution=128, alpha=(0.5, 0.25))),
    ]
    for label, settings in variants:
        pixels, result = picture(source, settings, **arguments)
        cells.append(Cell(_detail(pixels), label, f"table RMS {result.facts['errors']['rms']:.3g}"))
        cells.append(Cell(_contours(_detail(pixels)), "second derivative of the brightness", "bands show as lines"))
    _save(out / "figure-7.png", cells, 2, "After MY16 figure 7: filters on a 20 x 20 x 40 table")


def _detail(pixels: Array) -> Array:
    size = len(pixels)
    part = pixels[int(0.15 * size) : int(0.65 * size), int(0.2 * size) : int(0.7 * size)]
    return np.repeat(np.repeat(part, 2, 0), 2, 1)


def _contours(pixels: Array) -> Array:
    """Magnitude of the Laplacian of log brightness, smoothed against noise; kinks of the interpolation light up."""
    log = np.log(np.maximum(pixels[::2, ::2].mean(-1), 1e-4))
    kernel = np.ones(5) / 5
    for axis in (0, 1):
        log = np.apply_along_axis(lambda line: np.convolve(line, kernel, "same"), axis, log)
    laplacian = np.zeros_like(log)
    laplacian[4:-4, 4:-4] = log[8:, 4:-4] + log[:-8, 4:-4] + log[4:-4, 8:] + log[4:-4, :-8] - 4 * log[4:-4, 4:-4]
    grey = np.clip(np.abs(laplacian) * 4, 0, 1)
    return np.repeat(np.repeat(np.repeat(grey[..., None], 3, -1), 2, 0), 2, 1)


def _save(path: Path, cells: list[Cell], columns: int, title: str) -> None:
    write_sheet(path, cells, columns, title)
    print(f"  {path}")
