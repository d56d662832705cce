"""Wool and cloth rolled up: as geometry, as a compressed BTF, as shading maps (Kautz et al. 2004, figure 4)."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(1, str(Path(__file__).resolve().parents[1]))

import numpy as np
from commands import save
from measured_materials.addon.gantry import techniques
from measured_materials.addon.rendering.contact_sheet import Cell, write_sheet
from PIL import Image
from support.btf.figure_4 import photographed, rolled_geometry

NAMES = ("wool", "cloth")
SHOWN = {
    "BTF, PCA": "BTF, 16 components",
    "map of one arc": "Shading map",
    "map over azimuth": "Map over azimuth",
}
_PHOTOGRAPH, _SAMPLES, _ROLL, _ROLL_SAMPLES = 64, 16, 192, 64


def make(out: Path, folder: Path) -> None:
    """fig4.jpg, and how far each picture is off beneath it; of what `./run bench fig4 --out FOLDER` photographed, if
    that is the folder."""
    cells = [cell for name in NAMES for cell in row_of_cells(name, folder)]
    write_sheet(folder / "fig4.png", cells, 1 + len(SHOWN))
    save(Image.open(folder / "fig4.png"), out / "fig4.jpg", width=640)


def row_of_cells(name: str, folder: Path) -> list[Cell]:
    """The roll of one swatch, in each way."""
    truth = rolled_geometry(name, _ROLL, _ROLL_SAMPLES)
    bright = 0.7 / float(np.percentile(truth, 99))
    cells = [Cell(truth * bright, f"{name.capitalize()}, geometry", "")]
    for rival in photographed(name, _PHOTOGRAPH, _SAMPLES, folder):
        if rival.name not in SHOWN:
            continue
        picture = rival.rolled(_ROLL)
        error = techniques.errors(picture, truth)["rms"]
        print(f"  {name}, {rival.name}: {error:.0%} RMS", flush=True)
        below = f"of {rival.photographs} photographs, {rival.bytes / 1000:.0f} KB; {error:.0%} off"
        cells.append(Cell(picture * bright, SHOWN[rival.name], below))
    return cells
