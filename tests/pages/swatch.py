"""Denim of the virtual gantry: the ten photographs, the report's plot, the material."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from commands import run, save
from measured_materials.addon.gantry.photograph_arc import photograph_arc
from measured_materials.addon.gantry.swatches import SWATCHES
from measured_materials.addon.rendering.contact_sheet import Cell, write_sheet
from measured_materials.bake.images.image_io import read_image
from PIL import Image

ELEVATIONS = (5.0, 14.0, 23.0, 33.0, 42.0, 51.0, 60.0, 70.0, 79.0, 88.0)
_SWATCHES = {"denim": "jeans"}
_PHOTOGRAPH, _SAMPLES = 192, 32


def make(out: Path, folder: Path) -> None:
    """The three pictures of the tutorial on photographs."""
    bundle = photographed("denim", folder, plot=folder / "plot.png")
    frames = sorted((folder / "denim").glob("*.exr"))
    # One exposure for all, as the camera's was locked.
    pixels = [read_image(frame)[..., :3] for frame in frames]
    bright = 0.8 / max(float(np.percentile(p, 99)) for p in pixels)
    cells = [Cell(p * np.float32(bright), f"Lamp at {e:g}°") for p, e in zip(pixels, ELEVATIONS)]
    write_sheet(folder / "sheet.png", cells, 5)
    save(Image.open(folder / "sheet.png"), out / "swatch_photographs.jpg")
    # Of the report's three plots the first; the others are of the stored map.
    plot = Image.open(folder / "plot.png")
    save(plot.crop((0, round(0.055 * plot.height), round(0.362 * plot.width), plot.height)), out / "swatch_plot.jpg")
    file = folder / "denim.png"
    run(["render", str(bundle), "--resolution", "440", "--samples", "96", "--repeat", "3"], file)
    save(Image.open(file), out / "swatch.jpg")


def photographed(name: str, folder: Path, plot: Path | None = None) -> Path:
    """The bundle of a swatch that is photographed on an arc."""
    bundle = folder / f"{name}.mmat"
    if bundle.exists() and not plot:
        return bundle
    photograph_arc(
        SWATCHES[_SWATCHES[name]](0), folder / name, elevations=ELEVATIONS, size=_PHOTOGRAPH, samples=_SAMPLES
    )
    drawn = ["--plot", str(plot)] if plot else []
    run(["bake", "photographs", str(folder / name), "--align", "off", "--albedo", "0.3", *drawn], bundle)
    return bundle
