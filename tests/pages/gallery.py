"""The gallery: every command of gallery.md baked and rendered, on one sheet."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from commands import baked, commands_of, run, save
from measured_materials.addon.rendering.contact_sheet import Cell, write_sheet
from PIL import Image
from swatch import photographed

_SIZE, _SAMPLES = 300, 96


def make(out: Path, folder: Path) -> None:
    """Bake, render, and lay out four in a row."""
    cells = []
    for command in commands_of("gallery.md"):
        picture = rendered(baked(command, folder), _SIZE)
        cells.append(Cell(np.asarray(picture), _name(command)))
    cells.append(Cell(np.asarray(rendered(photographed("denim", folder), _SIZE)), "Denim"))
    write_sheet(folder / "gallery.png", cells, 4)
    save(Image.open(folder / "gallery.png"), out / "gallery.jpg")


def rendered(bundle: Path, size: int) -> Image.Image:
    """A bundle in the studio, as `render` shows it."""
    file = bundle.with_suffix(".png")
    run(["render", str(bundle), "--resolution", str(size), "--samples", str(_SAMPLES)], file)
    return Image.open(file).convert("RGB")


def _name(command: list[str]) -> str:
    """What it is called on the page, in the comment behind the command."""
    return " ".join(command[command.index("#") + 1 :]) if "#" in command else command[-1]
